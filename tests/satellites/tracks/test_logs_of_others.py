"""Logs as others write them: several angles, own classes and units, degrees on the earth, CSV of SUMO, a file of lights."""

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.runfile import load_recording, save_recording
from pytest_rvads.runs.states import Agent, Kind
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.support.errors import RunError

from .drives import LENGTH, WIDTH, Drive, drive

STOP = find("stop4")
CAR = drive(STOP, (0, 2), "7", speed=8.0)


def stopping(name: str, exit: int, start: float, seconds: float) -> Drive:
    """Return a vehicle that stops 0.4 m before the line for some seconds, or drives on at 8 m/s."""
    stations = np.concatenate((np.arange(-40.0, -0.4, 0.8), np.full(round(10 * seconds), -0.4), np.arange(-0.4, 30.0, 0.8)))
    poses = np.array([Itinerary.through(STOP, 0, exit).pose(station) for station in stations])
    times = start + 0.1 * np.arange(len(stations))
    return Drive(name, times, poses[:, :2], poses[:, 2], np.gradient(stations, 0.1), math.nan)


STOPPING = [stopping("a", 2, 0.0, 3.0), stopping("b", 1, 40.0, 0.0), stopping("c", 3, 80.0, 2.0)]


def of_motion(vehicle: Drive) -> np.ndarray:
    """Return the direction between noisy positions of the centre, which is any direction while the vehicle stands."""
    noise = np.random.default_rng(int(vehicle.times[0])).normal(0.0, 0.01, (len(vehicle.times), 2))
    x, y = np.diff(vehicle.moved(LENGTH / 2) + noise, axis=0).T
    return np.append(np.arctan2(y, x)[:1], np.arctan2(y, x))


def zero_at_rest(vehicle: Drive) -> np.ndarray:
    moves = np.append(False, np.hypot(*np.diff(vehicle.points, axis=0).T) > 1e-6)
    return np.where(moves, vehicle.heading, 0.0)


def of_body(vehicle: Drive) -> np.ndarray:
    return vehicle.heading


def table(vehicles: list[Drive], angles: dict[str, Callable[[Drive], np.ndarray]]) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {name: [] for name in ("time", "id", "x", "y", "length", "width", *angles)}
    for vehicle in vehicles:
        points, directions = vehicle.moved(LENGTH / 2), [angle(vehicle) for angle in angles.values()]
        for k, time in enumerate(vehicle.times.tolist()):
            row = (time, vehicle.name, *points[k].tolist(), LENGTH, WIDTH, *(float(angle[k]) for angle in directions))
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    return columns


@pytest.mark.parametrize(
    "angles",
    [
        {"yaw_rad": of_body, "heading_rad": of_motion},
        {"heading_rad": of_motion, "yaw_rad": of_body},
        {"heading": of_body, "yaw": of_motion},  # against their names
        {"orientation": of_body, "course": of_motion},
        {"psi": zero_at_rest, "heading": of_body},
        {"heading_deg": lambda v: np.degrees(of_motion(v)), "yaw_deg": lambda v: np.degrees(of_body(v))},
        {"heading": of_motion},
        {"yaw": zero_at_rest},
        {"theta": of_motion, "yaw": zero_at_rest},
    ],
    ids=lambda angles: "-".join(angles),
)
def test_vehicle_that_stands_is_judged_whatever_the_angles(angles: dict[str, Callable[[Drive], np.ndarray]]) -> None:
    """Two of three vehicles stop."""
    recording = read_tracks(table(STOPPING, angles), STOP, position_accuracy=0.0)
    assert [track.agent.name for track in recording.tracks] == ["a", "b", "c"]
    assert recording.left_out == ()
    assert [rvads.check(run, "full_stop").status for run in recording] == ["PASS", "FAIL", "PASS"]


LANES = find("lanes4")
"""Entrances 1 and 5 lead one way, to the left; entrance 2 leads two ways."""


def opposite(vehicle: Drive) -> np.ndarray:
    return np.full(len(vehicle.times), vehicle.heading[0] + math.pi)


def still(way: tuple[int, int], name: str, station: float, aside: float = 0.0) -> Drive:
    """Return a vehicle that stands for the whole recording, `aside` metres to the left of its way."""
    x, y, heading = Itinerary.through(LANES, *way).pose(station)
    points = np.full((100, 2), (x - aside * math.sin(heading), y + aside * math.cos(heading)))
    return Drive(name, 0.1 * np.arange(100), points, np.full(100, heading), np.zeros(100), math.nan)


@pytest.mark.parametrize(
    "angles",
    [
        {},
        {"heading": of_body},
        {"heading": of_motion},
        {"yaw": zero_at_rest},
        {"heading": opposite},
        {"yaw": zero_at_rest, "heading": of_motion},
        {"heading": of_motion, "yaw": of_body},
    ],
    ids=lambda angles: "-".join(angle.__name__ for angle in angles.values()) or "none",
)
@pytest.mark.parametrize("driven", [True, False])
def test_vehicles_that_stand_are_kept_where_their_place_decides(
    angles: dict[str, Callable[[Drive], np.ndarray]], driven: bool
) -> None:
    """Whether anybody drives or not; the lane of entrance 2 leads two ways, and nobody knows which of them the vehicle takes."""
    standing = [still((1, 3), "first", -0.5), still((1, 3), "second", -7.0), still((5, 1), "opposite", -0.5)]
    undecided = [still((2, 2), "forks", -0.5), still((2, 2), "parked", -20.0, -2.5), still((2, 2), "behind", 40.0)]
    if angles.get("heading") is opposite:
        driven = False
    drives = [*standing, *undecided, *([drive(LANES, (3, 0), "drives")] if driven else [])]
    recording = read_tracks(table(drives, angles), LANES)
    kept = {track.agent.name: track for track in recording.tracks}
    assert kept.keys() == {"first", "second", "opposite", *(["drives"] if driven else [])}
    for vehicle in standing:
        assert np.allclose(kept[vehicle.name].pose[:, :2], vehicle.points, atol=0.05)
        assert np.cos(kept[vehicle.name].pose[:, 2] - vehicle.heading).min() > 0.9
    reasons = dict(recording.left_out)
    assert reasons.keys() == {"forks", "parked", "behind"}
    assert "the track ends before the junction" in reasons["forks"]
    assert "it stands more than 1.75 m beside every way" in reasons["parked"]
    assert "the track begins in the junction or behind it" in reasons["behind"]


def test_vehicle_that_sets_off_at_the_end_has_its_front_at_the_line() -> None:
    stations = np.concatenate((np.full(100, -0.4), np.arange(-0.4, 3.0, 0.3)))
    poses = np.array([Itinerary.through(LANES, 1, 3).pose(station) for station in stations])
    starts = Drive("s", 0.1 * np.arange(len(stations)), poses[:, :2], poses[:, 2], np.gradient(stations, 0.1), math.nan)
    recording = read_tracks(table([starts, drive(LANES, (3, 0))], {"heading": of_motion}), LANES, position_accuracy=0.0)
    (track,) = (track for track in recording.tracks if track.agent.name == "s")
    assert np.allclose(track.station[:90], -0.4, atol=0.05)


def test_positions_that_a_log_repeats_say_nothing_of_its_noise() -> None:
    noisy = drive(LANES, (3, 0), "v")
    points = noisy.points + np.random.default_rng(1).normal(0.0, 0.2, noisy.points.shape)
    drives = [replace(noisy, points=points), *(still((1, 3), f"{k}", -7.0 * k - 0.5) for k in range(3))]
    assert read_tracks(table(drives, {}), LANES).position_accuracy == pytest.approx(0.2, rel=0.3)


def test_degrees_of_a_compass_of_the_motion() -> None:
    compass = {"bearing": lambda v: (90.0 - np.degrees(of_motion(v))) % 360.0}
    columns = {name: name for name in ("time", "id", "x", "y", "length", "width")} | {"heading": "bearing:north"}
    recording = read_tracks(table(STOPPING, compass), STOP, columns=columns, position_accuracy=0.0)
    assert [rvads.check(run, "full_stop").status for run in recording] == ["PASS", "FAIL", "PASS"]


def write(path: Path, columns: dict[str, list[Any]], delimiter: str = ",", point: str = ".") -> Path:
    with path.open("w", newline="") as file:
        out = csv.writer(file, delimiter=delimiter)
        out.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            out.writerow([str(value).replace(".", point) if isinstance(value, float) else value for value in row])
    return path


def imported(path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[dict[str, Any], str]:
    """Import a file at the all-way stop, and return the summary and the warnings."""
    places = () if "--map" in arguments else ("--junction", "stop4")
    assert main(["import", str(path), "-o", str(path.with_suffix(".npz")), "--json", *places, *arguments]) == 0
    printed = capsys.readouterr()
    return json.loads(printed.out), printed.err


def test_import_says_which_angle_it_took(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, warnings = imported(write(tmp_path / "t.csv", table(STOPPING, {"heading": of_motion, "yaw": of_body})), capsys)
    assert "of the angles yaw, heading, yaw is the heading" in warnings
    _, warnings = imported(write(tmp_path / "t.csv", table(STOPPING, {"heading": of_motion})), capsys)
    assert "headings are derived from positions" in warnings
    _, warnings = imported(write(tmp_path / "t.csv", table(STOPPING, {"heading": of_body})), capsys)
    assert warnings == ""


def test_unknown_class_is_told_and_settled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    classes = {"class": [{"a": "car", "b": "lkw", "c": "2"}[name] for name in table(STOPPING, {})["id"]]}
    path = write(tmp_path / "t.csv", table(STOPPING, {}) | classes)
    _, warnings = imported(path, capsys)
    assert "lkw (1), 2 (1): name their kinds by --classes" in warnings
    _, warnings = imported(path, capsys, "--classes", "lkw=truck,2=cyclist")
    assert warnings == ""
    kinds = [track.agent.kind for track in load_recording(path.with_suffix(".npz")).tracks]
    assert kinds == [Kind.CAR, Kind.TRUCK, Kind.CYCLIST]
    with pytest.raises(RunError, match=r"the kind of class 'lkw' must be .*, got 'lorry'"):
        read_tracks(path, STOP, classes={"lkw": "lorry"})


FEET = 0.3048


def test_feet_and_miles(tmp_path: Path) -> None:
    columns = table([CAR], {})
    rows = {name: [value / FEET for value in columns[name]] for name in ("x", "y", "length", "width")}
    path = write(tmp_path / "t.csv", {"t": columns["time"], "id": columns["id"], **rows, "v": [8.0 / 0.44704] * len(CAR.times)})
    names = {"time": "t", "id": "id", "x": "x:ft", "y": "y:ft", "length": "length:ft", "width": "width:ft"}
    for speed, recorded in (("v:mph", 8.0), ("v:ft/s", 8.0 / 0.44704 * FEET)):
        (track,) = read_tracks(path, STOP, columns={**names, "speed": speed}).tracks
        assert np.allclose(track.pose[:, :2], CAR.points, atol=0.01)
        assert track.agent.size == pytest.approx((LENGTH, WIDTH))
        assert track.speed[0] == pytest.approx(recorded, abs=0.01)


def test_decimal_commas_between_semicolons(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", table([CAR], {"heading": of_body}), ";", ",")
    (track,) = read_tracks(path, STOP).tracks
    assert np.allclose(track.pose[:, :2], CAR.points, atol=1e-6)
    path.write_text(path.read_text().replace(";", "\t"))
    with pytest.raises(RunError, match="is no number"):
        read_tracks(path, STOP, strict=True)


LATITUDE, LONGITUDE = 48.7758, 9.1829
TMERC = f"+proj=tmerc +lat_0={LATITUDE} +lon_0={LONGITUDE} +k=1 +x_0=0 +y_0=0 +datum=WGS84"


def on_earth(names: tuple[str, str]) -> dict[str, list[Any]]:
    """Return the car with degrees: near a place, the radii of curvature of the ellipsoid turn metres into angles."""
    squared, sine = 0.00669437999, math.sin(math.radians(LATITUDE))
    east = 6_378_137.0 / math.sqrt(1 - squared * sine**2)
    north = east * (1 - squared) / (1 - squared * sine**2)
    columns = table([CAR], {"yaw": of_body})
    x, y = np.array(columns.pop("x")), np.array(columns.pop("y"))
    longitude = LONGITUDE + np.degrees(x / (east * math.cos(math.radians(LATITUDE))))
    return columns | {names[0]: (LATITUDE + np.degrees(y / north)).tolist(), names[1]: longitude.tolist()}


@pytest.mark.parametrize("names", [("lat", "lon"), ("Latitude", "Longitude")])
def test_degrees_are_projected_as_the_map_says(tmp_path: Path, names: tuple[str, str]) -> None:
    text = path_of("stop4").read_text()
    place = tmp_path / "m.xodr"
    head, header, rest = text.partition("<header ")
    attributes, _, end = rest.partition("/>")
    begin = f"{head}{header}{attributes}>"
    tracks = write(tmp_path / "t.csv", on_earth(names))
    for projection, offset, moved in ((TMERC, "", 0.0), (TMERC.replace("x_0=0", "x_0=500"), '<offset x="490" y="0"/>', 10.0)):
        place.write_text(f"{begin}<geoReference><![CDATA[{projection}]]></geoReference>{offset}</header>{end}")
        (track,) = read_tracks(tracks, STOP.id, map=place, offset=(-moved, 0.0)).tracks
        assert np.allclose(track.pose[:, :2], CAR.points, atol=0.01)
    for projection in ("", "+proj=lcc +lat_0=48", "PROJCS[...]"):
        place.write_text(f"{begin}<geoReference>{projection}</geoReference></header>{end}")
        with pytest.raises(RunError, match=r"degrees of longitude and latitude, and .* has .*geoReference>.*give x and y in"):
            read_tracks(tracks, STOP.id, map=place)
    with pytest.raises(RunError, match="and the junction has no <geoReference>"):
        read_tracks(tracks, STOP)


def fcd(person: bool) -> str:
    rows = [
        "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle;vehicle_type;vehicle_speed"
        + ";person_id;person_x;person_y" * person
    ]
    rows += ["0.00;;;;;;" + ";;;" * person]
    for time, (x, y), heading in zip(CAR.times, CAR.points, CAR.heading, strict=True):
        rows.append(f"{time:.2f};7;{x};{y};{(90 - math.degrees(heading)) % 360};DEFAULT_VEHTYPE;8.0" + ";;;" * person)
        rows += [f"{time:.2f};;;;;;;7;{x};{y}"] * person
    return "\n".join(rows)


@pytest.mark.parametrize("person", [False, True])
def test_floating_car_data_as_csv(tmp_path: Path, capsys: pytest.CaptureFixture[str], person: bool) -> None:
    path = tmp_path / "fcd.csv"
    path.write_text(fcd(person))
    summary, warnings = imported(path, capsys, "--size", f"{LENGTH},{WIDTH}", "--strict")
    assert (summary["vehicles"], list(summary["left_out"])) == (1, ["person 7"] * person)
    assert warnings == ""
    (track,) = load_recording(path.with_suffix(".npz")).tracks
    assert np.allclose(track.pose[:, :2], CAR.points, atol=1e-6)  # the front bumper
    _, warnings = imported(path, capsys)
    assert "the log has no size of 1 vehicle" in warnings
    assert "--size" in warnings


def test_file_of_the_recorder_of_carla_is_refused_as_such(tmp_path: Path) -> None:
    path = tmp_path / "r.log"
    path.write_bytes(b"\x01\x00\x0e\x00CARLA_RECORDER" + bytes(range(256)))  # version, length of the magic text, the text
    with pytest.raises(RunError, match="is a file of CARLA's recorder"):
        read_tracks(path, STOP, format="carla")


@pytest.mark.parametrize(
    ("entrances", "control", "status"),
    [("0", JunctionControl.PARTIAL, "FAIL"), ("0123", JunctionControl.LIGHTS, "FAIL"), ("1", JunctionControl.PARTIAL, "NA")],
)
def test_recorded_lights_light_the_entrances(tmp_path: Path, entrances: str, control: JunctionControl, status: str) -> None:
    place = replace(find("right4"), name="unlit")
    assert place.control is JunctionControl.NONE
    lights = tmp_path / "l.csv"
    lights.write_text("time,entrance,colour\n" + "".join(f"0,{k},red\n30,{k},green\n" for k in entrances))
    recording = read_tracks(table([drive(place, (0, 2), "7")], {}), place, lights=lights)
    save_recording(recording, tmp_path / "r.npz")
    (run,) = load_recording(tmp_path / "r.npz")
    assert run.junction.control is control
    assert rvads.check(run, "red").status == status


def missing(stations: NDArray[np.float64], speeds: NDArray[np.float64]) -> set[str]:
    """Return the kinds of findings about a vehicle with a sample every 0.1 s."""
    way = Itinerary.through(STOP, 0, 2)
    pose, times = np.array([way.pose(station) for station in stations]), 0.1 * np.arange(len(stations), dtype=np.float64)
    track = Track(Agent("7", STOP.movements[0, 2]), times, stations, speeds, pose)
    return {finding.kind for finding in rvads.validate(Recording("t", STOP, (track,))[0])}


def test_vehicle_that_sets_off_or_stops_between_samples_misses_no_state() -> None:
    # It stands, jerks to 3 m/s within a twentieth of a second, drives on, and stops as hard: the mean of two speeds is not the
    # mean speed between their samples.
    stations = np.concatenate((np.full(10, -20.0), -20.0 + np.cumsum([0.27, *[0.3] * 20, 0.03, *[0.0] * 10])))
    assert missing(stations, np.array([0.0] * 10 + [3.0] * 21 + [0.0] * 11)) == set()
    driving = np.arange(-40.0, 20.0, 0.8)
    gap = np.concatenate((driving[:30], driving[33:]))  # three samples are lost, and the times do not tell
    assert missing(driving, np.full(len(driving), 8.0)) == set()
    assert missing(gap, np.full(len(gap), 8.0)) == {"missing ticks"}
