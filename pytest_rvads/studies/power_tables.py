"""Tables and the plot of what `power` and `killing` measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from pytest_rvads.studies.killing import Killing
from pytest_rvads.studies.power import Power, interval

__all__ = ["plot", "table_of_mutants", "table_of_power"]

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
    def text(value: float) -> str:
        return f"> {power.budget}" if value > power.budget else f"{value:g}"

    low, high = interval(power.simulations)
    return f"{text(median(power.simulations))} ({text(low)} to {text(high)}), {power.found:.0%}"


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

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="{_WIDTH}" height="{height}" fill="white"/>',
        f'<text x="{_LEFT}" y="14">simulations until detection: median and 95 % interval</text>',
    ]
    for tick in [t for t in (1, 2, 5, 10, 20, 50, 100, 200) if t <= budget] + [budget + 1]:
        label = f"&gt; {budget}" if tick > budget else str(tick)
        parts.append(f'<line x1="{x(tick):.1f}" y1="{_TOP - 8}" x2="{x(tick):.1f}" y2="{height - 30}" stroke="#ddd"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{height - 16}" text-anchor="middle">{label}</text>')
    y = _TOP
    for name in names:
        y += _ROW
        parts.append(f'<text x="8" y="{y}" font-weight="bold">{name}</text>')
        for power in (p for p in measured if p.deficiency == name):
            low, high = interval(power.simulations)
            middle = median(power.simulations)
            parts.append(f'<text x="{_LEFT - 8}" y="{y}" text-anchor="end">{power.method}</text>')
            parts.append(
                f'<line x1="{x(low):.1f}" y1="{y - 4}" x2="{x(high):.1f}" y2="{y - 4}" stroke="#1f5fa8" stroke-width="3"/>'
            )
            parts.append(f'<circle cx="{x(middle):.1f}" cy="{y - 4}" r="4.5" fill="#1f5fa8"/>')
            y += _ROW
    return "\n".join([*parts, "</svg>", ""])
