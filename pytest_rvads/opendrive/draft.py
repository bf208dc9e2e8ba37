"""A network in the making: what the steps of building it from the records of an OpenDRIVE file add to."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Edge
from pytest_rvads.opendrive.records import Document

__all__ = ["Chain", "Draft", "LaneEnd"]

LaneEnd = tuple[str, str, int]
"""Road id, ``start`` or ``end``, lane id."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain(Edge):
    """An edge made of lanes that go on one to one through the lane sections of a road: ``road.section.lane`` of the first."""

    lanes: tuple[tuple[int, int], ...]
    """Pairs (section index, lane id) in the order of travel."""
    s: NDArray[np.float64]
    """Road station of each point, shape ``(k,)`` [m]."""

    def station(self, s: float) -> float:
        """Return the arc length in the direction of travel at road station `s` [m]."""
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))))
        return float(np.interp(s, self.s, along) if self.forward else np.interp(-s, -self.s, along))


class Draft:
    """Edges, links and warnings so far."""

    def __init__(self, document: Document) -> None:
        """Begin without any edge."""
        self.document = document
        self.warnings: list[MapWarning] = list(document.warnings)
        self.edges: dict[str, Chain] = {}
        self.links = nx.DiGraph()
        """On the ids of all edges."""
        self.arriving: dict[LaneEnd, str] = {}
        """The edge that reaches a road end on a lane."""
        self.departing: dict[LaneEnd, str] = {}
        """The edge that leaves a road end on a lane."""
        self.direct: dict[str, list[tuple[str, str]]] = defaultdict(list)
        """Per direct junction, the pairs of edges it links."""
        self.listed: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connection table has."""
        self.linked: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connecting roads have."""
        self.idle: list[tuple[LaneEnd, LaneEnd]] = []
        """Lane links that no traffic passes."""
        self.left_out: set[str] = set()
        """Roads whose lanes have no place."""

    def warn(self, kind: Doubt, message: str, road: str | None = None, junction: str | None = None) -> None:
        """Add a warning."""
        self.warnings.append(MapWarning(kind, message, road, junction))

    def pair(self, one: LaneEnd, two: LaneEnd) -> tuple[str, str] | None:
        """Return the edges at two lane ends in the direction in which traffic passes, None where none passes."""
        for source, target in ((one, two), (two, one)):
            if source in self.arriving and target in self.departing:
                return self.arriving[source], self.departing[target]
        return None
