"""``rvads report compare``, as users call it, on the reports of two sessions."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.cli import main
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.files import save
from pytest_rvads.report.record import conclude, planned_record
from pytest_rvads.report.session_report import Report
from tests.inner_sessions import driven_by

CONFTEST = driven_by(
    "Racer if request.param in {racing} else rvads.Reference",
    params='["v1", "v2"]',
)
TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=1, grid="B", rules=("p1", "p4"), duration=3)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
Said = tuple[int, list[str], str]


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> Said:
    capsys.readouterr()
    status = main(["report", "compare", *arguments])
    out, err = capsys.readouterr()
    return status, out.splitlines(), err


def test_two_sessions(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A session in which both versions keep the rules, and one in which the second does not: two seconds."""
    monkeypatch.setenv("COLUMNS", "100")
    pytester.makepyfile(test_it=TESTS)
    for name, racing in (("old", []), ("new", ["v2"])):
        pytester.makeconftest(CONFTEST.format(racing=racing))
        pytester.runpytest(f"--rvads-report={name}.json", "-p", "no:cacheprovider")
    status, lines, err = said(capsys, "old.json", "new.json", "-o", "out.html", "-o", "out.md", "-o", "out.json")
    assert (status, err) == (0, "")
    assert "  against A: 1 NEW, 3 UNCHANGED" in lines
    assert "  v2, class 01, p1: pass -> FAIL (B)" in lines
    assert "  p4: 2 NA in both" in lines
    assert any("Racer (conftest.py " in line for line in lines[lines.index("B: new.json") :])
    assert any(line.startswith("  only in B: 1 x p1 (no two vehicles in the junction): ") for line in lines)
    page, markdown, content = (Path(f"out.{ending}").read_text(encoding="utf-8") for ending in ("html", "md", "json"))
    assert "| v2  01 | pass -> FAIL |" in markdown
    assert "pass -&gt; FAIL" in page
    assert json.loads(content)["common"] == 4


@pytest.fixture
def reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Reports of an earlier session and a later one; one that died, one of other tests, one of a version to come."""
    monkeypatch.chdir(tmp_path)
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "B", "rotation": 0, "rule": "p1"}
    start = planned_record("t.py::test[stop4]", 3, "test", keys, 4)
    old = Report((conclude(start, [Verdict("", Status.PASS, "")], "call", "passed"),), began="2026-01-01T10:00:00+00:00")
    new = Report((conclude(start, [Verdict("", Status.FAIL, "")], "call", "failed", text="p1: both in"),), exitstatus=1)
    other = planned_record("u.py::test[stop4]", 3, "test", keys, 4)
    save(tmp_path / "old.json", old)
    save(tmp_path / "new.json", new)
    save(tmp_path / "part.json", replace(new, complete=False))
    save(tmp_path / "other.json", Report((other, other)))
    later = json.loads((tmp_path / "old.json").read_text(encoding="utf-8")) | {"version": 99}
    (tmp_path / "later.json").write_text(json.dumps(later), encoding="utf-8")
    (tmp_path / "text.json").write_text("no report", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["old.json", "new.json"], 0),
        (["old.json", "new.json", "--fail-on", "new"], 1),
        (["new.json", "old.json", "--fail-on", "new", "--fail-on", "lost"], 0),
        (["old.json", "new.json", "--fail-on", "lost", "--fail-on", "eroded"], 0),
        (["old.json", "old.json", "--fail-on", "new"], 0),
    ],
)
def test_a_difference_fails_where_one_asks_for_that(
    reports: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], status: int
) -> None:
    assert said(capsys, *arguments)[::2] == (status, "")


def test_formats_of_items_hold_the_later_session_and_what_changed(reports: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "old.json", "new.json", "-o", "out.csv", "-o", "out.xml")[::2] == (0, "")
    rows = list(csv.DictReader((reports / "out.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["verdict"] for row in rows] == ["FAIL"]
    (case,) = ElementTree.parse(reports / "out.xml").iter("testcase")
    assert {one.get("name"): one.get("value") for one in case.iter("property")}["change"] == "NEW"
    assert case.find("failure") is not None


def test_one_session_twice_is_told(reports: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    _, lines, _ = said(capsys, "old.json", "old.json")
    assert "  no verdict of the 1 item that both have differs; they are reports of one session" in lines


def test_a_session_that_died_is_compared_and_told(reports: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, lines, err = said(capsys, "old.json", "part.json")
    assert (status, err) == (0, "")
    assert lines[lines.index("B: part.json") + 1].startswith("  note: incomplete: the session that writes it has not ended")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["old.json", "no.json"], "no.json can't be read as a report of --rvads-report: "),
        (["text.json", "old.json"], "text.json can't be read as a report of --rvads-report: "),
        (["old.json", "later.json"], "later.json is not a report of version 5 written by --rvads-report=FILE.json"),
        (["old.json", "new.json", "-o", "out.txt"], "a report is a .json, .html, .md, .csv, .xml file, got 'out.txt'"),
        (
            ["old.json", "other.json"],
            "old.json (1 item) and other.json (2 items) have no item in common, and items are matched by ",
        ),
    ],
)
def test_what_can_not_be_compared_is_told_in_a_sentence(
    reports: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], why: str
) -> None:
    status, lines, err = said(capsys, *arguments)
    assert (status, lines, err.count("\n")) == (2, [], 1)
    assert err.startswith(f"rvads: {why}")
    assert not (reports / "out.csv").exists()
