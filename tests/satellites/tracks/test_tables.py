"""Tables of tracks have any names, units and delimiters. A bad row is an error, or its vehicle is left out with a reason."""

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
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.satellites.tracks.table import columns_of, parse_pairs
from pytest_rvads.support.errors import RunError

from .drives import LENGTH, WIDTH, Drive, drive, write_csv

STOP = find("stop4")
FIRST, SECOND = drive(STOP, (0, 2), "7"), drive(STOP, (1, 2), "8", start=3.0)


def same(recording: Recording, drives: tuple[Drive, ...] = (FIRST, SECOND)) -> bool:
    return len(recording.tracks) == len(drives) and all(
        track.agent.name == vehicle.name
        and np.allclose(track.times, vehicle.times, atol=1e-9)
        and np.allclose(track.pose[:, :2], vehicle.points, atol=1e-6)
        and np.allclose(track.speed, vehicle.speed, atol=1e-6)
        for track, vehicle in zip(recording.tracks, drives, strict=True)
    )


def columns(*drives: Drive) -> dict[str, np.ndarray]:
    centre = np.vstack([vehicle.moved(LENGTH / 2) for vehicle in drives])
    count = [len(vehicle.times) for vehicle in drives]
    return {
        "time": np.concatenate([vehicle.times for vehicle in drives]),
        "id": np.repeat([int(vehicle.name) for vehicle in drives], count),
        "x": centre[:, 0],
        "y": centre[:, 1],
        "heading": np.concatenate([vehicle.heading for vehicle in drives]),
        "speed": np.concatenate([vehicle.speed for vehicle in drives]),
        "length": np.full(sum(count), LENGTH),
        "width": np.full(sum(count), WIDTH),
    }


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_user_names_units_columns_and_delimiters(tmp_path: Path, delimiter: str) -> None:
    lines = [delimiter.join(("When", "Who", "East", "North", "Course", "v:kmh", "l", "w"))]
    for vehicle in (FIRST, SECOND):
        for time, (x, y), heading, speed in zip(
            vehicle.times, vehicle.moved(LENGTH / 2), vehicle.heading, vehicle.speed, strict=True
        ):
            values = (time * 1e3, vehicle.name, x, y, 90.0 - math.degrees(heading), 3.6 * speed, LENGTH, WIDTH)
            lines.append(delimiter.join(str(value) for value in values))
    path = tmp_path / "own.csv"
    path.write_text("\ufeff" + "\n".join(lines), encoding="utf-8")
    columns = parse_pairs("time=When:ms, id=Who, x=East, y=North, heading=Course:north, speed=v:kmh:km/h", "--columns", "t=t")
    assert same(read_tracks(path, STOP, columns=columns))
    packed = tmp_path / "own.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert same(read_tracks(packed, STOP, columns=columns))


def test_ind_and_interaction_are_read(tmp_path: Path) -> None:
    header = "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,xAcceleration"
    lines = [header]
    vehicle = drive(STOP, (0, 2), "7", dt=0.05)
    for frame, ((x, y), heading) in enumerate(zip(vehicle.moved(LENGTH / 2), vehicle.heading, strict=True)):
        vx, vy = 8 * math.cos(heading), 8 * math.sin(heading)
        lines.append(f"0,7,{frame},{frame},{x},{y},{math.degrees(heading) % 360},{WIDTH},{LENGTH},{vx},{vy},0")
    path = tmp_path / "00_tracks.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert read_tracks(path, STOP).tracks[0].times[1] == pytest.approx(1 / 25)  # the frame rate of inD
    (tmp_path / "00_recordingMeta.csv").write_text("recordingId,frameRate\n0,20\n", encoding="utf-8")
    (tmp_path / "00_tracksMeta.csv").write_text(
        "recordingId,trackId,width,length,class\n0,7,1.8,4.6,truck_bus\n", encoding="utf-8"
    )
    recording = read_tracks(path, STOP, format="ind")
    assert same(recording, (vehicle,))
    assert recording.tracks[0].agent.kind is Kind.TRUCK

    lines = ["case_id,track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"]
    for case in (1.0, 2.0):
        for frame, ((x, y), heading) in enumerate(zip(FIRST.moved(LENGTH / 2), FIRST.heading, strict=True), start=1):
            vx, vy = 8 * math.cos(heading), 8 * math.sin(heading)
            lines.append(f"{case},7,{frame},{frame * 100},car,{x},{y},{vx},{vy},{heading},{LENGTH},{WIDTH}")
    path = tmp_path / "scenes.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    recording = read_tracks(path, STOP, format="interaction")
    assert [track.agent.name for track in recording.tracks] == ["1.0.7", "2.0.7"]
    assert len(recording) == 2  # two scenes never meet


@pytest.mark.parametrize("library", ["dict", "pandas", "polars", "pyarrow"])
def test_tables_in_memory_are_read(library: str) -> None:
    tables: dict[str, Callable[[], object]] = {
        "dict": lambda: columns(FIRST, SECOND),
        "pandas": lambda: pytest.importorskip("pandas").DataFrame(columns(FIRST, SECOND)),
        "polars": lambda: pytest.importorskip("polars").DataFrame(columns(FIRST, SECOND)),
        "pyarrow": lambda: pytest.importorskip("pyarrow").table(columns(FIRST, SECOND)),
    }
    assert same(read_tracks(tables[library](), STOP))


BAD = {
    "no number": ("x", "wide", r"t\.csv: row 12, column x: 'wide' is no number"),
    "not finite": ("y", "nan", r"t\.csv: row 12, column y: nan is no y"),
    "infinite": ("speed", "inf", r"t\.csv: row 12, column speed: inf is no speed"),
    "missing": ("heading", "", r"t\.csv: row 12, column heading: nan is no heading"),
    "back in time": ("time", "0.1", r"t\.csv: row 12, column time: the time of '7' is 0\.1 s, expected more than 0\.9"),
    "elsewhere": ("x", "5000", r"t\.csv: row 12, column x: '7' is .* m from where it was 0\.1 s before"),
    "no size": ("length", "-3", r"t\.csv: row 2, column length: -3 x 1\.8 m is no size"),
}


@pytest.mark.parametrize("what", BAD)
def test_vehicle_with_a_bad_row_is_left_out(tmp_path: Path, what: str) -> None:
    column, text, message = BAD[what]
    path = write_csv(tmp_path / "t.csv", [FIRST, SECOND])
    lines = path.read_text(encoding="utf-8").splitlines()
    number = lines[0].split(",").index(column)
    row = 1 if what == "no size" else 11
    cells = lines[row].split(",")
    cells[number] = text
    lines[row] = ",".join(cells)
    path.write_text("\n".join(lines), encoding="utf-8")
    recording = read_tracks(path, STOP)
    assert same(recording, (SECOND,))
    ((name, why),) = recording.left_out
    assert name == "7"
    with pytest.raises(RunError, match=message) as strict:
        read_tracks(path, STOP, strict=True)
    assert str(strict.value) == why


def test_row_with_an_unclosed_quote_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = write_csv(tmp_path / "t.csv", [FIRST, SECOND]), tmp_path / "out.npz"
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[20] = lines[20].replace("7,", '"7,', 1)
    path.write_text("\n".join(lines), encoding="utf-8")
    recording = read_tracks(path, STOP)
    assert [len(track.times) for track in recording.tracks] == [len(FIRST.times) - 1, len(SECOND.times)]
    assert recording.left_out == (("row 21", "t.csv: row 21, column id: a quote in the row is not closed"),)
    assert main(["import", str(path), "--junction", "stop4", "-o", str(out), "--strict"]) == 2
    assert "t.csv: row 21, column id: a quote in the row is not closed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "row 1 is empty"),
        ("a,b\n1,2", "row 1 has no column for the time"),
        ("time,id,x,y\n0,a,1", "row 2, column id: the row has 3 cells, expected 4"),
        ("time,id,x,y", "has no vehicles"),
    ],
)
def test_table_without_tracks_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RunError, match=message):
        read_tracks(path, STOP)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"tme": "t"}, r"'tme' is no field of a track, .* did you mean 'time'\?"),
        ({"time": "t:weeks"}, "'weeks' is no unit of time, expected s, ms, us, ns, 25hz"),
        ({"x": "X:cm"}, "'cm' is no unit of x, expected m, ft, deg"),
        ({"x": "missing"}, "row 1 has no column 'missing'"),
    ],
)
def test_wrong_column_is_refused(fields: dict[str, str], message: str) -> None:
    with pytest.raises(RunError, match=message):
        columns_of({"time": "t", "id": "i", "x": "X", "y": "Y", **fields}, ["t", "i", "X", "Y"], "t.csv")


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32), chunk=st.integers(1, 60))
def test_rows_of_vehicles_may_be_mixed(seed: int, chunk: int) -> None:
    order = random.Random(seed)
    table = columns(FIRST, SECOND)
    rows = np.arange(len(table["time"]))
    picks = [rows[: len(FIRST.times)].tolist(), rows[len(FIRST.times) :].tolist()]
    mixed = []
    while any(picks):
        rows_of_vehicle = picks[order.randrange(2)]
        mixed += rows_of_vehicle[:chunk]
        del rows_of_vehicle[:chunk]
    assert same(read_tracks({name: values[mixed] for name, values in table.items()}, STOP))


@pytest.mark.parametrize("wrong", ["degrees", "y down"])
def test_headings_off_the_direction_of_motion_are_refused(wrong: str) -> None:
    table = columns(FIRST, SECOND, *(drive(STOP, (k, (k + 1) % 4), str(10 + k), start=8.0 * k) for k in range(4)))
    if wrong == "degrees":
        table["heading"] = np.degrees(table["heading"])
    else:
        table["heading"] = -table["heading"] - math.pi / 4
    with pytest.raises(RunError, match=r"table: the heading of most vehicles .*heading=COLUMN:deg"):
        read_tracks(table, STOP)
    right = {"heading": "heading:deg"} if wrong == "degrees" else None
    if right:
        assert len(read_tracks(table, STOP, columns=right).tracks) == 6


def test_lane_change_in_a_single_step_keeps_the_vehicle() -> None:
    """A simulator of lanes moves a vehicle from a lane to the next lane in a single step."""
    table = columns(FIRST)
    across = np.array([-math.sin(FIRST.heading[0]), math.cos(FIRST.heading[0])]) * 3.2
    table["x"][:5] += across[0]
    table["y"][:5] += across[1]
    (track,) = read_tracks(table, STOP).tracks
    assert track.agent.name == FIRST.name


def with_reused_id(second: Drive, apart: float, **changes: object) -> dict[str, np.ndarray]:
    """Return two vehicles with the same id; the second vehicle comes `apart` seconds after the first has left."""
    table = columns(FIRST, replace(second, name="7", times=second.times - second.times[0] + FIRST.times[-1] + apart))
    table["class"] = np.full(len(table["id"]), "passenger")
    for name, value in changes.items():
        table[name][len(FIRST.times) :] = value
    return table


FAR = math.dist(FIRST.moved(LENGTH / 2)[-1], SECOND.moved(LENGTH / 2)[0])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (with_reused_id(SECOND, 1.0), f"row 162: '7' is {FAR:.1f} m from where it was 1 s before"),
        (with_reused_id(SECOND, 3.0, length=12.0), "row 162: '7' is 12 x 1.8 m large and was 4.6 x 1.8 m"),
        (with_reused_id(SECOND, 3.0, **{"class": "truck"}), "row 162: '7' is a truck and was a car"),
    ],
    ids=["jump", "size", "class"],
)
def test_reused_id_gives_a_second_vehicle(table: dict[str, np.ndarray], message: str) -> None:
    first, second = read_tracks(table, STOP).tracks
    assert (first.agent.name, second.agent.name) == ("7", "7#2")
    assert (first.agent.size, second.agent.size) == ((4.6, 1.8), (table["length"][-1], 1.8))
    assert (first.agent.way, second.agent.way) == (STOP.movements[0, 2], STOP.movements[1, 2])
    log, _ = read_log(table)
    (sentence,) = log.reused_ids
    assert sentence.startswith(f"table: {message}")
    assert sentence.endswith("7#2")


def test_varying_size_keeps_the_vehicle() -> None:
    """The box of a vehicle varies by some centimetres, also after a time in which the vehicle was hidden."""
    table = {name: np.delete(values, range(20, 32)) for name, values in columns(FIRST).items()}
    table["length"] = table["length"] + 0.1 * (np.arange(len(table["x"])) % 2)
    assert [track.agent.name for track in read_tracks(table, STOP).tracks] == ["7"]


def test_clock_may_count_from_1970() -> None:
    table = columns(FIRST, SECOND)
    table["time"] = table["time"] + 1.7e9
    early, late = read_tracks(columns(FIRST, SECOND), STOP), read_tracks(table, STOP)
    assert [t.times[0] - 1.7e9 for t in late.tracks] == pytest.approx([t.times[0] for t in early.tracks], abs=1e-6)
    for early_run, late_run in zip(early, late, strict=True):
        assert abs(late_run.steps - early_run.steps) <= 1
