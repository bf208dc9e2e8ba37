"""Lanes, movements, conflicts and who gives way against SUMO's networks (only where the eclipse-sumo wheel is installed).

A ``.net.xml`` holds connections lane by lane and per junction a matrix of requests: which connections meet (foes) and which
has to wait for which (response). netconvert writes the same network as OpenDRIVE, with the names of its edges as user data, but
without any sign except lights; so who gives way is compared where equals meet, at lights, and where signs are put up here.
"""

import os
import subprocess
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.draft import Chain
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.geometry.segment import Segment

sumo = pytest.importorskip("sumo")

Lane = tuple[str, int]
"""SUMO's edge, and lane counted from the kerb."""
Way = tuple[Lane, Lane]
Points = NDArray[np.float64]
CAR = 2.6
"""Width of a car and of what it sweeps in a bend [m]."""
TURNS = {"s": "straight", "l": "left", "r": "right"}


@dataclass(frozen=True)
class Net:
    """What SUMO knows of one junction."""

    type: str
    turns: dict[Way, str]
    foes: set[tuple[Way, Way]]
    waits: set[tuple[Way, Way]]
    protected: set[Way]
    """With a green of their own, in which nobody they meet has any; at other times they may have one, too, and wait on it."""


def nets(path: Path) -> dict[str, Net]:
    """Return the junctions of a network by name."""
    root = ElementTree.parse(path).getroot()
    rows = [row for row in root.iter("connection") if not row.get("from", ":").startswith(":")]
    # A turn that waits inside the junction has two lanes there, and the second one has the number.
    second = {f"{row.get('from')}_{row.get('fromLane')}": row.get("via") for row in root.iter("connection") if row.get("via")}
    found = {}
    for element in root.iter("junction"):
        numbers = {lane: k for k, lane in enumerate(element.get("intLanes", "").split())}
        ways = {
            numbers[second.get(row.get("via"), row.get("via"))]: (
                ((row.get("from", ""), int(row.get("fromLane", ""))), (row.get("to", ""), int(row.get("toLane", "")))),
                row.get("dir", ""),
            )
            for row in rows
            if second.get(row.get("via"), row.get("via")) in numbers
        }
        marked: dict[str, set[tuple[Way, Way]]] = {"foes": set(), "response": set()}
        for request in element.iter("request"):
            one = int(request.get("index", ""))
            for name, pairs in marked.items():
                bits = request.get(name, "")[::-1]
                pairs |= {(ways[one][0], ways[k][0]) for k, bit in enumerate(bits) if bit == "1"}
        id, foes = element.get("id", ""), marked["foes"]
        found[id] = Net(element.get("type", ""), dict(ways.values()), foes, marked["response"], protected(root, id, foes))
    return found


def protected(root: ElementTree.Element, id: str, foes: set[tuple[Way, Way]]) -> set[Way]:
    """Return the movements that have green at some time while no foe has."""
    links = {
        ((row.get("from", ""), int(row.get("fromLane", ""))), (row.get("to", ""), int(row.get("toLane", "")))): int(number)
        for row in root.iter("connection")
        if row.get("tl") == id and (number := row.get("linkIndex"))
    }
    states = [row.get("state", "") for logic in root.iter("tlLogic") if logic.get("id") == id for row in logic.iter("phase")]
    greens = [{way for way, number in links.items() if state[number] in "Gg"} for state in states]
    return {way for green in greens for way in green if not any((way, other) in foes for other in green)}


def convert(net: Path, path: Path, *options: str) -> None:
    """Write a network as OpenDRIVE, with the names of its edges."""
    run("netconvert", "-s", str(net), "--output.original-names", "--opendrive-output", str(path), *options)


def run(tool: str, *options: str) -> None:
    home = Path(sumo.SUMO_HOME)
    command = [str(home / "bin" / tool), *options]
    subprocess.run(command, capture_output=True, check=True, env={**os.environ, "SUMO_HOME": str(home)})


def names(path: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Return SUMO's names of the roads and junctions of an OpenDRIVE file."""
    root = ElementTree.parse(path).getroot()
    roads = {road.get("id", ""): data.get("value", "") for road in root.iter("road") for data in road.findall("userData")}
    return roads, {junction.get("id", ""): junction.get("name", "") for junction in root.iter("junction")}


class Ours:
    """A junction of an OpenDRIVE file, its movements by SUMO's names."""

    def __init__(self, road_map: RoadMap, id: str, path: Path) -> None:
        report = road_map.report(id)
        self.junction: Junction = road_map.junction(id)
        self.ways: dict[tuple[int, int], Way] = {}
        lanes = lanes_of(path)
        for way in report.movements:
            one, two = (road_map.graph.edges[edge] for edge in (way.path.entrance, way.path.exit))
            assert isinstance(one, Chain)
            assert isinstance(two, Chain)
            self.ways[way.entrance, way.exit] = lanes[one.road, one.lanes[-1][1]], lanes[two.road, two.lanes[0][1]]

    def pairs(self) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """Yield pairs of movements from different roads."""
        for one, mine in self.ways.items():
            for two, yours in self.ways.items():
                if mine[0][0] != yours[0][0]:
                    yield one, two

    def met_twice(self, one: tuple[int, int], two: tuple[int, int]) -> bool:
        """Whether two movements lead into different lanes of one road: there SUMO keeps a place for both lanes free."""
        return self.ways[one][1][0] == self.ways[two][1][0] and self.ways[one][1] != self.ways[two][1]


def lanes_of(path: Path) -> dict[tuple[str, int], Lane]:
    """Return SUMO's lane per road and lane of an OpenDRIVE file: all its roads are one-way, lane 0 lies at the kerb."""
    root = ElementTree.parse(path).getroot()
    roads, _ = names(path)
    keeps_left = any(road.find("lanes/laneSection/left/lane") is not None for road in root.iter("road"))
    found: dict[tuple[str, int], Lane] = {}
    for road in root.iter("road"):
        ids = sorted(int(lane.get("id", "")) for lane in road.findall("lanes/laneSection/right/lane"))
        if road.get("id") in roads:
            numbered = enumerate(reversed(ids) if keeps_left else ids)
            found |= {(road.get("id", ""), id): (roads[road.get("id", "")], index) for index, id in numbered}
    return found


GRID = ("--grid", "--grid.number", "3", "--grid.length", "150", "--grid.attach-length", "100", "--no-turnarounds")
SPIDER = ("--spider", "--spider.circle-number", "2", "--no-turnarounds", "-L", "2")
RANDOM = ("--rand", "--rand.iterations", "60", "--no-turnarounds", "--rand.min-angle", "30")
SHAPES = {
    **{f"grid{lanes}": (*GRID, "-L", str(lanes)) for lanes in (1, 2, 3)},
    "turns": (*GRID, "-L", "2", "--turn-lanes", "1"),
    **{f"spider{arms}": (*SPIDER, "--spider.arm-number", str(arms)) for arms in (3, 5)},
    **{f"random{seed}": (*RANDOM, "--seed", str(seed), "-L", "4", "--rand.random-lanenumber") for seed in (1, 2)},
}
TYPES = ("priority", "traffic_light", "right_before_left", "priority_stop", "allway_stop")
SIDES = {"right": (), "left": ("--lefthand",)}


def each(shapes: Iterable[str], types: Iterable[str], quick: set[str]) -> pytest.MarkDecorator:
    """Ask for every shape, type and side of traffic; all but the `quick` ones are slow together."""
    cases = {f"{shape}-{type}-{side}": (shape, type, SIDES[side]) for shape, type, side in product(shapes, types, SIDES)}
    assert quick <= cases.keys()
    marked = [pytest.param(*case, id=name, marks=() if name in quick else pytest.mark.slow) for name, case in cases.items()]
    return pytest.mark.parametrize(("shape", "type", "side"), marked)


def made(folder: Path, *options: str) -> tuple[dict[str, Net], Path]:
    """Return SUMO's junctions of a generated net, and the OpenDRIVE file of the same net."""
    net, path = folder / "g.net.xml", folder / "g.xodr"
    run("netgenerate", *options, "-o", str(net))
    convert(net, path, "-o", str(folder / "again.net.xml"))
    return nets(folder / "again.net.xml"), path


def usable(path: Path, theirs: dict[str, Net]) -> Iterator[tuple[Ours, Net]]:
    road_map, (_, called) = read_map(path), names(path)
    for report in road_map.junctions:
        net = theirs[called[report.id]]
        # Two arms are a joint; nothing is asked for at an unregulated node.
        if report.ways == 2 or net.type == "unregulated":
            continue
        assert report.usable, (report.id, report.reason)
        yield Ours(road_map, report.id, path), net


def distance(one: Segment | None, two: Segment | None) -> float:
    """Return the least distance between the points of two lines [m]."""
    assert one is not None
    assert two is not None
    gaps: Points = one.points[:, None] - two.points[None]
    return float(np.hypot(gaps[..., 0], gaps[..., 1]).min())


MOVEMENTS = {
    *("grid1-traffic_light-left", "grid2-priority_stop-right", "grid3-priority-left"),
    *("spider3-allway_stop-left", "spider5-right_before_left-right"),
}


@pytest.mark.extended
@each(SHAPES, TYPES, MOVEMENTS)
def test_movements_and_conflicts(tmp_path: Path, shape: str, type: str, side: tuple[str, ...]) -> None:
    """Every lane to lane connection, every turn, every two that meet.

    Exceptions, counted: into different lanes of one road SUMO lets nobody turn beside another one, as drivers may; and
    at odd angles, since it goes by the order of the roads around a node, bends that come too near for two cars are no foes to it.
    """
    theirs, path = made(tmp_path, *SHAPES[shape], "-j", type, *side)
    count: Counter[str] = Counter()
    for ours, net in usable(path, theirs):
        assert set(ours.ways.values()) == net.turns.keys()
        for key, way in ours.ways.items():
            turn = ours.junction.movements[key].turn.value
            # Partially left or right is straight to the paper, below 44 degrees.
            assert turn == TURNS.get(net.turns[way].lower()) or (net.turns[way] in "LR" and turn == "straight")
        for one, two in ours.pairs():
            mine, yours = (one, two) in (ours.junction.conflicts or ()), (ours.ways[one], ours.ways[two]) in net.foes
            if mine != yours:
                kind = "near" if mine else "beside" if ours.met_twice(one, two) else "missing"
                count[kind] += 1
                if mine:
                    assert one[1] != two[1]
                    assert distance(ours.junction.movements[one].path, ours.junction.movements[two].path) < CAR
            count["pairs"] += 1
    print(shape, type, *side, dict(count))
    assert not count["missing"]
    assert count["pairs"]
    assert not count["near"] or shape.startswith(("random", "spider")), "at right angles lanes cross or keep apart"


EQUALS = {"grid2-right_before_left-left", "grid1-traffic_light-right", "turns-traffic_light-left"}


@pytest.mark.extended
@each(("grid1", "grid2", "grid3", "turns"), ("right_before_left", "traffic_light"), EQUALS)
def test_who_gives_way_among_equals(tmp_path: Path, shape: str, type: str, side: tuple[str, ...]) -> None:
    """Right before left, and at lights who gives way to whom on the same green.

    Exceptions: of two opposite turns across each other SUMO lets one wait, where neither owes the other anything; and turns
    from a lane with an arrow, which have a green of their own, wait in SUMO on the one that they have beside oncoming traffic as
    well. OpenDRIVE has the arrow, not the programme.
    """
    theirs, path = made(tmp_path, *SHAPES[shape], "-j", type, *side)
    compared = 0
    for ours, net in usable(path, theirs):
        junction = ours.junction
        phases = {entrance: k for k, group in enumerate(junction.phase_groups) for entrance in group}
        for one, two in ours.pairs():
            opposite = (one[0], two[0]) in junction.opposite
            if (one, two) not in (junction.conflicts or ()) or (type == "traffic_light" and not opposite):
                continue
            if opposite and junction.movements[one].turn is junction.movements[two].turn is junction.far:
                continue
            compared += 1
            apart = not net.protected.isdisjoint((ours.ways[one], ours.ways[two]))
            assert (phases.get(one[0]) != phases.get(two[0])) == apart
            waits = (ours.ways[one], ours.ways[two]) in net.waits and not apart
            assert ((one, two) in (junction.yields or ())) == waits, (ours.ways[one], ours.ways[two])
    assert compared


NODES = """<nodes><node id="c" x="0" y="0" type="{type}"/><node id="s" x="0" y="-150"/><node id="e" x="150" y="0"/>
<node id="n" x="0" y="150"/><node id="w" x="-150" y="{skew}"/></nodes>"""


@pytest.mark.parametrize("skew", [0, 60])
@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.parametrize(("type", "sign"), [("priority", "205"), ("priority_stop", "206")])
def test_who_gives_way_to_the_major_road(tmp_path: Path, type: str, sign: str, lanes: int, skew: int) -> None:
    """A major road from west to east. The signs that netconvert doesn't write are put up here, by the priorities of the edges."""
    (tmp_path / "n.nod.xml").write_text(NODES.format(type=type, skew=skew), encoding="utf-8")
    major = {"e": 9, "w": 9, "s": 1, "n": 1}
    rows = [
        f'<edge id="{one}{two}" from="{one}" to="{two}" numLanes="{lanes}" priority="{major[arm]}" speed="14"/>'
        for arm in major
        for one, two in ((arm, "c"), ("c", arm))
    ]
    (tmp_path / "n.edg.xml").write_text(f"<edges>{''.join(rows)}</edges>", encoding="utf-8")
    net, path = tmp_path / "n.net.xml", tmp_path / "n.xodr"
    files = ("-n", str(tmp_path / "n.nod.xml"), "-e", str(tmp_path / "n.edg.xml"))
    run("netconvert", *files, "--no-turnarounds", "--output.original-names", "-o", str(net), "--opendrive-output", str(path))
    roads, _ = names(path)
    tree = ElementTree.parse(path)
    for road in tree.getroot().iter("road"):
        name = roads.get(road.get("id", ""), "")
        if name.endswith("c") and major[name[0]] == 1:
            place = {"id": name, "s": str(float(road.get("length", "")) - 2), "t": "-5", "orientation": "+", "dynamic": "no"}
            signals = road.find("signals")
            ElementTree.SubElement(road if signals is None else signals, "signal", {**place, "type": sign, "country": "DE"})
    tree.write(path)
    ((ours, theirs),) = usable(path, {"c": nets(net)["c"]})
    assert ours.junction.control == ("yield" if sign == "205" else "partial")
    waits = {(one, two) for one, two in ours.pairs() if (ours.ways[one], ours.ways[two]) in theirs.waits}
    found = {pair for pair in ours.pairs() if pair in (ours.junction.yields or ())}
    print(sorted(found - waits), sorted(waits - found))
    for one, two in (found ^ waits) & set(ours.junction.conflicts or ()):
        # Between equals SUMO lets a right turn go before whoever comes from its right, and one of two opposite left turns.
        assert major[ours.ways[one][0][0][0]] == major[ours.ways[two][0][0][0]]
