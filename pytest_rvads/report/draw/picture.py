"""Draws still pictures: a state of a run, and the ways through a junction."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from math import atan2, degrees

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import UTURN, turn_word
from pytest_rvads.report.draw.scene import PALETTE, Scene, body, inks, path, size
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import markup

__all__ = ["STYLE", "course", "draw_ways", "picture", "still"]

_BEYOND = 9.0
"""Margin of a picture around the junction and the starts of vehicles [m]."""
_TURNS: dict[str, str] = {"left": PALETTE[1], "straight": PALETTE[0], "right": PALETTE[2], UTURN: PALETTE[3]}
"""Colour per turn, as in pictures of maps."""
STYLE = """
.lane{fill:none;stroke:#d9d9d9}.way{fill:none;stroke:#bdbdbd;stroke-width:.12;stroke-dasharray:.6 .6}
.mark,.arrow{fill:none;stroke:#fff;stroke-width:.16}.mark.broken{stroke-dasharray:3 3}.arrow{stroke-width:.25}
.stop{stroke:#fff;stroke-width:.5}.number{font-size:2.6px;text-anchor:middle;fill:#666}
.letter,.name{text-anchor:middle;fill:#fff;font-weight:bold}.letter{font-size:1.8px}
.trail{fill:none;stroke-width:.35;opacity:.75}.front{fill:none;stroke:#fff;stroke-width:.22}
rect.broken{stroke:#d11f1f;stroke-width:.5;stroke-dasharray:.9 .45}.title{font-size:2.4px;fill:#222}svg{font-family:sans-serif}
"""


def picture(run: Run, tick: int, title: str, broken: Collection[str] = ()) -> str:
    """Return an SVG document of a state of a run.

    Args:
        run: a run with positions.
        tick: index of the state.
        title: text above the picture.
        broken: names of the highlighted vehicles.

    Raises:
        RunError: the run has no positions.
        MapError: the junction of the run has no geometry.
    """
    if run.pose is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to draw")
    scene = Scene(run.junction)
    left, top, wide, high = scene.view
    parts = [scene.road(), scene.lights(run.lights[tick])]
    colours = inks(run.agents)
    for column, colour in enumerate(colours):
        driven = run.pose[: tick + 1 : 5, column, :2]
        recorded = driven[np.isfinite(driven).all(axis=1)]  # the position of an absent vehicle can be NaN
        parts.append(f'<polyline class="trail" stroke="{colour}" points="{path(recorded)}"/>')
    for column, agent in enumerate(run.agents):
        if run.here[tick, column]:
            parts.append(body(run.pose[tick, column], agent, size(run, column), colours[column], agent.name in broken))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide * 10:.0f}" height="{(high + 5) * 10:.0f}" '
        f'viewBox="{left:.2f} {top - 5:.2f} {wide:.2f} {high + 5:.2f}"><style>{STYLE}</style>'
        f'<rect x="{left:.2f}" y="{top - 5:.2f}" width="{wide:.2f}" height="{high + 5:.2f}" fill="#fff"/>'
        f'{"".join(parts)}<rect x="{left:.2f}" y="{top - 5:.2f}" width="{wide:.2f}" height="5" fill="#fff"/>'
        f'<text class="title" x="{left + 1:.2f}" y="{top - 1.5:.2f}">{markup(title)}</text></svg>\n'
    )


def draw_ways(junction: Junction) -> str:
    """Return the ways through a junction as an SVG document, with a colour per turn.

    Raises:
        MapError: the junction has no geometry.
    """
    scene = Scene(junction)
    words = {key: turn_word(junction, m) for key, m in junction.movements.items()}
    lines = [course(junction.way_through(*key).points, _TURNS[word]) for key, word in words.items()]
    return still(scene, lines, (), [row for row in _TURNS.items() if row[0] != UTURN or UTURN in words.values()])


def course(points: NDArray[np.float64], ink: str) -> str:
    """Return an SVG line with an arrow at its end.

    Args:
        points: points of the line, x and y in the first two columns [m].
        ink: colour of the line.
    """
    (ax, ay), (bx, by) = points[-2:, :2].tolist()
    transform = f"translate({bx:.2f} {-by:.2f}) rotate({-degrees(atan2(by - ay, bx - ax)):.2f})"
    return (
        f'<polyline class="trail" stroke="{ink}" points="{path(points[:, :2])}"/>'
        f'<path class="trail" stroke="{ink}" transform="{transform}" d="M-1.4 -1L0 0L-1.4 1"/>'
    )


def still(
    scene: Scene, parts: Iterable[str], corners: Sequence[Sequence[float]] = (), legend: Sequence[tuple[str, str]] = ()
) -> str:
    """Return an SVG document of a road with elements on the road.

    Args:
        scene: the road.
        parts: elements on the road.
        corners: further points that the picture must show [m].
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
