"""CONTRIBUTING.md, "Add a log format": one function and one line make ``rvads import``, or ``rvads check``, read other files."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.readers import READERS, read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.logformats import FORMATS, Format
from pytest_rvads.satellites.tracks.samples import Gather, Log
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.errors import RunError

ZONES = {zone.name.lower(): zone for zone in Zone}


def read_zones(path: str | Path) -> list[Run]:
    """Read a table with a column per vehicle at stop4, called by entrance and exit (``0-2``), and a row per tick of 10 ms."""
    path, place = Path(path), find("stop4")
    names, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    ways = [tuple(map(int, name.split("-"))) for name in names]
    agents = tuple(Agent(f"a{i}", place.movements[i, k]) for i, k in ways)
    try:
        zone = np.array([[ZONES[word] for word in row] for row in rows], dtype=np.int8)
    except KeyError as error:
        raise RunError(f"{path.name}: a zone must be one of {', '.join(ZONES)}, got {error}") from error
    return [Run(path.stem, place, agents, zone, np.zeros((len(rows), len(place.entrances)), dtype=np.int8))]


def read_beacons(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Read lines such as ``12.5 bus @ 3.0 4.0``: places of front bumpers."""
    with opened(path, watch) as source:
        gather = Gather(source.where, {}, strict=strict)
        for row, line in enumerate(source.lines(), start=1):
            time, name, _, x, y = line.decode().split()
            try:
                gather.add(name, row, (float(time), float(x), float(y), np.nan, np.nan))
            except ValueError:
                gather.refuse(name, row, "x", f"{x!r} or another number is none")
        return gather.log()


def test_import_matches_what_the_new_reader_reads(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(FORMATS, "beacons", Format(read_beacons, (".beacons",), "front"))
    way = Itinerary.through(find("stop4"), 0, 2)
    poses = [(0.1 * k, way.pose(-30.0 + 0.8 * k)) for k in range(80)]
    file = tmp_path / "own.beacons"
    lines = [f"{time} bus @ {pose.x} {pose.y}" for time, pose in poses]
    file.write_text("\n".join([*lines, "1 lost @ here 4.0"]), encoding="utf-8")
    assert main(["import", str(file), "--junction", "stop4", "-o", str(tmp_path / "out.npz")]) == 0
    assert "1 vehicle at stop4" in capsys.readouterr().out
    recording = read_tracks(file, "stop4")
    assert [track.agent.way.key for track in recording.tracks] == [(0, 2)]
    assert recording.left_out == (("lost", "own.beacons: row 81, column x: 'here' or another number is none"),)


@pytest.fixture(autouse=True)
def _line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(READERS, ".csv", read_zones)


def test_check_judges_what_the_new_reader_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    together = [["approach", "approach"], ["entrance", "entrance"], ["junction", "junction"], ["exit", "exit"]]
    file = tmp_path / "both at once.CSV"
    file.write_text("\n".join(map(",".join, [["0-2", "1-3"], *together])), encoding="utf-8")
    assert main(["check", str(file), "--rules", "p1"]) == 1
    assert "FAIL  p1 at t=0.02 s: a0, a1 both in junction" in capsys.readouterr().out


def test_what_can_not_be_read_is_told(tmp_path: Path) -> None:
    file = tmp_path / "odd.csv"
    file.write_text("0-2\nasleep", encoding="utf-8")
    with pytest.raises(RunError, match=r"odd.csv: a zone must be one of .*, got 'asleep'"):
        read_runs(file)
