"""A CommonRoad scenario gives the map and the recorded vehicles."""

import gzip
import math
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.runfile import load_recording
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.support.errors import RunError

from ..lanelet2.commonroad_files import commonroad
from .drives import LENGTH, WIDTH, Drive, drive


def obstacle(vehicle: Drive, type: str = "car", tag: str = "dynamicObstacle") -> str:
    """Return a vehicle as an obstacle, with a state per step of 0.1 s, and the centre of the vehicle as its position."""
    states = []
    for time, (x, y), heading, speed in zip(
        vehicle.times, vehicle.moved(LENGTH / 2), vehicle.heading, vehicle.speed, strict=True
    ):
        exact = {"orientation": heading, "time": round(time / 0.1), "velocity": speed}
        numbers = "".join(f"<{name}><exact>{value}</exact></{name}>" for name, value in exact.items())
        states.append(f"<position><point><x>{x}</x><y>{y}</y></point></position>{numbers}")
    body = f"<shape><rectangle><length>{LENGTH}</length><width>{WIDTH}</width></rectangle></shape>"
    later = "".join(f"<state>{state}</state>\n" for state in states[1:])
    role = "<role>dynamic</role>" if tag == "obstacle" else ""
    return (
        f'<{tag} id="{vehicle.name}">{role}<type>{type}</type>{body}<initialState>{states[0]}</initialState>'
        f"<trajectory>{later}</trajectory></{tag}>\n"
    )


@pytest.fixture
def drives(tmp_path: Path) -> list[Drive]:
    """Return two vehicles that drive through the crossing of the written map."""
    path = tmp_path / "map.xml"
    path.write_text(commonroad(), encoding="utf-8")
    place = find("J301", path)
    (first, second) = sorted(place.movements)[:2]
    return [drive(place, first, "7"), drive(place, second, "8", start=3.0)]


def written(folder: Path, elements: str, **options: str) -> Path:
    path = folder / "scenario.xml"
    path.write_text(commonroad(elements=elements, **options), encoding="utf-8")
    return path


@pytest.mark.parametrize(("version", "tag"), [("2018b", "obstacle"), ("2020a", "dynamicObstacle")])
def test_scenario_gives_map_and_recording(tmp_path: Path, drives: list[Drive], version: str, tag: str) -> None:
    parked = '<obstacle id="9"><role>static</role><type>car</type><initialState/></obstacle>'
    path = written(tmp_path, obstacle(drives[0], tag=tag) + obstacle(drives[1], "bus", tag) + parked, version=version)
    recording = read_tracks(path, strict=True)
    assert recording.junction.id == "J301"
    assert not recording.left_out
    assert [(track.agent.name, track.agent.kind) for track in recording.tracks] == [("7", Kind.CAR), ("8", Kind.TRUCK)]
    for track, vehicle in zip(recording.tracks, drives, strict=True):
        assert np.allclose(track.pose[:, :2], vehicle.points, atol=1e-5)
        assert np.allclose(track.times, vehicle.times, atol=1e-6)
        assert np.allclose(track.speed, vehicle.speed, atol=1e-5)
        assert track.agent.size == pytest.approx((LENGTH, WIDTH))


def test_packed_scenario_needs_a_map(tmp_path: Path, drives: list[Drive]) -> None:
    path = written(tmp_path, obstacle(drives[0]))
    packed = tmp_path / "packed.xml.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    with pytest.raises(RunError, match=r"packed\.xml\.gz: the log names no map"):
        read_tracks(packed)
    assert len(read_tracks(packed, "J301", map=path).tracks) == 1


def test_circle_has_its_diameter_as_size(tmp_path: Path, drives: list[Drive]) -> None:
    rectangle = f"<rectangle><length>{LENGTH}</length><width>{WIDTH}</width></rectangle>"
    text = obstacle(drives[0]).replace(rectangle, "<circle><radius>1.5</radius></circle>")
    (vehicle,) = read_log(written(tmp_path, text))[0].vehicles
    assert vehicle.size == (3.0, 3.0)


def test_speeds_are_derived_where_states_lack_velocities(tmp_path: Path, drives: list[Drive]) -> None:
    text = obstacle(drives[0]).replace("<velocity><exact>8.0</exact></velocity></state>", "</state>")
    assert text.count("velocity") == 2
    path = written(tmp_path, text)
    assert read_log(path)[0].vehicles[0].speed is None
    (track,) = read_tracks(path).tracks
    assert np.allclose(track.speed[1:-1], 8.0, atol=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<time><exact>4</exact>", "<time><intervalStart>4</intervalStart><intervalEnd>5</intervalEnd>"), "row 4, column time"),
        (("<orientation><exact>", "<orientation><exact>about "), "row 1, column orientation"),
        (("<position><point>", "<position><circle>"), "row 1, column position"),
    ],
)
def test_vehicle_with_an_inexact_state_is_left_out(
    tmp_path: Path, drives: list[Drive], change: tuple[str, str], message: str
) -> None:
    text = obstacle(drives[0]).replace(*change, 1)
    if "circle" in change[1]:
        text = text.replace("</point>", "</circle>", 1)
    path = written(tmp_path, text + obstacle(drives[1]))
    recording = read_tracks(path)
    assert [track.agent.name for track in recording.tracks] == ["8"]
    assert recording.left_out == (("7", f"scenario.xml: {message}: it is missing or not exact, expected a number or a point"),)
    with pytest.raises(RunError, match=message):
        read_tracks(path, strict=True)


def test_obstacle_without_a_trajectory_is_left_out(tmp_path: Path, drives: list[Drive]) -> None:
    before, _, behind = obstacle(drives[0]).partition("<trajectory>")
    text = before + "<occupancySet/>" + behind.partition("</trajectory>")[2]
    (refused,) = read_log(written(tmp_path, text))[0].refused
    assert refused == ("7", "scenario.xml: row 1, column position: the obstacle has no trajectory, expected states")


@pytest.mark.parametrize("step", ["0", "-1", "nan", "inf", "soon", ""])
def test_scenario_without_a_time_step_is_refused(tmp_path: Path, step: str) -> None:
    path = written(tmp_path, "")
    path.write_text(path.read_text(encoding="utf-8").replace('timeStepSize="0.1"', f'timeStepSize="{step}"'), encoding="utf-8")
    with pytest.raises(RunError, match=r"row 1: got <commonRoad timeStepSize=.*, expected .* a positive timeStepSize"):
        read_log(path)


def test_columns_of_a_scenario_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"scenario\.xml: a CommonRoad scenario has fixed elements, leave --columns out"):
        read_log(written(tmp_path, ""), columns={"x": "X"})


def test_command_imports_a_public_scenario(shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = shared / "maps" / "commonroad" / "USA_Lanker-1_3_T-1.xml"
    if not path.is_file():
        pytest.skip("the folder ../shared/maps/commonroad is absent")
    obstacles = ElementTree.parse(path).getroot().findall("dynamicObstacle")
    vehicles = {vehicle.name: vehicle for vehicle in read_log(path, strict=True)[0].vehicles}
    assert vehicles.keys() == {element.get("id") for element in obstacles}
    for element in obstacles:
        vehicle = vehicles[element.get("id", "")]
        last = element.findall("trajectory/state")[-1]
        place = [float(last.findtext(f"position/point/{axis}", "")) for axis in ("x", "y")]
        assert (vehicle.times[0], vehicle.times[-1]) == (0.0, pytest.approx(0.1 * int(last.findtext("time/exact", ""))))
        assert vehicle.points[-1].tolist() == place
    assert main(["import", str(path), "-o", str(tmp_path / "out.npz")]) == 0
    assert "16 vehicles at USA_Lanker_1_3_T_1.11530" in capsys.readouterr().out
    recording = load_recording(tmp_path / "out.npz")
    assert len(recording.tracks) + len(recording.left_out) == len(obstacles) == 36
    assert all(math.dist(a[:2], b[:2]) < 3.0 for track in recording.tracks for a, b in pairwise(track.pose))
