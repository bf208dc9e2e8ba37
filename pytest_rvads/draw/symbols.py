"""What stands beside a road and is painted on it, as pieces of SVG: signs, arrows of lanes, marks between lanes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.control import Sign
from pytest_rvads.maps.segment import Turn

__all__ = ["arrow", "beside", "marks", "sign"]

Points = NDArray[np.float64]

_ARROWS = {
    Turn.STRAIGHT: "M0 0H3.2M2.4-.6L3.2 0L2.4.6",
    Turn.LEFT: "M0 0H1Q1.9 0 1.9-.9V-1.5M1.3-.9L1.9-1.6L2.5-.9",
    Turn.RIGHT: "M0 0H1Q1.9 0 1.9.9V1.5M1.3.9L1.9 1.6L2.5.9",
}
"""In metres, seen in the direction of travel, x ahead and y to the right."""


def sign(kind: Sign, x: float, y: float, radius: float) -> str:
    """Return a stop sign (octagon), a yield sign (triangle) or a priority sign (diamond) at a point; nothing for others."""
    border = f'stroke-width="{radius / 5:.2f}"'
    match kind:
        case Sign.STOP:
            corners = [(cos(pi / 8 + k * pi / 4), sin(pi / 8 + k * pi / 4)) for k in range(8)]
            look = f'fill="#c1272d" stroke="#fff" {border}'
        case Sign.YIELD:
            corners = [(-1.0, -0.8), (1.0, -0.8), (0.0, 0.9)]
            look = f'fill="#fff" stroke="#c1272d" stroke-width="{radius / 2.5:.2f}"'
        case Sign.PRIORITY:
            corners = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
            look = f'fill="#f2b705" stroke="#fff" {border}'
        case _:
            return ""
    path = "L".join(f"{x + radius * u:.2f} {y + radius * v:.2f}" for u, v in corners)
    return f'<path class="sign {kind}" d="M{path}z" {look}/>'


def arrow(turns: Collection[Turn]) -> str:
    """Return the path of the arrow on a lane that allows these turns; in metres, x in the direction of travel, y to its right."""
    return "".join(_ARROWS[turn] for turn in Turn if turn in turns)


def beside(points: Points, left: float) -> Points:
    """Return a line beside another one.

    Args:
        points: shape ``(k, 2)`` [m].
        left: how far to the left of it [m].
    """
    ahead = np.gradient(points, axis=0)
    ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
    return points + left * np.column_stack((-ahead[:, 1], ahead[:, 0]))


def marks(lanes: Sequence[Points], width: float, *, left_hand: bool, centre: bool) -> Iterator[tuple[Points, bool]]:
    """Yield the marks along lanes of one direction, and whether each is broken: only between two of them.

    Args:
        lanes: centre lines, from the kerb.
        width: of a lane [m].
        left_hand: whether traffic keeps left.
        centre: whether there is a mark beyond the last lane too.
    """
    inward = -width / 2 if left_hand else width / 2
    for number, lane in enumerate(lanes):
        if number == 0:
            yield beside(lane, -inward), False
        if centre or number < len(lanes) - 1:
            yield beside(lane, inward), number < len(lanes) - 1
