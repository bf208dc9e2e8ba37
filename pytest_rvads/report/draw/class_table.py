"""The figure of the equivalence classes of an n-way junction, as in the paper: a row per class, a diagram per member."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, pi, sin

from pytest_rvads.report.draw.svg import document, text

__all__ = ["draw_classes"]

_CELL, _LABEL, _RADIUS, _LANE = 110, 90, 42.0, 5.0
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f00")
"""Okabe and Ito's palette, distinguishable by colour-blind people; a colour per symbolic direction."""


def draw_classes(ways: int, title: str, rows: Iterable[tuple[str, Sequence[tuple[int, ...]]]]) -> str:
    """Return an SVG document with the members of classes.

    Args:
        ways: number of entrances.
        title: the first line.
        rows: per class the label of the class and the direction tuples of its members.
    """
    body = [text(10, 24, title, font_size=15, font_weight="bold")]
    count = 0
    for label, members in rows:
        top = 40 + count * _CELL
        body.append(text(10, top + _CELL / 2 + 4, label))
        for column, member in enumerate(members):
            x, y = _LABEL + (column + 0.5) * _CELL, top + _CELL / 2
            body.append(f'<g transform="translate({x:g} {y:g})">{_diagram(ways, member)}</g>')
        count += 1
    markers = "".join(
        f'<marker id="d{d}" viewBox="0 0 6 6" refX="4" refY="3" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L6 3L0 6z" fill="{_COLOURS[d - 1]}"/></marker>'
        for d in range(1, ways)
    )
    return document(_LABEL + ways * _CELL + 10, 50 + count * _CELL, body, markers)


def _diagram(ways: int, directions: Sequence[int]) -> str:
    parts = []
    for arm in range(ways):
        ux, uy = _outward(arm, ways)
        parts.append(f'<line x2="{_RADIUS * ux:.1f}" y2="{_RADIUS * uy:.1f}" stroke="#ddd" stroke-width="{4 * _LANE:g}"/>')
    for arm, direction in enumerate(directions):
        ux, uy = _outward(arm, ways)
        number = _RADIUS + 8
        parts.append(text(number * ux, number * uy + 3, str(arm), font_size=9, fill="#666", text_anchor="middle"))
        if direction:
            parts.append(_movement(ways, arm, (arm + direction) % ways, direction))
    return "".join(parts)


def _movement(ways: int, entrance: int, leaving: int, direction: int) -> str:
    """Return a curve from the lane that leads in, on the right of its arm, to the lane that leads out."""
    ux, uy = _outward(entrance, ways)
    vx, vy = _outward(leaving, ways)
    # Screen y points down: the lane to the right of a driver heading inwards (-u) lies along (uy, -ux).
    start = (_RADIUS * ux + _LANE * uy, _RADIUS * uy - _LANE * ux)
    end = (_RADIUS * vx - _LANE * vy, _RADIUS * vy + _LANE * vx)
    bend = 2 * _LANE
    controls = (bend * ux + _LANE * uy, bend * uy - _LANE * ux), (bend * vx - _LANE * vy, bend * vy + _LANE * vx)
    path = " ".join(f"{x:.1f} {y:.1f}" for x, y in (*controls, end))
    colour = _COLOURS[direction - 1]
    return (
        f'<path d="M{start[0]:.1f} {start[1]:.1f}C{path}" fill="none" stroke="{colour}" stroke-width="2" '
        f'marker-end="url(#d{direction})"/>'
    )


def _outward(arm: int, ways: int) -> tuple[float, float]:
    """Return the direction of an arm on the screen: arm 0 points down, the other arms follow counter-clockwise."""
    angle = -pi / 2 + 2 * pi * arm / ways
    return cos(angle), -sin(angle)
