"""Tracks lie on the lanes: those of inD and INTERACTION on their Lanelet2 maps, others after a correction by `--align`."""

import cmath
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.runs.runfile import load_recording
from pytest_rvads.satellites.tracks.correcting import misalignment_of
from pytest_rvads.satellites.tracks.importing import read_tracks

from ..lanelet2.lanelet_files import Crossing, place
from .drives import LENGTH, WIDTH, Drive, drive, write_csv

RADIUS, SQUARE = 6_378_137.0, (2 - 1 / 298.257223563) / 298.257223563
"""Radius of the equator [m], and square of the eccentricity of the ellipsoid of WGS 84."""


def in_degrees(crossing: Crossing, latitude: float, longitude: float, scale: float = 1.0) -> Crossing:
    """Replace local coordinates by degrees about a place, by the radii of curvature of the ellipsoid at the place."""
    sine = math.sin(math.radians(latitude))
    prime = RADIUS / math.sqrt(1 - SQUARE * sine**2)
    meridian = prime * (1 - SQUARE) / (1 - SQUARE * sine**2)
    for (x, y), id in crossing.nodes.items():
        node = crossing.elements[id]
        node[:] = []
        node.set("lat", f"{latitude + math.degrees(y / scale / meridian):.11f}")
        node.set("lon", f"{longitude + math.degrees(x / scale / prime / math.cos(math.radians(latitude))):.11f}")
    return crossing


def drives_of(junction: Junction) -> list[Drive]:
    return [drive(junction, key, str(k), start=8.0 * k) for k, key in enumerate(sorted(junction.movements))]


def write_ind(path: Path, drives: list[Drive], turn: complex, shift: complex) -> Path:
    """Write tracks of inD, after a similarity from the coordinates of the map to the coordinates of the recording."""
    lines = ["recordingId,trackId,frame,xCenter,yCenter,heading,width,length,xVelocity,yVelocity"]
    for vehicle in drives:
        for (x, y), heading, time in zip(vehicle.moved(LENGTH / 2), vehicle.heading, vehicle.times, strict=True):
            place, facing = turn * complex(x, y) + shift, heading + cmath.phase(turn)
            velocity = cmath.rect(8.0, facing)
            numbers = (place.real, place.imag, math.degrees(facing), WIDTH, LENGTH, velocity.real, velocity.imag)
            lines.append(f"0,{vehicle.name},{round(time * 10)}," + ",".join(map(repr, numbers)))
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


# Values of pyproj 3.7.2 (PROJ 9.5.1) at 50.78 degrees north and 6.07 degrees east: EPSG:32632, its convergence and scale.
UTM, CONVERGENCE, SCALE = 293450.3146 + 5629453.6692j, -2.2707383789903743, 1.0001239139109726


def test_tracks_of_ind_lie_on_their_lanelets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    map = in_degrees(Crossing(), 50.78, 6.07).write(tmp_path / "ind.osm")
    drives = drives_of(find(_only_id(map), map))
    east, north = 293400.0, 5629500.0
    turn = SCALE * cmath.rect(1.0, math.radians(CONVERGENCE))
    tracks = write_ind(tmp_path / "07_tracks.csv", drives, turn, UTM - complex(east, north))
    meta = f"recordingId,frameRate,xUtmOrigin,yUtmOrigin\n7,10,{east},{north}\n"
    (tmp_path / "07_recordingMeta.csv").write_text(meta, encoding="utf-8")
    recording = read_tracks(tracks, _only_id(map), map=map, format="ind", strict=True)
    assert not recording.left_out
    for track, vehicle in zip(recording.tracks, drives, strict=True):
        assert np.abs(track.pose[:, :2] - vehicle.points).max() < 0.01
        assert np.abs(np.angle(np.exp(1j * (track.pose[:, 2] - vehicle.heading)))).max() < 1e-4
    out = tmp_path / "out.npz"
    command = ["import", str(tracks), "--format", "ind", "--map", str(map), "--junction", _only_id(map), "-o", str(out)]
    assert main(command) == 0
    assert "12 vehicles at" in capsys.readouterr().out
    assert max(track.offset for track in load_recording(out).tracks) < 0.02


# Values of pyproj 3.7.2: EPSG:32631 at latitude and longitude 0.009, minus its value at (0, 0), and its factors there.
DATA_SET, DATA_SET_CONVERGENCE, DATA_SET_SCALE = 1002.8583 + 996.1366j, -0.00047026111922304737, 1.0009727780652513


def test_tracks_of_interaction_lie_on_their_lanelets(tmp_path: Path) -> None:
    map = in_degrees(Crossing(), 0.009, 0.009).write(tmp_path / "interaction.osm")
    turn = DATA_SET_SCALE * cmath.rect(1.0, math.radians(DATA_SET_CONVERGENCE))
    lines = ["track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"]
    for start in range(4):  # straight lines, 1.75 m to the right of the middle
        ahead = place(start, -1.0, 0.0)
        for frame in range(100):
            x, y = place(start, 50.0 - frame, 1.75)
            point, velocity = turn * complex(x, y) + DATA_SET, turn * 10.0 * complex(*ahead)
            motion = f"{velocity.real},{velocity.imag},{cmath.phase(velocity)}"
            lines.append(f"{start},{frame},{frame * 100},car,{point.real},{point.imag},{motion},{LENGTH},{WIDTH}")
    tracks = tmp_path / "vehicle_tracks_000.csv"
    tracks.write_text("\n".join(lines), encoding="utf-8")
    recording = read_tracks(tracks, _only_id(map), map=map, format="interaction", strict=True)
    assert len(recording.tracks) == 4
    assert max(track.offset for track in recording.tracks) < 0.02


def _only_id(map: Path) -> str:
    (report,) = read_map(map).junctions
    return report.id


STOP = find("stop4")
DRIVES = [drive(STOP, key, f"v{k}", start=8.0 * k) for k, key in enumerate(sorted(STOP.movements))]


def moved(vehicle: Drive, turn: complex, shift: complex) -> Drive:
    places = turn * (vehicle.points @ np.array([1.0, 1j])) + shift
    heading = vehicle.heading + cmath.phase(turn)
    return Drive(
        vehicle.name, vehicle.times, np.column_stack((places.real, places.imag)), heading, vehicle.speed, vehicle.crosses
    )


@pytest.mark.parametrize(("degrees", "shift"), [(0.0, 0.6 - 0.8j), (2.0, 0.0), (-1.5, -0.5 + 0.7j)])
def test_shift_and_rotation_are_told_and_corrected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], degrees: float, shift: complex
) -> None:
    turn = cmath.rect(1.0, math.radians(degrees))
    # The offset brings the tracks to the coordinates of the map, apart from the shift and the rotation.
    log = write_csv(tmp_path / "log.csv", [moved(vehicle, turn, shift - 500.0 + 300j) for vehicle in DRIVES], noise=0.05)
    out = tmp_path / "out.npz"
    command = ["import", str(log), "--junction", "stop4", "--offset=500,-300", "-o", str(out), "--json"]
    assert main(command) == 0
    captured = capsys.readouterr()
    assert "beside the lanes" in captured.err
    assert "--align" in captured.err
    misalignment = json.loads(captured.out)["misalignment"]
    assert misalignment["applied"] is False
    assert misalignment["rotation"] == pytest.approx(-math.radians(degrees), abs=math.radians(0.1))
    # At the centre of rotation, the correction takes the moved point back.
    centre = complex(*misalignment["centre"])
    assert complex(*misalignment["shift"]) == pytest.approx((centre - shift) / turn - centre, abs=0.1)
    assert main([*command, "--align"]) == 0
    captured = capsys.readouterr()
    assert "the tracks were moved" in captured.err
    assert json.loads(captured.out)["misalignment"]["applied"] is True
    recording = load_recording(out)
    assert len(recording.tracks) == len(DRIVES)
    assert max(track.offset for track in recording.tracks) < 0.2
    assert misalignment_of([recording]).systematic < 0.05


def test_tracks_on_the_lanes_give_no_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_csv(tmp_path / "log.csv", DRIVES, noise=0.1)
    assert main(["import", str(log), "--junction", "stop4", "-o", str(tmp_path / "out.npz")]) == 0
    captured = capsys.readouterr()
    assert "beside the lanes" not in captured.out + captured.err


def test_shift_along_the_only_road_is_not_guessed(tmp_path: Path) -> None:
    straight = next(vehicle for key, vehicle in zip(sorted(STOP.movements), DRIVES, strict=True) if key == (0, 2))
    log = write_csv(tmp_path / "log.csv", [moved(straight, 1.0, 0.9 + 3.0j)])
    misalignment = misalignment_of([read_tracks(log, STOP)])
    assert misalignment.lateral == pytest.approx(-0.9, abs=0.01)
    assert misalignment.shift == pytest.approx((-0.9, 0.0), abs=0.01)
    assert misalignment.rotation == pytest.approx(0.0, abs=1e-3)


def test_vehicles_far_off_on_both_sides_are_no_misalignment(tmp_path: Path) -> None:
    beside = [
        moved(vehicle, 1.0, cmath.rect(0.9, float(vehicle.heading[0]) + math.copysign(math.pi / 2, k % 2 - 0.5)))
        for k, vehicle in enumerate(
            [drive(STOP, (a, (a + 2) % 4), f"v{a}{k}", start=20.0 * (4 * k + a)) for a in range(4) for k in range(2)]
        )
    ]
    recording = read_tracks(write_csv(tmp_path / "log.csv", beside), STOP)
    assert min(track.offset for track in recording.tracks) > 0.8
    assert misalignment_of([recording]).systematic < 0.1
