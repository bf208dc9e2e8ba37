"""A case gives the same bits on every Python: nothing that maps, runs and indicators depend on is added up by `sum`.

Since Python 3.12 `sum` compensates for rounding where it adds floats; before, the last bit may be another one.
"""

import builtins
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.runs.itineraries import Itinerary
from tools.crossings import opendrive
from tools.make_maps import LAYOUTS
from tools.roundabouts import Roundabout, roundabout

SUM = sum


@pytest.fixture(autouse=True)
def exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """`sum` refuses this package floats."""

    def add(values: Iterable[Any], start: Any = 0) -> Any:
        found = SUM(values, start)
        if isinstance(found, float) and sys._getframe(1).f_globals["__name__"].startswith("pytest_rvads."):
            raise AssertionError("the last bit of this sum depends on the version of Python: take math.fsum")
        return found

    monkeypatch.setattr(builtins, "sum", add)


@pytest.mark.parametrize("name", LAYOUTS)
def test_maps_that_are_written_and_read(name: str, tmp_path: Path) -> None:
    layout = LAYOUTS[name]
    path = tmp_path / f"{name}.xodr"
    path.write_text(roundabout(layout, name) if isinstance(layout, Roundabout) else opendrive(layout, name), encoding="utf-8")
    usable = [report.id for report in read_map(path).junctions if report.usable]
    assert usable
    assert [rvads.find(id, map=path).id for id in usable] == usable


def test_runs_and_their_indicators() -> None:
    place = rvads.find("stop4")
    senses = rvads.Senses(dropout=0.1, position_noise=0.2, latency=0.05, jitter=0.05)
    case = rvads.Case(rvads.Scenario(place, "1133", distance=5, duration=4.0, senses=senses), rvads.RollingStop)
    run = rvads.simulate(case)
    assert rvads.kpis(run).pairs
    assert rvads.check(run, "p1").status


def test_tracks_that_are_read(tmp_path: Path) -> None:
    place = rvads.find("stop4")
    rows = ["time,id,x,y,speed"]
    for entrance in range(3):
        way = Itinerary.through(place, entrance, (entrance + 2) % 4)
        for tick in range(80):
            x, y, _ = way.pose(-40.0 + 0.8 * tick)
            rows.append(f"{0.1 * tick},v{entrance},{x},{y},8")
    (tmp_path / "log.csv").write_text("\n".join(rows), encoding="utf-8")
    assert len(rvads.files.read_tracks(tmp_path / "log.csv", place, size=(4.6, 1.8)).tracks) == 3
