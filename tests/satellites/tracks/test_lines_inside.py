"""Stop lines that are painted behind the end of the incoming lane: where they lie, and what that means for logs and drivers.

The layouts have their arms along the axes, and the lanes of arm 0 end 15 m south of the centre. So the place of a line follows
from its distance on the straight way by hand.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.logic.check import check
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tools.crossings import Layout, opendrive

FORMS = ("signal", "across", "along")


def paint(road: Element, id: str, s: float, form: str, t: float = 0.0, length: float = 3.5) -> None:
    """Add a stop line: a signal, an object whose length lies across the road, or an object whose width does."""
    place = {"id": id, "name": "StopLine", "s": repr(s), "t": repr(t), "zOffset": "0", "orientation": "-", "type": "-1"}
    if form == "signal":
        SubElement(SubElement(road, "signals"), "signal", place | {"dynamic": "no", "subtype": "-1", "country": "OpenDRIVE"})
    elif form == "across":
        SubElement(SubElement(road, "objects"), "object", place | {"hdg": "-1.5708", "length": repr(length), "width": "0"})
    else:
        SubElement(SubElement(road, "objects"), "object", place | {"hdg": "0", "length": "0.3", "width": repr(length)})


def layout(**shape: Any) -> Element:
    """Return a layout without the lines that the writer draws at the ends of the lanes."""
    root = ElementTree.fromstring(opendrive(Layout(**shape)).encode())
    for road in root.iter("road"):
        for objects in road.findall("objects"):
            road.remove(objects)
    return root


def lined(depths: dict[tuple[int, int], float], form: str = "across", **shape: Any) -> Element:
    """Return a layout with lines on ways, given by their arms, `depths` [m] behind the end of the incoming lane."""
    root = layout(**shape)
    for road in root.iter("road"):
        ends = road.find("link/predecessor"), road.find("link/successor")
        if road.get("junction") == "1" and None not in ends:
            arms = tuple(int(end.get("elementId")) for end in ends)
            if arms in depths:
                paint(road, f"line{arms}", depths[arms], form)
    return root


def saved(root: Element, path: Path) -> str:
    path.write_bytes(ElementTree.tostring(root))
    return str(path)


STRAIGHT = [(0, 2), (1, 3), (2, 0), (3, 1)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("left_hand", [False, True])
def test_line_lies_where_it_is_painted(tmp_path: Path, form: str, left_hand: bool) -> None:
    path = saved(lined(dict.fromkeys(STRAIGHT, 3.0), form, left_hand=left_hand), tmp_path / "x.xodr")
    junction = find("1", path)
    assert junction.setbacks == pytest.approx((-3.0,) * 4, abs=1e-4)
    assert junction.approach(0) == pytest.approx(123.0, abs=1e-3)  # the approach of the layout is 120 m long
    line = junction.entrances[0].stop_line
    assert line is not None
    assert line == pytest.approx((-1.75 if left_hand else 1.75, -12.0, np.pi / 2), abs=1e-3)
    assert not [warning for warning in read_map(path).warnings if "line" in warning.message]


def test_every_arm_has_its_own_line(tmp_path: Path) -> None:
    depths = {(0, 1): 3.0, (1, 3): 0.5, (1, 2): 0.5, (2, 0): 2.0}  # on the turning way alone, on two ways, on the straight way
    root = lined(depths)
    road = next(road for road in root.iter("road") if road.get("id") == "3")
    paint(road, "before", 1.5, "across", t=-1.75 if road.find(".//lane[@id='-1']") is None else 1.75)
    junction = find("1", saved(root, tmp_path / "x.xodr"))
    assert junction.setbacks == pytest.approx((-3.0, -0.5, -2.0, 1.5), abs=0.05)


def test_line_may_be_on_the_road_of_another_way(tmp_path: Path) -> None:
    root = layout()
    for road in root.iter("road"):
        ends = road.find("link/predecessor"), road.find("link/successor")
        if road.get("junction") == "1" and [end.get("elementId") for end in ends if end is not None] == ["0", "2"]:
            paint(road, "far", 28.0, "across", t=3.5)  # 2 m before the end of its way, over the lane from the north
    junction = find("1", saved(root, tmp_path / "x.xodr"))
    assert junction.setbacks == pytest.approx((0.0, 0.0, -2.0, 0.0), abs=1e-4)


def test_lanes_side_by_side_have_a_line_each(tmp_path: Path) -> None:
    lanes = (((1, 2), (2, 3)),) * 4
    root = layout(stop=25.0, lanes=lanes, exits=(2,) * 4, control=JunctionControl.LIGHTS)
    roads = [road for road in root.iter("road") if road.get("junction") == "1"]
    ends = [[road.find(f"link/{tag}").get("elementId") for tag in ("predecessor", "successor")] for road in roads]
    straight = [road for road, arms in zip(roads, ends, strict=True) if arms == ["0", "2"]]
    for depth, road in zip((1.0, 3.0), straight, strict=True):
        paint(road, f"line{depth}", depth, "across")
    assert sorted(find("1", saved(root, tmp_path / "x.xodr")).setbacks[:2]) == pytest.approx([-3.0, -1.0], abs=1e-4)
    for element in (*straight[1].iter("objects"),):
        straight[1].remove(element)
    for objects in straight[0].iter("object"):
        objects.set("length", "10.5")  # one line over both lanes
    assert find("1", saved(root, tmp_path / "y.xodr")).setbacks[:2] == pytest.approx((-1.0, -1.0), abs=1e-4)


def test_lines_where_ways_have_met_are_counted(tmp_path: Path) -> None:
    # The straight ways cross 15 - 1.75 m behind the ends of the lanes, and are in conflict from 2.6 m before that.
    path = saved(lined(dict.fromkeys(STRAIGHT[:3], 11.0)), tmp_path / "x.xodr")
    junction = find("1", path)
    assert junction.setbacks == (0.0,) * 4
    assert [lane.beyond for lane in junction.entrances] == [pytest.approx(11.0, abs=1e-4)] * 3 + [None]
    (message,) = [warning.message for warning in read_map(path).warnings if "stop line" in warning.message]
    assert message.startswith("3 stop lines of junction '1' lie up to 11.0 m behind the end of the lane, where ways have met")


@pytest.mark.parametrize("stop", [8.0, 25.0])
@pytest.mark.parametrize("left_hand", [False, True])
def test_line_is_used_up_to_the_place_where_ways_first_meet(tmp_path: Path, stop: float, left_hand: bool) -> None:
    """From there on, a vehicle that waits is in the way of vehicles from other lanes: centre lines are nearer than 2.6 m."""
    bare = find("1", saved(layout(stop=stop, left_hand=left_hand), tmp_path / "bare.xodr"))
    paths = [(way.entrance, way.path.points, way.path.stations) for way in bare.movements.values() if way.path is not None]
    others = np.vstack([points for entrance, points, _ in paths if entrance != 0])
    near = [np.hypot(*(points[:, None] - others).T).min(axis=0) < 2.6 for _, points, _ in paths]
    meet = min(float(path[2][close].min()) for path, close in zip(paths, near, strict=True) if path[0] == 0 and close.any())
    for depth, used in ((meet - 0.6, True), (meet + 0.6, False)):
        place = find("1", saved(lined({(0, 2): depth}, stop=stop, left_hand=left_hand), tmp_path / "x.xodr"))
        line = place.entrances[0]
        assert (line.setback, line.beyond) == (
            (pytest.approx(-depth, abs=1e-3), None) if used else (0.0, pytest.approx(depth, abs=1e-3))
        )


def test_lines_that_no_traffic_crosses_are_counted(tmp_path: Path) -> None:
    root = lined({(0, 2): 2.0})
    road = next(road for road in root.iter("road") if road.get("junction") == "1")
    paint(road, "off", 1.0, "across", t=40.0)
    path = saved(root, tmp_path / "x.xodr")
    (message,) = [warning.message for warning in read_map(path).warnings if "stop line" in warning.message]
    assert message.startswith("1 of 2 stop lines in junctions, 'off' first, were ignored")


def log(path: Path, stop: float | None, side: float = 1.75) -> str:
    """Write a log of a car from the south that stands for 3 s with its front `stop` [m] behind the end of its lane; or never.

    The car comes at 8 m/s, and brakes and accelerates with 2 m/s^2.
    """
    times = np.arange(0.0, 25.0, 0.1)
    if stop is None:
        front = -55.0 + 8.0 * times
    else:
        begin, halt = (stop - 16.0 + 40.0) / 8.0, (stop - 16.0 + 40.0) / 8.0 + 4.0
        braking = np.clip(times - begin, 0.0, 4.0)
        going = np.clip(times - halt - 3.0, 0.0, None)
        front = -55.0 + 8.0 * np.minimum(times, begin) + 8.0 * braking - braking**2 + going**2
    front = front[front < 60.0]
    rows = [f"car,{time:.1f},{side},{y - 2.3},1.5707963,4.6,1.8" for time, y in zip(times, front, strict=False)]
    path.write_text("\n".join(["id,time,x,y,heading,length,width", *rows]))
    return str(path)


def verdicts(tmp_path: Path, map: str, stop: float | None, *rules: str, lights: str = "", side: float = 1.75) -> dict[str, str]:
    out = tmp_path / "run.npz"
    command = ["import", log(tmp_path / "log.csv", stop, side), "--map", map, "--junction", "1", "-o", str(out)]
    if lights:
        (tmp_path / "lights.csv").write_text(lights)
        command += ["--lights", str(tmp_path / "lights.csv")]
    assert main(command) == 0
    (run,) = read_runs(out)
    return {rule: check(run, rule).outcome.name for rule in rules}


@pytest.mark.parametrize(
    ("stop", "full_stop"),
    [(2.7, "PASS"), (-0.3, "PASS"), (4.0, "FAIL"), (-9.0, "FAIL"), (None, "FAIL")],
    ids=["at the line", "at the end of the lane", "beyond the line", "too early", "never"],
)
@pytest.mark.parametrize("left_hand", [False, True])
def test_car_stops_at_the_painted_line(tmp_path: Path, stop: float | None, full_stop: str, left_hand: bool) -> None:
    path = saved(lined(dict.fromkeys(STRAIGHT, 3.0), "signal", left_hand=left_hand), tmp_path / "x.xodr")
    found = verdicts(tmp_path, path, stop, "full_stop", "keep_clear", side=-1.75 if left_hand else 1.75)
    assert found["full_stop"] == full_stop
    if stop == 2.7:
        assert found["keep_clear"] == "PASS", "a car that waits before the line is not in the junction"


@pytest.mark.parametrize(("stop", "red"), [(2.7, "PASS"), (4.0, "FAIL")])
def test_car_waits_for_green_at_the_painted_line(tmp_path: Path, stop: float, red: str) -> None:
    path = saved(lined(dict.fromkeys(STRAIGHT, 3.0), control=JunctionControl.LIGHTS), tmp_path / "x.xodr")
    lights = "time,entrance,colour\n0,0,red\n9.0,0,green\n"
    assert verdicts(tmp_path, path, stop, "red", lights=lights) == {"red": red}


@pytest.mark.parametrize(("stop", "full_stop"), [(10.7, "UNSURE"), (-0.3, "PASS"), (None, "FAIL"), (14.0, "FAIL")])
def test_place_of_an_unused_line_makes_no_violation(tmp_path: Path, stop: float | None, full_stop: str) -> None:
    path = saved(lined(dict.fromkeys(STRAIGHT, 11.0)), tmp_path / "x.xodr")
    assert verdicts(tmp_path, path, stop, "full_stop") == {"full_stop": full_stop}


def test_file_of_a_run_holds_the_lines(tmp_path: Path) -> None:
    path = saved(lined({(0, 2): 2.0, (1, 3): 11.0}), tmp_path / "x.xodr")
    verdicts(tmp_path, path, 1.7)
    (run,) = read_runs(tmp_path / "run.npz")
    assert run.junction == find("1", path)
    assert run.junction.digest != find("1", saved(layout(), tmp_path / "bare.xodr")).digest
    assert [(lane.setback, lane.beyond) for lane in run.junction.entrances] == [
        (pytest.approx(-2.0, abs=1e-4), None),
        (0.0, pytest.approx(11.0, abs=1e-4)),
        (0.0, None),
        (0.0, None),
    ]


@pytest.mark.parametrize("control", [JunctionControl.STOP, JunctionControl.LIGHTS])
@pytest.mark.parametrize("way", ["1000", "2000", "3000"])
def test_reference_stops_at_the_painted_line(tmp_path: Path, control: JunctionControl, way: str) -> None:
    place = find("1", saved(lined(dict.fromkeys(STRAIGHT, 3.0), control=control), tmp_path / "x.xodr"))
    run = simulate(Case(Scenario(place, way, distance=30.0, speed=8.0), Reference))
    rules = ("full_stop", "red", "keep_clear", "progress", "keep_lane", "p1", "p4")
    assert {check(run, rule).outcome.name for rule in rules} <= {"PASS", "NA"}
    stood = run.need("station")[:, 0][np.abs(run.need("speed")[:, 0]) < 0.1]
    if control is JunctionControl.STOP:
        assert 2.0 < stood[0] < 3.0, "not at the end of the lane, 3 m before the line"


def test_written_junction_keeps_its_lines(tmp_path: Path) -> None:
    place = find("1", saved(lined({(0, 2): 2.0, (1, 3): 3.0}), tmp_path / "x.xodr"))
    again = find(place.id, written(place, tmp_path / "again.xodr"))
    assert again.setbacks == pytest.approx(place.setbacks, abs=0.01)


def written(place: Junction, path: Path) -> str:
    """Write a junction as one of a map in another format than OpenDRIVE is written."""
    other = path.with_suffix(".txt")
    other.write_text("no OpenDRIVE")
    path.write_text(replace(place, map=str(other)).opendrive(), encoding="utf-8")
    return str(path)


def test_map_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(lined(dict.fromkeys(STRAIGHT, 3.0)), tmp_path / "x.xodr")
    assert main(["map", path, "--svg", str(tmp_path / "x.svg"), "--json"]) == 0
    (junction,) = json.loads(capsys.readouterr().out)["junctions"]
    assert junction["usable_from"] == pytest.approx(123.0, abs=1e-3)
