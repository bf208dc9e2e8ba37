"""Tables of tracks: any names, units and delimiters; a bad row costs its vehicle and is told, or is an error."""

import gzip
import math
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.cli import main
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.finder import find
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.satellites.tracks.table import columns_of, parse_columns

from .drives import LENGTH, WIDTH, Drive, drive, write_csv

STOP = find("stop4")
ONE, TWO = drive(STOP, (0, 2), "7"), drive(STOP, (1, 2), "8", start=3.0)


def same(recording: Recording, drives: tuple[Drive, ...] = (ONE, TWO)) -> bool:
    return len(recording.tracks) == len(drives) and all(
        track.agent.name == one.name
        and np.allclose(track.times, one.times, atol=1e-9)
        and np.allclose(track.pose[:, :2], one.points, atol=1e-6)
        and np.allclose(track.speed, one.speed, atol=1e-6)
        for track, one in zip(recording.tracks, drives, strict=True)
    )


def columns(*drives: Drive) -> dict[str, np.ndarray]:
    centre = np.vstack([one.moved(LENGTH / 2) for one in drives])
    count = [len(one.times) for one in drives]
    return {
        "time": np.concatenate([one.times for one in drives]),
        "id": np.repeat([int(one.name) for one in drives], count),
        "x": centre[:, 0],
        "y": centre[:, 1],
        "heading": np.concatenate([one.heading for one in drives]),
        "speed": np.concatenate([one.speed for one in drives]),
        "length": np.full(sum(count), LENGTH),
        "width": np.full(sum(count), WIDTH),
    }


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_units_names_and_delimiters_are_what_a_user_says(tmp_path: Path, delimiter: str) -> None:
    lines = [delimiter.join(("When", "Who", "East", "North", "Course", "v:kmh", "l", "w"))]
    for one in (ONE, TWO):
        for time, (x, y), heading, speed in zip(one.times, one.moved(LENGTH / 2), one.heading, one.speed, strict=True):
            values = (time * 1e3, one.name, x, y, 90.0 - math.degrees(heading), 3.6 * speed, LENGTH, WIDTH)
            lines.append(delimiter.join(str(value) for value in values))
    path = tmp_path / "own.csv"
    path.write_text("\ufeff" + "\n".join(lines), encoding="utf-8")
    told = parse_columns("time=When:ms, id=Who, x=East, y=North, heading=Course:north, speed=v:kmh:km/h")
    assert same(read_tracks(path, STOP, columns=told))
    packed = tmp_path / "own.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert same(read_tracks(packed, STOP, columns=told))


def test_ind_and_interaction_are_known(tmp_path: Path) -> None:
    header = "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,xAcceleration"
    lines = [header]
    one = drive(STOP, (0, 2), "7", dt=0.05)
    for frame, ((x, y), heading) in enumerate(zip(one.moved(LENGTH / 2), one.heading, strict=True)):
        vx, vy = 8 * math.cos(heading), 8 * math.sin(heading)
        lines.append(f"0,7,{frame},{frame},{x},{y},{math.degrees(heading) % 360},{WIDTH},{LENGTH},{vx},{vy},0")
    path = tmp_path / "00_tracks.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert read_tracks(path, STOP).tracks[0].times[1] == pytest.approx(1 / 25)  # as inD has it where nothing else is said
    (tmp_path / "00_recordingMeta.csv").write_text("recordingId,frameRate\n0,20\n", encoding="utf-8")
    (tmp_path / "00_tracksMeta.csv").write_text(
        "recordingId,trackId,width,length,class\n0,7,1.8,4.6,truck_bus\n", encoding="utf-8"
    )
    found = read_tracks(path, STOP, format="ind")
    assert same(found, (one,))
    assert found.tracks[0].agent.kind is Kind.TRUCK

    lines = ["case_id,track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"]
    for case in (1.0, 2.0):
        for frame, ((x, y), heading) in enumerate(zip(ONE.moved(LENGTH / 2), ONE.heading, strict=True), start=1):
            vx, vy = 8 * math.cos(heading), 8 * math.sin(heading)
            lines.append(f"{case},7,{frame},{frame * 100},car,{x},{y},{vx},{vy},{heading},{LENGTH},{WIDTH}")
    path = tmp_path / "scenes.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    found = read_tracks(path, STOP, format="interaction")
    assert [track.agent.name for track in found.tracks] == ["1.0.7", "2.0.7"]
    assert len(found) == 2  # two scenes never meet


@pytest.mark.parametrize("library", ["dict", "pandas", "polars", "pyarrow"])
def test_tables_in_memory_are_read(library: str) -> None:
    made: dict[str, Callable[[], object]] = {
        "dict": lambda: columns(ONE, TWO),
        "pandas": lambda: pytest.importorskip("pandas").DataFrame(columns(ONE, TWO)),
        "polars": lambda: pytest.importorskip("polars").DataFrame(columns(ONE, TWO)),
        "pyarrow": lambda: pytest.importorskip("pyarrow").table(columns(ONE, TWO)),
    }
    assert same(read_tracks(made[library](), STOP))


BAD = {
    "no number": ("x", "wide", r"t\.csv: row 12, column x: 'wide' is no number"),
    "not finite": ("y", "nan", r"t\.csv: row 12, column y: nan is no y"),
    "infinite": ("speed", "inf", r"t\.csv: row 12, column speed: inf is no speed"),
    "missing": ("heading", "", r"t\.csv: row 12, column heading: nan is no heading"),
    "back in time": ("time", "0.1", r"t\.csv: row 12, column time: '7' is at 0\.1 s again or goes back, expected more than 0\.9"),
    "elsewhere": ("x", "5000", r"t\.csv: row 12, column x: '7' is .* m from where it was 0\.1 s before"),
    "no size": ("length", "-3", r"t\.csv: row 2, column length: -3 x 1\.8 m is no size"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_row_costs_its_vehicle_and_is_told(tmp_path: Path, what: str) -> None:
    column, text, told = BAD[what]
    path = write_csv(tmp_path / "t.csv", [ONE, TWO])
    lines = path.read_text(encoding="utf-8").splitlines()
    number = lines[0].split(",").index(column)
    row = 1 if what == "no size" else 11
    cells = lines[row].split(",")
    cells[number] = text
    lines[row] = ",".join(cells)
    path.write_text("\n".join(lines), encoding="utf-8")
    found = read_tracks(path, STOP)
    assert same(found, (TWO,))
    ((name, why),) = found.left_out
    assert name == "7"
    with pytest.raises(RunError, match=told) as strict:
        read_tracks(path, STOP, strict=True)
    assert str(strict.value) == why


def test_unclosed_quote_costs_its_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = write_csv(tmp_path / "t.csv", [ONE, TWO]), tmp_path / "out.npz"
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[20] = lines[20].replace("7,", '"7,', 1)
    path.write_text("\n".join(lines), encoding="utf-8")
    recording = read_tracks(path, STOP)
    assert [len(track.times) for track in recording.tracks] == [len(ONE.times) - 1, len(TWO.times)]
    assert recording.left_out == (("row 21", "t.csv: row 21, column id: a quote in the row is not closed"),)
    assert main(["import", str(path), "--junction", "stop4", "-o", str(out), "--strict"]) == 2
    assert "t.csv: row 21, column id: a quote in the row is not closed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "row 1 is empty"),
        ("a,b\n1,2", "row 1 has no column for the time"),
        ("time,id,x,y\n0,a,1", "row 2, column id: the row has 3 cells, expected 4"),
        ("time,id,x,y", "it has no vehicles"),
    ],
)
def test_what_is_no_table_of_tracks_is_told(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RunError, match=told):
        read_tracks(path, STOP)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"tme": "t"}, r"'tme' is no field of a track, .* did you mean 'time'\?"),
        ({"time": "t:weeks"}, "'weeks' is no unit of time, expected s, ms, us, ns, 25hz"),
        ({"x": "X:cm"}, "'cm' is no unit of x, expected no other unit"),
        ({"x": "missing"}, "row 1 has no column 'missing'"),
    ],
)
def test_a_wrong_column_is_told(given: dict[str, str], told: str) -> None:
    with pytest.raises(RunError, match=told):
        columns_of({"time": "t", "id": "i", "x": "X", "y": "Y", **given}, ["t", "i", "X", "Y"], "t.csv")


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32), chunk=st.integers(1, 60))
def test_rows_of_vehicles_may_be_mixed_in_any_way(seed: int, chunk: int) -> None:
    order = random.Random(seed)
    table = columns(ONE, TWO)
    rows = np.arange(len(table["time"]))
    picks = [rows[: len(ONE.times)].tolist(), rows[len(ONE.times) :].tolist()]
    mixed = []
    while any(picks):
        from_ = picks[order.randrange(2)]
        mixed += from_[:chunk]
        del from_[:chunk]
    assert same(read_tracks({name: values[mixed] for name, values in table.items()}, STOP))


@pytest.mark.parametrize("wrong", ["degrees", "y down"])
def test_headings_that_lead_elsewhere_than_the_vehicles_are_told(wrong: str) -> None:
    table = columns(ONE, TWO, *(drive(STOP, (k, (k + 1) % 4), str(10 + k), start=8.0 * k) for k in range(4)))
    if wrong == "degrees":
        table["heading"] = np.degrees(table["heading"])
    else:
        table["heading"] = -table["heading"] - math.pi / 4
    with pytest.raises(RunError, match=r"most of its vehicles head elsewhere than they go.*heading=COLUMN:deg"):
        read_tracks(table, STOP)
    right = {"heading": "heading:deg"} if wrong == "degrees" else None
    if right:
        assert len(read_tracks(table, STOP, columns=right).tracks) == 6


def test_who_changes_lanes_in_one_step_is_one_vehicle() -> None:
    """A simulator that knows lanes only has a vehicle on one in a step, and on the next one in the step after."""
    table = columns(ONE)
    across = np.array([-math.sin(ONE.heading[0]), math.cos(ONE.heading[0])]) * 3.2
    table["x"][:5] += across[0]
    table["y"][:5] += across[1]
    (track,) = read_tracks(table, STOP).tracks
    assert track.agent.name == ONE.name


def again(second: Drive, apart: float, **other: object) -> dict[str, np.ndarray]:
    """Return two vehicles with one id, the second of which comes `apart` seconds after the first has gone."""
    table = columns(ONE, replace(second, name="7", times=second.times - second.times[0] + ONE.times[-1] + apart))
    table["class"] = np.full(len(table["id"]), "passenger")
    for name, value in other.items():
        table[name][len(ONE.times) :] = value
    return table


FAR = math.dist(ONE.moved(LENGTH / 2)[-1], TWO.moved(LENGTH / 2)[0])


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (again(TWO, 1.0), f"row 162: '7' is {FAR:.1f} m from where it was 1 s before: it is another vehicle, called 7#2"),
        (again(TWO, 3.0, length=12.0), "row 162: '7' is 12 x 1.8 m large and was 4.6 x 1.8 m: it is another vehicle, called 7#2"),
        (again(TWO, 3.0, **{"class": "truck"}), "row 162: '7' is a truck and was a car: it is another vehicle, called 7#2"),
    ],
    ids=["jump", "size", "class"],
)
def test_id_of_another_vehicle(table: dict[str, np.ndarray], told: str) -> None:
    one, two = read_tracks(table, STOP).tracks
    assert (one.agent.name, two.agent.name) == ("7", "7#2")
    assert (one.agent.size, two.agent.size) == ((4.6, 1.8), (table["length"][-1], 1.8))
    assert (one.agent.route, two.agent.route) == (STOP.movements[0, 2], STOP.movements[1, 2])
    log, _ = read_log(table)
    assert [sentence.split(": ", 1)[1] for sentence in log.reused_ids] == [told]


def test_size_that_a_detector_measures_anew() -> None:
    """Boxes vary by some centimetres, also over a time in which the vehicle was hidden."""
    table = {name: np.delete(values, range(20, 32)) for name, values in columns(ONE).items()}
    table["length"] = table["length"] + 0.1 * (np.arange(len(table["x"])) % 2)
    assert [track.agent.name for track in read_tracks(table, STOP).tracks] == ["7"]


def test_a_clock_may_count_from_1970() -> None:
    table = columns(ONE, TWO)
    table["time"] = table["time"] + 1.7e9
    early, late = read_tracks(columns(ONE, TWO), STOP), read_tracks(table, STOP)
    assert [t.times[0] - 1.7e9 for t in late.tracks] == pytest.approx([t.times[0] for t in early.tracks], abs=1e-6)
    for one, other in zip(early, late, strict=True):
        assert abs(other.steps - one.steps) <= 1
