"""Records of the parts of an OpenDRIVE file that the metric graph needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from pytest_rvads.geometry.network import MapWarning
from pytest_rvads.geometry.segment import Limits

__all__ = ["Connection", "Cubic", "Document", "JunctionRecord", "Lane", "Road", "RoadLink", "Section", "Shape", "Signal"]

_RAMPS = frozenset({"entry", "exit", "mwyentry", "mwyexit", "onramp", "offramp", "connectingramp"})
"""Lane types (in lower case) of lanes whose traffic joins other traffic; mwyEntry and mwyExit are entry and exit before version
1.4."""
_DRIVABLE = _RAMPS | {"driving", "sliplane"}
"""Lane types that vehicles drive on."""


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
    """In lower case."""
    widths: tuple[Cubic, ...]
    """Stations from the start of the section."""
    borders: tuple[Cubic, ...]
    """Outer border relative to the reference line, used if the lane has no widths."""
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    reversed: bool = False
    """True where traffic runs against the usual direction of the lane (OpenDRIVE 1.8)."""
    limits: Limits = ()
    """Speed limits of the lane; stations from the start of the section."""

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
        """Return whether traffic on the lane runs along the reference line, from the side on which traffic keeps."""
        return ((self.id < 0) != left_hand) != self.reversed


class Section(NamedTuple):
    """A lane section."""

    s: float
    lanes: dict[int, Lane]


class RoadLink(NamedTuple):
    """The road or junction that continues a road at one of its ends."""

    junction: bool
    element: str
    contact: str
    """start or end of the other road; empty for a junction."""


class Signal(NamedTuple):
    """A sign, light, stop line, or a reference to one."""

    id: str
    road: str
    s: float
    t: float
    orientation: str
    reference: bool
    type: str
    """In lower case; empty for a reference."""
    subtype: str
    dynamic: bool
    lanes: tuple[tuple[int, int], ...]
    """Ranges of the ids of lanes that the signal is valid for; empty where the file gives none."""
    line: bool
    """True for a stop line."""
    country: str = ""
    """In lower case, as the file has it."""
    name: str = ""
    """In lower case."""


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """A ``<road>``."""

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
    """Speed limits of the types of the road; a limit of a lane counts before them."""

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
    """A ``<junction>`` as the file has it."""

    id: str
    type: str
    connections: tuple[Connection, ...]
    priorities: tuple[tuple[str, str], ...] = ()
    """Pairs of roads: traffic on the first has priority over traffic on the second."""

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

        The links of the incoming road decide, else the links of the connecting road.
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
