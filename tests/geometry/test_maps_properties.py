"""What must not matter: the order of elements, names, orientations of signals, where the map lies and how it is turned."""

import math
import random
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.analysis import JunctionReport, LaneEnd
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.road_map import RoadMap, read_map
from tools.crossings import Layout, opendrive

FILES = (
    "cubetown",
    "sumo_skew4",
    "sumo_stop4",
    "fabriksgatan_traffic_lights",
    "simple_3way_intersection_lht",
    "multi_intersections",
)
FEW = settings(derandomize=True, deadline=None, max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])


def sources(shared: Path) -> list[bytes]:
    own = [
        opendrive(Layout(3, JunctionControl.LIGHTS)),
        opendrive(Layout(5, JunctionControl.STOP, stop=25, setback=3, left_hand=True)),
    ]
    return [text.encode() for text in own] + [(shared / "maps" / f"{stem}.xodr").read_bytes() for stem in FILES]


def shape(report: JunctionReport, first: int = 0) -> tuple[object, ...]:
    """Return all of a junction that does not depend on names and places, counting arms from `first`."""
    n = report.ways

    def turned(arm: int) -> int:
        return (arm - first) % n

    def place(end: LaneEnd) -> tuple[int, int]:
        return turned(end.arm), end.lane

    ins, outs = [place(end) for end in report.entrances], [place(end) for end in report.exits]
    lengths = zip(ins, report.approach, report.setbacks, strict=True)
    return (
        n,
        report.control,
        report.usable,
        sorted((ins[w.entrance], outs[w.exit], w.turn, round(w.length, 2), round(w.turning, 3)) for w in report.movements),
        sorted((end, round(approach, 2), round(back, 2)) for end, approach, back in lengths),
        sorted((turned(a), turned(b)) for a, b in report.right_of),
        sorted((turned(a), turned(b)) for a, b in report.opposite),
        {frozenset(ins[entrance] for entrance in group) for group in report.phase_groups},
        report.left_hand,
    )


def same_graph(one: RoadMap, two: RoadMap) -> None:
    """Compare the invariants of two metric graphs that ought to be isomorphic."""

    def profile(road_map: RoadMap) -> list[tuple[object, ...]]:
        graph = road_map.graph
        rows = []
        for id in graph.segments:
            u, v = graph.ends(id)
            segment = graph.segment(id)
            degrees = [d(x) for x in (u, v) for d in (graph.graph.in_degree, graph.graph.out_degree)]
            rows.append((round(segment.length, 2), segment.turn.value, segment.junction is None, *degrees))
        return sorted(rows)

    assert profile(one) == profile(two)


def read(path: Path, root: Element) -> RoadMap:
    path.write_bytes(ElementTree.tostring(root))
    return read_map(path)


def change(shared: Path, tmp_path: Path, data: st.DataObject, how: Callable[[Element], None]) -> tuple[RoadMap, RoadMap]:
    source = data.draw(st.sampled_from(sources(shared)))
    before = read(tmp_path / "before.xodr", ElementTree.fromstring(source))
    root = ElementTree.fromstring(source)
    how(root)
    return before, read(tmp_path / "after.xodr", root)


def shuffle(root: Element, seed: int) -> None:
    chance = random.Random(seed)
    for element in root.iter():
        children = list(element)
        chance.shuffle(children)
        element[:] = children


def flip(root: Element) -> None:
    for signals in root.iter("signals"):
        for signal in signals:
            signal.set("orientation", {"+": "-", "-": "+"}.get(signal.get("orientation", ""), "+"))


def move(root: Element, angle: float, east: float, north: float) -> None:
    for geometry in root.iter("geometry"):
        x, y, heading = (float(geometry.get(name)) for name in ("x", "y", "hdg"))
        geometry.set("x", repr(east + x * math.cos(angle) - y * math.sin(angle)))
        geometry.set("y", repr(north + x * math.sin(angle) + y * math.cos(angle)))
        geometry.set("hdg", repr(heading + angle))


@given(data=st.data(), seed=st.integers(0, 1000))
@FEW
def test_order_of_elements(shared: Path, tmp_path: Path, data: st.DataObject, seed: int) -> None:
    before, after = change(shared, tmp_path, data, partial(shuffle, seed=seed))
    assert {r.id: shape(r) for r in before.junctions} == {r.id: shape(r) for r in after.junctions}
    same_graph(before, after)


@given(data=st.data())
@FEW
def test_names(shared: Path, tmp_path: Path, data: st.DataObject) -> None:
    def rename(root: Element) -> None:
        for road in root.iter("road"):
            road.set("id", f"Straße {road.get('id')}.")
            if road.get("junction") != "-1":
                road.set("junction", f"J {road.get('junction')}")
            for link in road.findall("link/*"):
                prefix = "J {}" if link.get("elementType") == "junction" else "Straße {}."
                link.set("elementId", prefix.format(link.get("elementId")))
            for signal in road.findall("signals/*"):
                signal.set("id", f"sig {signal.get('id')}")
        for control in root.findall("controller/control"):
            control.set("signalId", f"sig {control.get('signalId')}")
        for junction in root.iter("junction"):
            junction.set("id", f"J {junction.get('id')}")
            for row in junction.findall("connection"):
                for name in ("incomingRoad", "connectingRoad"):
                    row.set(name, f"Straße {row.get(name)}.")

    before, after = change(shared, tmp_path, data, rename)
    assert {f"J {r.id}": shape(r) for r in before.junctions} == {r.id: shape(r) for r in after.junctions}
    same_graph(before, after)


@pytest.mark.extended
@given(data=st.data())
@FEW
def test_orientation_of_signals(shared: Path, tmp_path: Path, data: st.DataObject) -> None:
    before, after = change(shared, tmp_path, data, flip)
    assert {r.id: shape(r) for r in before.junctions} == {r.id: shape(r) for r in after.junctions}


@pytest.mark.extended
@given(data=st.data(), angle=st.floats(-math.pi, math.pi), east=st.floats(-1e5, 1e5), north=st.floats(-1e5, 1e5))
@FEW
def test_where_the_map_lies(shared: Path, tmp_path: Path, data: st.DataObject, angle: float, east: float, north: float) -> None:
    before, after = change(shared, tmp_path, data, partial(move, angle=angle, east=east, north=north))
    for one, two in zip(before.junctions, after.junctions, strict=True):
        # Arms are counted from the south, so the numbers turn with the map; what is between them does not.
        assert any(shape(one) == shape(two, first) for first in range(two.ways))
    same_graph(before, after)


@cache
def town(path: Path) -> RoadMap:
    return read_map(path)


@pytest.mark.extended
@pytest.mark.parametrize("stem", ["Town07", "Issue295a"])
@pytest.mark.parametrize(
    ("how", "turned"),
    [(partial(shuffle, seed=7), False), (flip, False), (partial(move, angle=2.1, east=4e4, north=-3e4), True)],
    ids=["order", "flip", "move"],
)
def test_whole_towns(shared: Path, tmp_path: Path, stem: str, how: Callable[[Element], None], turned: bool) -> None:
    """Many lane sections, references to signals, splines: what the small files hardly have."""
    source = shared / "maps" / f"{stem}.xodr"
    root = ElementTree.fromstring(source.read_bytes())
    how(root)
    one, two = town(source), read(tmp_path / "after.xodr", root)
    reports = {report.id: report for report in two.junctions}
    for report in one.junctions:
        other = reports[report.id]
        assert any(shape(report) == shape(other, first) for first in range(other.ways if turned and other.ways else 1))
    same_graph(one, two)


@pytest.mark.parametrize("namespace", ["http://code.asam.net/simulation/standard/opendrive_schema", "x"])
def test_namespaces(tmp_path: Path, namespace: str) -> None:
    text = opendrive(Layout(4, JunctionControl.LIGHTS))
    path = tmp_path / "plain.xodr"
    path.write_text(text, encoding="utf-8")
    spaced = tmp_path / "spaced.xodr"
    spaced.write_text(text.replace("<OpenDRIVE>", f'<OpenDRIVE xmlns="{namespace}">'), encoding="utf-8")
    assert shape(read_map(path).junctions[0]) == shape(read_map(spaced).junctions[0])
