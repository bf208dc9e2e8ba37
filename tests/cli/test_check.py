"""``rvads check`` of many files: found, judged in order, told as they come; what goes wrong costs no other verdict."""

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.cli import main, run_answers
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.files import FORMATS, load
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import save_run
from pytest_rvads.runs.states import Agent, Zone

Make = Callable[..., Run]
Read = pytest.CaptureFixture[str]
RVADS = str(Path(sys.executable).with_name("rvads"))
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


@pytest.fixture(scope="module")
def runs(make: Make) -> dict[str, Run]:
    """Runs at an all-way stop, without positions: two vehicles one after the other, or together from 1.5 s to 2 s."""
    apart = make("stop4", {0: (2, 10, 50, 200), 2: (2, 10, 250, 300)}, 400)
    together = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 150, 300)}, 400)
    return {"good": replace(apart, label="good"), "bad": replace(together, label="bad")}


@pytest.fixture
def folder(runs: dict[str, Run], tmp_path: Path) -> Path:
    """Four files that can be read, one in a folder within, and one that can't."""
    place = tmp_path / "drives"
    (place / "more").mkdir(parents=True)
    for name, kind in (("d1", "good"), ("d3", "bad"), ("more/d4", "good"), ("more/d5", "bad")):
        save_run(replace(runs[kind], label=Path(name).name), place / f"{name}.npz")
    (place / "d2.npz").write_bytes(b"no run")
    (place / "notes.txt").write_text("nothing to judge")
    return place


def lines(out: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in out.splitlines()]


def test_what_folders_patterns_and_files_mean(folder: Path, capsys: Read) -> None:
    def judged(*names: str) -> list[str]:
        main(["check", *(str(folder / name) for name in names), "--rules", "p1", "--jsonl"])
        return [line["run"] for line in lines(capsys.readouterr().out) if "run" in line]

    assert judged(".") == ["d1", "d3", "d4", "d5"]
    assert judged("more/d5.npz", ".") == ["d5", "d1", "d3", "d4"], "each once, where it is named first"
    assert judged("*.npz") == ["d1", "d3"]
    assert judged("**/*[45].npz") == ["d4", "d5"]
    assert judged("m*e", "d3.npz") == ["d4", "d5", "d3"], "a pattern may mean folders"
    odd = folder / "odd[1]*.npz"
    (folder / "d1.npz").rename(odd)
    assert judged("odd[1]*.npz") == ["d1"], "a file of that name comes before a pattern"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("none.npz", "none.npz: can't be read: No such file or directory"),
        ("empty", "empty: the folder is empty, expected files of runs (.json, .npz, .xosc) in it"),
        ("x.json", "x.json: the folder is empty, expected files of runs (.json, .npz, .xosc) in it"),
        ("none*.npz", "none*.npz: no file matches this pattern"),
        (
            "drives/notes.txt",
            "drives/notes.txt: expected a file of runs (.json, .npz, .xosc), got one ending in '.txt'; "
            "rvads import makes a recording (.npz) of a log of tracks",
        ),
    ],
)
def test_what_is_not_there_is_told_and_costs_nothing_else(
    folder: Path, name: str, told: str, capsys: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    for empty in ("empty", "x.json"):
        Path(empty).mkdir()
    assert main(["check", name]) == 2
    assert capsys.readouterr() == ("", f"rvads: {told}\n")
    assert main(["check", name, "drives/d1.npz", "--rules", "p1", "--jsonl"]) == 2
    out, err = capsys.readouterr()
    assert [line["verdicts"]["p1"]["status"] for line in lines(out) if "run" in line] == ["PASS"]
    assert err == f"rvads: {told}\n"


@pytest.mark.extended
def test_any_number_of_processes_tells_the_same(folder: Path, shared: Path, capsys: Read) -> None:
    files = [str(folder), str(shared / "runs" / "t-way-stop.json")]
    told = []
    for jobs in ("1", "2", "5"):
        assert main(["check", *files, "-j", jobs, "--jsonl"]) == 2
        told.append(capsys.readouterr())
    assert told[0] == told[1] == told[2]
    assert [line.get("run", line["file"]) for line in lines(told[0].out)][:5] == ["d1", str(folder / "d2.npz"), "d3", "d4", "d5"]
    assert len(lines(told[0].out)) > 20, "the file of recorded runs was judged in parts"


def test_json_names_who_broke_what_when_and_by_how_much(folder: Path, capsys: Read) -> None:
    assert main(["check", str(folder / "d1.npz"), str(folder / "d3.npz"), "--rules", "p1", "--rules", "p4", "--json"]) == 0
    na = {"status": "NA", "violated": [], "unsure": []}
    # Both are in the junction from 1.5 s to 2 s.
    both = {"a": "a0", "a'": "a1", "time": 1.5, "margin": 0.5}
    assert json.loads(capsys.readouterr().out) == {
        "version": 1,
        "d1": {"p1": {"status": "PASS", "violated": [], "unsure": []}, "p4": na},
        "d3": {"p1": {"status": "FAIL", "violated": [both], "unsure": []}, "p4": na},
    }


def test_what_never_got_done_is_open_in_json(make: Make, tmp_path: Path, capsys: Read) -> None:
    own = tmp_path / "own.rules"
    own.write_text("[gets_in]\ntext = forall a. F a@j\n", encoding="utf-8")
    save_run(make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, None, None)}, 400), tmp_path / "run.npz")
    main(["check", str(tmp_path / "run.npz"), "--rules", str(own), "--json"])
    _, found = json.loads(capsys.readouterr().out).values()
    (one,) = found["gets_in"].pop("open")
    assert found == {"gets_in": {"status": "OPEN", "violated": [], "unsure": []}}
    assert one["a"] == "a1"


def test_a_rule_may_be_called_as_the_indicators(folder: Path, tmp_path: Path, capsys: Read) -> None:
    own = tmp_path / "own.rules"
    own.write_text("[kpis]\ntext = forall a. F a@j\n", encoding="utf-8")
    main(["check", str(folder / "d1.npz"), "--rules", str(own), "--json", "-v"])
    _, found = json.loads(capsys.readouterr().out).values()
    assert found["kpis"]["status"] == "PASS"
    assert {v["agent"]: v["waiting"] for v in found["(kpis)"]["vehicles"]} == {"a0": 0.4, "a2": 2.4}, "ticks 10 to 50, 10 to 250"


def test_runs_of_one_name_are_told_apart(runs: dict[str, Run], tmp_path: Path, capsys: Read) -> None:
    for name in ("one.npz", "two.npz"):
        save_run(runs["good"], tmp_path / name)
    main(["check", str(tmp_path), "--rules", "p1", "--json"])
    assert list(json.loads(capsys.readouterr().out)) == ["version", "good", f"{tmp_path}/two.npz: good"]
    save_run(replace(runs["good"], label="version"), tmp_path / "one.npz")
    main(["check", str(tmp_path), "--rules", "p1", "--json"])
    assert list(json.loads(capsys.readouterr().out)) == ["version", f"{tmp_path}/one.npz: version", "good"]


def test_of_many_runs_what_is_wrong_is_printed_and_the_sums(folder: Path, capsys: Read) -> None:
    (folder / "d2.npz").unlink()
    assert main(["check", str(folder), "--rules", "p1", "--rules", "p4"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        *("d3", "  FAIL  p1 at t=1.50 s: a0, a1 both in junction"),
        *("d5", "  FAIL  p1 at t=1.50 s: a0, a1 both in junction"),
        "      PASS    FAIL      NA",
        "p1       2       2",
        "p4                       4",
        "4 runs, 8 vehicles judged",
    ]
    assert err.splitlines() == ["1/4 files", "2/4 files", "3/4 files", "4/4 files"]
    main(["check", str(folder), "--rules", "p1", "--rules", "p4", "-v"])
    assert "  PASS  p1: kept in 1 of 1 instances\n" in capsys.readouterr().out


def test_reports_of_all_formats_hold_a_record_per_run_and_rule(folder: Path, tmp_path: Path, capsys: Read) -> None:
    paths = [tmp_path / f"out{ending}" for ending in FORMATS]
    reports = [word for path in paths for word in ("-o", str(path))]
    assert main(["check", str(folder), "--rules", "p1", "--rules", "p4", *reports]) == 2
    printed = capsys.readouterr().out
    report = load(tmp_path / "out.json")
    told = [(record.nodeid, record.status, record.outcome) for record in report.records]
    assert told[:4] == [
        ("d1-p1", "PASS", "passed"),
        ("d1-p4", "NA", "skipped"),
        ("d3-p1", "FAIL", "failed"),
        ("d3-p4", "NA", "skipped"),
    ]
    assert len(told) == 8
    assert report.exitstatus == 2
    assert [note for note in report.notes if "d2.npz" in note]
    table = re.findall(r"^p1 +(\d+) +(\d+)$", printed, re.MULTILINE)
    assert table == [("2", "2")]
    for path in paths:  # CSV and JUnit files have a row or case per record and no totals
        if path.suffix in (".csv", ".xml"):
            continue
        assert "8 verdicts on 4 runs: 2 pass, 2 fail, 4 na" in path.read_text(encoding="utf-8").lower()
    assert main(["report", "compare", str(tmp_path / "out.json"), str(tmp_path / "out.json")]) == 0
    assert main(["check", str(folder), "-o", "out.txt"]) == 2
    assert "a report is a .json" in capsys.readouterr().err


def test_verdicts_come_one_by_one_and_no_run_is_held(folder: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "d2.npz").unlink()
    told: list[str] = []
    read: list[weakref.ref[Run]] = []

    def counting(path: str) -> list[Run]:
        told.append(capsys.readouterr().out)
        assert [run for run in read if run() is not None] == [], "an earlier run is still in memory"
        (run,) = read_runs(path)
        read.append(weakref.ref(run))
        return [run]

    monkeypatch.setattr(run_answers, "read_runs", counting)
    main(["check", str(folder), "--rules", "p1", "--json"])
    assert ['"d' in out for out in told] == [False, True, True, True]
    assert len(read) == 4


def test_runs_are_judged_by_the_rules_of_the_road_by_default(folder: Path, capsys: Read) -> None:
    main(["check", str(folder / "d3.npz"), "--jsonl"])
    (told,) = lines(capsys.readouterr().out)
    assert set(told["verdicts"]) == {rule.name for rule in rulebook("road") if not rule.crosswalks}


def test_a_log_is_sent_to_the_command_that_imports_it(tmp_path: Path, capsys: Read) -> None:
    (tmp_path / "drive.csv").write_text("time,id,x,y\n0,v,0,0\n", encoding="utf-8")
    assert main(["check", str(tmp_path / "drive.csv")]) == 2
    assert "rvads import makes a recording" in capsys.readouterr().err


def test_a_rule_that_can_not_judge_costs_no_other_verdict(folder: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(run: Run, rule: Rule) -> Verdict:
        if rule.name == "p2" and run.label == "d3":
            raise ZeroDivisionError("a fault of ours")
        return check(run, rule)

    monkeypatch.setattr("pytest_rvads.logic.check.check", fails)
    assert main(["check", str(folder / "d3.npz"), str(folder / "d1.npz"), "--rules", "paper", "--jsonl"]) == 2
    out, err = capsys.readouterr()
    one, two = lines(out)
    assert [one["verdicts"][name]["status"] for name in ("p1", "p2")] == ["FAIL", "ERROR"]
    assert two["verdicts"]["p1"]["status"] == "PASS"
    assert re.fullmatch(r"rvads: d3 can't be judged by p2: ZeroDivisionError: a fault of ours \(test_check.py:\d+\)\n", err)
    assert err == f"rvads: d3 {one['errors'][0]}\n"


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    """A file of a recording: every minute a car drives through stop4 at 10 m/s, a busy period each, ten in all.

    The last one jumps by 8 m, 2 s after it appears.
    """
    place = find("stop4")
    movement = place.leads(0, 2)
    way = Itinerary.through(place, *movement.key)
    tracks = []
    for number in range(10):
        times = 100.0 + 60.0 * number + np.arange(0.0, 8.0, 0.1)
        station = 10.0 * (times - times[0]) - 40.0 + (8.0 * (times - times[0] > 2.05) if number == 9 else 0.0)
        pose = np.array([way.pose(float(value)) for value in station])
        agent = Agent(f"v{number}", movement, size=(4.6, 1.8))
        tracks.append(Track(agent, times, station, np.full(len(times), 10.0), pose))
    recording = Recording("log", place, tuple(tracks))
    monkeypatch.setattr(run_answers, "read_runs", lambda path: recording)
    return str(tmp_path / "log.npz")


def test_a_recording_is_judged_period_by_period(log: str, capsys: Read) -> None:
    assert main(["check", log, "--rules", "full_stop"]) == 1
    out, err = capsys.readouterr()
    # 40 m at 10 m/s before the entrance.
    starts = [100.0 + 60.0 * number for number in range(10)]
    told = re.findall(r"^  FAIL  full_stop at t=(.*) s: v(\d) entered", out, re.MULTILINE)
    assert [int(vehicle) for _, vehicle in told] == list(range(10))
    assert [float(time) for time, _ in told[:9]] == pytest.approx([start + 4.0 for start in starts[:9]], abs=0.02)
    assert out.endswith("full_stop      10\n10 runs, 10 vehicles judged\n")
    warnings, progress = err.splitlines()[:-1], [line for line in err.splitlines() if "busy" in line]
    assert progress == [f"{n}/10 busy periods" for n in (3, 5, 8, 10)], "a line per quarter"
    jumps = {float(time) for time in re.findall(r"v9 makes .* m from (.*) s to the next state", "\n".join(warnings))}
    assert jumps
    assert all(starts[9] + 1.9 <= time <= starts[9] + 2.2 for time in jumps), "on the clock of the log"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_periods_of_a_recording_are_lines_as_they_are_judged(log: str, jobs: str, capsys: Read) -> None:
    if jobs != "1" and multiprocessing.get_start_method() != "fork":
        pytest.skip("what is patched here is not known elsewhere")
    assert main(["check", log, "--rules", "full_stop", "--jsonl", "-j", jobs]) == 0
    found = lines(capsys.readouterr().out)
    assert [line["start"] for line in found] == pytest.approx([100.0 + 60.0 * number for number in range(10)], abs=0.01)
    assert [[i["a"] for i in line["verdicts"]["full_stop"]["violated"]] for line in found] == [[f"v{n}"] for n in range(10)]
    assert {line["vehicles"] for line in found} == {1}
    assert {line["file"] for line in found} == {log}
    assert {line["version"] for line in found} == {1}


def test_of_many_doubts_the_first_are_told(runs: dict[str, Run], tmp_path: Path, capsys: Read) -> None:
    zone = runs["good"].zone.copy()
    zone[300:] = Zone.APPROACH
    save_run(replace(runs["good"], zone=zone), tmp_path / "first.npz")
    for number in range(29):
        (tmp_path / f"run{number:02d}.npz").hardlink_to(tmp_path / "first.npz")
    files = len(list(tmp_path.glob("*.npz")))
    main(["check", str(tmp_path), "--rules", "p1", "--jsonl"])
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 21
    assert err[-1] == "warning: further warnings are not printed, --verbose prints them"
    main(["check", str(tmp_path), "--rules", "p1", "--jsonl", "-v"])
    err = capsys.readouterr().err.splitlines()
    assert err[0] == "warning: good: a0 jumps on the graph at 3.00 s: from exit to approach in one step"
    assert len(err) == 2 * files, "two vehicles in each"


forked = pytest.mark.skipif(multiprocessing.get_start_method() != "fork", reason="what is patched here is not known elsewhere")


@forked
def test_a_process_that_dies_costs_one_file(folder: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    def dies(run: Run, rule: Rule) -> Verdict:
        if run.label == "d3":
            os._exit(9)
        return check(run, rule)

    monkeypatch.setattr("pytest_rvads.logic.check.check", dies)
    assert main(["check", str(folder), "-j", "2", "--rules", "p1", "--jsonl"]) == 2
    out, err = capsys.readouterr()
    assert [line["run"] for line in lines(out) if "run" in line] == ["d1", "d4", "d5"]
    assert f"rvads: {folder}/d3.npz: the process that worked on it died" in err
    assert multiprocessing.active_children() == []


def unsure(run: Run, rule: Rule) -> Verdict:
    """A verdict that hangs on how exact the recording is, as a judge of recorded traffic gives it."""
    binding = (("a", "a0"), ("a'", "a1"))
    instance = InstanceVerdict(binding, Status.UNSURE, (), 30, 50, (), None, "a0 crossed its line within 0.02 s of a1")
    return Verdict(
        rule.name, Status.UNSURE, f"{rule.name} UNSURE: it depends on 1 of 1", instances=(instance,), counts={"unsure": 1}
    )


def test_what_is_unsure_is_listed_and_neither_passes_nor_fails(
    folder: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pytest_rvads.logic.check.check", unsure)
    files = [str(folder / "d1.npz"), str(folder / "d3.npz")]
    assert main(["check", *files, "--rules", "p1"]) == 5
    out, err = capsys.readouterr()
    assert out.startswith(
        "d1\n  UNSURE p1: it depends on 1 of 1\n         UNSURE a0, a1: a0 crossed its line within 0.02 s of a1\nd3"
    )
    assert "every verdict that applies is UNSURE" in err
    main(["check", *files, "--rules", "p1", "--json"])
    found = json.loads(capsys.readouterr().out)["d1"]["p1"]
    hangs = {"hangs": "a0 crossed its line within 0.02 s of a1"}
    assert found == {
        "status": "UNSURE",
        "violated": [],
        "unsure": [{"a": "a0", "a'": "a1", "time": 0.5, "margin": None, **hangs}],
    }
    # Something else that is definite makes it a success.
    monkeypatch.setattr("pytest_rvads.logic.check.check", lambda run, rule: (unsure if rule.name == "p3" else check)(run, rule))
    assert main(["check", files[0], "--rules", "p1", "--rules", "p3"]) == 0


@pytest.fixture
def busy(runs: dict[str, Run], tmp_path: Path) -> list[str]:
    """More files than are judged before somebody gets impatient."""
    first = tmp_path / "first.npz"
    save_run(runs["good"], first)
    for number in range(2000):
        (tmp_path / f"run{number:04d}.npz").hardlink_to(first)
    return [RVADS, "check", str(tmp_path), "--jsonl", "-j", "2", "--rules", "road"]


def children(process: subprocess.Popen[bytes]) -> list[int]:
    task = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not task.exists():
        pytest.skip("only Linux tells who belongs to a process")
    return [int(number) for number in task.read_text().split()]


@pytest.mark.extended
@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_whoever_is_interrupted_leaves_nobody_behind(busy: list[str], how: signal.Signals, status: int) -> None:
    process = subprocess.Popen(busy, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT, start_new_session=True)
    assert process.stdout
    assert process.stderr
    process.stdout.readline()
    workers = children(process)
    assert len(workers) == 2
    if how is signal.SIGINT:
        os.killpg(process.pid, how)  # as a terminal does it: everybody is told
        rest = process.stdout.read().splitlines()
        assert process.stderr.read().decode() == "rvads: interrupted\n"
        assert all("verdicts" in json.loads(line) for line in rest), "whole lines"
        assert len(rest) < 1900
    else:
        process.kill()
    assert process.wait(20) == status
    end = time.monotonic() + 10
    while (left := [number for number in workers if Path(f"/proc/{number}").exists()]) and time.monotonic() < end:
        time.sleep(0.05)
    assert left == []
    process.stdout.close()
    process.stderr.close()


def test_what_only_following_asks_for_is_refused_without_it(tmp_path: Path, capsys: Read) -> None:
    wrong = ["--map", "m.xodr", "--junction", "2", "--strict", "--accuracy", "0.1"]
    assert main(["check", str(tmp_path), *wrong]) == 2
    assert "--map, --junction, --strict, --accuracy can't be given without --follow" in capsys.readouterr().err
