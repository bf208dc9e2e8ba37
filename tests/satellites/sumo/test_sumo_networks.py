"""Networks of SUMO have the lanes, the right of way and the lights of the junction; other junctions are refused."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.opendrive.map_file import NAMES
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Colour, SignalPlan
from pytest_rvads.satellites.sumo import road_network
from pytest_rvads.satellites.sumo.road_network import network
from pytest_rvads.support.errors import RunError, ScenarioError

from .with_sumo import needs_sumo, signed

pytestmark = needs_sumo

STOP, YIELD, NONE, PRIORITY, LIGHTS = (rvads.values.Sign(s) for s in ("stop", "yield", "none", "priority", "lights"))
SHOW = """
import json, sys, libsumo
libsumo.start(["sumo", "--net-file", sys.argv[1], "--step-length", "0.01", "--no-step-log", "--xml-validation", "never"])
shown = []
for _ in range(int(sys.argv[2])):
    libsumo.simulationStep()
    shown.append(libsumo.trafficlight.getRedYellowGreenState("J"))
print(json.dumps(shown))
"""


def made(place: rvads.Junction, rotation: int = 0) -> ET.Element:
    return ET.fromstring(network(place, plan(place, rotation)).text)


def plan(place: rvads.Junction, rotation: int = 0) -> SignalPlan:
    codes = [place.directions(entrance)[0] for entrance in range(len(place.entrances))]
    return rvads.Scenario(place, codes, rotation=rotation).signals()


def points(lane: ET.Element) -> np.ndarray[Any, Any]:
    return np.array([[float(number) for number in point.split(",")[:2]] for point in lane.attrib["shape"].split()])


def ways(root: ET.Element, place: rvads.Junction) -> dict[tuple[int, int], list[ET.Element]]:
    """Return the lanes of SUMO along every movement: the lane in, the lanes within the node, the lane out."""
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    links = {
        (f"{c.attrib['from']}_{c.attrib['fromLane']}", f"{c.attrib['to']}_{c.attrib['toLane']}"): c.get("via")
        for c in root.iter("connection")
    }
    lanes_along = {}
    for entrance, exit in place.movements:
        lane_in, lane_out = place.entrances[entrance], place.exits[exit]
        start, end = f"in{lane_in.arm}_{lane_in.lane}", f"out{lane_out.arm}_{lane_out.lane}"
        within = [links[start, end]]
        while (via := links[within[-1], end]) is not None:  # those who turn left may wait in the middle
            within.append(via)
        lanes_along[entrance, exit] = [lanes[name] for name in (start, *within, end)]
    return lanes_along


@pytest.mark.extended
@pytest.mark.parametrize("name", NAMES)
def test_lanes_follow_the_itineraries(name: str) -> None:
    place = rvads.find(name)
    for (entrance, exit), lanes in ways(made(place), place).items():
        way = itinerary(place, entrance, exit)
        line = np.vstack([points(lane) for lane in lanes])
        length = sum(float(lane.attrib["length"]) for lane in lanes)
        assert length == pytest.approx(way.path.length, abs=0.02)
        station = 0.0
        for x, y in line.tolist():
            station, offset = way.path.project(x, y, station + 1.0, 200.0 if len(line) < 8 else 5.0)
            assert abs(offset) < 0.001
        assert float(lanes[0].attrib["length"]) == pytest.approx(place.approach(entrance), abs=1e-6)


def test_each_lane_ends_at_its_own_stopping_line() -> None:
    place = rvads.find("lanes4")
    lanes = tuple(replace(lane, setback=2.5 + lane.lane) for lane in place.entrances)
    place = replace(place, name="set back", entrances=lanes)
    for (entrance, exit), along in ways(made(place), place).items():
        assert float(along[0].attrib["length"]) == pytest.approx(120.0 - lanes[entrance].setback, abs=1e-6)
        end = place.way_in(entrance).points[-1]
        assert np.hypot(*(points(along[0])[-1] - end)) == pytest.approx(lanes[entrance].setback, abs=1e-6)
        within = sum(float(lane.attrib["length"]) for lane in along[1:-1])
        assert within == pytest.approx(lanes[entrance].setback + place.movements[entrance, exit].length, abs=0.02)


@pytest.mark.parametrize(
    ("place", "kind"),
    [
        (rvads.find("stop4"), "allway_stop"),
        (rvads.find("light3"), "traffic_light"),
        (rvads.find("right4"), "right_before_left"),
        (rvads.find("yield4"), "priority"),
        (rvads.find("roundabout4"), "priority"),
        (signed("stop4", STOP, NONE, STOP, NONE), "priority_stop"),
        (signed("stop4", YIELD, YIELD, YIELD, YIELD), "right_before_left"),
    ],
    ids=lambda item: item if isinstance(item, str) else item.name,
)
def test_junction_gives_a_node_of_its_kind(place: rvads.Junction, kind: str) -> None:
    (node,) = [item for item in made(place).iter("junction") if item.get("id") == "J"]
    assert node.get("type") == kind


@pytest.mark.parametrize(
    ("place", "why"),
    [
        (signed("stop4", STOP, YIELD, PRIORITY, PRIORITY), "it has stop signs beside yield signs"),
        (signed("stop4", LIGHTS, NONE, LIGHTS, NONE), "it has lights at some entrances only"),
        (
            signed("right4", NONE, NONE, NONE, NONE, stated=frozenset({((1, 3), (0, 2))})),
            "it has a right of way that SUMO's network does not have: ",
        ),
    ],
    ids=["two kinds of signs", "some lights", "stated right of way"],
)
def test_junctions_beyond_sumo_are_refused(place: rvads.Junction, why: str) -> None:
    with pytest.raises(ScenarioError, match=rf"^junction 'signed' can't be simulated in SUMO, {why}.*choose another simulator"):
        network(place, plan(place))


@pytest.mark.extended
@pytest.mark.parametrize(("name", "rotation"), [("light4", 0), ("light4", 1), ("light3", 0), ("lanes4", 0)])
def test_lights_follow_the_signal_plan_in_every_step(name: str, rotation: int, tmp_path: Path) -> None:
    place = rvads.find(name)
    signals = plan(place, rotation)
    steps = 2000 * len(signals.groups) + 200  # a cycle, and a little of the next one
    net = network(place, signals)
    (tmp_path / net.name).write_bytes(net.text)
    command = [sys.executable, "-c", SHOW, str(tmp_path / net.name), str(steps)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    shown = json.loads(done.stdout.splitlines()[-1])
    numbers = {(lane.arm, lane.lane): number for number, lane in enumerate(place.entrances)}
    links = {
        int(c.attrib["linkIndex"]): numbers[int(c.attrib["from"][2:]), int(c.attrib["fromLane"])]
        for c in ET.fromstring(net.text).iter("connection")
        if c.get("linkIndex")
    }
    assert len(links) == len(place.movements)
    letters = {Colour.GREEN: "Gg", Colour.YELLOW: "y", Colour.RED: "r"}
    for step in range(steps):
        colours = signals.colours(step * 0.01, len(place.entrances))
        assert all(shown[step][link] in letters[colours[entrance]] for link, entrance in links.items()), step


def test_left_hand_traffic_keeps_left_in_sumo(shared: Path) -> None:
    path = shared / "maps" / "simple_3way_intersection_lht.xodr"
    place = rvads.find("1", map=path)
    assert place.left_hand
    root = made(place)
    assert root.get("lefthand") == "true"
    for (entrance, exit), lanes in ways(root, place).items():
        way = itinerary(place, entrance, exit).path
        for x, y in np.vstack([points(lane) for lane in lanes]).tolist():
            assert min(abs(way.project(x, y, station, 30.0)[1]) for station in range(0, int(way.length), 20)) < 0.05


def test_missing_netconvert_names_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(road_network, "find_spec", lambda _name: None)
    monkeypatch.setenv("SUMO_HOME", "")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RunError, match=r"eclipse-sumo, which is not installed: pip install 'pytest-rvads\[sumo\]'$"):
        road_network.program_and_home.__wrapped__()


def test_failing_netconvert_is_named_with_its_output() -> None:
    with pytest.raises(RunError, match=r"^SUMO's netconvert \(.*\) made no network: .*Error"):
        road_network.netconvert({"node-files": ET.Element("nothing")}, left_hand=False)
