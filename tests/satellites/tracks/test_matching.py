"""Every vehicle is matched to the way that it drove, and every omitted vehicle has a reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find, load, names
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import Point
from pytest_rvads.satellites.tracks.matching import BEFORE, BEHIND, BESIDE, NEVER, ONCE, PARKED, UNCLEAR
from pytest_rvads.support.errors import RunError

from .drives import LENGTH, WIDTH, Drive, drive, write_csv

STOP = find("stop4")


def cut(vehicle: Drive, keep: np.ndarray, name: str = "") -> Drive:
    return Drive(
        name or vehicle.name,
        vehicle.times[keep],
        vehicle.points[keep],
        vehicle.heading[keep],
        vehicle.speed[keep],
        vehicle.crosses,
    )


def reasons(recording: Recording) -> dict[str, str]:
    return dict(recording.left_out)


@pytest.mark.extended
@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("name", names())
def test_every_vehicle_is_matched_to_its_movement(tmp_path: Path, name: str, noise: float) -> None:
    place = find(name)
    drives = [drive(place, key, f"{key[0]}-{key[1]}", start=20.0 * k) for k, key in enumerate(sorted(place.movements))]
    recording = read_tracks(write_csv(tmp_path / "t.csv", drives, noise=noise), place)
    assert {track.agent.name: track.agent.way.key for track in recording.tracks} == {
        f"{i}-{k}": (i, k) for i, k in place.movements
    }
    assert max(track.offset for track in recording.tracks) == pytest.approx(noise, abs=0.05 + noise / 3)


@pytest.mark.extended
@pytest.mark.parametrize("dt", [0.04, 0.1, 0.2])
def test_matched_track_crosses_the_vertex_at_the_recorded_time(tmp_path: Path, dt: float) -> None:
    drives = [
        drive(STOP, key, f"v{k}", start=1.0 + 3 * k, speed=6.0 + k / 3, dt=dt) for k, key in enumerate(sorted(STOP.movements))
    ]
    recording = read_tracks(write_csv(tmp_path / "t.csv", drives), STOP)
    for run in recording:
        for column, agent in enumerate(run.agents):
            (vehicle,) = (d for d in drives if d.name == agent.name)
            assert run.start + run.entry(column) == pytest.approx(vehicle.crosses, abs=0.011)  # a tick


def test_recorded_point_decides_the_place_of_the_front(tmp_path: Path) -> None:
    vehicle = drive(STOP, (0, 2))
    shares: dict[Point, float] = {"front": 0.0, "center": LENGTH / 2, "rear_axle": 0.8 * LENGTH}
    for point, back in shares.items():
        track = read_tracks(write_csv(tmp_path / f"{point}.csv", [vehicle], back=back), STOP, point=point).tracks[0]
        assert np.allclose(track.pose[:, :2], vehicle.points, atol=1e-6)
        assert np.allclose(track.station, -40.0 + 8.0 * vehicle.times, atol=1e-6)
    with pytest.raises(RunError, match=r"point must be front, center, rear_axle, got 'centre'; did you mean 'center'\?"):
        read_tracks(tmp_path / "front.csv", STOP, point="centre")  # type: ignore[arg-type]


@pytest.mark.extended
def test_noise_is_estimated_to_a_quarter(tmp_path: Path) -> None:
    drives = [drive(STOP, key, f"v{k}", start=5.0 * k) for k, key in enumerate(sorted(STOP.movements))]
    for noise in (0.05, 0.1, 0.2):
        recording = read_tracks(write_csv(tmp_path / "t.csv", drives, noise=noise), STOP)
        assert recording.position_accuracy == pytest.approx(noise, rel=0.25)
        assert all(track.spread is not None and (track.spread > 0.0).all() for track in recording.tracks)
    exact = read_tracks(write_csv(tmp_path / "t.csv", drives), STOP)
    assert (exact.position_accuracy, exact.tracks[0].spread) == (0.0, None)
    assert read_tracks(write_csv(tmp_path / "t.csv", drives), STOP, position_accuracy=0.1).position_accuracy == 0.1


def test_second_passage_of_a_name_is_a_second_vehicle(tmp_path: Path) -> None:
    first, second = drive(STOP, (0, 2), "bus"), drive(STOP, (1, 3), "bus", start=60.0)
    times, points, heading, speed = (
        np.concatenate((getattr(first, name), getattr(second, name))) for name in ("times", "points", "heading", "speed")
    )
    both = Drive("bus", times, points, heading, speed, first.crosses)
    recording = read_tracks(write_csv(tmp_path / "t.csv", [both]), STOP)
    assert [(track.agent.name, track.agent.way.key) for track in recording.tracks] == [("bus", (0, 2)), ("bus#2", (1, 3))]


def test_noise_of_a_standing_vehicle_is_no_motion(tmp_path: Path) -> None:
    vehicle = drive(STOP, (0, 3), speed=5.0)
    stop = int(np.searchsorted(vehicle.times, vehicle.crosses)) - 2
    parts = [np.arange(stop), np.full(200, stop), np.arange(stop, len(vehicle.times))]
    rows = np.concatenate(parts)
    waits = Drive("v", 0.1 * np.arange(len(rows)), vehicle.points[rows], vehicle.heading[rows], vehicle.speed[rows], 0.0)
    recording = read_tracks(write_csv(tmp_path / "t.csv", [waits], noise=0.1), STOP)
    assert [track.agent.way.key for track in recording.tracks] == [(0, 3)]
    assert len(recording.tracks[0].times) == len(rows)


def test_omitted_vehicles_have_reasons(tmp_path: Path) -> None:
    way = drive(STOP, (0, 2), "passes")
    before = cut(way, way.times < way.crosses - 1.0, "ends before")
    turns = drive(STOP, (0, 1))
    inside = cut(turns, turns.times < turns.crosses + 0.2, "ends early inside")
    behind = cut(way, way.times > way.crosses + 0.5, "begins inside")
    parked = Drive(
        "parked", way.times, np.repeat(before.points[:1] + 3.0, len(way.times), axis=0), way.heading, 0 * way.speed, 0.0
    )
    away = Drive("away", way.times, way.points + 500.0, way.heading, way.speed, 0.0)
    beside = Drive(
        "beside", way.times, way.points + 5.0 * np.array([-np.sin(way.heading[0]), np.cos(way.heading[0])]), *way_rest(way)
    )
    against = Drive("against", way.times, way.points[::-1], way.heading + np.pi, way.speed, 0.0)
    once = cut(way, way.times == way.times[9], "once")
    drives = [way, before, inside, behind, parked, away, beside, against, once]
    recording = read_tracks(write_csv(tmp_path / "t.csv", drives, back=0.0), STOP, point="front")
    assert [track.agent.name for track in recording.tracks] == ["passes"]
    reason = reasons(recording)
    assert reason["ends before"] == BEFORE
    assert reason["ends early inside"] == UNCLEAR
    assert reason["begins inside"] == BEHIND
    assert reason["parked"] == PARKED
    assert reason["once"] == ONCE
    assert reason["away"] == NEVER
    assert reason["against"] == reason["beside"] == BESIDE


def way_rest(vehicle: Drive) -> tuple[np.ndarray, np.ndarray, float]:
    return vehicle.heading, vehicle.speed, vehicle.crosses


def test_tracks_of_another_origin_are_refused_with_their_distance(tmp_path: Path) -> None:
    vehicle = drive(STOP, (0, 2))
    far = Drive("v", vehicle.times, vehicle.points + np.array([1000.0, 0.0]), vehicle.heading, vehicle.speed, vehicle.crosses)
    path = write_csv(tmp_path / "t.csv", [far])
    with pytest.raises(RunError, match=r"no vehicle in t.csv passes junction 'stop4': .* 1,0\d\d m .* --offset=X,Y"):
        read_tracks(path, STOP)
    assert len(read_tracks(path, STOP, offset=(-1000.0, 0.0)).tracks) == 1


def test_centre_points_need_a_size(tmp_path: Path) -> None:
    vehicle = drive(STOP, (0, 2))
    columns: dict[str, Any] = {
        "time": vehicle.times,
        "id": ["v"] * len(vehicle.times),
        "x": vehicle.moved(2.3)[:, 0],
        "y": vehicle.moved(2.3)[:, 1],
    }
    with pytest.raises(RunError, match=r"no vehicle in table passes .* its length is not known, .* --size \(size=\)"):
        read_tracks(columns, STOP)
    count = len(vehicle.times)
    rows = {name: [*columns[name]] * 2 for name in ("time", "x", "y")}
    sizes = {"id": ["v"] * count + ["sized"] * count, "length": [None] * count + [LENGTH] * count, "width": [WIDTH] * 2 * count}
    recording = read_tracks({**rows, **sizes}, STOP)
    assert [track.agent.name for track in recording.tracks] == ["sized"]
    assert reasons(recording)["v"].startswith("its length is not known")
    track = read_tracks(columns, STOP, size=(LENGTH, WIDTH)).tracks[0]
    assert track.agent.size == (LENGTH, WIDTH)
    assert np.allclose(track.pose[:, :2], vehicle.points, atol=0.01)  # the heading comes from the way
    assert np.allclose(track.speed, 8.0, atol=0.01)  # the speed comes from the positions
    assert read_tracks(columns, STOP, point="front").tracks[0].agent.size is None


@pytest.mark.extended
@pytest.mark.parametrize("map", ["multi_intersections", "Town07", "sumo_skew4", "fabriksgatan"])
def test_vehicles_on_maps_from_elsewhere_are_matched_to_their_movements(shared: Path, tmp_path: Path, map: str) -> None:
    path = shared / "maps" / f"{map}.xodr"
    usable = [report.id for report in load(path).junctions if report.usable][:3]
    places = [find(id, path) for id in usable]
    drives: dict[str, Drive] = {}
    for place in places:
        for key in sorted(place.movements):
            way = Itinerary.through(place, *key)
            name = f"{place.id} {key[0]} {key[1]}"
            drives[name] = drive(place, key, name, start=30.0 * len(drives), begin=max(-40.0, 0.5 - way.origin))
    log = write_csv(tmp_path / "t.csv", [*drives.values()], noise=0.1)
    for place in places:
        recording = read_tracks(log, place)
        movements = {track.agent.name: track.agent.way.key for track in recording.tracks}
        wrong = {name: key for name, key in movements.items() if name != f"{place.id} {key[0]} {key[1]}"}
        missing = [name for name in drives if name.startswith(f"{place.id} ") and name not in movements]
        assert (wrong, missing) == ({}, [])
