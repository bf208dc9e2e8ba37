"""A junction and the vehicles of a run in it, as pieces of SVG in metres."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, degrees, sin

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import Sign
from pytest_rvads.runs.states import Agent, Colour, Kind
from pytest_rvads.wording import markup

__all__ = ["Scene", "body", "ink", "path"]

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f00", "#555555")
"""Okabe and Ito's palette, distinguishable by colour-blind people; one per entrance."""

_LIGHTS = {Colour.GREEN: "#1fa34a", Colour.YELLOW: "#e0a800", Colour.RED: "#d11f1f", Colour.NONE: "#888"}
_CORNERS = {Kind.CAR: 0.4, Kind.TRUCK: 0.0}
"""Radius of the corners of a body [m]; whoever is on two wheels or feet is round at both ends."""
_MARGIN = 28.0
"""How far the picture reaches beyond the junction [m]."""


@dataclass(frozen=True, slots=True)
class Scene:
    """The static part of a picture: where it looks, and the road in it.

    Raises:
        MapError: the junction has no geometry.
    """

    junction: Junction

    def __post_init__(self) -> None:
        if not self.junction.drivable:
            raise MapError(
                f"junction {self.junction.name!r} comes from a recording without positions, so there is nothing to draw"
            )

    @property
    def view(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the picture in SVG coordinates (y down) [m]."""
        points = np.vstack([self.junction.way_through(*key).points for key in self.junction.movements])
        low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
        return float(low[0]), float(-high[1]), float(high[0] - low[0]), float(high[1] - low[1])

    def road(self) -> str:
        """Return lanes, movements, stopping lines, entrance numbers and signs."""
        junction, width = self.junction, self.junction.lane_width
        ways = [junction.way_through(*key) for key in junction.movements]
        lanes = [*map(junction.way_in, range(len(junction.entrances))), *map(junction.way_out, range(len(junction.exits))), *ways]
        parts = [f'<polyline class="lane" stroke-width="{width:g}" points="{path(s.points)}"/>' for s in lanes]
        parts += [f'<polyline class="way" points="{path(s.points)}"/>' for s in ways]
        for entrance, lane in enumerate(junction.entrances):
            x, y, heading = junction.way_in(entrance).pose(junction.approach(entrance))
            ax, ay = -sin(heading) * width / 2, cos(heading) * width / 2
            parts.append(f'<line class="stop" x1="{x - ax:.2f}" y1="{-(y - ay):.2f}" x2="{x + ax:.2f}" y2="{-(y + ay):.2f}"/>')
            side = 1 if self.junction.left_hand else -1
            px, py = x - sin(heading) * width * side, y + cos(heading) * width * side
            parts.append(f'<text class="number" x="{px:.2f}" y="{-py + 0.9:.2f}">{entrance}</text>')
            if lane.sign is Sign.STOP:
                qx, qy = px - 3.2 * cos(heading), py - 3.2 * sin(heading)
                parts.append(f'<path class="sign" transform="translate({qx:.2f} {-qy:.2f})" d="{_octagon(1.0)}"/>')
        return "".join(parts)

    def lights(self, colours: Iterable[int]) -> str:
        """Return a lamp per controlled entrance; its letter tells the colour to those who can't see it."""
        parts = []
        for entrance, colour in enumerate(map(Colour, colours)):
            if colour is Colour.NONE:
                continue
            x, y, heading = self.junction.way_in(entrance).pose(self.junction.approach(entrance))
            side = 1 if self.junction.left_hand else -1
            qx = x - sin(heading) * self.junction.lane_width * side - 3.2 * cos(heading)
            qy = y + cos(heading) * self.junction.lane_width * side - 3.2 * sin(heading)
            parts.append(
                f'<g class="lamp" data-entrance="{entrance}" transform="translate({qx:.2f} {-qy:.2f})">'
                f'<circle r="1.3" fill="{_LIGHTS[colour]}"/><text class="letter" y="0.65">{colour.name[0]}</text></g>'
            )
        return "".join(parts)


def ink(agent: Agent) -> str:
    """Return the colour that a vehicle is drawn in."""
    return PALETTE[agent.entrance % len(PALETTE)]


def body(pose: NDArray[np.float64], agent: Agent, size: tuple[float, float], broken: bool = False) -> str:
    """Return a vehicle to scale; `pose` is that of the centre of its front bumper, `size` its length and width [m]."""
    (x, y, heading), (length, width), name = map(float, pose), size, markup(agent.name)
    outline = ' class="broken"' if broken else ""
    kind = "" if agent.kind is Kind.CAR else f"<title>{agent.kind} {name}</title>"
    return (
        f'<g class="vehicle" data-agent="{name}" transform="translate({x:.3f} {-y:.3f}) rotate({-degrees(heading):.2f})">{kind}'
        f'<rect{outline} x="{-length:g}" y="{-width / 2:g}" width="{length:g}" height="{width:g}" '
        f'rx="{_CORNERS.get(agent.kind, width / 2):g}" fill="{ink(agent)}"/>'
        f'<path class="front" d="M-1.3 {-width / 2 + 0.25:g}L-0.3 0L-1.3 {width / 2 - 0.25:g}"/>'
        f'<text class="name" transform="translate({-length / 2:g} 0) rotate({degrees(heading):.2f})" y="0.6">{name}</text></g>'
    )


def path(points: NDArray[np.float64]) -> str:
    """Return points of shape ``(k, 2)`` [m] as SVG coordinates, y down."""
    return " ".join(f"{x:.2f},{-y:.2f}" for x, y in points)


def _octagon(radius: float) -> str:
    corners = [(radius * cos(0.3927 + k * 0.7854), radius * sin(0.3927 + k * 0.7854)) for k in range(8)]
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in corners) + "z"
