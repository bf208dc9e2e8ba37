"""Metric graphs (paper, section 4.1), and the paths on them through a junction and along its roads.

The edges of a graph are labelled with segments of lane centre line. The paper's ``s(-, eta)``, ``s(eta, -)``, ``s[-, eta]`` and
``s[eta, -]`` are `MetricGraph.before`, `after_end`, `Segment.head` and `Segment.tail`; the paper's concatenation of segments is
`Segment.then`. The graph is the first value that is made from the network of a map file. Arms, ways through a junction and walks
along its roads are found on the graph and its line graph by networkx.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import NamedTuple

import networkx as nx

from pytest_rvads.geometry.network import Network
from pytest_rvads.geometry.segment import GAP_LIMIT, Segment, join
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.errors import MapError

_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Position:
    """A position on a metric graph: a segment and a distance along it, the paper's ``s(-, eta)``."""

    segment: str
    eta: float
    """Distance from the beginning of the segment [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Ride:
    """A ride: consecutive segments from one position to another; the first and the last segment are cut at the positions."""

    segments: tuple[Segment, ...]
    """The segments; empty for the ride from a position to itself."""
    length: float
    """Sum of the lengths of the segments [m]."""

    def path(self) -> Segment | None:
        """Return the concatenation of the segments; None for no segments, or for two segments that are not consecutive."""
        return join(self.segments) if self.segments else None


@dataclass(frozen=True, slots=True)
class Road:
    """A road: a maximal directed path whose inner vertices have one edge in and one edge out."""

    entrance: str
    """First vertex."""
    exit: str
    """Last vertex; the first vertex if the road is a closed loop."""
    segments: tuple[str, ...]
    """Ids of the segments of the road, in order."""


class MetricGraph:
    """The metric graph of a network, on `networkx.MultiDiGraph`, and its line graph."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.edges = network.edges
        self.links = network.links
        """The line graph: an arc leads from the id of a segment to the id of a segment onto which traffic can continue.

        Where lanes merge and fork at a vertex, the line graph has fewer arcs than pairs of segments that meet at the vertex,
        because a file states the links lane by lane.
        """
        self.graph = nx.MultiDiGraph()
        """The metric graph: nodes are names of vertices; an edge has its segment's id as key and the length [m] as ``weight``."""
        # Links identify lane ends: a vertex is a class of linked lane ends, named after the first lane that ends or starts there.
        classes = nx.utils.UnionFind((id, end) for id in self.edges for end in ("start", "end"))
        for lane, next_lane in chain(self.links.edges, *(junction.direct for junction in network.junctions.values())):
            classes.union((lane, "end"), (next_lane, "start"))
        names: dict[tuple[str, str], str] = {}
        self._inside: dict[str, list[str]] = {}
        for id, edge in self.edges.items():
            start, end = (names.setdefault(classes[id, at], f"{id}:{at}") for at in ("start", "end"))
            self.graph.add_edge(start, end, key=id, weight=edge.length)
            if edge.junction is not None:
                self._inside.setdefault(edge.junction, []).append(id)
        self._ends: dict[str, tuple[str, str]] = {key: (u, v) for u, v, key in self.graph.edges(keys=True)}
        self._segments: dict[str, Segment] = {}

    @property
    def segments(self) -> tuple[str, ...]:
        """Ids of all segments."""
        return tuple(self._ends)

    def segment(self, id: str) -> Segment:
        """Return the segment with this id."""
        self.ends(id)
        if id not in self._segments:  # most segments of a town are never used
            edge = self.edges[id]
            turn = Turn.STRAIGHT if edge.junction is None else Turn.of(edge.turning)
            self._segments[id] = Segment(id, edge.points, turn, edge.junction, edge.limits)
        return self._segments[id]

    def inside(self, junction: str) -> Sequence[str]:
        """Return the ids of the segments that lie in a junction, in file order."""
        return self._inside.get(junction, ())

    def ends(self, id: str) -> tuple[str, str]:
        """Return the start vertex and the end vertex of segment `id`."""
        try:
            return self._ends[id]
        except KeyError:
            raise MapError(f"the metric graph has no segment {id!r} among its {len(self._ends)}") from None

    def before(self, id: str, eta: float) -> Position:
        """Return the paper's ``s(-, eta)``, the position `eta` after the beginning of segment `id` [m]."""
        length = self.segment(id).length
        if not -_SAME <= eta <= length + _SAME:
            raise MapError(f"segment {id!r} is {length:.3f} m long and has no position at {eta:.3f} m")
        return Position(id, min(max(eta, 0.0), length))

    def after_end(self, id: str, eta: float) -> Position:
        """Return the position on segment `id` that lies `eta` [m] back from the end, the paper's ``s(eta, -)``."""
        return self.before(id, self.segment(id).length - eta)

    def distance(self, one: Position, two: Position) -> float:
        """Return the paper's ``d_G`` [m]: the length of the shortest ride, 0 for the same place, infinite if no ride exists."""
        ride = self.ride(one, two)
        return math.inf if ride is None else ride.length

    def same(self, one: Position, two: Position) -> bool:
        """Return whether two positions are the same place; the end of a segment and the start of the next are the same vertex."""
        if one.segment == two.segment and abs(one.eta - two.eta) <= _SAME:
            return True
        vertex = self._vertex(one)
        return vertex is not None and vertex == self._vertex(two)

    def ride(self, one: Position, two: Position) -> Ride | None:
        """Return the shortest ride from `one` to `two`; None if no ride exists."""
        if self.same(one, two):
            return Ride((), 0.0)
        first, last = self.segment(one.segment), self.segment(two.segment)
        if one.segment == two.segment and one.eta < two.eta:
            part = first.tail(first.length - one.eta).head(two.eta - one.eta)
            return Ride((part,), part.length)
        source, target = self._ends[one.segment][1], self._ends[two.segment][0]
        lead = first.length - one.eta
        parts = [first.tail(lead)] if lead > _SAME else []
        try:
            nodes = nx.dijkstra_path(self.graph, source, target)
        except nx.NetworkXNoPath:
            return None
        for u, v in pairwise(nodes):
            options = self.graph[u][v]
            parts.append(self.segment(min(options, key=lambda key: options[key]["weight"])))
        if two.eta > _SAME:
            parts.append(last.head(two.eta))
        return Ride(tuple(parts), math.fsum(part.length for part in parts))

    def roads(self) -> Iterator[Road]:
        """Yield the roads: the maximal directed paths outside junctions, each once."""
        outside = [(id, *ends) for id, ends in self._ends.items() if self.edges[id].junction is None]
        starting = {u: id for id, u, _ in outside}
        inner = {v for _, _, v in outside if self.graph.in_degree(v) == 1 == self.graph.out_degree(v) and v in starting}
        done: set[str] = set()
        # First the paths, from their entrances; the remaining segments form closed loops.
        for id, u, _ in [row for row in outside if row[1] not in inner] + outside:
            if id in done:
                continue
            way = [id]
            done.add(id)
            while self._ends[way[-1]][1] in inner and (following := starting[self._ends[way[-1]][1]]) not in done:
                way.append(following)
                done.add(following)
            yield Road(u, self._ends[way[-1]][1], tuple(way))

    def junction(self, id: str) -> nx.MultiDiGraph:
        """Return the sub-graph of junction `id`: the edges in the junction, with their vertices."""
        if not self.inside(id):
            raise MapError(f"no segment of the metric graph lies in a junction {id!r}")
        return self.graph.edge_subgraph((*self._ends[key], key) for key in self.inside(id))

    def _vertex(self, position: Position) -> str | None:
        u, v = self.ends(position.segment)
        if position.eta <= _SAME:
            return u
        return v if position.eta >= self.segment(position.segment).length - _SAME else None


_MOST_STEPS = 300_000


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
                # The smoothest transition sorts first. Of lanes that part in a joint, the shortest keeps its course.
                bends.append((round(turn, 3), gap, inside, before.id, after.id, choice.id))
        if not bends:
            return way
        way.append(min(bends)[-1])
        seen.add(way[-1])
