"""Records of an OpenDRIVE file: what the metric graph needs of it, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from pytest_rvads.maps.doubts import MapWarning

__all__ = [
    "DRIVABLE",
    "Connection",
    "Cubic",
    "Document",
    "JunctionRecord",
    "Lane",
    "LaneLink",
    "Road",
    "RoadLink",
    "Section",
    "Shape",
    "Signal",
]

DRIVABLE = frozenset({"driving", "entry", "exit", "mwyentry", "mwyexit", "onramp", "offramp", "connectingramp", "sliplane"})
"""Lane types (in lower case) that vehicles drive on; mwyEntry and mwyExit are entry and exit before version 1.4."""


class Cubic(NamedTuple):
    """``a + b ds + c ds^2 + d ds^3`` from station `s` on [m]."""

    s: float
    a: float
    b: float
    c: float
    d: float


class Shape(NamedTuple):
    """One piece of a reference line."""

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
    """One lane of a lane section."""

    id: int
    type: str
    """In lower case."""
    widths: tuple[Cubic, ...]
    """Stations from the start of the section."""
    borders: tuple[Cubic, ...]
    """Outer border relative to the reference line, used where there are no widths."""
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    reversed: bool = False
    """True where traffic runs against the usual direction of the lane (OpenDRIVE 1.8)."""

    @property
    def drivable(self) -> bool:
        """Lane 0 is never a lane, though some writers type it driving."""
        return self.id != 0 and self.type in DRIVABLE


class Section(NamedTuple):
    """A lane section."""

    s: float
    lanes: dict[int, Lane]


class RoadLink(NamedTuple):
    """What a road continues into at one of its ends."""

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
    """Ranges of lane ids it is valid for; empty where the file gives none."""
    line: bool
    """True for a stop line."""
    country: str = ""
    """In lower case, as the file has it."""
    name: str = ""
    """In lower case."""


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """A road."""

    id: str
    length: float
    junction: str | None
    """Id of the junction it lies in, None for a road outside."""
    rule: str | None
    """RHT, LHT, or None where the file does not say."""
    shapes: tuple[Shape, ...]
    offsets: tuple[Cubic, ...]
    sections: tuple[Section, ...]
    predecessor: RoadLink | None
    successor: RoadLink | None
    signals: tuple[Signal, ...]


class LaneLink(NamedTuple):
    """One lane link of a connection."""

    source: int
    target: int


class Connection(NamedTuple):
    """One row of the connection table of a junction."""

    incoming: str
    connecting: str
    """Connecting road; the linked road in a direct junction."""
    contact: str
    links: tuple[LaneLink, ...]


class JunctionRecord(NamedTuple):
    """A ``<junction>`` as the file has it."""

    id: str
    type: str
    connections: tuple[Connection, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """All records of one file."""

    path: str
    roads: dict[str, Road]
    junctions: dict[str, JunctionRecord]
    controllers: dict[str, tuple[str, ...]]
    """Signal ids per controller id."""
    warnings: tuple[MapWarning, ...]

    def touching(self, junction: str, row: Connection) -> str | None:
        """Return the end of the incoming road of a connection at which it holds, None where the roads do not touch.

        By the links of the incoming road, else by those of the connecting road.
        """
        incoming, connecting = self.roads[row.incoming], self.roads[row.connecting]
        ends = [
            end
            for end, link in (("start", incoming.predecessor), ("end", incoming.successor))
            if link is not None
            and (link.element == junction if link.junction else (link.element, link.contact) == (connecting.id, row.contact))
        ]
        if len(ends) == 1:
            return ends[0]
        back = connecting.predecessor if row.contact == "start" else connecting.successor
        if back is not None and not back.junction and back.element == incoming.id and back.contact in ("start", "end"):
            return back.contact
        return ends[0] if ends else None
