"""Logs of SUMO, CARLA, OSI and ROS with the same vehicles give the same tracks; a CommonRoad scenario gives tracks and map."""

import gzip
import json
import math
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.runfile import load_recording
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.support.errors import RunError

from ..lanelet2.commonroad_files import commonroad
from .drives import LENGTH, WIDTH, Drive, drive

STOP = find("stop4")
FIRST, SECOND = drive(STOP, (0, 2), "1"), drive(STOP, (1, 2), "2", start=3.0)


def ticks() -> list[tuple[float, list[tuple[Drive, int]]]]:
    """Return the vehicles of every time, each with the number of its sample."""
    vehicles: dict[float, list[tuple[Drive, int]]] = defaultdict(list)
    for vehicle in (FIRST, SECOND):
        for k, time in enumerate(vehicle.times.tolist()):
            vehicles[round(time, 6)].append((vehicle, k))
    return sorted(vehicles.items())


def hold(path: Path, names: tuple[str, str] = ("1", "2"), **options: Any) -> None:
    recording = read_tracks(path, STOP, strict=True, **options)
    assert [track.agent.name for track in recording.tracks] == [*names]
    for track, vehicle in zip(recording.tracks, (FIRST, SECOND), strict=True):
        assert np.allclose(track.pose[:, :2], vehicle.points, atol=1e-5)
        assert np.allclose(track.times, vehicle.times, atol=1e-6)
        assert np.allclose(track.speed, vehicle.speed, atol=1e-5)
        assert track.agent.size == pytest.approx((LENGTH, WIDTH))


def fcd() -> str:
    lines = ["<fcd-export>"]
    for time, vehicles in ticks():
        lines.append(f'<timestep time="{time}">')
        for vehicle, k in vehicles:
            x, y = vehicle.points[k]
            angle = (90 - math.degrees(vehicle.heading[k])) % 360
            pose = f'x="{x:.9f}" y="{y:.9f}" angle="{angle:.9f}"'
            lines.append(f'<vehicle id="{vehicle.name}" {pose} type="car" speed="{vehicle.speed[k]}"/>')
        lines.append("</timestep>")
    return "\n".join([*lines, "</fcd-export>"])


def test_sumo(tmp_path: Path) -> None:
    path = tmp_path / "t.xml"
    path.write_text(fcd(), encoding="utf-8")
    hold(path, size=(LENGTH, WIDTH))
    packed = tmp_path / "t.xml.gz"
    packed.write_bytes(gzip.compress(fcd().encode()))
    hold(packed, size=(LENGTH, WIDTH))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('speed="8.0"', 'speed="fast"'), r"t\.xml: row 3, column speed: 'fast' is no number"),
        (('<timestep time="0.0">', '<timestep time="soon">'), r"t\.xml: row 3, column time: 'soon' is no time"),
        (("<fcd-export>", "<!DOCTYPE x [<!ENTITY a 'b'>]><fcd-export>"), "document type declaration"),
        (("</fcd-export>", ""), r"t\.xml: row \d+, column \d+: not XML: no element found"),
        (("fcd-export", "fcd-import"), "<fcd-export> is missing"),
    ],
)
def test_damaged_file_of_sumo_is_refused(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "t.xml"
    path.write_text(fcd().replace(*change), encoding="utf-8")
    with pytest.raises(RunError, match=message):
        read_tracks(path, STOP, strict=True, size=(LENGTH, WIDTH))


def carla() -> list[dict[str, Any]]:
    """Return records of autoware-carla-scenario, in a left-handed frame; the origin of an actor is not the centre of its box."""
    records: list[dict[str, Any]] = [{"type": "world", "schema_version": 2, "map": "Town", "episode": 1}]
    light = {"type": "traffic_light", "id": 90, "opendrive_id": "0", "location": [0.0, 0.0, 5.0], "boxes": [], "stops": []}
    records.append(light)
    half, centre = [LENGTH / 2, WIDTH / 2, 0.7], [0.1, 0.0, 0.7]
    fixed = {"type_id": "vehicle.x", "role": "", "extent": half, "center": centre}
    records += [{"type": "actor", "id": int(vehicle.name), **fixed} for vehicle in (FIRST, SECOND)]
    for number, (time, vehicles) in enumerate(ticks()):
        states = []
        for vehicle, k in vehicles:
            (x, y), heading = vehicle.moved(LENGTH / 2 + 0.1)[k], float(vehicle.heading[k])
            vx, vy = 8 * math.cos(heading), -8 * math.sin(heading)
            states.append([int(vehicle.name), x, -y, 0.0, 0.0, 0.0, -math.degrees(heading), vx, vy, 0.0])
        tick: dict[str, Any] = {"type": "tick", "frame": number, "t": time, "actors": states, "control": {}}
        if number in (0, 20):
            tick["lights"] = {"90": "Red" if number == 0 else "Green"}
        records.append(tick)
    return records


def test_carla(tmp_path: Path) -> None:
    path = tmp_path / "t.trajectory.jsonl"
    path.write_text("\n".join(map(json.dumps, carla())), encoding="utf-8")
    hold(path)
    shown = read_tracks(path, STOP).lights[0]
    assert list(zip(shown.times.tolist(), shown.colours.tolist(), strict=True)) == [(0.0, Colour.RED), (2.0, Colour.GREEN)]
    with path.open("a", encoding="utf-8") as file:
        file.write('\n{"type": "tick", "t": "late"}')
    with pytest.raises(RunError, match=r"t\.trajectory\.jsonl: row \d+, column t: it must be a number, got 'late'"):
        read_tracks(path, STOP)


def write_osi(path: Path, **fields: Any) -> None:
    """Write a trace; its first ground truth has a further moving object with only these fields."""
    osi = pytest.importorskip("betterosi")
    with osi.Writer(path) as out:
        for number, (time, vehicles) in enumerate(ticks()):
            nanos = round(time * 1e9)
            truth = osi.GroundTruth(timestamp=osi.Timestamp(seconds=nanos // 10**9, nanos=nanos % 10**9))
            for vehicle, k in vehicles:
                (x, y), heading = vehicle.moved(LENGTH / 2)[k].tolist(), float(vehicle.heading[k])
                base = osi.BaseMoving(
                    position=osi.Vector3d(x=x, y=y),
                    orientation=osi.Orientation3d(yaw=heading),
                    dimension=osi.Dimension3d(length=LENGTH, width=WIDTH, height=1.5),
                    velocity=osi.Vector3d(x=8 * math.cos(heading), y=8 * math.sin(heading)),
                )
                truth.moving_object.append(osi.MovingObject(id=osi.Identifier(value=int(vehicle.name)), type=2, base=base))
            if fields and number == 0:
                truth.moving_object.append(osi.MovingObject(**fields))
            out.add(truth)


@pytest.mark.parametrize("name", ["t.mcap", "t_gt_3.osi", "drive.osi"])
def test_osi(tmp_path: Path, name: str) -> None:
    write_osi(tmp_path / name)
    hold(tmp_path / name)


def test_object_of_osi_without_an_id_is_left_out(tmp_path: Path) -> None:
    write_osi(tmp_path / "t.mcap", type=2)
    recording = read_tracks(tmp_path / "t.mcap", STOP)
    assert len(recording.tracks) == 2
    assert recording.left_out == (("row 1", "t.mcap: row 1, column id: a moving object has no id"),)


def test_ros(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, odometry = store.types, "nav_msgs/msg/Odometry"
    vector, covariance = types["geometry_msgs/msg/Vector3"], np.zeros(36)
    with Writer(tmp_path / "bag", version=9) as out:
        for vehicle in (FIRST, SECOND):
            topic = out.add_connection(f"/{vehicle.name}", odometry, typestore=store)
            for time, (x, y), heading in zip(vehicle.times.tolist(), vehicle.moved(0.8 * LENGTH), vehicle.heading, strict=True):
                nanos = round(time * 1e9)
                stamp = types["builtin_interfaces/msg/Time"](sec=nanos // 10**9, nanosec=nanos % 10**9)
                turned = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
                pose = types["geometry_msgs/msg/Pose"](
                    position=types["geometry_msgs/msg/Point"](x=float(x), y=float(y), z=0.0),
                    orientation=types["geometry_msgs/msg/Quaternion"](**turned),
                )
                twist = types["geometry_msgs/msg/Twist"](linear=vector(x=8.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
                message = types[odometry](
                    header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="map"),
                    child_frame_id="base_link",
                    pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
                    twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance),
                )
                out.write(topic, nanos, store.serialize_cdr(message, odometry))
    hold(tmp_path / "bag", size=(LENGTH, WIDTH))


@pytest.mark.parametrize(("name", "extra"), [("t.mcap", "osi"), ("t.db3", "rosbag")])
def test_missing_extra_is_named(tmp_path: Path, name: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("betterosi", "rosbags", "rosbags.highlevel"):
        monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(RunError, match=rf"install 'pytest-rvads\[{extra}\]'"):
        read_tracks(tmp_path / name, STOP)


def test_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"t\.dat has none of .*\.csv.*--format"):
        read_tracks(tmp_path / "t.dat", STOP)
    with pytest.raises(RunError, match=r"'fdc' is no format of tracks, .* did you mean 'fcd'\?"):
        read_tracks(tmp_path / "t.dat", STOP, format="fdc")
    with pytest.raises(RunError, match=r"none\.csv: can't be read: No such file"):
        read_tracks(tmp_path / "none.csv", STOP)
    with pytest.raises(RunError, match="a file or a table, got int"):
        read_tracks(7, STOP)


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
