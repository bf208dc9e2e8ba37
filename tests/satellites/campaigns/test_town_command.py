"""``rvads town``: what it prints, leaves behind and returns, and that what it prints can be pasted."""

import html
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.files import load
from pytest_rvads.report.session_report import Report
from pytest_rvads.satellites.campaigns import campaign, replays
from tools.crossings import Layout, opendrive

SHORT = ("-j", "1", "--grid", "B", "--subject", "none")

DRIVER = """
from pathlib import Path

from pytest_rvads import Reference

class Impatient(Reference):
    made = 0

    def __init__(self):
        super().__init__()
        Impatient.made += 1
        if Impatient.made == {last} and not Path("patient").exists():
            raise KeyboardInterrupt

class Fickle(Reference):
    def __init__(self):
        super().__init__()
        self.throttle = 1.0 if Path("driven").exists() else 0.9
        Path("driven").touch()

    def control(self, view):
        return super().control(view)._replace(throttle=self.throttle, brake=0.0)
"""

KEPT = """
import os, signal, time
from pathlib import Path

def kept():
    while not any(len(file.read_bytes().splitlines()) > 1 for file in Path("rvads-town").glob("results-*.jsonl")):
        time.sleep(0.05)
"""
"""Waits in a driver until the command has kept a result: the results file begins with a line about itself."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with two maps of one junction each."""
    monkeypatch.chdir(tmp_path)
    for name in ("stop3", "stop4"):
        shutil.copy(path_of(name), tmp_path / f"{name}.xodr")
    return tmp_path


def ran(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Return exit status, standard output and standard error of the command."""
    try:
        status = main(["town", *words])
    except SystemExit as ended:
        status = int(ended.code or 0)
    out, err = capsys.readouterr()
    return status, out, err


def shown(folder: Path) -> dict[str, tuple[str, str]]:
    """Return the mark and the text of every junction on the map of a page, by name."""
    text = (folder / "town.html").read_text(encoding="utf-8")
    marks = re.findall(r'<a [^>]*class="mark (\w+)"[^>]*data-name="([^"]*)" aria-label="([^"]*)"', text)
    return {name: (mark, html.unescape(label)) for mark, name, label in marks}


def items(folder: Path) -> list[dict[str, Any]]:
    """Return the items that a page shows."""
    text = (folder / "town.html").read_text(encoding="utf-8")
    found: list[dict[str, Any]] = json.loads(text.partition('id="data">')[2].partition("</script>")[0])["items"]
    return found


def judged(report: Report) -> dict[str, str]:
    return {record.nodeid: record.status.value for record in report.records}


def test_what_would_run_is_listed_without_a_driver_and_without_a_trace(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    status, out, _ = ran(capsys, "stop3.xodr", "stop4.xodr", "--list", "--grid", "AB")
    ids = out.splitlines()
    assert status == 0
    assert len(ids) == len({*ids})
    assert {id.split(".")[0] for id in ids} == {"stop3", "stop4"}
    assert {id[-1] for id in ids} == {"A", "B"}
    assert {path.suffix for path in folder.iterdir()} == {".xodr"}


@pytest.mark.extended
def test_a_town_is_judged_once_and_not_again(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("stop3.xodr", "stop4.xodr", "--autopilot", "reference", "--sample", "2", *SHORT)
    status, out, err = ran(capsys, *words)
    assert status == 0
    assert "2/2 runs" in err
    assert "look: rvads-town/town.html" in out
    first = load(folder / "rvads-town/town.json")
    assert {record.junction.split(".")[0] for record in first.records} == {"stop3", "stop4"}
    assert not any(record.failed for record in first.records)
    (results,) = (folder / "rvads-town").glob("results-*.jsonl")
    assert main(["report", "merge", str(results), "-o", "all/out.xml", "-o", "all/out.html"]) == 0
    cases = ElementTree.parse(folder / "all/out.xml").iter("testcase")
    assert [case.get("name") for case in cases] == [record.nodeid for record in first.records]
    assert "rvads verdicts" in (folder / "all/out.html").read_text(encoding="utf-8")
    assert {mark for mark, _ in shown(folder / "rvads-town").values()} <= {"good", "doubt"}
    (drawn,) = first.drawn
    assert (drawn.what, drawn.taken, drawn.seed) == ("runs", 2, 0)

    def never(*_: object) -> None:
        raise AssertionError("it was judged before")

    monkeypatch.setattr(campaign, "simulate", never)
    status, _, err = ran(capsys, *words)
    assert status == 0
    assert "are not simulated again" in err
    assert judged(load(folder / "rvads-town/town.json")) == judged(first)


@pytest.mark.extended
def test_the_printed_line_runs_exactly_that_case_again(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    status, out, _ = ran(capsys, "stop4.xodr", "--autopilot", "lgsvl", *SHORT, "--sample", "3")
    assert status == 1
    line = next(line.partition("first: ")[2] for line in out.splitlines() if "first: rvads" in line)
    command, name, *words = shlex.split(line)
    assert (command, name) == ("rvads", "town")
    whole = judged(load(folder / "rvads-town/town.json"))
    status, _, _ = ran(capsys, *words, "-j", "1")
    assert status == 1
    again = judged(load(folder / "rvads-town/only/town.json"))
    id = words[-1]
    run = id.rpartition("-")[0]
    assert again == {name: status for name, status in whole.items() if name.rpartition("-")[0] == run}
    assert again[id] == "FAIL"
    assert judged(load(folder / "rvads-town/town.json")) == whole, "the town as a whole stays as it was"
    assert {mark for mark, _ in shown(folder / "rvads-town").values()} == {"bad"}
    assert {record.look.partition("/")[0] for record in load(folder / "rvads-town/town.json").records} <= {"", "rvads-town"}
    looks = [item["look"] for item in items(folder / "rvads-town") if item["look"]]
    assert looks
    for look in looks:
        assert (folder / "rvads-town" / look.partition("#")[0]).read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.extended
def test_what_was_judged_before_an_interrupt_is_kept_and_gone_on_from(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(folder)
    (folder / "impatient.py").write_text(DRIVER.format(last=4), encoding="utf-8")
    words = ("stop3.xodr", "--autopilot", "impatient:Impatient", *SHORT)
    status, out, err = ran(capsys, *words)
    assert status == 2
    assert "interrupted" in err
    assert "INCOMPLETE: interrupted, 2 runs have no result" in out
    ((mark, label),) = shown(folder / "rvads-town").values()
    assert mark == "doubt"
    assert label.endswith("; results are missing")
    assert "INCOMPLETE" in (folder / "rvads-town/town.html").read_text(encoding="utf-8")
    (folder / "patient").touch()
    status, out, _ = ran(capsys, *words)
    assert status == 0
    assert "INCOMPLETE" not in out
    assert len({record.run for record in load(folder / "rvads-town/town.json").records}) == 3


@pytest.mark.extended
@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
def test_terminated_town_leaves_its_page_and_report(folder: Path, number: str) -> None:
    ends = DRIVER.format(last=4).replace(
        "raise KeyboardInterrupt", "kept(); os.kill(os.getppid(), signal.{number}); time.sleep(60)"
    )
    (folder / "impatient.py").write_text(f"{KEPT}{ends.format(number=number)}", encoding="utf-8")
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    words = ["-c", "from pytest_rvads.cli import main; raise SystemExit(main())", "town", "stop3.xodr", *SHORT]
    command = [sys.executable, *words, "--autopilot", "impatient:Impatient"]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "rvads: interrupted" in done.stderr
    assert "INCOMPLETE" in (folder / "rvads-town/town.html").read_text(encoding="utf-8")
    assert json.loads((folder / "rvads-town/town.json").read_text(encoding="utf-8"))["complete"] is False


def test_a_driver_that_drives_otherwise_every_time_is_flaky(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(folder)
    (folder / "fickle.py").write_text(DRIVER.format(last=0), encoding="utf-8")
    status, out, _ = ran(capsys, "stop3.xodr", "--autopilot", "fickle:Fickle", *SHORT, "--sample", "1")
    assert status == 1
    assert "were different when they were simulated again" in out
    records = load(folder / "rvads-town/town.json").records
    assert {record.status for record in records if record.failed} == {Outcome.FLAKY}


@pytest.mark.extended
def test_of_many_causes_the_first_of_every_junction_are_drawn(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replays, "MOST", 1)
    _, out, _ = ran(capsys, "stop3.xodr", "stop4.xodr", "--autopilot", "lgsvl", *SHORT, "--sample", "4")
    assert "causes have no replay: the first 1 were drawn" in out
    assert len([*(folder / "rvads-town/replays").iterdir()]) == 1


def test_an_error_before_anything_was_judged_leaves_no_page(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(folder)
    (folder / "nested.py").write_text("def make():\n    return lambda: None\n\n\ndriver = make()\n", encoding="utf-8")
    status, out, err = ran(capsys, "stop3.xodr", "stop4.xodr", "--autopilot", "nested:driver", "-j", "2", "--grid", "B")
    assert status == 2
    assert out == ""
    assert err.count("rvads: ") == 1
    assert not (folder / "rvads-town/town.html").exists()


@pytest.mark.extended
def test_a_junction_that_is_refused_is_shown_with_its_reason(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    words = ("stop3.xodr", "stop4.xodr", "--autopilot", "reference", *SHORT, "--subject", "3", "--sample", "1")
    status, _, err = ran(capsys, *words)
    assert status == 0
    assert "1 junction refused, the first: stop3" in err
    ((mark, label),) = (one for name, one in shown(folder / "rvads-town").items() if name.startswith("stop3"))
    assert mark == "none"
    assert label.endswith(": refused: subject must be an entrance, 0 to 2, or 'all', got 3")
    (reason,) = load(folder / "rvads-town/town.json").refused
    assert reason.startswith("subject must be an entrance")


@pytest.mark.extended
def test_what_is_refused_for_one_reason_is_told_together(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    shutil.copy(folder / "stop3.xodr", folder / "other.xodr")
    words = ("stop3.xodr", "other.xodr", "stop4.xodr", "--autopilot", "reference", *SHORT, "--subject", "3", "--sample", "1")
    _, out, _ = ran(capsys, *words)
    assert "2 junctions left out: subject must be an entrance, 0 to 2, or 'all', got 3: stop3." in " ".join(out.split())


def test_where_everything_is_refused_nothing_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = ran(capsys, "stop3.xodr", "--autopilot", "reference", "--subject", "3")
    assert status == 5
    assert "nothing to judge" in err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "no driver is named: name the driver by --autopilot module:name or --sut COMMAND"),
        (["--autopilot", "nobody"], "unknown autopilot 'nobody'"),
        (["--autopilot", "json:nothing"], "--autopilot must name an autopilot as module:name"),
        (["--autopilot", "reference", "--sut", "x"], "not allowed with"),
        (["--autopilot", "reference", "--rules", "p77"], "p77"),
        (["--autopilot", "reference", "--grid", "Z"], "unknown configuration 'Z'"),
        (
            ["--autopilot", "reference", "--subject", "none", "--traffic", "hesitant"],
            "--traffic drives the vehicles beside a subject",
        ),
        (["--autopilot", "reference", "--subject", "x"], "--subject must be an entrance, counted from 0, all, or none, got 'x'"),
        (["--autopilot", "reference", "--subject", "0", "--traffic", "mad"], "unknown traffic 'mad'"),
        (["--autopilot", "reference", "--followers", "-1"], "followers must be a whole number"),
        (["--autopilot", "reference", "--sample", "0"], "--sample must be at least 1, got 0"),
        (["--autopilot", "reference", "--limit", "0"], "--limit must be at least 1, got 0"),
        (["--autopilot", "reference", "--junctions", "77"], "has no junction '77'"),
        (["--autopilot", "reference", "--only", "nothing*"], "no run has an id like 'nothing*', there are stop3.1-class"),
        (["--only", "nothing*", "--list"], "no run has an id like 'nothing*', there are stop3.1-class"),
        (["--sut", "no_such_program --fast"], "--sut must be the command of a program that exists and may be executed"),
        (["--sut", __file__], "--sut must be the command of a program that exists and may be executed"),
        (["--autopilot", "reference", "--simulator", "none"], "unknown simulator 'none'"),
        (["nowhere.xodr", "--autopilot", "reference"], "nowhere.xodr"),
    ],
)
def test_wrong_use_is_told_in_one_sentence(capsys: pytest.CaptureFixture[str], folder: Path, words: list[str], told: str) -> None:
    status, out, err = ran(capsys, "stop3.xodr", *words)
    assert status == 2
    assert out == ""
    assert told in err
    assert not (folder / "rvads-town").exists()


def test_two_maps_of_one_name_are_refused(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    (folder / "other").mkdir()
    shutil.copy(folder / "stop3.xodr", folder / "other/stop3.xodr")
    status, _, err = ran(capsys, "stop3.xodr", "other/stop3.xodr", "--autopilot", "reference")
    assert status == 2
    assert "two are called 'stop3'" in err


@pytest.mark.parametrize("where", ["taken", "taken/below"])
def test_where_no_folder_can_be_is_told_in_a_sentence_before_anything_runs(
    capsys: pytest.CaptureFixture[str], folder: Path, where: str
) -> None:
    (folder / "taken").write_text("mine", encoding="utf-8")
    status, _, err = ran(capsys, "stop3.xodr", "--autopilot", "reference", *SHORT, "-o", where)
    assert status == 2
    assert f"-o must name a folder to write to, got {where!r}, which can't be made (" in err
    assert "runs\n" not in err.partition("rvads: ")[2]


@pytest.mark.extended
def test_movements_that_no_car_can_follow_are_left_out_and_counted(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    (folder / "tight.xodr").write_text(opendrive(Layout(stop=2.5, lane_width=2.5, lane_offset=1.25)), encoding="utf-8")
    told = "4 movements left out: no car can keep its lane in a bend so narrow (cover 'class' takes them all the same)"
    status, out, err = ran(capsys, "tight.xodr", "--autopilot", "reference", *SHORT, "--rules", "keep_lane", "-o", "town")
    assert status == 0, "the reference keeps its lane elsewhere"
    assert f"{told}: tight.1 from entrance 0 to exit 1" in err
    assert "4 movements left out" in " ".join(out.split())
    assert any(note.startswith(told) for note in load(folder / "town" / "town.json").notes)
