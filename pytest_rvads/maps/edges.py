"""Edges: the lanes of roads in the direction of travel, and the network that links them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.doubts import MapWarning

__all__ = ["Edge", "End", "Network"]

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
    warnings: tuple[MapWarning, ...]
