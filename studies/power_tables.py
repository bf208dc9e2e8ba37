"""Tables and the plot of what `power` and `killing` measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from pytest_rvads.report.svg import document, polyline, text
from studies.detection import Power, interval
from studies.killing import Killing

_WIDTH, _ROW, _LEFT, _TOP = 640, 18, 170, 30


def table_of_power(measured: Sequence[Power]) -> str:
    """Return a Markdown table: median simulations until detection, 95 % interval, share of seeds that found it."""
    methods = list(dict.fromkeys(p.method for p in measured))
    lines = ["| | " + " | ".join(methods) + " |", "|---" * (len(methods) + 1) + "|"]
    for name in dict.fromkeys(p.deficiency for p in measured):
        cells = [_cell(next(p for p in measured if (p.deficiency, p.method) == (name, method))) for method in methods]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(power: Power) -> str:
    def shown(value: float) -> str:
        return f"> {power.budget}" if value > power.budget else f"{value:g}"

    low, high = interval(power.simulations)
    return f"{shown(median(power.simulations))} ({shown(low)} to {shown(high)}), {power.found:.0%}"


def table_of_mutants(killings: Sequence[Killing]) -> str:
    """Return a Markdown table: what is wrong with a mutant, which rules and relations kill it."""
    lines = ["| mutant | what is wrong | rules | relations |", "|---|---|---|---|"]
    for k in killings:
        rules = ", ".join(k.rules) or "**survives**"
        lines.append(f"| {k.mutant} | {k.fault} | {rules} | {', '.join(k.relations)} |")
    return "\n".join(lines)


def plot(measured: Sequence[Power]) -> str:
    """Return an SVG: per deficiency and method the median with its interval, on a logarithmic axis."""
    budget = max(p.budget for p in measured)
    names = list(dict.fromkeys(p.deficiency for p in measured))
    height = _TOP + len(measured) * _ROW + len(names) * _ROW + 40

    def x(value: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - 40) * math.log(value) / math.log(budget + 1)

    parts = [text(_LEFT, 14, "simulations until detection: median and 95 % interval")]
    for tick in [t for t in (1, 2, 5, 10, 20, 50, 100, 200) if t <= budget] + [budget + 1]:
        parts.append(polyline([(x(tick), _TOP - 8), (x(tick), height - 30)], stroke="#ddd"))
        parts.append(text(x(tick), height - 16, f"> {budget}" if tick > budget else str(tick), text_anchor="middle"))
    y = _TOP
    for name in names:
        y += _ROW
        parts.append(text(8, y, name, font_weight="bold"))
        for power in (p for p in measured if p.deficiency == name):
            low, high = interval(power.simulations)
            parts.append(text(_LEFT - 8, y, power.method, text_anchor="end"))
            parts.append(polyline([(x(low), y - 4), (x(high), y - 4)], stroke="#1f5fa8", stroke_width=3))
            parts.append(f'<circle cx="{x(median(power.simulations)):.1f}" cy="{y - 4}" r="4.5" fill="#1f5fa8"/>')
            y += _ROW
    return document(_WIDTH, height, parts)
