"""A recording that lacks the colour of a light of its map: no definite verdict depends on the colour."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.tracks.importing import read_tracks

LIGHTS = find("light4")
STEP = 0.1


def samples(name: str, key: tuple[int, int], stations: np.ndarray, start: float = 0.0) -> dict[str, list[Any]]:
    """Return the columns of a table with a vehicle at stations of a way, a sample every `STEP` seconds."""
    x, y, heading = np.array([Itinerary.through(LIGHTS, *key).pose(station) for station in stations]).T.tolist()
    times = (start + STEP * np.arange(len(x))).tolist()
    speed = np.gradient(stations, STEP).tolist()
    return {
        "time": times,
        "id": [name] * len(x),
        "x": x,
        "y": y,
        "heading": heading,
        "speed": speed,
        "length": [4.6] * len(x),
        "width": [1.8] * len(x),
    }


def waiting(seconds: float) -> np.ndarray:
    """Return stations of a vehicle that comes at 8 m/s, waits before the line, and drives on."""
    coming, leaving = np.arange(-40.0, -0.3, 0.8), np.arange(-0.3, 30.0, 0.8)
    return np.concatenate((coming, np.full(round(seconds / STEP), -0.3), leaving))


DRIVING = np.arange(-40.0, 30.0, 0.8)
WAITER = samples("w", (0, 2), waiting(20.0))
LEFT, ONCOMING = samples("left", (0, 3), DRIVING), samples("oncoming", (2, 0), DRIVING)


def recording(tmp_path: Path, *vehicles: dict[str, list[Any]], lights: str = "") -> Recording:
    table = {column: [value for vehicle in vehicles for value in vehicle[column]] for column in vehicles[0]}
    path = tmp_path / "lights.csv"
    path.write_text("time,entrance,colour\n" + lights)
    return read_tracks(table, LIGHTS, point="front", position_accuracy=0.0, lights=path if lights else None)


def status(run: Run, rule: str) -> str:
    return rvads.check(run, rule).status


@pytest.mark.parametrize(
    ("lights", "expected"),
    [
        ("", "UNSURE"),
        ("0,1,red\n", "UNSURE"),  # of another entrance
        ("40,0,green\n", "UNSURE"),  # begins after the vehicle has gone
        ("0,0,unknown\n", "UNSURE"),
        ("0,0,red\n", "PASS"),
        ("0,0,green\n", "FAIL"),
    ],
)
def test_vehicle_that_waits_at_an_unknown_light_breaks_nothing(tmp_path: Path, lights: str, expected: str) -> None:
    (run,) = recording(tmp_path, WAITER, lights=lights)
    assert status(run, "progress") == expected
    # The 20 s at the line are too long at green alone, so at red they are kept, and a light that is not recorded can be red.
    assert status(run, "keep_clear") == "PASS"


def test_colour_that_was_recorded_in_time_decides(tmp_path: Path) -> None:
    (run,) = recording(tmp_path, WAITER, lights="1,0,red\n24,0,green\n")  # the vehicle is 32 m away at 1 s
    assert (status(run, "progress"), status(run, "red")) == ("PASS", "PASS")


def test_crash_stays_a_violation_without_a_single_vehicle_to_blame(tmp_path: Path) -> None:
    (run,) = recording(tmp_path, LEFT, ONCOMING)
    assert status(run, "no_collision") == status(run, "no_conflict") == "FAIL"
    assert status(run, "left_yields") == "NA"
    crash = rvads.check(run, "no_collision")
    assert {*crash.responsible} == {"left", "oncoming"}
    assert "a colour of a light was not recorded" in crash.explanation


@pytest.mark.parametrize("subject", ["left", "oncoming"])
def test_blame_of_a_vehicle_under_test_is_unsure(tmp_path: Path, subject: str) -> None:
    (run,) = recording(tmp_path, LEFT, ONCOMING)
    assert status(replace(run, facts=replace(run.facts, subject=subject)), "no_collision") == "UNSURE"
    (run,) = recording(tmp_path, LEFT, ONCOMING, lights="0,0,green\n0,2,green\n")
    verdict = rvads.check(replace(run, facts=replace(run.facts, subject=subject)), "no_collision")
    assert (verdict.status, verdict.provoked) == ("FAIL", subject == "oncoming")


def test_pass_that_a_red_light_would_take_away_is_unsure(tmp_path: Path) -> None:
    lights = "".join(f"{time},{entrance},{colour}\n" for entrance in (0, 2) for time, colour in ((0, "red"), (4.9, "unknown")))
    (run,) = recording(tmp_path, LEFT, lights=lights)
    # The front passes the line at 5 s. The light turned green in time, or it did not.
    assert status(run, "red") == "UNSURE"


def test_import_says_which_lights_the_log_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tracks, lights = tmp_path / "t.csv", tmp_path / "l.csv"
    rows = zip(*WAITER.values(), strict=True)
    tracks.write_text("\n".join([",".join(WAITER), *(",".join(map(str, row)) for row in rows)]))
    lights.write_text("time,entrance,colour\n30,0,green\n0,1,red\n0,2,red\n")
    arguments = ["import", str(tracks), "--junction", "light4", "--point", "front", "-o", str(tmp_path / "t.npz"), "--json"]
    assert main([*arguments, "--lights", str(lights)]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["unknown_lights"] == {"0": 30.0, "3": None}
    assert "at entrances 3; before 30 s at entrance 0" in printed.err
    assert main(arguments) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["unknown_lights"] == dict.fromkeys("0123")
    assert "--lights" in printed.err
    lights.write_text("time,entrance,colour\n" + "".join(f"0,{entrance},red\n" for entrance in range(4)))
    assert main([*arguments, "--lights", str(lights)]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["unknown_lights"] == {}
    assert not printed.err


def test_states_of_a_stream_without_lights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream = tmp_path / "s.jsonl"
    columns = zip(*(WAITER[name] for name in ("time", "x", "y", "heading", "speed")), strict=True)
    lines = [
        {"t": time, "vehicles": [{"id": "w", "x": x, "y": y, "heading": heading, "speed": speed, "length": 4.6, "width": 1.8}]}
        for time, x, y, heading, speed in columns
    ]
    stream.write_text("\n".join(map(json.dumps, lines)) + "\n")
    with stream.open() as opened, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", opened)
        main(["check", "--follow", "-", "--junction", "light4", "--rules", "progress", "--json", "--accuracy", "0"])
    assert json.loads(capsys.readouterr().out.splitlines()[0])["status"] == "UNSURE"
