"""One instant of a run as a picture: trails, bodies to scale, lights, what is broken."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pytest_rvads.draw.scene import Scene, body, inks, path, size
from pytest_rvads.errors import RunError
from pytest_rvads.runs.run import Run
from pytest_rvads.wording import markup

__all__ = ["STYLE", "picture"]

STYLE = """
.lane{fill:none;stroke:#d9d9d9}.way{fill:none;stroke:#bdbdbd;stroke-width:.12;stroke-dasharray:.6 .6}
.mark,.arrow{fill:none;stroke:#fff;stroke-width:.16}.mark.broken{stroke-dasharray:3 3}.arrow{stroke-width:.25}
.stop{stroke:#fff;stroke-width:.5}.number{font-size:2.6px;text-anchor:middle;fill:#666}
.letter,.name{text-anchor:middle;fill:#fff;font-weight:bold}.letter{font-size:1.8px}
.trail{fill:none;stroke-width:.35;opacity:.75}.front{fill:none;stroke:#fff;stroke-width:.22}
rect.broken{stroke:#d11f1f;stroke-width:.5;stroke-dasharray:.9 .45}.title{font-size:2.4px;fill:#222}svg{font-family:sans-serif}
"""


def picture(run: Run, tick: int, title: str, broken: Collection[str] = ()) -> str:
    """Return an SVG document of the state at `tick`.

    Args:
        run: a run with positions.
        tick: index of the state.
        title: text above the picture.
        broken: names of the vehicles to point out.

    Raises:
        RunError: the run holds no positions.
        MapError: its junction has no geometry.
    """
    if run.pose is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to draw")
    scene = Scene(run.junction)
    left, top, wide, high = scene.view
    parts = [scene.road(), scene.lights(run.lights[tick])]
    colours = inks(run.agents)
    for column, colour in enumerate(colours):
        driven = run.pose[: tick + 1 : 5, column, :2]
        known = driven[np.isfinite(driven).all(axis=1)]  # who is absent or gone may have no place
        parts.append(f'<polyline class="trail" stroke="{colour}" points="{path(known)}"/>')
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
