"""Draws a junction and the vehicles of a run as SVG elements in metres, and still pictures of a run and of ways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import atan2, cos, degrees, sin

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing, Crosswalk, Parking, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import UTURN, turn_word
from pytest_rvads.report.svg import arrow, marks, sign
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Kind, Vehicle
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.wording import markup

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f00", "#555555")
"""Okabe and Ito's palette, distinguishable by colour-blind people."""
_DARKER = 0.62
"""Factor on the brightness of a colour of the palette, if the palette is used for a second round of agents."""

_LIGHTS = {Colour.GREEN: "#1fa34a", Colour.YELLOW: "#e0a800", Colour.RED: "#d11f1f", Colour.NONE: "#888"}
_BAY = 2.0
"""Width of the parking place between the road and what stands beside the road [m]."""
_CORNERS = {Kind.CAR: 0.4, Kind.TRUCK: 0.0}
"""Radius of the corners of a body [m]; bodies of riders and pedestrians are round at both ends."""
_MARGIN = 28.0
"""Margin of a picture around the junction [m]."""
_ARROW = 9.0
"""The arrow on a lane begins this far before the stopping line [m]."""
_LAMP = 1.8
"""On arms with several lanes, a light hangs over its lane this far beyond the stopping line [m]."""
_POST = 3.2
"""Signs and lights at the kerb stand this far before the stopping line [m]."""
_NAME, _ROOM = 1.8, 3
"""Height of a name [m], and most letters of a name across a vehicle; a longer name is written along the vehicle."""


@dataclass(frozen=True, slots=True)
class Scene:
    """The static part of a picture: the visible area and the road; the junction must have a geometry."""

    junction: Junction

    def __post_init__(self) -> None:
        if not self.junction.drivable:
            raise MapError(
                f"junction {self.junction.name!r} comes from a recording without positions, so there is nothing to draw"
            )

    @property
    def view(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the picture in SVG coordinates (y down) [m]."""
        low, high = self.core[0] - _MARGIN, self.core[1] + _MARGIN
        return float(low[0]), float(-high[1]), float(high[0] - low[0]), float(high[1] - low[1])

    @property
    def core(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest x and y of the ways through the junction [m]."""
        points = np.vstack([self.junction.way_through(*key).points for key in self.junction.movements])
        return points.min(axis=0), points.max(axis=0)

    def road(self) -> str:
        """Return SVG elements of lanes with marks and arrows, movements, other ways, stopping lines, arm numbers and signs."""
        junction, width = self.junction, self.junction.lane_width
        ways = [junction.way_through(*key) for key in junction.movements]
        lanes = [*map(junction.way_in, range(len(junction.entrances))), *map(junction.way_out, range(len(junction.exits))), *ways]
        parts = [f'<polyline class="lane" stroke-width="{width:g}" points="{path(s.points)}"/>' for s in lanes]
        for arm in junction.arms:
            sides = [junction.way_in(e).points for e in arm.entrances], [junction.way_out(e).points for e in arm.exits]
            for side, centre in zip(sides, (True, not arm.entrances), strict=True):
                for line, broken in marks(side, width, left_hand=junction.left_hand, centre=centre):
                    parts.append(f'<polyline class="{"mark broken" if broken else "mark"}" points="{path(line)}"/>')
        parts += [f'<polyline class="way" points="{path(s.points)}"/>' for s in ways]
        for crosswalk in junction.crossings if junction.further else ():  # stripes of 0.5 m, in the direction of the vehicles
            stripes = f'stroke="#fff" stroke-dasharray=".5" stroke-width="{_width(crosswalk):.2f}"'
            parts.append(f'<polygon class="crosswalk" fill="#fff" opacity=".3" points="{path(crosswalk.area)}"/>')
            parts.append(f'<polyline class="crosswalk" fill="none" {stripes} points="{path(crosswalk.path.points)}"/>')
        for way, _, _ in junction.further:
            if not isinstance(way, Crossing | Parking) and way.path is not None:
                stripes = f'fill="none" stroke="#fff" stroke-dasharray=".5" stroke-width="{way.width:g}"'
                parts.append(f'<polyline class="further" {stripes} points="{path(way.path.points)}"/>')
        parts += map(self._entrance, range(len(junction.entrances)))
        return "".join(parts)

    def _entrance(self, entrance: int) -> str:
        """Return SVG elements of an entrance: stopping line and arrow; at the kerb also the number and the sign of its arm."""
        junction, lane = self.junction, self.junction.entrances[entrance]
        x, y, heading = junction.way_in(entrance).pose(junction.approach(entrance))
        ax, ay = -sin(heading) * junction.lane_width / 2, cos(heading) * junction.lane_width / 2
        parts = [f'<line class="stop" x1="{x - ax:.2f}" y1="{-(y - ay):.2f}" x2="{x + ax:.2f}" y2="{-(y + ay):.2f}"/>']
        turns = {m.turn for m in junction.movements.values() if m.entrance == entrance}
        if len(junction.arms[lane.arm].entrances) > 1 or len(junction.directions(entrance)) < junction.ways - 1:
            tx, ty, along = junction.way_in(entrance).pose(max(junction.approach(entrance) - _ARROW, 0.0))
            place = f"translate({tx:.2f} {-ty:.2f}) rotate({-degrees(along):.2f})"
            parts.append(f'<path class="arrow" transform="{place}" d="{arrow(turns)}"/>')
        if lane.lane == 0:
            px, py = self._kerb(entrance)
            parts.append(f'<text class="number" x="{px:.2f}" y="{-py + 0.9:.2f}">{lane.arm}</text>')
            parts.append(sign(lane.sign, px - _POST * cos(heading), -(py - _POST * sin(heading)), 1.0))
        return "".join(parts)

    def _kerb(self, entrance: int) -> tuple[float, float]:
        """Return a point beside the road at a stopping line."""
        x, y, heading = self.junction.way_in(entrance).pose(self.junction.approach(entrance))
        beyond = _BAY if self.junction.further and self.junction.crossings else 0.0
        aside = (self.junction.lane_width + beyond) * (1 if self.junction.left_hand else -1)
        return x - sin(heading) * aside, y + cos(heading) * aside

    def lights(self, colours: Iterable[int]) -> str:
        """Return an SVG lamp per entrance with a light; a letter in the lamp names the colour for colour-blind readers."""
        junction, parts = self.junction, []
        for entrance, colour in enumerate(map(Colour, colours)):
            if colour is Colour.NONE:
                continue
            lane = junction.way_in(entrance)
            if entrance >= len(junction.entrances):  # on the sidewalk beside the crosswalk
                way, scale = junction.further[entrance - len(junction.entrances)].way, " scale(.6)"
                x, y, heading = lane.pose(lane.length - 0.9)
                if isinstance(way, Crossing):
                    aside = _width(junction.crossings[way.crosswalk]) / 2 + 0.9
                    aside *= -1 if (way.side is Side.NEAR) != junction.left_hand else 1  # on the side of the junction
                    x, y = x - aside * sin(heading), y + aside * cos(heading)
            else:
                (x, y, heading), beyond, scale = lane.pose(junction.approach(entrance)), _LAMP, ""  # over the lane
                if len(junction.arms[junction.entrances[entrance].arm].entrances) == 1:
                    (x, y), beyond = self._kerb(entrance), -_POST
                x, y = x + beyond * cos(heading), y + beyond * sin(heading)
            parts.append(
                f'<g class="lamp" data-entrance="{entrance}" transform="translate({x:.2f} {-y:.2f}){scale}">'
                f'<circle r="1.3" fill="{_LIGHTS[colour]}"/><text class="letter" y="0.65">{colour.name[0]}</text></g>'
            )
        return "".join(parts)


def _width(crosswalk: Crosswalk) -> float:
    """Return the mean width of a crosswalk: its area by its length [m]."""
    (x, y), (u, v) = crosswalk.area.T, np.roll(crosswalk.area, -1, axis=0).T
    return float(abs(np.dot(x, v) - np.dot(y, u)) / 2.0 / crosswalk.path.length)


def label(junction: Junction, entrance: int) -> str:
    """Return the name of an entrance: the number of its arm, with the number of its lane if the arm has several lanes."""
    return junction.vehicle_at(entrance).removeprefix("a")


def inks(agents: Sequence[Agent]) -> list[str]:
    """Return the colours of agents: a colour per entrance, or a colour per agent if several agents share an entrance."""
    several = max(Counter(agent.entrance for agent in agents).values(), default=0) > 1
    numbers = range(len(agents)) if several else [agent.entrance for agent in agents]
    colours = []
    for agent, number in zip(agents, numbers, strict=True):
        colour = PALETTE[number % len(PALETTE)]
        if number // len(PALETTE) % 2:
            colour = "#" + "".join(f"{int(_DARKER * int(colour[k : k + 2], 16)):02x}" for k in (1, 3, 5))
        colours.append("#8a9099" if isinstance(agent.way, Parking) else colour)
    return colours


def body(
    pose: NDArray[np.float64],
    agent: Agent,
    size: tuple[float, float],
    colour: str,
    broken: bool = False,
    style: str = "vehicle",
    more: str = "",
) -> str:
    """Return the SVG element of an agent, drawn to scale.

    The pose is that of the centre of the front bumper: x [m], y [m], heading [rad]. The size is length and width [m]. The name
    of a pedestrian stands above its circle. Of a group, only the first pedestrian has its name there.
    """
    heading, (length, width), name = float(pose[2]), size, markup(agent.name)
    outline = ' class="broken"' if broken else ""
    kind = "" if agent.kind is Kind.CAR else f"<title>{agent.kind} {name}</title>"
    corner, edge = _CORNERS.get(agent.kind, width / 2), ""
    if agent.kind is Kind.PEDESTRIAN:
        # White edges: the circle is seen on dark asphalt, and the name is readable on asphalt, stripes and vehicles.
        edge = ' stroke="#fff" stroke-width=".12"'
        inner = (
            f'<text font-size="1.3" text-anchor="middle" font-weight="bold" fill="{colour}" stroke="#fff" stroke-width=".4" '
            'stroke-linejoin="round" paint-order="stroke" '
            f'transform="translate({-length / 2:g} 0) rotate({degrees(heading):.2f})" y="{-width / 2 - 0.2:.2f}">'
            f"{'' if '+' in name else name}</text>"
        )
    else:
        along = len(agent.name) > _ROOM
        turned = (180.0 if cos(heading) < 0 else 0.0) if along else degrees(heading)
        # The width of a bold letter is about 0.6 of its height; the arrow at the front takes a part of the room.
        middle = length * (0.58 if along else 0.5)
        high = min(_NAME, 0.75 * length / (0.6 * len(agent.name))) if along else _NAME
        inner = (
            f'<path class="front" d="M-1.3 {-width / 2 + 0.25:g}L-0.3 0L-1.3 {width / 2 - 0.25:g}"/>'
            f'<text class="{"name along" if along else "name"}" font-size="{high:.2f}" '
            f'transform="translate({-middle:g} 0) rotate({turned:.2f})" y="{high / 3:.2f}">{name}</text>'
        )
    return (
        f'<g class="{style}" data-agent="{name}" transform="{placed(pose)}">{kind}'
        f'<rect{outline} x="{-length:g}" y="{-width / 2:g}" width="{length:g}" height="{width:g}" '
        f'rx="{corner:g}" fill="{colour}"{edge}/>{inner}{more}</g>'
    )


def placed(pose: NDArray[np.float64]) -> str:
    """Return the SVG transform that moves a body to a pose; the body has the centre of its front bumper at the origin."""
    x, y, heading = map(float, pose)
    return f"translate({x:.3f} {-y:.3f}) rotate({-degrees(heading):.2f})"


def size(run: Run, agent: int) -> tuple[float, float]:
    """Return length and width of an agent's body [m]; the size of the default vehicle if the run holds no size."""
    return run.agents[agent].size or (Vehicle().length, Vehicle().width)


def path(points: NDArray[np.float64]) -> str:
    """Return points of shape ``(k, 2)`` [m] as the text of an SVG attribute ``points``, with y down."""
    return " ".join(f"{x:.2f},{-y:.2f}" for x, y in points)


_BEYOND = 9.0
"""Margin of a picture around the junction and the starts of vehicles [m]."""
TURNS: dict[str, str] = {"left": PALETTE[1], "straight": PALETTE[0], "right": PALETTE[2], UTURN: PALETTE[3]}
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
    """Return an SVG document of a state of a run."""
    if run.pose is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to draw")
    scene = Scene(run.junction)
    left, top, wide, high = scene.view
    top, high = top - 5, high + 5  # room for the title
    parts = [scene.road(), scene.lights(run.lights[tick])]
    colours = inks(run.agents)
    for column, colour in enumerate(colours):
        driven = run.pose[: tick + 1 : 5, column, :2]
        recorded = driven[np.isfinite(driven).all(axis=1)]  # the position of an absent vehicle can be NaN
        parts.append(f'<polyline class="trail" stroke="{colour}" points="{path(recorded)}"/>')
    for column, agent in enumerate(run.agents):
        if run.here[tick, column]:
            parts.append(body(run.pose[tick, column], agent, size(run, column), colours[column], agent.name in broken))
    parts.append(f'<rect x="{left:.2f}" y="{top:.2f}" width="{wide:.2f}" height="5" fill="#fff"/>')
    parts.append(f'<text class="title" x="{left + 1:.2f}" y="{top + 3.5:.2f}">{markup(title)}</text>')
    return _document(left, top, wide, high, parts) + "\n"


def _document(left: float, top: float, wide: float, high: float, parts: Iterable[str]) -> str:
    """Return an SVG document of a part of the road in SVG coordinates [m], with 10 pixels per metre."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide * 10:.0f}" height="{high * 10:.0f}" '
        f'viewBox="{left:.2f} {top:.2f} {wide:.2f} {high:.2f}"><style>{STYLE}</style>'
        f'<rect x="{left:.2f}" y="{top:.2f}" width="{wide:.2f}" height="{high:.2f}" fill="#fff"/>{"".join(parts)}</svg>'
    )


def draw_ways(junction: Junction) -> str:
    """Return the ways through a junction as an SVG document, with a colour per turn."""
    scene = Scene(junction)
    words = {key: turn_word(junction, m) for key, m in junction.movements.items()}
    lines = [course(junction.way_through(*key).points, TURNS[word]) for key, word in words.items()]
    return still(scene, lines, (), [row for row in TURNS.items() if row[0] != UTURN or UTURN in words.values()])


def course(points: NDArray[np.float64], ink: str) -> str:
    """Return an SVG line with an arrow at its end; the first two columns of `points` are x and y [m]."""
    (ax, ay), (bx, by) = points[-2:, :2].tolist()
    transform = f"translate({bx:.2f} {-by:.2f}) rotate({-degrees(atan2(by - ay, bx - ax)):.2f})"
    return (
        f'<polyline class="trail" stroke="{ink}" points="{path(points[:, :2])}"/>'
        f'<path class="trail" stroke="{ink}" transform="{transform}" d="M-1.4 -1L0 0L-1.4 1"/>'
    )


def still(
    scene: Scene, parts: Iterable[str], corners: Sequence[Sequence[float]] = (), legend: Sequence[tuple[str, str]] = ()
) -> str:
    """Return an SVG document of a road with elements on the road; `corners` are further points that it must show [m]."""
    points = np.vstack([*scene.core, *np.reshape(corners, (-1, 2))])
    low, high = points.min(axis=0) - _BEYOND, points.max(axis=0) + _BEYOND
    (left, _), (wide, tall), top = low, high - low, -high[1]
    key = [
        f'<text class="title" x="{left + 1:.2f}" y="{top + 3 + 3 * k:.2f}" style="fill:{ink}">{markup(word)}</text>'
        for k, (word, ink) in enumerate(legend)
    ]
    return _document(left, top, wide, tall, [scene.road(), *parts, *key])
