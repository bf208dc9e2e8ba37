"""Records of the parts of an OpenDRIVE file that the metric graph needs, and the reference lines of roads, sampled by station.

Reference lines have five plan-view geometries. Lines and arcs are closed forms. Spirals are integrated by 5-point
Gauss-Legendre quadrature on pieces of at most 2 m, within 4.4e-8 m of Fresnel integrals. The parameters of poly3 and paramPoly3
are found from arc lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.network import MapWarning
from pytest_rvads.geometry.segment import Limits

_RAMPS = frozenset({"entry", "exit", "mwyentry", "mwyexit", "onramp", "offramp", "connectingramp"})
"""Lane types (in lower case) of lanes whose traffic joins other traffic; mwyEntry and mwyExit are entry and exit before version
1.4."""
_DRIVABLE = _RAMPS | {"driving", "sliplane"}
"""Lane types that vehicles drive on."""

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_PIECE = 2.0
STEP = 0.05
MOST_CELLS = 200_000


class Cubic(NamedTuple):
    """The polynomial ``a + b ds + c ds^2 + d ds^3`` from station `s` on [m]."""

    s: float
    a: float
    b: float
    c: float
    d: float


class Shape(NamedTuple):
    """A piece of a reference line."""

    s: float
    x: float
    y: float
    heading: float
    length: float
    kind: str
    """line, arc, spiral, poly3 or paramPoly3."""
    values: tuple[float, ...]
    """Curvatures [1/m] or polynomial coefficients."""
    normalized: bool
    """True where the parameter of a paramPoly3 runs from 0 to 1 instead of 0 to `length`."""


class Lane(NamedTuple):
    """A lane of a lane section."""

    id: int
    type: str
    """Type of the lane, in lower case."""
    widths: tuple[Cubic, ...]
    """Widths of the lane; stations count from the start of the section."""
    borders: tuple[Cubic, ...]
    """Outer border relative to the reference line, used if the lane has no widths."""
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    reversed: bool = False
    """True where traffic runs against the usual direction of the lane (OpenDRIVE 1.8)."""
    limits: Limits = ()
    """Speed limits of the lane; stations count from the start of the section."""

    @property
    def drivable(self) -> bool:
        """Whether vehicles drive on the lane; never on lane 0, though some writers give lane 0 the type driving."""
        return self.id != 0 and self.type in _DRIVABLE

    @property
    def ramp(self) -> bool:
        """Whether the lane is a ramp, or an entry or exit lane."""
        return self.type in _RAMPS

    def onward(self, end: str) -> tuple[int, ...]:
        """Return the lanes that this lane is linked to at the ``start`` or ``end`` of the section."""
        return self.predecessors if end == "start" else self.successors

    def forward(self, *, left_hand: bool) -> bool:
        """Return whether traffic on the lane runs along the reference line, if traffic keeps to the given side."""
        return ((self.id < 0) != left_hand) != self.reversed


class Section(NamedTuple):
    """A lane section: the part of a road along which its lanes stay the same."""

    s: float
    lanes: dict[int, Lane]


class RoadLink(NamedTuple):
    """The road or junction that continues a road at one of its ends."""

    junction: bool
    element: str
    contact: str
    """start or end of the other road; empty for a junction."""


class Signal(NamedTuple):
    """The record of a sign, light or stop line, or of a reference to a sign or light."""

    id: str
    road: str
    s: float
    t: float
    orientation: str
    reference: bool
    type: str
    """Type of the signal, in lower case; empty for a reference."""
    subtype: str
    dynamic: bool
    lanes: tuple[tuple[int, int], ...]
    """Ranges of the ids of lanes that the signal is valid for; empty where the file gives none."""
    line: bool
    """True for a stop line."""
    country: str = ""
    """Country of the signal, in lower case, as the file has it."""
    name: str = ""
    """Name of the signal, in lower case."""
    meanings: tuple[str, ...] | None = None
    """Values of ``<priority>`` in the ``<semantics>`` of the signal, in lower case; None without ``<semantics>``."""
    across: tuple[float, float] = (0.0, 0.0)
    """Direction of a stop line, relative to the road [rad], and its length [m]; the length is 0 where the file gives none."""


class CrosswalkRecord(NamedTuple):
    """The record of a crosswalk on a road."""

    id: str
    s: float
    t: float
    heading: float
    """Direction of the local axis u, relative to the direction of the road [rad]."""
    corners: tuple[tuple[float, float], ...]
    """Corners of the painted area [m]: pairs (u, v) around the place (s, t) of the crosswalk, or pairs (s, t)."""
    local: bool
    """Whether the corners are pairs (u, v)."""


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """The record of a ``<road>`` of the file."""

    id: str
    length: float
    junction: str | None
    """Id of the junction in which the road lies, None for a road outside of junctions."""
    rule: str | None
    """RHT, LHT, or None where the file does not say."""
    shapes: tuple[Shape, ...]
    offsets: tuple[Cubic, ...]
    sections: tuple[Section, ...]
    predecessor: RoadLink | None
    successor: RoadLink | None
    signals: tuple[Signal, ...]
    motorway: bool = False
    limits: Limits = ()
    """Speed limits of the types of the road; where a lane has a limit, the limit of the lane applies."""
    crosswalks: tuple[CrosswalkRecord, ...] = ()
    arm: str | None = None
    """Id of the first road of the arm that the road is a lane of, in a file that the project wrote from lanelets."""

    @property
    def drivable(self) -> bool:
        """Whether vehicles drive on any lane of the road."""
        return any(lane.drivable for section in self.sections for lane in section.lanes.values())

    @property
    def contacts(self) -> Iterator[tuple[str, RoadLink | None]]:
        """Yield the two ends of the road, with the link of each end."""
        yield "start", self.predecessor
        yield "end", self.successor

    def lanes_at(self, end: str) -> dict[int, Lane]:
        """Return the lanes at the ``start`` or ``end`` of the road; no lanes if the road has no lane section."""
        return self.sections[0 if end == "start" else -1].lanes if self.sections else {}


class Connection(NamedTuple):
    """A row of the connection table of a junction."""

    incoming: str
    connecting: str
    """The connecting road; in a direct junction the linked road."""
    contact: str
    links: tuple[tuple[int, int], ...]
    """Pairs of lane ids: a lane of the incoming road, a lane of the connecting road."""


class JunctionRecord(NamedTuple):
    """The record of a ``<junction>`` of the file."""

    id: str
    type: str
    connections: tuple[Connection, ...]
    priorities: tuple[tuple[str, str], ...] = ()
    """Pairs of roads: traffic on the first has priority over traffic on the second."""
    cross_paths: tuple[tuple[str, str], ...] = ()
    """Per ``<crossPath>`` its id and the road on which pedestrians cross (OpenDRIVE 1.8)."""

    @property
    def made_of_roads(self) -> bool:
        """Whether the connections of the junction are roads in the junction."""
        return self.type in ("default", "")


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """All records of one file."""

    path: str
    roads: dict[str, Road]
    junctions: dict[str, JunctionRecord]
    controllers: dict[str, tuple[str, ...]]
    """Signal ids per controller id."""
    warnings: tuple[MapWarning, ...]

    def rows(self) -> Iterator[tuple[JunctionRecord, Connection]]:
        """Yield the rows of all connection tables whose two roads exist."""
        for junction in self.junctions.values():
            for row in junction.connections:
                if row.incoming in self.roads and row.connecting in self.roads:
                    yield junction, row

    def touching(self, junction: str, row: Connection) -> str | None:
        """Return the end of the incoming road at which a connection begins, None if the two roads do not touch.

        The links of the incoming road name the end. If these links fit both ends or no end, the links of the connecting road
        decide.
        """
        incoming, connecting = self.roads[row.incoming], self.roads[row.connecting]
        ends = [
            end
            for end, link in incoming.contacts
            if link is not None
            and (link.element == junction if link.junction else (link.element, link.contact) == (connecting.id, row.contact))
        ]
        if len(ends) == 1:
            return ends[0]
        back = connecting.predecessor if row.contact == "start" else connecting.successor
        if back is not None and not back.junction and back.element == incoming.id and back.contact in ("start", "end"):
            return back.contact
        return ends[0] if ends else None


class Line(NamedTuple):
    """Points of a reference line."""

    x: Array
    """East coordinates, shape ``(k,)`` [m]."""
    y: Array
    """North coordinates, shape ``(k,)`` [m]."""
    heading: Array
    """Headings, counter-clockwise from east, not unwrapped, shape ``(k,)`` [rad]."""


def evaluate(shape: Shape, along: Array) -> Line:
    """Return points of a piece of a reference line at ascending distances from its start, shape ``(k,)`` [m]."""
    if shape.kind == "line":
        u, v, turn = along, np.zeros_like(along), np.zeros_like(along)
    elif shape.kind == "arc":
        turn = shape.values[0] * along
        # sin(a)/k and (1 - cos(a))/k, written so that both terms are defined for a curvature k of zero.
        chord = along * np.sinc(turn / (2 * np.pi))
        u, v = chord * np.cos(turn / 2), chord * np.sin(turn / 2)
    elif shape.kind == "spiral":
        u, v, turn = _spiral(shape.values[0], shape.values[1], shape.length, along)
    elif shape.kind == "poly3":
        a, b, c, d = shape.values
        u = _parameters(along, along[-1], along[-1], lambda p: np.sqrt(1 + (b + p * (2 * c + 3 * d * p)) ** 2))
        v, turn = a + u * (b + u * (c + u * d)), np.arctan(b + u * (2 * c + 3 * d * u))
    else:
        au, bu, cu, du, av, bv, cv, dv = shape.values
        end = 1.0 if shape.normalized else shape.length
        p = _parameters(
            along, end, shape.length, lambda p: np.hypot(bu + p * (2 * cu + 3 * du * p), bv + p * (2 * cv + 3 * dv * p))
        )
        # The stated length of a piece can differ from the arc length by centimetres; the end point is exact.
        p[along >= shape.length - 1e-6] = end  # a station within a micrometre of the end is the end
        turn = np.arctan2(bv + p * (2 * cv + 3 * dv * p), bu + p * (2 * cu + 3 * du * p))
        u, v = au + p * (bu + p * (cu + p * du)), av + p * (bv + p * (cv + p * dv))
    cos, sin = np.cos(shape.heading), np.sin(shape.heading)
    return Line(shape.x + u * cos - v * sin, shape.y + u * sin + v * cos, shape.heading + turn)


def pose_at(road: Road, s: float) -> tuple[float, float, float]:
    """Return the point of a reference line at a station [m], and the heading [rad]; beyond its ends the line goes straight on."""
    within = min(max(s, 0.0), road.length)
    shape = next((shape for shape in reversed(road.shapes) if shape.s <= within), road.shapes[0])
    (x,), (y,), (heading,) = evaluate(shape, np.array([max(within - shape.s, 0.0)]))
    beyond = s - within
    return float(x + beyond * np.cos(heading)), float(y + beyond * np.sin(heading)), float(heading)


def _spiral(first: float, last: float, length: float, along: Array) -> tuple[Array, Array, Array]:
    rate = (last - first) / length if length else 0.0
    lead = np.linspace(0.0, along[0], int(np.ceil(along[0] / _PIECE)) + 1)[:-1]
    grid = np.concatenate((lead, along)) if len(lead) or along[0] == 0.0 else np.concatenate(([0.0], along))
    widest = float(np.max(np.diff(grid), initial=0.0))
    parts = max(1, int(np.ceil(widest / _PIECE)))
    fine = grid
    if parts > 1:
        steps = np.linspace(0.0, 1.0, parts + 1)[:-1]
        fine = np.append((grid[:-1, None] + np.diff(grid)[:, None] * steps).ravel(), grid[-1])
    half = np.diff(fine) / 2
    nodes = (fine[:-1] + half)[:, None] + half[:, None] * _NODES
    angle = first * nodes + rate * nodes**2 / 2
    u = np.concatenate(([0.0], np.cumsum(half * (np.cos(angle) @ _WEIGHTS))))
    v = np.concatenate(([0.0], np.cumsum(half * (np.sin(angle) @ _WEIGHTS))))
    keep = slice(None, None, parts)
    back = len(along)
    return u[keep][-back:], v[keep][-back:], first * along + rate * along**2 / 2


def _parameters(along: Array, end: float, length: float, speed: Callable[[Array], Array]) -> Array:
    """Return the parameters from 0 to `end` at arc lengths, the integrals of `speed`, along a piece of a length [m]."""
    cells = min(max(int(np.ceil(length / STEP)), 1), MOST_CELLS)
    grid = np.linspace(0.0, max(end, STEP), cells + 1)
    half = np.diff(grid) / 2
    nodes = (grid[:-1] + half)[:, None] + half[:, None] * _NODES
    return np.interp(along, np.concatenate(([0.0], np.cumsum(half * (speed(nodes) @ _WEIGHTS)))), grid)
