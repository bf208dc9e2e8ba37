"""What tests asked for and did not run, as all forms of a report tell it."""

from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.cli.report_commands import merge
from pytest_rvads.report.figures import refused
from pytest_rvads.report.files import FORMATS, load, save
from pytest_rvads.report.outline import outline
from pytest_rvads.report.record import planned_record
from pytest_rvads.report.session_report import Drawn, Report

MANY = {"it has 2 arms": tuple(f"town.{k}" for k in range(12)), "it has no lanes": ("town.90", "town.91"), "it is odd": ("x.1",)}
DRAWN = (Drawn("t.py::test_it", "runs", 400, 12_960, 1), Drawn("t.py::test_it", "junctions", 20, 300, 1))
REPORT = Report((), refused=MANY, drawn=DRAWN)


def test_junctions_are_counted_by_reason_and_the_first_named() -> None:
    assert refused(REPORT) == [
        "12 junctions left out: it has 2 arms: town.0, town.1, town.2, town.3, town.4 and 7 more",
        "2 junctions left out: it has no lanes: town.90, town.91",
        "1 junction left out: it is odd: x.1",
        "400 of 12,960 runs drawn by --rvads-sample, seed 1: t.py::test_it",
        "20 of 300 junctions drawn by limit= of the mark, seed 1: t.py::test_it",
    ]
    assert refused(Report(())) == []


def test_the_rest_of_many_reasons_is_counted() -> None:
    assert refused(REPORT, 1)[1] == "3 junctions left out for other reasons: reports in files say which"
    assert refused(REPORT, 3) == refused(REPORT)
    many = Report((), refused={f"reason {k}": (f"x.{k}",) for k in range(20)})
    assert len(refused(many, 5)) == 6
    short, whole = (sum(len([*block.plain()]) for block in outline(many, short)) for short in (True, False))
    assert whole - short == 20 - 6


@pytest.mark.parametrize("form", [form for form in FORMATS if form not in (".csv", ".xml")])  # these have records alone
def test_every_form_tells_it(form: str, tmp_path: Path) -> None:
    save(tmp_path / f"r{form}", REPORT)
    text = (tmp_path / f"r{form}").read_text(encoding="utf-8").replace("\\", "")
    assert all(said in text for said in ("2 junctions left out: it has no lanes: town.90, town.91", "400 of 12,960 runs drawn"))
    if form == ".json":
        assert load(tmp_path / "r.json") == REPORT


def test_merged_shards_tell_it_once() -> None:
    other = Report((), refused={"it is odd": ("x.1", "x.2"), "it is new": ("y.1",)}, drawn=DRAWN[:1])
    made = (planned_record("t.py::test_it[1]", 1, "test_it", {"junction": "stop4"}, 4),)
    whole = merge([("a", replace(REPORT, records=made)), ("b", replace(other, records=made))])
    assert whole.refused == {**MANY, "it is odd": ("x.1", "x.2"), "it is new": ("y.1",)}
    assert whole.drawn == DRAWN
