"""Movements and turn types against SUMO's ``netconvert`` (only where the eclipse-sumo wheel is installed).

netconvert keeps of every lane which one of the OpenDRIVE file it was, so movements are compared lane by lane, in both directions:
it has every one of ours, and we all of its, but for those that we say we left out since their lanes don't meet.
"""

import math
import re
import subprocess
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.graph import Route
from pytest_rvads.geometry.opendrive.draft import Chain
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.geometry.turns import Turn

sumo = pytest.importorskip("sumo")

STEMS = [
    *("Town01", "Town04", "Town07", "multi_intersections", "Crossing8Course", "fabriksgatan", "fabriksgatan_traffic_lights"),
    *("simple_4way_intersection", "simple_3way_intersection_lht", "intersection_3_5m_width", "cubetown", "Issue295a"),
    *("sumo_stop4", "sumo_lights4", "sumo_t3", "sumo_skew4"),
]
TURNS = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right"}
OTHER = {"Town04": {"partial": 8, "chord": 8}, "Issue295a": {"partial": 4}}
"""How many turn types are not SUMO's, by the reason that `reason` makes sure of."""
LIMIT = 44.0
"""From which change of direction on a movement is a turn, to SUMO as to us [deg]."""

Points = NDArray[np.float64]
Lanes = tuple[str, str]
"""Where a movement comes from and goes to: ``road_lane`` of the OpenDRIVE file."""


@dataclass(frozen=True)
class Connection:
    """What netconvert knows of a movement."""

    turn: str
    angle: float
    """From the last chord of netconvert's line of the one road to the first chord of the other one, to the left [deg]."""


def connections(path: Path, out: Path) -> dict[str, dict[Lanes, Connection]]:
    """Return the movements that netconvert finds, by junction and lanes."""
    # netconvert reads no `rule`. Told to keep left, it takes the lanes of the other side, and puts them where the file's lie.
    left_hand = 'rule="LHT"' in path.read_text(encoding="utf-8")
    options = ("--opendrive", str(path), "-o", str(out), "--output.original-names", *(("--lefthand",) if left_hand else ()))
    subprocess.run([str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), *options], capture_output=True, check=True)
    root = ElementTree.parse(out).getroot()
    nodes = {node.get("id", ""): [[float(node.get("x", "")), float(node.get("y", ""))]] for node in root.iter("junction")}
    edges = {edge.get("id", ""): edge for edge in root.iter("edge")}
    lanes = {}
    for lane in root.iter("lane"):
        for name in (row.get("value", "") for row in lane.iter("param") if row.get("key") == "origId"):
            road, number = name.rsplit("_", 1)
            lanes[lane.get("id", "")] = f"{road}_{-int(number) if left_hand else number}"

    def line(edge: ElementTree.Element) -> Points:
        """Return the line that netconvert gives an edge; where it writes none, from node to node."""
        if shape := edge.get("shape"):
            return np.array([[float(value) for value in place.split(",")[:2]] for place in shape.split()])
        return np.array(nodes[edge.get("from", "")] + nodes[edge.get("to", "")])

    found: dict[str, dict[Lanes, Connection]] = {}
    for row in root.iter("connection"):
        one, two = (row.get(name, "") for name in ("from", "to"))
        if not one.startswith(":"):
            node = edges[one].get("to", "")
            key = lanes[f"{one}_{row.get('fromLane')}"], lanes[f"{two}_{row.get('toLane')}"]
            angle = math.remainder(direction(line(edges[two])[:2]) - direction(line(edges[one])[-2:]), 360)
            assert key not in found.setdefault(node, {})
            found[node][key] = Connection(row.get("dir", ""), angle)
    return found


def direction(chord: Points) -> float:
    """Return the direction from one place to the next one [deg]."""
    return math.degrees(math.atan2(*(chord[1] - chord[0])[::-1]))


def compare(path: Path, out: Path) -> tuple[int, Counter[str]]:
    """Hold every movement at a usable junction against netconvert's; return how many, and the other turn types by reason."""
    road_map, found = read_map(path), connections(path, out)
    compared, other = 0, Counter[str]()
    for report in road_map.junctions:
        if not report.usable:
            continue
        ours, theirs = {ends(road_map, way): way for way in report.movements}, found[report.id]
        assert ours.keys() <= theirs.keys(), f"netconvert has no movements {sorted(ours.keys() - theirs.keys())}"
        assert len(ours) == len(report.movements)
        rest = sorted(theirs.keys() - ours.keys())
        assert len(rest) == left_out(road_map, report.id), f"only netconvert has {rest}"
        compared += len(ours)
        for lanes, way in ours.items():
            # What `reason` says of chords holds for every movement: SUMO goes by the angle between them.
            assert theirs[lanes].turn in "LR" or (theirs[lanes].turn == "s") == (abs(theirs[lanes].angle) < LIMIT)
            if TURNS.get(theirs[lanes].turn) != way.turn.value:
                other[reason(report, way, theirs[lanes])] += 1
    return compared, other


def ends(road_map: RoadMap, way: Route) -> Lanes:
    """Return the lanes where a movement begins and ends."""
    one, two = (road_map.graph.edges[edge] for edge in (way.path.entrance, way.path.exit))
    assert isinstance(one, Chain)
    assert isinstance(two, Chain)
    return f"{one.road}_{one.lanes[-1][1]}", f"{two.road}_{two.lanes[0][1]}"


def left_out(road_map: RoadMap, junction: str) -> int:
    """Return how many movements of a junction our warnings say are left out, because their lanes don't meet."""
    said = [re.match(r"(\d+) of \d+ movements", doubt.message) for doubt in road_map.warnings if doubt.junction == junction]
    return sum(int(match[1]) for match in said if match)


def reason(report: JunctionReport, way: Route, theirs: Connection) -> str:
    """Return why a movement is straight to the paper, and a turn to SUMO."""
    assert way.turn is Turn.STRAIGHT
    arm, bend = report.entrances[way.entrance].arm, abs(way.turning)
    if theirs.turn in "LR":
        # "Partially" left or right, since another one leads straighter on, or as straight: from 5 regular arms two do.
        mates = [mate for mate in report.movements if mate.exit != way.exit and report.entrances[mate.entrance].arm == arm]
        assert min(abs(mate.turning) for mate in mates) < bend + math.radians(0.1)
        return "partial"
    # netconvert draws bends as chords of 2 m, and half a chord at either end adds to the turn where all three roads bend alike.
    assert LIMIT - 3 < math.degrees(bend) < LIMIT <= abs(theirs.angle) < LIMIT + 3
    assert TURNS[theirs.turn] == ("left" if way.turning > 0 else "right")
    return "chord"


@pytest.mark.extended
@pytest.mark.parametrize("stem", STEMS)
def test_turn_types(shared: Path, tmp_path: Path, stem: str) -> None:
    compared, other = compare(shared / "maps" / f"{stem}.xodr", tmp_path / "net.xml")
    print(f"{stem}: {compared} movements, with another turn type {dict(other)}")
    assert compared
    assert other == OTHER.get(stem, {})


GRID = ("--grid", "--grid.number", "3", "--grid.length", "120", "--grid.attach-length", "100")
SPIDER = ("--spider", "--spider.circle-number", "1", "--spider.arm-number")


@pytest.mark.extended
@pytest.mark.parametrize("left_hand", [False, True], ids=["right", "left"])
@pytest.mark.parametrize(
    ("shape", "type", "expected"),
    [
        (GRID, "priority", {(4, "none"): 9}),
        (GRID, "traffic_light", {(4, "lights"): 9}),
        ((*SPIDER, "5"), "priority", {(5, "none"): 1, (3, "none"): 5}),
        ((*SPIDER, "8"), "priority", {(8, "none"): 1, (3, "none"): 8}),
    ],
    ids=["grid", "lights", "spider5", "spider8"],
)
def test_generated_maps(tmp_path: Path, shape: tuple[str, ...], type: str, expected: dict[str, Any], left_hand: bool) -> None:
    """Ways, control and side of traffic as netgenerate was told; no road of these files states on which side traffic keeps."""
    home, net, path = Path(sumo.SUMO_HOME) / "bin", tmp_path / "g.net.xml", tmp_path / "g.xodr"
    side = ("--lefthand",) if left_hand else ()
    make = [str(home / "netgenerate"), *shape, "-j", type, "--no-turnarounds", "-o", str(net), *side]
    subprocess.run(make, capture_output=True, check=True)
    subprocess.run([str(home / "netconvert"), "-s", str(net), "--opendrive-output", str(path)], capture_output=True, check=True)
    reports = read_map(path).junctions
    found: dict[tuple[int, str], int] = {}
    for report in reports:
        assert report.usable, report.reason
        found[report.ways, report.control.value] = found.get((report.ways, report.control.value), 0) + 1
    assert found == expected
    assert {report.left_hand for report in reports} == {left_hand}
    assert 'rule="' not in path.read_text(encoding="utf-8")
    _, other = compare(path, tmp_path / "back.net.xml")
    assert other.keys() <= {"partial"}


@pytest.mark.parametrize("name", ["lanes4", "yield4", "stop3"])
def test_movements_of_a_junction_written_from_its_centre_lines(tmp_path: Path, name: str) -> None:
    (tmp_path / "town.osm").write_text("<osm/>", encoding="utf-8")
    place = replace(find(name), map=str(tmp_path / "town.osm"))
    path = tmp_path / "written.xodr"
    path.write_text(place.opendrive(), encoding="utf-8")
    found = connections(path, tmp_path / "net.xml")[place.id]
    turns = {
        (f"{entrance}_1", f"{len(place.entrances) + exit}_-1"): way.turn.value
        for (entrance, exit), way in place.movements.items()
    }
    assert {lanes: TURNS[way.turn] for lanes, way in found.items()} == turns
