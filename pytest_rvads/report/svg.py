"""Makes elements of SVG: documents, lines, text, traffic signs, the arrows and marks on lanes.

It also draws curves: the braking envelope v(d)max as in the paper, the dynamics and the pedals of a driver.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import cos, floor, isfinite, log10, pi, sin

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.wording import markup

Points = NDArray[np.float64]
_ARROWS = {
    Turn.STRAIGHT: "M0 0H3.2M2.4-.6L3.2 0L2.4.6",
    Turn.LEFT: "M0 0H1Q1.9 0 1.9-.9V-1.5M1.3-.9L1.9-1.6L2.5-.9",
    Turn.RIGHT: "M0 0H1Q1.9 0 1.9.9V1.5M1.3.9L1.9 1.6L2.5.9",
}
"""Path of the arrow per turn, in metres, x in the direction of travel and y to its right."""


def document(width: float, height: float, body: Iterable[str], defs: str = "") -> str:
    """Return an SVG document with a white background."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}" '
        f'font-family="sans-serif" font-size="12"><defs>{defs}</defs>'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(body)}</svg>\n'
    )


def polyline(points: Iterable[Sequence[float]], **style: str | float | None) -> str:
    """Return an SVG line through `points`; underscores in the names of style attributes become hyphens, and None is left out."""
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="M{path}" fill="none"{_attributes(style)}/>'


def text(x: float, y: float, content: str, **style: str | float | None) -> str:
    """Return an SVG text element at a point, with the text escaped."""
    return f'<text x="{x:.1f}" y="{y:.1f}"{_attributes(style)}>{markup(content)}</text>'


def wrap(content: str, width: int) -> list[str]:
    """Return text in lines of at most `width` characters; a word longer than a line is broken."""
    lines = [""]
    for word in content.split():
        for part in (word[i : i + width] for i in range(0, len(word), width)):
            if lines[-1] and len(lines[-1]) + 1 + len(part) > width:
                lines.append(part)
            else:
                lines[-1] = f"{lines[-1]} {part}".strip()
    return lines


def _attributes(style: dict[str, str | float | None]) -> str:
    shown = {name.replace("_", "-"): value for name, value in style.items() if value is not None}
    return "".join(f' {name}="{markup(str(value))}"' for name, value in shown.items())


_SIGNS = {
    Sign.STOP: ([(cos(pi / 8 + k * pi / 4), sin(pi / 8 + k * pi / 4)) for k in range(8)], "#c1272d", "#fff", 5.0),
    Sign.YIELD: ([(-1.0, -0.8), (1.0, -0.8), (0.0, 0.9)], "#fff", "#c1272d", 2.5),
    Sign.PRIORITY: ([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)], "#f2b705", "#fff", 5.0),
}
"""Corners of a sign of radius 1, colours of its face and of its border, and its radius in widths of the border."""


def sign(kind: Sign, x: float, y: float, radius: float) -> str:
    """Return the SVG element of a stop, yield or priority sign at a point; an empty text for other controls."""
    if kind not in _SIGNS:
        return ""
    corners, face, border, widths = _SIGNS[kind]
    path = "L".join(f"{x + radius * u:.2f} {y + radius * v:.2f}" for u, v in corners)
    return f'<path class="sign {kind}" d="M{path}z" fill="{face}" stroke="{border}" stroke-width="{radius / widths:.2f}"/>'


def arrow(turns: Collection[Turn]) -> str:
    """Return the SVG path of the arrow on a lane with these turns [m], x in the direction of travel and y to the right."""
    return "".join(_ARROWS[turn] for turn in Turn if turn in turns)


def beside(points: Points, left: float) -> Points:
    """Return the line at a distance to the left [m] of a line with points of shape ``(k, 2)`` [m]."""
    ahead = np.gradient(points, axis=0)
    ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
    return points + left * np.column_stack((-ahead[:, 1], ahead[:, 0]))


def marks(lanes: Sequence[Points], width: float, *, left_hand: bool, centre: bool) -> Iterator[tuple[Points, bool]]:
    """Yield the marks along the lanes (of this width [m]) of an arm in one direction, each with whether it is broken."""
    inward = -width / 2 if left_hand else width / 2
    for number, lane in enumerate(lanes):
        if number == 0:
            yield beside(lane, -inward), False
        if centre or number < len(lanes) - 1:
            yield beside(lane, inward), number < len(lanes) - 1


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
