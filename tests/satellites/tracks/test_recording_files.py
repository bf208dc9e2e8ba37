"""Recordings survive writing and reading, and `rvads import` writes them and prints a summary."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find, load
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.runfile import load_recording, load_run, save_recording
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.lightlog import lights_at, read_lights
from pytest_rvads.support.errors import RunError

from .drives import drive, write_csv

LIGHT = find("light4")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    drives = [drive(LIGHT, key, f"v{k}", start=4.0 * k + 40.0 * (k > 5)) for k, key in enumerate(sorted(LIGHT.movements))]
    return write_csv(tmp_path / "drives.csv", drives, noise=0.1)


@pytest.fixture
def lights(tmp_path: Path) -> Path:
    path = tmp_path / "lights.csv"
    rows = [f"{time},{entrance},{'red' if k % 2 else 'G'}" for k, time in enumerate((0, 10.5, 20, 60)) for entrance in range(4)]
    path.write_text("\n".join(["time,entrance,colour", *rows]), encoding="utf-8")
    return path


def test_recording_survives_writing_and_reading(log: Path, lights: Path, tmp_path: Path) -> None:
    recording = read_tracks(log, LIGHT, lights=lights, speed_accuracy=0.2, speed_limit=13.9)
    path = tmp_path / "kept.npz"
    save_recording(recording, path)
    copy = load_recording(path)
    assert [run.hash for run in copy] == [run.hash for run in recording]
    assert len(copy) == len(recording) > 1
    assert (copy.left_out, copy.facts, copy.label) == (recording.left_out, recording.facts, "drives")
    runs = read_runs(path)
    assert isinstance(runs, Recording)  # a recording makes its runs lazily
    assert runs[0] == recording[0]
    save_recording(copy, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
    with pytest.raises(RunError, match="not a run kept by rvads: its format is 'rvads-recording'"):
        load_run(path)


def test_lights_hold_until_the_next_row(log: Path, lights: Path) -> None:
    run = read_tracks(log, LIGHT, lights=lights)[0]
    shown = {round(run.start + tick * run.dt, 2): run.lights[tick, 2] for tick in range(run.steps)}
    assert [shown[time] for time in (0.0, 10.49, 10.5, 19.99, 20.0)] == [
        Colour.GREEN,
        Colour.GREEN,
        Colour.RED,
        Colour.RED,
        Colour.GREEN,
    ]


@pytest.fixture
def sumo(shared: Path) -> Junction:
    """A junction with a light for each turn; the ids of the lights contain their entrance."""
    return next(
        find(report.id, shared / "maps" / "sumo_lights4.xodr") for report in load(shared / "maps" / "sumo_lights4.xodr").junctions
    )


def own_signals(place: Junction, entrance: int) -> list[str]:
    """Return the ids of the signals of an entrance; SUMO writes these signals on the road that leads to the entrance."""
    road = place.entrances[entrance].approach.id.split("+")[-1].split(".")[0]
    root = ElementTree.parse(place.map).getroot()
    return [signal.get("id") for signal in root.iterfind(f"road[@id='{road}']/signals/signal")]


def test_signals_are_matched_by_their_ids_on_the_map(sumo: Junction, tmp_path: Path) -> None:
    for entrance in range(4):
        name = own_signals(sumo, entrance)[0]
        path = tmp_path / "lights.csv"
        path.write_text(f"time;signal;color\n1;{name};r\n2;{name};y\n3;elsewhere;g", encoding="utf-8")
        ((number, light),) = lights_at(sumo, read_lights(path)).items()
        assert number == entrance
        assert (light.times.tolist(), light.colours.tolist()) == ([1.0, 2.0], [Colour.RED, Colour.YELLOW])


def test_colour_is_unknown_while_the_lights_of_sumo_differ(sumo: Junction, tmp_path: Path) -> None:
    (signal,) = own_signals(sumo, 1)
    light, number = signal.rsplit("_", 1)
    states = [(0, "Gr"), (1, "Gr"), (5, "yr"), (8, "rr"), (9, "rG")]  # of two signals of the same light
    rows = "".join(f'<tlsState time="{t}" id="{light}" state="{"O" * int(number)}{state}"/>' for t, state in states)
    path = tmp_path / "tls.xml"
    path.write_text(f"<tlsStates>{rows}</tlsStates>", encoding="utf-8")
    shown = read_lights(path)
    assert shown[signal].times.tolist() == [0.0, 5.0, 8.0]
    together = lights_at(sumo, {signal: shown[signal], "entrance 1": shown[f"{light}_{int(number) + 1}"]})[1]
    assert dict(zip(together.times.tolist(), together.colours.tolist(), strict=True)) == {
        0.0: Colour.NONE,
        5.0: Colour.NONE,
        8.0: Colour.RED,
        9.0: Colour.NONE,
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,colour\n", "row 1 must have the columns time, signal or entrance, and colour, got time, colour"),
        ("time,signal,colour\n1,a,pink", "row 2, column colour: 'pink' is no colour, expected green, yellow, red, off"),
        ("time,signal,colour\n1,a,red\nx,a,red", "row 3, column time: 'x' is no time"),
        ("time,signal,colour\n2,a,red\n1,a,green", "row 3, column time: 1 s is too early for 'a', expected more than 2 s"),
        ('time,signal,colour\n1,a,red\n2,"a,green\n3,a,red', "row 3: a quote in the row is not closed"),
        ("time,signal,colour\n", "wrong.csv: the file has only the names of columns"),
        ("time,signal,colour\n1,a", "row 2: the row has 2 cells, expected 3 as in row 1"),
        (
            "time,signal,colour\n1,north,red",
            "none of the lights (north) is at junction 'light4', which has the lights 0, 1, 2, 3, entrance 0",
        ),
    ],
)
def test_damaged_file_of_lights_is_refused(log: Path, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RunError) as error:
        read_tracks(log, LIGHT, lights=path)
    assert message in str(error.value)


@pytest.mark.extended
def test_command_prints_a_summary(log: Path, lights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.npz"
    command = ["import", str(log), "--junction", "light4", "--lights", str(lights), "-o", str(out)]
    assert main(command) == 0
    text = capsys.readouterr().out
    count = len(LIGHT.movements)
    assert f"{count} vehicles at light4, 2 busy periods" in text
    assert "1 from 0 to 1, right" in text
    assert "m accurate (estimated)" in text
    assert "lights at entrances 0, 1, 2, 3" in text
    assert main([*command, "--json", "--accuracy", "0.1"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["vehicles"], summary["accuracy"]) == (count, {"position": 0.1, "speed": 0.0, "stated": True})
    assert sum(summary["movements"].values()) == count
    assert len(load_recording(out).tracks) == count
    assert main(["check", str(out), "--rules", "red"]) in (0, 1)


def test_command_imports_all_junctions_of_a_map(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    map = str(path_of("light4"))
    assert main(["import", str(log), "--map", map, "--junction", "all", "-o", str(tmp_path / "cut")]) == 0
    (file,) = (tmp_path / "cut").glob("*.npz")
    assert len(load_recording(file).tracks) == len(LIGHT.movements)
    assert main(["import", str(log), "--map", map, "--junction", "all", "--offset", "900,0", "-o", str(tmp_path / "cut")]) == 2
    assert "--offset=X,Y (offset=)" in capsys.readouterr().err


def test_lights_of_another_place_are_refused(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown, out = tmp_path / "lights.csv", tmp_path / "out.npz"
    shown.write_text("time,signal,colour\n0,north,red\n", encoding="utf-8")
    assert main(["import", str(log), "--junction", "light4", "--lights", str(shown), "-o", str(out)]) == 2
    assert "none of the lights (north) is at junction 'light4'" in capsys.readouterr().err
    assert not out.exists()


def test_map_without_a_usable_junction_is_refused(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree = ElementTree.parse(path_of("light4"))
    for lane in [lane for lane in tree.iter("lane") if lane.get("type") == "driving"][2:]:
        lane.set("type", "sidewalk")
    map = tmp_path / "closed.xodr"
    tree.write(map)
    assert main(["import", str(log), "--map", str(map), "--junction", "all", "-o", str(tmp_path / "cut")]) == 2
    message = capsys.readouterr().err
    assert f"map file {map} has no usable junction (" in message
    assert load(map).junctions[0].reason in message


def test_omitted_vehicles_are_counted_and_listed(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = log.read_text(encoding="utf-8").splitlines()
    log.write_text("\n".join(lines[:-30]), encoding="utf-8")  # the last vehicle disappears on its exit road
    with log.open("a", encoding="utf-8") as file:
        file.write("\n0,parked,0,0,0,0,4,2,car\n1,parked,0,0,0,0,4,2,car\n1,walks,0,0,0,1,1,1,pedestrian")
    command = ["import", str(log), "--junction", "light4", "-o", str(tmp_path / "out.npz")]
    assert main(command) == 0
    assert "left out: 2" in capsys.readouterr().out
    assert main([*command, "--json"]) == 0
    left_out = json.loads(capsys.readouterr().out)["left_out"]
    assert left_out["parked"] == "its way is not known: the track begins in the junction or behind it"
    assert left_out["walks"].startswith("it is a pedestrian")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "long"], "--size L,W takes two numbers in metres, got 'long'"),
        (["--size", "0,0"], "size must be a length and a width from 0.1 to 100 m"),
        (["--offset", "1"], "--offset=X,Y takes two numbers in metres"),
        (["--columns", "x"], "--columns takes pairs such as time=t:ms"),
        (["--accuracy", "-1"], "position_accuracy must be a standard deviation from 0 to 10"),
        (["--speed-limit", "-1"], "speed_limit of facts"),
        (["--point", "nose"], "point must be front, center, rear_axle"),
    ],
)
def test_wrong_options_are_refused(
    log: Path, tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", str(log), "--junction", "light4", "-o", str(tmp_path / "o.npz"), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") <= 5  # a progress bar may stand above the error


def test_file_that_is_no_recording_is_refused(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "x.npz"
    recording = read_tracks(log, LIGHT)
    np.savez(path, times=np.zeros(3))
    with pytest.raises(RunError, match="not a recording kept by rvads: it has no header"):
        load_recording(path)
    save_recording(recording, path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(RunError, match="not a recording kept by rvads"):
        load_recording(path)
    with pytest.raises(RunError, match="save_recording takes a recording"):
        save_recording("x", path)  # type: ignore[arg-type]
