"""Paths on the line graph of a metric graph: through a junction, and along the roads before and after it."""

from __future__ import annotations

import math
from collections.abc import Container
from typing import NamedTuple

import networkx as nx

from pytest_rvads.geometry.graph import MetricGraph
from pytest_rvads.geometry.network import Edge
from pytest_rvads.geometry.segment import GAP_LIMIT, Turn
from pytest_rvads.support.errors import MapError

__all__ = ["Path", "Route", "paths_of", "walk"]

_MOST_STEPS = 300_000


class Path(NamedTuple):
    """A path through a junction in the file."""

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
    """A route through a junction of a map, from a lane to a lane."""

    entrance: int
    """Number of the entrance."""
    exit: int
    """Number of the exit."""
    turn: Turn
    length: float
    """Length along the lane centre line [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    path: Path


def paths_of(graph: MetricGraph, junction: str) -> list[Path]:
    """Return the shortest path from every entrance edge to every exit edge of `junction`.

    Raises:
        MapError: the lanes of the junction branch so often that the junction can be no intersection.
    """
    edges, links, inside = graph.edges, graph.links, dict.fromkeys(graph.inside(junction))
    starts = dict.fromkeys(lane for id in inside for lane in links.pred[id] if lane not in inside)
    # The junction's part of the line graph. An edge outside may lead both in and out, if a road returns.
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
    """Walk from an edge over road links to the next junction or the end of the road.

    Where lanes merge or fork, the walk follows the lane that continues straightest.

    Args:
        graph: the metric graph of the map.
        start: the edge at which the walk begins.
        upstream: walk against traffic.
        joints: ids of junctions of two arms, through which the walk continues.

    Returns:
        The edges in the order of the walk.
    """
    onward = graph.links.pred if upstream else graph.links.succ
    way = [start]
    seen = {start}
    while True:
        last_edge = graph.edges[way[-1]]
        choices = [graph.edges[id] for id in onward[last_edge.id]]
        if any(choice.junction is not None and choice.junction not in joints for choice in choices):
            return way
        bends = [
            (bend, choice.id)
            for choice in choices
            if choice.id not in seen
            and (bend := _bend(*((choice, last_edge) if upstream else (last_edge, choice)))).gap <= GAP_LIMIT
        ]
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
    """Length inside a joint [m]: lanes that part in a joint begin alike, and the lane that keeps its line is the shortest."""
    ids: tuple[str, str]


def _bend(edge_before: Edge, edge_after: Edge) -> _Bend:
    turn = abs(math.remainder(edge_after.start_heading - edge_before.end_heading, math.tau))
    inside = math.fsum(edge.length for edge in (edge_before, edge_after) if edge.junction is not None)
    return _Bend(round(turn, 3), math.dist(edge_before.points[-1], edge_after.points[0]), inside, (edge_before.id, edge_after.id))
