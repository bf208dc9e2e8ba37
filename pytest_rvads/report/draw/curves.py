"""The figure of the braking envelope v(d)max, as in the paper: a curve of maximal safe speeds per aggression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pytest_rvads.report.draw.svg import document, polyline, text

__all__ = ["Curves", "draw_braking"]

Curves = Mapping[int, Sequence[tuple[float, float | None]]]
"""Per aggression the points (distance [m], speed [m/s]) by distance; the speed is None if no speed is safe."""

_STYLES = {1: ("#0072b2", "none", "●"), 2: ("#d55e00", "9 3", "▲"), 3: ("#009e73", "3 3", "■")}
"""Colour, dashes and mark by aggression, so that the curves differ without colours, too."""
_LEFT, _TOP, _WIDE, _HIGH = 60.0, 44.0, 560.0, 340.0
"""Place and size of the diagram [px]."""
_REACH, _FAST, _TICK = 20.0, 12.0, 2.0
"""Ends of the axes [m], [m/s], and the distance of their ticks."""


def draw_braking(curves: Curves, title: str, beneath: Curves | None = None) -> str:
    """Return an SVG document of the curves, up to 20 m.

    Args:
        curves: the curves, drawn as lines; with `beneath` drawn as points, with a cross if no speed is safe.
        title: text above the diagram.
        beneath: finer curves for comparison, drawn as thin grey lines.
    """
    body = [text(_LEFT, 24, title, font_weight="bold"), *_axes()]
    lines = [[_place(d, v) for d, v in line if v is not None] for line in (beneath or {}).values()]
    body += [polyline(line, stroke="#aaa", stroke_width=1) for line in lines]
    for row, (level, line) in enumerate(curves.items()):
        colour, dashes, mark = _STYLES[level]
        y = _TOP + _HIGH - 20.0 * (len(curves) - row)
        body.append(text(_LEFT + _WIDE - 88, y + 4, f"aggression {level}"))
        if beneath:
            points = [(*_place(d, v or 0.0), "×" if v is None else mark) for d, v in line]
            points.append((_LEFT + _WIDE - 100, y, mark))
            body += [text(x, y + 3, glyph, fill=colour, text_anchor="middle", font_size=10) for x, y, glyph in points]
        else:
            key = [(_LEFT + _WIDE - 140, y), (_LEFT + _WIDE - 95, y)]
            for course in ([_place(d, v) for d, v in line if v is not None], key):
                body.append(polyline(course, stroke=colour, stroke_width=2, stroke_dasharray=dashes))
    if beneath:
        note = "thin: the plant under full service brake; ×: not even a standing vehicle is safe"
        body.append(text(_LEFT + _WIDE - 10, _TOP + _HIGH - 80, note, fill="#666", text_anchor="end"))
    return document(_LEFT + _WIDE + 30, _TOP + _HIGH + 50, body)


def _place(distance: float, speed: float) -> tuple[float, float]:
    return _LEFT + _WIDE * distance / _REACH, _TOP + _HIGH * (1.0 - speed / _FAST)


def _axes() -> list[str]:
    body = []
    for k in range(round(_REACH / _TICK) + 1):
        x, y = _place(k * _TICK, 0.0)
        body += [polyline([(x, y), (x, _TOP)], stroke="#eee"), text(x, y + 18, f"{k * _TICK:g}", text_anchor="middle")]
    for k in range(round(_FAST / _TICK) + 1):
        x, y = _place(0.0, k * _TICK)
        body += [polyline([(x, y), (x + _WIDE, y)], stroke="#eee"), text(x - 8, y + 4, f"{k * _TICK:g}", text_anchor="end")]
    body.append(polyline([(_LEFT, _TOP), _place(0.0, 0.0), _place(_REACH, 0.0)], stroke="#222"))
    middle = _TOP + _HIGH / 2
    body.append(text(_LEFT + _WIDE / 2, _TOP + _HIGH + 38, "distance to the stopping line [m]", text_anchor="middle"))
    body.append(text(18, middle, "greatest safe speed [m/s]", text_anchor="middle", transform=f"rotate(-90 18 {middle:g})"))
    return body
