"""The same verdicts under xdist, in JUnit and in report logs."""

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import pytest

from pytest_rvads.report.files import load
from tests.inner_sessions import driven_by, records_of

TESTS = driven_by(
    "Racer",
    """
    @rvads.scenario("stop4", classes=(1, 2), grid="CD", rules=("p1", "p2", "p4"))
    def test_rules(run, rule, monitor):
        monitor.check(rule)
""",
)


ITEMS = 12
"""Two classes in two configurations by three rules."""


def session(folder: Path, *options: str) -> pytest.RunResult:
    """Run a session in a process of its own."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rvads-artefacts=none", *options]
    done = subprocess.run(command, cwd=folder, env=os.environ | {"COLUMNS": "200"}, capture_output=True, text=True, check=False)
    return pytest.RunResult(done.returncode, done.stdout.splitlines(), done.stderr.splitlines(), duration=0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("outputs")
    (folder / "test_all.py").write_text(TESTS, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def on_workers(folder: Path) -> pytest.RunResult:
    """A session on two workers, which leaves a report log and JUnit's XML."""
    return session(folder, "--report-log=two.jsonl", "--junitxml=two.xml", "-n", "2", "--dist", "worksteal")


def outcomes(path: Path) -> dict[str, tuple[str, str, str, str]]:
    """Read a report log: node id to outcome and message."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        if entry.get("$report_type") == "TestReport" and entry["when"] == "call":
            found[entry["nodeid"]] = (
                entry["outcome"],
                entry["rvads"]["status"],
                entry["rvads"]["hash"],
                entry["rvads"]["message"],
            )
    return found


@pytest.mark.extended
def test_xdist_gives_the_same_verdicts_ids_and_hashes(folder: Path, on_workers: pytest.RunResult) -> None:
    one, two = session(folder, "--report-log=one.jsonl"), on_workers
    assert one.parseoutcomes() == two.parseoutcomes()
    first, second = outcomes(folder / "one.jsonl"), outcomes(folder / "two.jsonl")
    assert len(first) == ITEMS
    assert first == second
    assert Counter(status for _, status, _, _ in first.values())["NA"] >= ITEMS / 3, "p4 is not about a stop junction"

    def table(result: pytest.RunResult) -> list[str]:
        start = next(i for i, line in enumerate(result.outlines) if "rvads verdicts" in line)
        return result.outlines[start : start + 8]

    assert table(one) == table(two), "the summary does not depend on who ran what"
    for result in (one, two):
        result.stdout.fnmatch_lines(["nearest: time to collision 0.00 s (a? and a? in test_rules[[]stop4-class0*[]]: *)*"])


@pytest.mark.extended  # two workers; without workers: test_every_run_and_rule_is_an_item
def test_junit_carries_the_cell_and_its_verdict(folder: Path, on_workers: pytest.RunResult) -> None:
    cases = list(ET.parse(folder / "two.xml").iter("testcase"))
    assert len(cases) == ITEMS
    seen: Counter[str | None] = Counter()
    for case in cases:
        found = {p.get("name"): p.get("value") for p in case.iter("property")}
        scenario = f"{found['junction']}-class{int(found['class']):02d}-as{found['scenario']}"
        assert case.get("name") == f"test_rules[{scenario}-cfg{found['configuration']}-{found['rule']}]"
        child = {"PASS": None, "NA": "skipped"}.get(found["verdict"], "failure")
        assert (case.find(child) is not None) if child else not [e for e in case if e.tag != "properties"]
        seen[found["verdict"]] += 1
    assert set(seen) <= {"PASS", "FAIL", "OPEN", "NA"}
    assert seen["FAIL"]


@pytest.mark.extended
def test_a_record_of_an_error_crosses_the_workers(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        class Broken:
            def control(self, seen):
                raise OSError("sensor gone")

        @pytest.fixture
        def rvads_autopilot():
            return Broken

        @rvads.scenario("stop4", classes=(1, 2), grid="C", rules="p1")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-n", "1")
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines(["stop4: *2 error*"])


@pytest.mark.extended
@pytest.mark.parametrize(
    ("variables", "options"),
    [
        ({"PYTHONIOENCODING": "ascii"}, []),
        pytest.param({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, ["-s"], marks=pytest.mark.slow),
        pytest.param({"PYTHONIOENCODING": "ascii"}, ["-n1"], marks=pytest.mark.slow),
    ],
)
def test_no_encoding_of_the_terminal_changes_a_verdict(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], options: list[str]
) -> None:
    """A driver prints what the encoding lacks: under ``-s``, and where a failed run is repeated, to the terminal itself."""
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        class Größer(rvads.RollingStop):
            def control(self, seen):
                if seen.time == 0:
                    print("→ größer ✓")
                return super().control(seen)

        @pytest.fixture
        def rvads_autopilot():
            return Größer

        @rvads.scenario("stop4", classes=7, distances=(10, 11, 12, 13), rules=("p1", "p3"), requirement="§ 8")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    result = pytester.runpytest_subprocess("--rvads-report=r.json", "--rvads-report=r.html", *options)
    result.assert_outcomes(passed=1, failed=1)
    records = records_of(pytester.path, "r.json")
    assert [(one["status"], one["driver"].rpartition(".")[2], one["requirements"]) for one in records] == [
        ("PASS", "Größer", ["§ 8"]),
        ("FAIL", "Größer", ["§ 8"]),
    ]
    result.stdout.fnmatch_lines(["driven by *.Gr\\xf6\\xdfer (*): 1 run", " 07 * pass * FAIL"])


@pytest.mark.extended
def test_a_message_that_no_file_can_hold_costs_no_report(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        class Broken:
            def control(self, seen):
                raise OSError("half a character: \\ud800, \\x1b[2J")

        @pytest.fixture
        def rvads_autopilot():
            return Broken

        @rvads.scenario("stop4", classes=1, grid="C", rules="p1", requirement="\\udfff")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    paths = [pytester.path / f"r.{ending}" for ending in ("json", "html", "md", "csv")]
    result = pytester.runpytest_subprocess(*(f"--rvads-report={path}" for path in paths))
    result.assert_outcomes(errors=1)
    assert "INTERNALERROR" not in result.stdout.str()
    for path in paths:
        assert "half a character" in path.read_text(encoding="utf-8")
    assert [record.status for record in load(paths[0]).records] == ["ERROR"]
