"""The algebra of metric graphs: positions, segments, rides, distance, roads, junctions, entex."""

import math
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.graph import MetricGraph, Position
from pytest_rvads.geometry.network import Edge, Network
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.errors import MapError

QUICK = settings(derandomize=True, deadline=None, max_examples=60)


@pytest.fixture(scope="module")
def stop4() -> RoadMap:
    return read_map(path_of("stop4"))


def positions(graph: MetricGraph) -> st.SearchStrategy[Position]:
    pair = st.tuples(st.sampled_from(graph.segments), st.floats(0, 1))
    return pair.map(lambda p: graph.before(p[0], p[1] * graph.segment(p[0]).length))


def test_vertices_and_edges_of_an_x(stop4: RoadMap) -> None:
    graph = stop4.graph.graph
    # 4 entrances, 4 exits, and the far ends of 4 roads in both directions.
    assert graph.number_of_nodes() == 16
    assert graph.number_of_edges() == 8 + 12
    assert sorted(d for _, d in graph.out_degree()) == [0] * 4 + [1] * 8 + [3] * 4
    assert all(
        stop4.graph.segment(id).length == pytest.approx(length) and length > 0
        for _, _, id, length in graph.edges(keys=True, data="weight")
    )


def test_roads_are_maximal_paths(stop4: RoadMap) -> None:
    roads = list(stop4.graph.roads())
    assert len(roads) == 8
    assert sorted(id for road in roads for id in road.segments) == sorted(
        i for i in stop4.graph.segments if stop4.graph.segment(i).junction is None
    )


def test_roads_of_a_town(shared: Path) -> None:
    graph = read_map(shared / "maps" / "Town07.xodr").graph
    seen: list[str] = []
    for road in graph.roads():
        seen += road.segments
        ends = [graph.ends(id) for id in road.segments]
        assert (ends[0][0], ends[-1][1]) == (road.entrance, road.exit)
        for (_, v), (w, _) in pairwise(ends):
            assert v == w
            assert graph.graph.in_degree(v) == graph.graph.out_degree(v) == 1
    assert sorted(seen) == sorted(id for id in graph.segments if graph.segment(id).junction is None)


def test_the_junction_is_the_rest(stop4: RoadMap) -> None:
    junction = stop4.graph.junction("1")
    assert junction.number_of_edges() == 12
    assert junction.number_of_nodes() == 8
    with pytest.raises(MapError, match="no segment of the metric graph lies in a junction 'x'"):
        stop4.graph.junction("x")


def test_entex_joins_the_two_directions_of_an_arm(stop4: RoadMap) -> None:
    entex = stop4.entex("1")
    assert len(entex) == 4
    for entrance, exit in entex.items():
        ((_, _, into),) = stop4.graph.graph.in_edges(entrance, keys=True)
        ((_, _, out),) = stop4.graph.graph.out_edges(exit, keys=True)
        assert math.dist(stop4.graph.segment(into).points[-1], stop4.graph.segment(out).points[0]) == pytest.approx(3.5)


def test_predicates_follow_the_table_of_semantics(stop4: RoadMap) -> None:
    """Evaluate right-of and opposite on the graph itself, by the paper's words."""
    graph, entex = stop4.graph, stop4.entex("1")
    junction = graph.junction("1")
    moves = [(u, v, graph.segment(id).turn) for u, v, id in junction.edges(keys=True)]
    report = stop4.report("1")
    number = {graph.ends(arm.entrances[0])[1]: i for i, arm in enumerate(report.arms)}
    right_of = {
        (number[v1], number[v2])
        for v1, v3, t1 in moves
        for v2, v4, t2 in moves
        if v3 == v4 and (t1, t2) in {(Turn.RIGHT, Turn.STRAIGHT), (Turn.STRAIGHT, Turn.LEFT)}
    }
    opposite = {
        (number[v1], number[v2])
        for v1, v3, t1 in moves
        for v2, v4, t2 in moves
        if t1 == t2 == Turn.STRAIGHT and entex[v1] == v4 and entex[v2] == v3
    }
    assert right_of == report.right_of
    assert opposite == report.opposite


@given(data=st.data())
@QUICK
def test_parts_of_a_segment_add_up(stop4: RoadMap, data: st.DataObject) -> None:
    segment = stop4.graph.segment(data.draw(st.sampled_from(stop4.graph.segments)))
    eta = data.draw(st.floats(0.01, 0.99)) * segment.length
    head, tail = segment.head(eta), segment.tail(segment.length - eta)
    assert head.length == pytest.approx(eta)
    whole = head.then(tail)
    assert whole is not None
    assert whole.length == pytest.approx(segment.length)
    assert stop4.graph.before(segment.id, eta).eta == pytest.approx(stop4.graph.after_end(segment.id, segment.length - eta).eta)


def test_concatenation_is_partial(stop4: RoadMap) -> None:
    graph = stop4.graph
    one = graph.segment("0.0.1")
    following = {v: key for _, v, key in graph.graph.out_edges(graph.ends("0.0.1")[1], keys=True)}
    for key in following.values():
        assert one.then(graph.segment(key)) is not None
    assert one.then(graph.segment("2.0.1")) is None
    with pytest.raises(MapError, match=r"is 120.000 m long and has no position at 121.000 m"):
        graph.before("0.0.1", 121)
    with pytest.raises(MapError, match="no segment 'x'"):
        graph.segment("x")


@given(data=st.data())
@QUICK
def test_distance_laws(stop4: RoadMap, data: st.DataObject) -> None:
    graph = stop4.graph
    p, q, r = (data.draw(positions(graph)) for _ in range(3))
    assert graph.distance(p, p) == 0
    assert graph.distance(p, r) <= graph.distance(p, q) + graph.distance(q, r) + 1e-6
    ride = graph.ride(p, q)
    if ride is None:
        assert graph.distance(p, q) == math.inf
    else:
        assert graph.distance(p, q) == pytest.approx(sum(s.length for s in ride.segments))
        assert ride.segments == () or ride.path() is not None


def test_distances_by_hand(stop4: RoadMap) -> None:
    graph = stop4.graph
    start = graph.after_end("0.0.1", 20.0)
    # Straight on: 20 m to the vertex, 30 m through the junction, 5 m down the road.
    assert graph.distance(start, graph.before("2.0.-1", 5.0)) == pytest.approx(55.0, abs=1e-6)
    assert graph.distance(graph.before("2.0.-1", 5.0), start) == math.inf
    assert graph.distance(start, graph.after_end("0.0.1", 5.0)) == pytest.approx(15.0)
    assert graph.distance(graph.after_end("0.0.1", 5.0), start) == math.inf


def test_the_end_of_a_segment_is_the_start_of_the_next(stop4: RoadMap) -> None:
    graph = stop4.graph
    vertex = graph.ends("0.0.1")[1]
    for _, _, key in graph.graph.out_edges(vertex, keys=True):
        assert graph.same(graph.after_end("0.0.1", 0.0), Position(key, 0.0))
        assert graph.distance(graph.after_end("0.0.1", 0.0), Position(key, 0.0)) == 0


def test_closed_loops_are_roads_too() -> None:
    corners = [(0.0, 0.0), (10.0, 0.0), (5.0, 8.0)]
    edges = {}
    for i in range(3):
        one, two = corners[i], corners[(i + 1) % 3]
        edges[f"s{i}"] = Edge(f"s{i}", f"r{i}", None, True, np.array([one, two]), 0.0, 3.5, math.dist(one, two))
    loop = MetricGraph(Network(edges, nx.DiGraph([("s0", "s1"), ("s1", "s2"), ("s2", "s0")]), {}))
    (road,) = loop.roads()
    assert set(road.segments) == {"s0", "s1", "s2"}
    assert road.entrance == road.exit
    # Around the loop and back to just behind the start.
    total = sum(loop.segment(id).length for id in loop.segments)
    assert loop.distance(Position("s0", 5.0), Position("s0", 4.0)) == pytest.approx(total - 1.0)
