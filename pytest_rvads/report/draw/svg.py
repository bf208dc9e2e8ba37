"""Makes elements of SVG: documents, lines, text, traffic signs, and the arrows and marks on lanes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from math import cos, pi, sin

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
