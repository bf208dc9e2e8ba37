"""`rvads import` tells that tracks lie beside the lanes, and `--align` brings them onto the lanes."""

import cmath
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.recordingfile import load_recording
from pytest_rvads.satellites.tracks.correcting import misalignment_of
from pytest_rvads.satellites.tracks.importing import read_tracks

from .drives import Drive, drive, write_csv

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
