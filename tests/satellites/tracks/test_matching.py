"""Every vehicle is matched to the way that it drove, whatever else the log holds; who is left out is told why."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.errors import RunError
from pytest_rvads.junctions.finder import find, load, names
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import Point

from .drives import LENGTH, WIDTH, Drive, drive, write_csv

STOP = find("stop4")


def cut(one: Drive, keep: np.ndarray, name: str = "") -> Drive:
    return Drive(name or one.name, one.times[keep], one.points[keep], one.heading[keep], one.speed[keep], one.crosses)


def reasons(recording: Recording) -> dict[str, str]:
    return dict(recording.left_out)


@pytest.mark.extended
@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("name", names())
def test_every_movement_is_found(tmp_path: Path, name: str, noise: float) -> None:
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
            (one,) = (d for d in drives if d.name == agent.name)
            assert run.start + run.entry(column) == pytest.approx(one.crosses, abs=0.011)  # a tick


def test_reference_point_shifts_the_front(tmp_path: Path) -> None:
    one = drive(STOP, (0, 2))
    shares: dict[Point, float] = {"front": 0.0, "center": LENGTH / 2, "rear_axle": 0.8 * LENGTH}
    for point, back in shares.items():
        track = read_tracks(write_csv(tmp_path / f"{point}.csv", [one], back=back), STOP, point=point).tracks[0]
        assert np.allclose(track.pose[:, :2], one.points, atol=1e-6)
        assert np.allclose(track.station, -40.0 + 8.0 * one.times, atol=1e-6)
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


def test_standing_in_noise_is_neither_driving_nor_coming_again(tmp_path: Path) -> None:
    one = drive(STOP, (0, 3), speed=5.0)
    stop = int(np.searchsorted(one.times, one.crosses)) - 2
    parts = [np.arange(stop), np.full(200, stop), np.arange(stop, len(one.times))]
    rows = np.concatenate(parts)
    waits = Drive("v", 0.1 * np.arange(len(rows)), one.points[rows], one.heading[rows], one.speed[rows], 0.0)
    recording = read_tracks(write_csv(tmp_path / "t.csv", [waits], noise=0.1), STOP)
    assert [track.agent.way.key for track in recording.tracks] == [(0, 3)]
    assert len(recording.tracks[0].times) == len(rows)


def test_who_is_left_out_is_told_why(tmp_path: Path) -> None:
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
    drives = [way, before, inside, behind, parked, away, beside, against]
    recording = read_tracks(write_csv(tmp_path / "t.csv", drives, back=0.0), STOP, point="front")
    assert [track.agent.name for track in recording.tracks] == ["passes"]
    told = reasons(recording)
    assert told["ends before"] == "its way is not known: the track ends before the junction"
    assert (
        told["ends early inside"] == "its way is not known: the track ends in the junction, where several ways are still as near"
    )
    assert told["begins inside"] == "its way is not known: the track begins in the junction or behind it"
    assert told["parked"] == "it does not move"
    assert told["away"] == "it never comes near the junction"
    assert told["against"] == told["beside"] == "it is more than 3 m beside every way through the junction"


def way_rest(one: Drive) -> tuple[np.ndarray, np.ndarray, float]:
    return one.heading, one.speed, one.crosses


def test_tracks_of_another_origin_are_told_how_to_move(tmp_path: Path) -> None:
    one = drive(STOP, (0, 2))
    far = Drive("v", one.times, one.points + np.array([1000.0, 0.0]), one.heading, one.speed, one.crosses)
    path = write_csv(tmp_path / "t.csv", [far])
    with pytest.raises(
        RunError, match=r"nobody in t.csv passes junction 'stop4': its tracks are around .* 1,0\d\d m .* --offset=X,Y"
    ):
        read_tracks(path, STOP)
    assert len(read_tracks(path, STOP, offset=(-1000.0, 0.0)).tracks) == 1


def test_a_size_is_needed_where_points_are_centres(tmp_path: Path) -> None:
    one = drive(STOP, (0, 2))
    columns: dict[str, Any] = {
        "time": one.times,
        "id": ["v"] * len(one.times),
        "x": one.moved(2.3)[:, 0],
        "y": one.moved(2.3)[:, 1],
    }
    with pytest.raises(RunError, match=r"nobody in table passes .* its length is not known, .*: --size \(size=\) gives one"):
        read_tracks(columns, STOP)
    count = len(one.times)
    rows = {name: [*columns[name]] * 2 for name in ("time", "x", "y")}
    told = {"id": ["v"] * count + ["sized"] * count, "length": [None] * count + [LENGTH] * count, "width": [WIDTH] * 2 * count}
    found = read_tracks({**rows, **told}, STOP)
    assert [track.agent.name for track in found.tracks] == ["sized"]
    assert reasons(found)["v"].startswith("its length is not known")
    track = read_tracks(columns, STOP, size=(LENGTH, WIDTH)).tracks[0]
    assert track.agent.size == (LENGTH, WIDTH)
    assert np.allclose(track.pose[:, :2], one.points, atol=0.01)  # its heading is that of its way
    assert np.allclose(track.speed, 8.0, atol=0.01)  # and its speed that of its places
    assert read_tracks(columns, STOP, point="front").tracks[0].agent.size is None


@pytest.mark.extended
@pytest.mark.parametrize("map", ["multi_intersections", "Town07", "sumo_skew4", "fabriksgatan"])
def test_on_maps_of_other_people_every_vehicle_is_where_it_was(shared: Path, tmp_path: Path, map: str) -> None:
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
        found = {track.agent.name: track.agent.way.key for track in recording.tracks}
        wrong = {name: key for name, key in found.items() if name != f"{place.id} {key[0]} {key[1]}"}
        missing = [name for name in drives if name.startswith(f"{place.id} ") and name not in found]
        assert (wrong, missing) == ({}, [])
