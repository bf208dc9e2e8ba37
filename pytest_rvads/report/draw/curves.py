"""Draws curves as SVG: the braking envelope v(d)max as in the paper, the dynamics and the pedals of a driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, isfinite, log10

from pytest_rvads.report.draw.svg import document, polyline, text

Curves = Mapping[int, Sequence[tuple[float, float | None]]]
"""By aggression (1 to 3), points (distance [m], speed [m/s]) in the order of distance; the speed is None if no speed is safe."""

_STYLES = {1: ("#0072b2", "none", "●"), 2: ("#d55e00", "9 3", "▲"), 3: ("#009e73", "3 3", "■")}
"""Colour, dashes and mark by aggression, so that the curves differ even without colours."""
_LEFT, _TOP, _WIDE, _HIGH = 60.0, 44.0, 560.0, 340.0
"""Place and size of the diagram [px]."""
_REACH, _FAST, _TICK = 20.0, 12.0, 2.0
"""Ends of the axes [m], [m/s], and the distance of their ticks."""
_ENDS = (1.0, 1.2, 1.6, 2.0, 2.4, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Ends of the axes of a diagram in units of a power of ten; a quarter of each has at most three digits."""
_LETTER = 12.0
"""Height of a line of labels at the ends of lines [px]."""


def draw_braking(curves: Curves, title: str, beneath: Curves | None = None) -> str:
    """Return an SVG diagram of the braking envelope v(d)max for distances up to 20 m."""
    body = [text(_LEFT, 24, title, font_weight="bold")]
    for k in range(round(_REACH / _TICK) + 1):
        x, y = _pixel(k * _TICK, 0.0)
        body += [polyline([(x, y), (x, _TOP)], stroke="#eee"), text(x, y + 18, f"{k * _TICK:g}", text_anchor="middle")]
    for k in range(round(_FAST / _TICK) + 1):
        x, y = _pixel(0.0, k * _TICK)
        body += [polyline([(x, y), (x + _WIDE, y)], stroke="#eee"), text(x - 8, y + 4, f"{k * _TICK:g}", text_anchor="end")]
    body.append(polyline([(_LEFT, _TOP), _pixel(0.0, 0.0), _pixel(_REACH, 0.0)], stroke="#222"))
    middle = _TOP + _HIGH / 2
    body.append(text(_LEFT + _WIDE / 2, _TOP + _HIGH + 38, "distance to the stopping line [m]", text_anchor="middle"))
    body.append(text(18, middle, "greatest safe speed [m/s]", text_anchor="middle", transform=f"rotate(-90 18 {middle:g})"))
    lines = [[_pixel(d, v) for d, v in line if v is not None] for line in (beneath or {}).values()]
    body += [polyline(line, stroke="#aaa", stroke_width=1) for line in lines]
    for row, (level, line) in enumerate(curves.items()):
        colour, dashes, mark = _STYLES[level]
        y = _TOP + _HIGH - 20.0 * (len(curves) - row)
        body.append(text(_LEFT + _WIDE - 88, y + 4, f"aggression {level}"))
        if beneath:
            points = [(*_pixel(d, v or 0.0), "×" if v is None else mark) for d, v in line]
            points.append((_LEFT + _WIDE - 100, y, mark))
            body += [text(x, y + 3, glyph, fill=colour, text_anchor="middle", font_size=10) for x, y, glyph in points]
        else:
            key = [(_LEFT + _WIDE - 140, y), (_LEFT + _WIDE - 95, y)]
            for course in ([_pixel(d, v) for d, v in line if v is not None], key):
                body.append(polyline(course, stroke=colour, stroke_width=2, stroke_dasharray=dashes))
    if beneath:
        note = "thin: the plant under full service brake; ×: not even a standing vehicle is safe"
        body.append(text(_LEFT + _WIDE - 10, _TOP + _HIGH - 80, note, fill="#666", text_anchor="end"))
    return document(_LEFT + _WIDE + 30, _TOP + _HIGH + 50, body)


def _pixel(distance: float, speed: float) -> tuple[float, float]:
    return _LEFT + _WIDE * distance / _REACH, _TOP + _HIGH * (1.0 - speed / _FAST)


def draw_dynamics(
    braking: Sequence[tuple[float, float]], times: Mapping[float, Sequence[tuple[float, float]]], title: str
) -> str:
    """Return an SVG document of a driver's dynamics: left the braking distance B(v), right the times AT(v, x), a curve per v.

    `braking` are pairs of a speed [m/s] and a distance to stop [m]. `times` are, by initial speed [m/s], pairs of a distance [m]
    and the time to drive it [s]. Infinite values are left out.
    """
    stops = [(v, d) for v, d in braking if isfinite(d)]
    curves = {v: [(0.0, 0.0), *((x, t) for x, t in line if isfinite(t))] for v, line in times.items()}
    body = [text(_LEFT, 24, title, font_weight="bold")]
    body += _panel(_LEFT, {"": stops}, "speed v [m/s]", "B(v): distance to stop [m]")
    labelled = {f"from {v:g} m/s": line for v, line in curves.items()}
    body += _panel(2 * _LEFT + _HIGH, labelled, "distance x [m]", "AT(v, x): time [s]")
    return document(2 * _LEFT + 2 * _HIGH + 110, _TOP + _HIGH + 50, body)


def draw_pedals(points: Mapping[str, Sequence[tuple[float, float]]], title: str) -> str:
    """Return an SVG document of what pedals do: by pedal, some positions, 0..1, and the sizes of their accelerations [m/s^2]."""
    body = [text(_LEFT, 24, title, font_weight="bold")]
    for number, (name, line) in enumerate(points.items()):
        left = _LEFT + number * (_LEFT + _HIGH)
        up = "deceleration [m/s²]" if name == "brake" else "acceleration [m/s²]"
        body += _panel(left, {"": [(0.0, 0.0), *line]}, f"position of the {name}, 1 = full", up)
    return document(len(points) * (_LEFT + _HIGH) + 110, _TOP + _HIGH + 50, body)


def _panel(left: float, lines: Mapping[str, Sequence[tuple[float, float]]], along: str, up: str) -> list[str]:
    """Return a square diagram of lines, each with a label at its end; labels of ends that are close stand below each other."""
    points = [point for line in lines.values() for point in line]
    ends_of_axes = [1.0, 1.0]
    for axis in (0, 1):
        greatest = max((point[axis] for point in points), default=0.0)
        if greatest > 0.0:
            unit = 10.0 ** floor(log10(greatest))
            round_numbers = (part * unit for part in _ENDS)
            ends_of_axes[axis] = next(float(f"{end:.6g}") for end in round_numbers if end >= greatest * (1.0 - 1e-9))
    wide, high = ends_of_axes

    def place(point: tuple[float, float]) -> tuple[float, float]:
        return left + _HIGH * point[0] / wide, _TOP + _HIGH * (1.0 - point[1] / high)

    bottom = _TOP + _HIGH
    body = [polyline([(left, _TOP), (left, bottom), (left + _HIGH, bottom)], stroke="#222")]
    for part in (0.0, 0.25, 0.5, 0.75, 1.0):
        x, y = place((part * wide, part * high))
        body += [polyline([(x, _TOP), (x, bottom)], stroke="#eee"), polyline([(left, y), (left + _HIGH, y)], stroke="#eee")]
        body.append(text(x, bottom + 18, f"{part * wide:g}", text_anchor="middle"))
        body.append(text(left - 8, y + 4, f"{part * high:g}", text_anchor="end"))
    body += [polyline(map(place, line), stroke="#0072b2", stroke_width=2) for line in lines.values() if line]
    ends = sorted((*place(line[-1])[::-1], label) for label, line in lines.items() if line and label)
    below = -_LETTER
    for y, x, label in ends:
        below = max(y, below + _LETTER)
        body.append(text(x + 6, below + 4, label, font_size=11))
    body.append(text(left + _HIGH / 2, bottom + 38, along, text_anchor="middle"))
    body.append(text(left, _TOP - 6, up))
    return body
