"""Paths on a metric graph, through a junction and along its roads; and the place on the graph of a vehicle with a known pose.

A vehicle is projected on its own track (the segments of its route), in a window around its last station. Half of the points
inside a junction lie within 0.5 m of another movement, so the lane nearest to a vehicle in a junction is often the wrong lane.
`Locator` finds the lanes of a vehicle whose route is not known yet, and returns all candidates, the best first.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import networkx as nx

from pytest_rvads.geometry.graph import MetricGraph, Position
from pytest_rvads.geometry.segment import GAP_LIMIT, Pose, Segment, join
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.errors import MapError

_MOST_STEPS = 300_000

_CELL = 8.0
_REACH = 6.0
_PER_RADIAN = 2.0


class Path(NamedTuple):
    """A path through a junction of a map file, given by ids of edges."""

    entrance: str
    """Edge before the junction."""
    exit: str
    """Edge after the junction."""
    edges: tuple[str, ...]
    """Edges inside the junction."""
    length: float
    """Length along the lane centre line [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""


class Route(NamedTuple):
    """A path through a junction of a map file, with the numbers of its entrance and exit and its turn."""

    entrance: int
    exit: int
    turn: Turn
    length: float
    """Length along the lane centre line [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    path: Path


def paths_of(graph: MetricGraph, junction: str) -> list[Path]:
    """Return the shortest path from every entrance edge to every exit edge of `junction`."""
    edges, links, inside = graph.edges, graph.links, dict.fromkeys(graph.inside(junction))
    starts = dict.fromkeys(lane for id in inside for lane in links.pred[id] if lane not in inside)
    # The junction's part of the line graph. An edge outside is two nodes, because a road that returns leads both in and out.
    cut = nx.DiGraph()
    for lane in (*starts, *inside):
        for next_lane in links.succ[lane]:
            if next_lane in inside:
                cut.add_edge((lane, "inside" if lane in inside else "in"), (next_lane, "inside"), weight=edges[next_lane].length)
            elif lane in inside:
                cut.add_edge((lane, "inside"), (next_lane, "out"), weight=0.0)
    all_paths: list[Path] = []
    steps = 0
    for start in starts:
        before, length = nx.dijkstra_predecessor_and_distance(cut, (start, "in"))
        steps += len(length)
        if steps > _MOST_STEPS:
            raise MapError(
                f"the lanes of junction {junction!r} branch too often, {len(starts)} entrances lead to {len(inside)} lanes"
            )
        paths = []
        for end in length:
            if end[1] == "out":
                way = [end]
                while way[-1] != (start, "in"):
                    way.append(before[way[-1]][0])
                ids = tuple(id for id, _ in way[-2:0:-1])
                paths.append(Path(start, end[0], ids, length[end], math.fsum(edges[id].turning for id in ids)))
        all_paths += sorted(paths, key=lambda path: path.edges)
    return all_paths


def walk(graph: MetricGraph, start: str, *, upstream: bool, joints: Container[str] = ()) -> list[str]:
    """Return the edges from an edge along the links of lanes to the next junction or the end of the road.

    Where lanes merge or fork, the walk follows the lane that continues straightest.
    """
    onward = graph.links.pred if upstream else graph.links.succ
    way = [start]
    seen = {start}
    while True:
        last_edge = graph.edges[way[-1]]
        choices = [graph.edges[id] for id in onward[last_edge.id]]
        if any(choice.junction is not None and choice.junction not in joints for choice in choices):
            return way
        bends = []
        for choice in choices:
            before, after = (choice, last_edge) if upstream else (last_edge, choice)
            gap = math.dist(before.points[-1], after.points[0])
            if choice.id not in seen and gap <= GAP_LIMIT:
                turn = abs(math.remainder(after.start_heading - before.end_heading, math.tau))
                inside = math.fsum(edge.length for edge in (before, after) if edge.junction is not None)
                bends.append((_Bend(round(turn, 3), gap, inside, (before.id, after.id)), choice.id))
        if not bends:
            return way
        way.append(min(bends)[1])
        seen.add(way[-1])


class _Bend(NamedTuple):
    """The transition from a lane to a next lane; the smoothest transition sorts first."""

    turn: float
    """Change of heading between the lanes [rad]."""
    gap: float
    """Gap between the lanes [m]."""
    inside: float
    """Length of the lanes in a joint, a junction that only joins two roads [m].

    Lanes that part in a joint begin with the same heading; the lane that keeps its course is the shortest of these lanes.
    """
    ids: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a pose relative to a line."""

    position: Position
    station: float
    """Station along the track, or along the segment if there is no track [m]."""
    offset: float
    """Offset to the left of the line [m]."""
    heading_error: float
    """Heading of the pose minus direction of the line, in -pi..pi [rad]."""


class Track:
    """Consecutive segments of a metric graph, at least one, such as an itinerary."""

    def __init__(self, segments: Sequence[Segment]) -> None:
        path = join(segments) if segments else None
        if path is None:
            names = [segment.id for segment in segments]
            raise MapError(f"a track needs segments that follow one another, got {names}")
        self.path = path
        self.segments = tuple(segments)
        self._starts: list[float] = []
        station = 0.0
        for i, segment in enumerate(segments):
            if i:
                station += math.dist(segments[i - 1].points[-1], segment.points[0])
            self._starts.append(station)
            station += segment.length

    def project(self, pose: Pose, near: float, window: float = 5.0) -> Place:
        """Project a pose on the track, within `window` of station `near` [m]."""
        station, offset = self.path.project(pose.x, pose.y, near, window)
        error = math.remainder(pose.heading - self.path.pose(station).heading, math.tau)
        return Place(self.position(station), station, offset, error)

    def position(self, station: float) -> Position:
        """Return the position on the metric graph at `station` [m]; in a gap, the end of the segment before the gap."""
        i = max(bisect_right(self._starts, station) - 1, 0)
        segment = self.segments[i]
        return Position(segment.id, min(max(station - self._starts[i], 0.0), segment.length))


class Locator:
    """Finds the segments that a pose can be on, by a grid of cells over the plane."""

    def __init__(self, segments: Iterable[Segment]) -> None:
        self._cells: dict[tuple[int, int], list[tuple[Segment, int]]] = {}
        for segment in segments:
            for i, ((x, y), (u, v)) in enumerate(pairwise(segment.points.tolist())):
                # A cell that the straight piece passes and that is left out is a neighbour of one of these cells.
                steps = max(1, math.ceil(math.dist((x, y), (u, v)) / (_CELL / 2)))
                cells = {
                    (math.floor((x + (u - x) * k / steps) / _CELL), math.floor((y + (v - y) * k / steps) / _CELL))
                    for k in range(steps + 1)
                }
                for cell in cells:
                    self._cells.setdefault(cell, []).append((segment, i))

    def locate(self, pose: Pose, reach: float = 4.0, turn: float = math.pi / 2) -> list[Place]:
        """Return the places of a pose within `reach` of a line [m] and heading along it within `turn` [rad], the best first."""
        if not all(map(math.isfinite, pose)):
            raise MapError(f"a pose needs finite coordinates and heading, got {tuple(pose)}")
        if not 0 < reach <= _REACH:
            raise MapError(f"reach must lie above 0 and up to {_REACH:g} m, got {reach!r}")
        column, row = math.floor(pose.x / _CELL), math.floor(pose.y / _CELL)
        best: dict[str, tuple[float, Place]] = {}
        for cell in ((column + i, row + k) for i in (-1, 0, 1) for k in (-1, 0, 1)):
            for segment, i in self._cells.get(cell, ()):
                start = float(segment.stations[i])
                length = float(segment.stations[i + 1]) - start
                (x, y), (u, v) = segment.points[i].tolist(), segment.points[i + 1].tolist()
                ux, uy = (u - x) / length, (v - y) / length
                along = min(max((pose.x - x) * ux + (pose.y - y) * uy, 0.0), length)
                dx, dy = pose.x - x - along * ux, pose.y - y - along * uy
                distance = math.hypot(dx, dy)
                error = math.remainder(pose.heading - math.atan2(uy, ux), math.tau)
                cost = distance + _PER_RADIAN * abs(error)
                if distance <= reach and abs(error) <= turn and cost < best.get(segment.id, (math.inf,))[0]:
                    place = Place(Position(segment.id, start + along), start + along, ux * dy - uy * dx, error)
                    best[segment.id] = cost, place
        return [place for _, place in sorted(best.values(), key=lambda entry: (entry[0], entry[1].position.segment))]
