"""A picture of a junction without a run: the movements in a colour per turn, and the objects and markings of the junction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import atan2, degrees

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.draw.picture import STYLE
from pytest_rvads.draw.scene import PALETTE, Scene, path
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.junctions.turn_words import UTURN, turn_word
from pytest_rvads.wording import markup

__all__ = ["course", "draw_ways", "still"]

_BEYOND = 9.0
"""How far a picture reaches beyond the junction, and beyond where vehicles start [m]."""
_TURNS: dict[str, str] = {"left": PALETTE[1], "straight": PALETTE[0], "right": PALETTE[2], UTURN: PALETTE[3]}
"""The colours that pictures of maps have."""


def draw_ways(junction: Junction) -> str:
    """Return the ways through a junction as an SVG document, in a colour per turn.

    Raises:
        MapError: the junction has no geometry.
    """
    scene = Scene(junction)
    words = {key: turn_word(junction, m) for key, m in junction.movements.items()}
    lines = [course(junction.way_through(*key).points, _TURNS[word]) for key, word in words.items()]
    return still(scene, lines, (), [row for row in _TURNS.items() if row[0] != UTURN or UTURN in words.values()])


def course(points: NDArray[np.float64], ink: str) -> str:
    """Return a line that ends in an arrow."""
    (ax, ay), (bx, by) = points[-2:, :2].tolist()
    turned = f"translate({bx:.2f} {-by:.2f}) rotate({-degrees(atan2(by - ay, bx - ax)):.2f})"
    return (
        f'<polyline class="trail" stroke="{ink}" points="{path(points[:, :2])}"/>'
        f'<path class="trail" stroke="{ink}" transform="{turned}" d="M-1.4 -1L0 0L-1.4 1"/>'
    )


def still(
    scene: Scene, parts: Iterable[str], corners: Sequence[Sequence[float]] = (), legend: Sequence[tuple[str, str]] = ()
) -> str:
    """Return the road and what is on it as an SVG document.

    Args:
        scene: the road.
        parts: what is on it.
        corners: further points that it has to show [m].
        legend: words and their colours.
    """
    through = [scene.junction.way_through(*key).points for key in scene.junction.movements]
    points = np.vstack([*through, *np.reshape(corners, (-1, 2))])
    low, high = points.min(axis=0) - _BEYOND, points.max(axis=0) + _BEYOND
    (left, bottom), (wide, tall) = low, high - low
    top = bottom + tall
    key = "".join(
        f'<text class="title" x="{left + 1:.2f}" y="{-top + 3 + 3 * k:.2f}" style="fill:{ink}">{markup(word)}</text>'
        for k, (word, ink) in enumerate(legend)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide * 10:.0f}" height="{tall * 10:.0f}" '
        f'viewBox="{left:.2f} {-top:.2f} {wide:.2f} {tall:.2f}"><style>{STYLE}</style>'
        f'<rect x="{left:.2f}" y="{-top:.2f}" width="{wide:.2f}" height="{tall:.2f}" fill="#fff"/>'
        f"{scene.road()}{''.join(parts)}{key}</svg>"
    )
