"""What every reader of a map format gives: the lanes of roads in the direction of travel, their links, what stands on them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError
from pytest_rvads.maps.control import MapObject
from pytest_rvads.maps.doubts import MapWarning
from pytest_rvads.maps.segment import Limits

__all__ = ["DeclaredJunction", "Edge", "Network", "facing"]


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A lane of a road, or of a way through a junction, in the direction of travel."""

    id: str
    """Unique in the map."""
    road: str
    junction: str | None
    """Id of the junction it lies in, None on a road outside."""
    forward: bool
    """True where travel is from the start to the end of the road; two lanes of a road may differ."""
    points: NDArray[np.float64]
    """Centre line, shape ``(k, 2)``, k >= 2, no two consecutive points equal [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    width: float
    """At mid-length [m]."""
    length: float
    """Arc length [m]."""
    joins: bool = field(default=False, kw_only=True)
    """Whether it is a ramp or an entry or exit lane, or too narrow for a car at its end: its traffic joins other traffic."""
    limits: Limits = field(default=(), kw_only=True)
    """The speed limits that the map states along it."""

    @property
    def start_heading(self) -> float:
        """Direction of the first step [rad]."""
        (x, y), (u, v) = self.points[0], self.points[1]
        return math.atan2(v - y, u - x)

    @property
    def end_heading(self) -> float:
        """Direction of the last step [rad]."""
        (x, y), (u, v) = self.points[-2], self.points[-1]
        return math.atan2(v - y, u - x)

    @property
    def tail(self) -> tuple[str, str]:
        """The road end where travel begins: road id, ``start`` or ``end``."""
        return self.road, "start" if self.forward else "end"

    @property
    def head(self) -> tuple[str, str]:
        """The road end where travel arrives."""
        return self.road, "end" if self.forward else "start"


def facing(entrance: Edge, exit: Edge) -> tuple[float, float, bool]:
    """Return how an exit lies to an entrance: gap [m], angle missing to leading straight back [rad], whether on the left."""
    heading = entrance.end_heading
    (x, y), (u, v) = entrance.points[-1], exit.points[0]
    angle = abs(math.remainder(exit.start_heading - heading - math.pi, math.tau))
    left = math.cos(heading) * (v - y) - math.sin(heading) * (u - x) >= 0
    return math.hypot(u - x, v - y), angle, bool(left)


@dataclass(frozen=True, slots=True)
class DeclaredJunction:
    """A junction as its file declares it."""

    type: str = "default"
    """``default`` where lanes lead through it; others are listed and never usable."""
    direct: tuple[tuple[str, str], ...] = ()
    """Pairs of edges outside the junction that the junction links directly, without a connecting lane."""
    lost: str | None = None
    """A road of the junction, or one that it connects, whose lanes have no place because it has no geometry or no length."""
    priorities: tuple[tuple[str, str], ...] = ()
    """Pairs of roads: traffic on the first has priority over traffic on the second."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """The lanes of a map with their links, and what a file says of its junctions.

    Raises:
        MapError: a link, edge or object names what the network does not have.
    """

    edges: Mapping[str, Edge]
    links: nx.DiGraph
    """On the ids of edges: an arc leads to what traffic can go on to."""
    junctions: Mapping[str, DeclaredJunction]
    """By id, in file order."""
    left_hand: frozenset[str] = frozenset()
    """Roads where traffic keeps left."""
    motorways: frozenset[str] = field(default=frozenset(), kw_only=True)
    """Roads that are motorways."""
    objects: tuple[MapObject, ...] = ()
    """Stop signs, lights and stop lines with the entrances they are for."""
    controllers: tuple[tuple[str, ...], ...] = ()
    """Per controller of lights, the ids of its objects."""
    warnings: tuple[MapWarning, ...] = ()

    def __post_init__(self) -> None:
        self.links.add_nodes_from(self.edges)
        for what, names, known in (
            ("edge", self.links, self.edges),
            ("junction", (edge.junction for edge in self.edges.values() if edge.junction is not None), self.junctions),
            ("junction", (item.junction for item in self.objects), self.junctions),
        ):
            for name in names:
                if name not in known:
                    raise MapError(
                        f"a network names the {what} {name!r} but has none of this id, expected one of its {len(known)}"
                    )
