"""Edges: the lanes of roads in the direction of travel, the network that links them, and its draft."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.opendrive.records import Document

__all__ = ["Draft", "Edge", "End", "Network"]

End = tuple[str, str, int]
"""Road id, ``start`` or ``end``, lane id."""


@dataclass(slots=True, eq=False)
class Edge:
    """A lane of a road, over all its lane sections, in the direction of travel."""

    id: str
    """Road, first lane section and lane in travel order: ``road.section.lane``."""
    road: str
    junction: str | None
    forward: bool
    """True where travel is along the reference line."""
    lanes: tuple[tuple[int, int], ...]
    """Pairs (section index, lane id) in the order of travel."""
    points: NDArray[np.float64]
    """Shape ``(k, 2)`` [m]."""
    s: NDArray[np.float64]
    """Road station of each point, shape ``(k,)`` [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    width: float
    """At mid-length [m]."""
    length: float
    """Arc length [m]."""
    before: list[str] = field(default_factory=list)
    """Ids of edges that lead into this one."""
    after: list[str] = field(default_factory=list)
    """Ids of edges that follow this one."""

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

    def station(self, s: float) -> float:
        """Return the arc length in the direction of travel at road station `s` [m]."""
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))))
        if self.forward:
            return float(np.interp(s, self.s, along))
        return float(np.interp(-s, -self.s, along))


class Draft:
    """A network in the making: what the steps of building it add to."""

    def __init__(self, document: Document) -> None:
        """Begin without any edge."""
        self.document = document
        self.warnings: list[MapWarning] = []
        self.edges: dict[str, Edge] = {}
        self.arriving: dict[End, str] = {}
        """The edge that reaches a road end on a lane."""
        self.departing: dict[End, str] = {}
        """The edge that leaves a road end on a lane."""
        self.direct: dict[str, list[tuple[str, str]]] = defaultdict(list)
        """Per direct junction, the pairs of edges it links."""
        self.listed: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connection table has."""
        self.linked: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connecting roads have."""
        self.left_out: set[str] = set()
        """Roads whose lanes have no place."""

    def warn(self, kind: Doubt, message: str, road: str | None = None, junction: str | None = None) -> None:
        """Add a warning."""
        self.warnings.append(MapWarning(kind, message, road, junction))

    def pair(self, one: End, two: End) -> tuple[str, str] | None:
        """Return the edges at two lane ends in the direction in which traffic passes, None where none passes."""
        for source, target in ((one, two), (two, one)):
            if source in self.arriving and target in self.departing:
                return self.arriving[source], self.departing[target]
        return None

    def link(self, one: End, two: End) -> tuple[str, str] | None:
        """Link two lane ends in the direction in which traffic passes; return the edges, None where none passes."""
        pair = self.pair(one, two)
        if pair is not None:
            self.join(*pair)
        return pair

    def join(self, source: str, target: str) -> None:
        """Let edge `target` follow edge `source`."""
        after = self.edges[source].after
        if target not in after:
            after.append(target)
            self.edges[target].before.append(source)


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """All edges of a map with their links."""

    edges: dict[str, Edge]
    arriving: dict[End, str]
    """The edge that reaches a road end on a lane."""
    departing: dict[End, str]
    """The edge that leaves a road end on a lane."""
    left_hand: dict[str, bool]
    """Per road, True where traffic keeps left."""
    direct: dict[str, list[tuple[str, str]]]
    """Per direct junction, the pairs of edges it links."""
    inside: dict[str, tuple[str, ...]]
    """Per junction, the edges that lie in it."""
    left_out: frozenset[str]
    """Roads whose lanes have no place, because the road has no geometry or no length."""
    warnings: tuple[MapWarning, ...]
