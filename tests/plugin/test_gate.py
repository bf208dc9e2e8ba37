"""Coverage as a gate, and how shards of a session add up."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.cli import main
from pytest_rvads.report.figures import SIMULTANEOUS
from pytest_rvads.report.files import load
from pytest_rvads.report.outline import outline
from tests.inner_sessions import records_of

TESTS = """
    import pytest_rvads as rvads

    # Of four vehicles that arrive together nobody is first (p3 is NA in C); in E two arrive before the others.
    @rvads.scenario("stop4", classes=(1, 2), grid="CE", rules=("p1", "p3"), duration=10)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


@pytest.fixture
def tests(pytester: pytest.Pytester, reference: None) -> pytest.Pytester:
    pytester.makepyfile(test_gate=TESTS)
    return pytester


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "1"), marks=pytest.mark.slow)])
def test_the_gate_counts_what_the_tests_ask_for(tests: pytest.Pytester, workers: tuple[str, ...]) -> None:
    # Two classes x two configurations x two rules, of which p3 in C is NA.
    result = tests.runpytest("--rvads-cov-fail-under=75", *workers)
    assert result.ret == 0
    result.stdout.fnmatch_lines(["coverage: 6/8 cells exercised (75.0 %): 2 NA"])
    result = tests.runpytest("--rvads-cov-fail-under=75.1", *workers)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["rvads: coverage is below 75.1 %: 6/8 cells exercised (75.0 %): 2 NA"])


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), ("-n", "1")])
def test_deselecting_does_not_raise_coverage(tests: pytest.Pytester, workers: tuple[str, ...]) -> None:
    result = tests.runpytest("-k", "class01 and p1", "--rvads-cov-fail-under=50", *workers)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["*coverage is below 50 %: 2/8 cells exercised (25.0 %): 6 not selected"])


def test_the_gate_needs_something_to_judge(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_plain(): ...")
    assert pytester.runpytest().ret == 0
    result = pytester.runpytest("--rvads-cov-fail-under=1")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["rvads: coverage is below 1 %: 0/0 cells exercised*"])
    result = pytester.runpytest("--rvads-cov-arrivals=6")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(
        ["rvads: the largest untested gap is above 6 s: arrivals: 0 of 0 pairs of conflicting movements met"]
    )
    pytester.makeini("[pytest]\nrvads_cov_fail_under = 2\n")
    assert pytester.runpytest("--collect-only").ret == 0, "nothing is claimed where nothing should run"


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), ("-n", "1")])
def test_the_gate_of_arrivals_asks_for_the_largest_untested_gap(tests: pytest.Pytester, workers: tuple[str, ...]) -> None:
    """Of class 2, 1112, only the right turn from arm 0 meets a movement: straight on from arm 3, into the same exit.

    In C they arrive together, in E the vehicle of arm 3 arrives 5 s later. So nobody from the left arrived before the right turn.
    """
    assert tests.runpytest("--rvads-cov-arrivals=6", *workers).ret == 0
    result = tests.runpytest("--rvads-cov-arrivals=5.9", *workers)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    said = (
        "rvads: the largest untested gap is above 5.9 s: arrivals: 2 of 14 pairs of conflicting movements met, the other vehicle"
    )
    result.stdout.fnmatch_lines(
        [f"{said} 1 times first, 2 together, 1 later; largest untested gap 6 s (-6 to 0 s) at stop4, vehicle under test from *"]
    )


@pytest.mark.extended
def test_a_session_without_a_gap_between_arrivals_says_so_last(tests: pytest.Pytester) -> None:
    """In D all vehicles start 20 m before their lines."""
    tests.makepyfile(test_gate=TESTS.replace('"CE"', '"D"'))
    result = tests.runpytest("--rvads-artefacts=none", "--rvads-report=out.json")
    assert result.ret == 0
    assert result.outlines[-2] == f"rvads: {SIMULTANEOUS}", "before pytest's own last line"
    assert sum(SIMULTANEOUS in line for line in result.outlines) == 1
    assert SIMULTANEOUS in outline(load(tests.path / "out.json"))[-1].plain()


@pytest.mark.parametrize("value", ["12.1", "-1", "most", "nan"])
def test_a_gate_of_arrivals_out_of_range_is_refused(pytester: pytest.Pytester, value: str) -> None:
    pytester.makeini(f"[pytest]\nrvads_cov_arrivals = {value}\n")
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"*rvads_cov_arrivals must be a number from 0 to 12, got '{value}'*"])


@pytest.mark.parametrize("value", ["101", "-1", "most", "nan"])
def test_a_gate_out_of_range_is_refused(pytester: pytest.Pytester, value: str) -> None:
    result = pytester.runpytest(f"--rvads-cov-fail-under={value}")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"*rvads_cov_fail_under must be a number from 0 to 100, got '{value}'*"])


def test_shards_of_two_projects_are_not_merged(tests: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    tests.runpytest("-k", "class01 and p1 and cfgC", "--rvads-report=a.json")
    tests.makeini("[pytest]\nrvads_autopilot = reference\naddopts = --strict-markers\n")
    tests.runpytest("-k", "class02 and p1 and cfgC", "--rvads-report=b.json")
    capsys.readouterr()
    assert main(["report", "merge", str(tests.path / "a.json"), str(tests.path / "b.json")]) == 2
    assert "are no parts of one session: they differ in the project" in capsys.readouterr().err


@pytest.mark.extended
def test_shards_merge_into_one_table(tests: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    shards = {"a": "class01", "b": "class02 and cfgC", "c": "class02 and cfgE"}
    for name, keyword in shards.items():
        tests.runpytest("-k", keyword, f"--rvads-report={name}.json", f"--rvads-report={name}.md")
    assert (tests.path / "a.md").exists(), "the option may be repeated"
    capsys.readouterr()
    names = [str(tests.path / f"{name}.json") for name in shards]
    assert main(["report", "merge", *names, "-o", str(tests.path / "all.json"), "--cov-fail-under", "75"]) == 0
    said = capsys.readouterr()
    assert "coverage: 6/8 cells exercised (75.0 %): 2 NA" in said.out
    assert "01-02   pass   NA" in said.out
    assert said.err == ""
    tests.runpytest("--rvads-report=whole.json")
    whole, merged = (load(tests.path / f"{name}.json") for name in ("whole", "all"))
    assert merged == whole, "three shards add up to the table of one session"
    own: dict[str, Any] = {"seconds": {}, "began": "", "command": ""}
    assert outline(replace(merged, **own)) == outline(replace(whole, **own)), "but for when they ran and by which command"
    parts = [load(Path(name)) for name in names]
    assert merged.began == min(part.began for part in parts) != ""
    assert merged.command == ", ".join(part.command for part in parts)
    assert merged.seconds.keys() == whole.seconds.keys()
    capsys.readouterr()
    assert main(["report", "merge", *names[:2], "--cov-fail-under", "75"]) == 1
    assert "rvads: coverage is below 75 %: 4/8" in capsys.readouterr().err
    assert main(["report", "merge", *names, "--cov-arrivals", "6"]) == 0
    capsys.readouterr()
    assert main(["report", "merge", *names, "--cov-arrivals", "5.9"]) == 1
    assert "rvads: the largest untested gap is above 5.9 s: arrivals: 2 of 14 pairs" in capsys.readouterr().err


def test_merge_refuses_files_without_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.json"
    other.write_text(
        '{"format": "rvads-report", "version": 5, "records": [{"type": "simulated", "nodeid": 7}]}', encoding="utf-8"
    )
    assert main(["report", "merge", str(other)]) == 2
    said = "other.json is a damaged report, write it again: the field 'records[0].nodeid' must be a text, got 7\n"
    assert capsys.readouterr().err.endswith(said)
    assert main(["report", "merge", str(tmp_path / "none.json")]) == 2
    assert "can't be read" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["report", "merge", str(other), "--cov-fail-under", "many"])


@pytest.mark.extended
def test_dying_worker_loses_one_item(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import os
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=(1, 2, 3), grid="E", rules="p1", duration=2)
        def test_rules(run, rule, monitor):
            if run.label.startswith("stop4-class02"):
                os._exit(3)
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-n", "1", "--rvads-report=out.json")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["stop4: *3 verdicts: 2 pass, 1 error", "*1 x p1: the worker process crashed*"])
    stopped = pytester.runpytest("-n", "1", "--max-worker-restart=0", "--rvads-report=stopped.json")
    assert stopped.ret != 0
    records = records_of(pytester.path, "stopped.json")
    assert sorted(r["status"] for r in records) == ["ERROR", "NOT RUN", "PASS"]
