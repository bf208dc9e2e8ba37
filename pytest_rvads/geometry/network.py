"""The network that a reader of a map format returns: lanes in the direction of travel, links, signs, junctions and warnings.

A warning is a typed record of a repair or of a doubt of the reader.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import MapObject
from pytest_rvads.geometry.segment import Limits
from pytest_rvads.support.errors import MapError

HAND = "RVADS_HAND"
"""Environment variable in which a user states the side on which traffic keeps, ``left`` or ``right``, for maps of lanelets."""
_NAME_OR_NUMBER = r"(?:'[^']*'|[^\s']*\d[^\s']*)"
_NAMES_AND_NUMBERS = re.compile(rf"{_NAME_OR_NUMBER}(?:,? (?:and )?{_NAME_OR_NUMBER})*")
_PLACES = 4
"""Most places that a line about several warnings names beside the place of the first warning."""


class Doubt(StrEnum):
    """Kinds of warnings about a map."""

    GAP = "gap"
    """Two linked lanes, or two pieces of a reference line, do not meet. Overlaps were cut, and lateral steps became tapers."""
    LENGTH = "length"
    """The reference line is not as long as the road says, or the road has no reference line and was left out."""
    KINK = "kink"
    """A reference line bends sharply. The lane on the inner side of the bend would run backwards in the bend and was cut."""
    ORIENTATION = "orientation"
    """The orientation of a signal contradicts the traffic it is for, and was ignored."""
    TABLE = "table"
    """The connection table of a junction and the links of its roads disagree, or junctions were read as one cluster."""
    LINK = "link"
    """A link names a missing road, junction or lane or the wrong end of a road, or a link was added from the geometry."""
    SIGNAL = "signal"
    """A signal is broken or could not be assigned to an entrance, or a reference names no signal."""
    LANE = "lane"
    """A lane section has two lanes with the same id; the lane that is not for driving was left out."""
    RIGHT_OF = "right_of"
    """No entrance is right-of another entrance: a Y junction, where the priority rules say nothing."""
    ORDER = "order"
    """The movements of an entrance, sorted by turn, do not follow the cyclic order of the exits."""
    BEND = "bend"
    """No path of its rear axle keeps a usual car in its lane on a movement: the car cuts the corner or swings out."""
    ROOM = "room"
    """A car that stands at its stopping line leaves no room for the body of a car on another movement."""
    SIDE = "side"
    """A road does not say on which side traffic keeps, or says the wrong side; the side that the lanes need was taken."""
    SPEED = "speed"
    """A speed limit can't be read and was ignored."""
    UNITS = "units"
    """The header states another unit of length; the metres of the standard were taken."""
    CROSSWALK = "crosswalk"
    """A crosswalk is broken, or lies over no arm of a junction."""


@dataclass(frozen=True, slots=True)
class MapWarning:
    """A warning about a map file: a repair by the reader of the file, or a doubt."""

    kind: Doubt
    message: str
    """One sentence."""
    road: str | None = None
    junction: str | None = None

    def record(self) -> dict[str, str | None]:
        """Return the fields of the warning as a dict of texts for JSON."""
        return {"kind": self.kind.value, "message": self.message, "road": self.road, "junction": self.junction}


def gathered(warnings: Iterable[MapWarning]) -> list[dict[str, Any]]:
    """Return warnings as builtins for JSON; warnings whose messages differ only in names and numbers are one record.

    Such a record has the place of the first warning, a message that counts the warnings and names the first places, the number of
    the warnings as ``count``, and the records of the other warnings as ``more``.
    """
    groups: dict[tuple[Doubt, str], list[MapWarning]] = {}
    for warning in warnings:
        groups.setdefault((warning.kind, _NAMES_AND_NUMBERS.sub("#", warning.message)), []).append(warning)
    records = []
    for first, *others in groups.values():
        record: dict[str, Any] = first.record()
        if others:
            every = (
                f"road {w.road!r}" if w.road else f"junction {w.junction!r}" for w in (first, *others) if w.road or w.junction
            )
            places = list(dict.fromkeys(every))[1:]
            named = f": {', '.join(places[:_PLACES])}" if places else ""
            message = f"{first.message} (and {len(others)} more such{named}{', ...' if len(places) > _PLACES else ''})"
            record |= {"message": message, "count": 1 + len(others), "more": [warning.record() for warning in others]}
        records.append(record)
    return records


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A lane of a road, or of a way through a junction, in the direction of travel."""

    id: str
    road: str
    junction: str | None
    """Id of the junction in which the lane lies, None on a road outside of junctions."""
    forward: bool
    """Whether traffic on the lane runs from the start to the end of the road; lanes of a road can have opposite directions."""
    points: NDArray[np.float64]
    """Points of the centre line, shape ``(k, 2)``, k >= 2, no two consecutive points equal [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    width: float
    """Width of the lane at mid-length [m]."""
    length: float
    """Arc length of the centre line [m]."""
    joins: bool = field(default=False, kw_only=True)
    """Whether traffic on the lane joins other traffic: a ramp, entry lane, exit lane, or lane that ends narrower than a car."""
    limits: Limits = field(default=(), kw_only=True)

    @property
    def start_heading(self) -> float:
        """Direction of the lane at its start [rad]."""
        (x, y), (u, v) = self.points[0], self.points[1]
        return math.atan2(v - y, u - x)

    @property
    def end_heading(self) -> float:
        """Direction of the lane at its end [rad]."""
        (x, y), (u, v) = self.points[-2], self.points[-1]
        return math.atan2(v - y, u - x)

    @property
    def tail(self) -> tuple[str, str]:
        """The road end at which travel begins: road id, ``start`` or ``end``."""
        return self.road, "start" if self.forward else "end"

    @property
    def head(self) -> tuple[str, str]:
        """The road end at which travel ends: road id, ``start`` or ``end``."""
        return self.road, "end" if self.forward else "start"


def facing(entrance: Edge, exit: Edge) -> tuple[float, float, bool]:
    """Return the gap from an entrance to an exit [m], the exit's angle to the reversed entrance [rad], whether it lies left."""
    heading = entrance.end_heading
    (x, y), (u, v) = entrance.points[-1], exit.points[0]
    angle = abs(math.remainder(exit.start_heading - heading - math.pi, math.tau))
    left = math.cos(heading) * (v - y) - math.sin(heading) * (u - x) >= 0
    return math.hypot(u - x, v - y), angle, bool(left)


@dataclass(frozen=True, slots=True, eq=False)
class PaintedCrosswalk:
    """A crosswalk as its map file gives it, before it is known which arm of which junction the crosswalk lies over."""

    id: str
    road: str
    """Id of the road to which the file adds the crosswalk; empty for a crosswalk without a road."""
    area: NDArray[np.float64]
    """Corners of the painted area, counter-clockwise, shape ``(k, 2)``, k >= 3 [m]."""
    lights: tuple[str, ...] = ()
    """Ids of the lights for pedestrians who cross here."""
    beside: Mapping[str, float] = field(default_factory=dict)
    """Per edge near the area, the width of the shoulder and of other lanes between the edge and its kerb [m]; 0 if left out."""


@dataclass(frozen=True, slots=True)
class DeclaredJunction:
    """A junction as its file declares it."""

    type: str = "default"
    """``default`` for a junction with connecting lanes; junctions of other types are listed and never usable."""
    direct: tuple[tuple[str, str], ...] = ()
    """Pairs of edges outside the junction that the junction links without a connecting lane."""
    lost: str | None = None
    """A road in the junction, or a road that the junction connects, that has no geometry or no length; None if there is none."""
    priorities: tuple[tuple[str, str], ...] = ()
    """Pairs of roads: traffic on the first has priority over traffic on the second."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """The lanes of a map with their links, and the junctions that the map file declares.

    Raises:
        MapError: a link, edge or object names an edge or a junction that the network does not have.
    """

    edges: Mapping[str, Edge]
    links: nx.DiGraph
    """Graph on the ids of edges: an arc leads from an edge to an edge on which traffic can continue."""
    junctions: Mapping[str, DeclaredJunction]
    """The declared junctions by id, in file order."""
    left_hand: frozenset[str] = frozenset()
    """Ids of the roads where traffic keeps left."""
    motorways: frozenset[str] = field(default=frozenset(), kw_only=True)
    """Ids of the roads that are motorways."""
    objects: tuple[MapObject, ...] = ()
    """Signs, lights and stop lines with the entrances that they regulate."""
    controllers: tuple[tuple[str, ...], ...] = ()
    """Per controller of lights, the ids of its objects."""
    warnings: tuple[MapWarning, ...] = ()
    crosswalks: tuple[PaintedCrosswalk, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        self.links.add_nodes_from(self.edges)
        for noun, names, table in (
            ("edge", self.links, self.edges),
            ("junction", (edge.junction for edge in self.edges.values() if edge.junction is not None), self.junctions),
            ("junction", (item.junction for item in self.objects), self.junctions),
        ):
            for name in names:
                if name not in table:
                    raise MapError(
                        f"a network names the {noun} {name!r} but has no {noun} with this id, expected an id of its {len(table)}"
                    )
