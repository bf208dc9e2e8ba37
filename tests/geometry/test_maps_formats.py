"""Another map format: a reader of its own, known by its suffix, is all that a usable junction takes."""

import math
import os
from dataclasses import replace
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from pytest_rvads.geometry.control import JunctionControl, MapObject, ObjectKind
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.network import DeclaredJunction, Edge, Network
from pytest_rvads.geometry.road_map import READERS, describe, read_map
from pytest_rvads.support.errors import MapError

STAR = """\
stop
arm south 0 -60
arm east 60 0
arm north 0 60
arm west -60 0
"""


def straight(id: str, road: str, one: np.ndarray, two: np.ndarray, *, forward: bool) -> Edge:
    return Edge(id, road, None, forward, np.array([one, two]), 0.0, 3.0, math.dist(one, two))


def read_star(path: str | os.PathLike[str]) -> Network:
    """Read a junction of straight arms around the origin: what regulates it, then name and far end of each arm."""
    control, *rows = Path(path).read_text(encoding="utf-8").split("\n")
    edges: dict[str, Edge] = {}
    links = nx.DiGraph()
    objects = []
    for _, name, x, y in (row.split() for row in rows if row):
        far = np.array([float(x), float(y)])
        out = far / math.hypot(*far)
        left = np.array([-out[1], out[0]]) * 1.5
        edges[f"{name}.in"] = straight(f"{name}.in", name, far + left, 12 * out + left, forward=False)
        edges[f"{name}.out"] = straight(f"{name}.out", name, 12 * out - left, far - left, forward=True)
        if control == "stop":
            objects.append(MapObject(f"sign.{name}", ObjectKind.STOP, "x", f"{name}.in", edges[f"{name}.in"].length - 2, 2.0))
    lanes = list(edges.values())
    for one in [edge for edge in lanes if not edge.forward]:
        for two in [edge for edge in lanes if edge.forward and edge.road != one.road]:
            turning = math.remainder(two.start_heading - one.end_heading, math.tau)
            id = f"{one.road}-{two.road}"
            edges[id] = replace(straight(id, id, one.points[-1], two.points[0], forward=True), junction="x", turning=turning)
            links.add_edges_from([(one.id, id), (id, two.id)])
    return Network(edges, links, {"x": DeclaredJunction()}, objects=tuple(objects))


@pytest.fixture
def star(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(READERS, ".star", read_star)
    path = tmp_path / "town.STAR"
    path.write_text(STAR, encoding="utf-8")
    return path


def test_a_reader_for_another_suffix_gives_a_usable_junction(star: Path) -> None:
    junction = find("4-way all-way stop with 40 m of approach", star)
    assert (junction.name, junction.id, junction.ways, junction.control) == ("town.x", "x", 4, JunctionControl.STOP)
    assert [junction.movements[0, k].turn.value for k in (1, 2, 3)] == ["right", "straight", "left"]
    assert junction.opposite == {(0, 2), (2, 0), (1, 3), (3, 1)}
    assert junction.right_of == {(1, 0), (2, 1), (3, 2), (0, 3)}
    assert junction.setbacks == (0.0,) * 4, "a sign is no line"
    assert [entrance.sign_setback for entrance in junction.entrances] == [2.0] * 4
    assert junction.approach(0) == pytest.approx(48.0)
    assert junction.movements[0, 2].length == pytest.approx(24.0)


def test_its_map_is_described_as_any_other(star: Path) -> None:
    road_map = read_map(star)
    (row,) = describe(road_map)["junctions"]
    assert row["usable"]
    assert row["approach"] == [48.0] * 4
    assert len(road_map.entex("x")) == 4
    assert road_map.graph.graph.number_of_edges() == 8 + 12
    (path,) = (way.path for way in road_map.report("x").movements if (way.entrance, way.exit) == (0, 1))
    assert (path.entrance, *path.edges, path.exit) == ("south.in", "south-east", "east.out")


def test_the_suffix_decides(star: Path, tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"not XML: .*expected an OpenDRIVE file"):
        read_map(star.rename(tmp_path / "town.xodr"))


def test_unknown_ids_of_a_network_are_refused() -> None:
    lane = straight("a", "r", np.array([0.0, 0.0]), np.array([9.0, 0.0]), forward=True)
    with pytest.raises(MapError, match="names the edge 'b' but has no edge"):
        Network({"a": lane}, nx.DiGraph([("a", "b")]), {})
    with pytest.raises(MapError, match="names the junction 'x' but has no junction"):
        Network({"a": replace(lane, junction="x")}, nx.DiGraph(), {})
