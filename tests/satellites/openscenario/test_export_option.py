"""``--rvads-export``: the runs of failures, for other tools."""

import re

import pytest

import pytest_rvads as rvads
from pytest_rvads.logic.judging.verdicts import Status

pytestmark = pytest.mark.usefixtures("library")
FAILING = """
import pytest
import pytest_rvads as rvads

@pytest.fixture
def rvads_autopilot():
    return rvads.traffic("red_light_runner")

@rvads.scenario("light4", scenarios=["2323", "2222"], distances=5, speeds=5, duration=4.0, rules=("p4", "red", "no_collision"))
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RVADS_MAP", "PYTEST_ADDOPTS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("COLUMNS", "200")


@pytest.mark.extended
@pytest.mark.parametrize("workers", ["-n0", "-n1"])
def test_every_failed_run_is_written_once_with_one_map(pytester: pytest.Pytester, workers: str) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest(workers, "-p", "no:cacheprovider", "--rvads-export=out", "--rvads-summary=full")
    failed = re.findall(r"FAILED \S+\[(\S+)-(p4|red)\]", result.stdout.str())
    assert len(failed) > len({run for run, _ in failed}) == 2
    folder = pytester.path / "out"
    assert len([*folder.glob("*.xosc")]) == 2
    assert [path.name for path in folder.glob("*.xodr")] == ["light4.xodr"]
    written = {run.label: run for path in folder.glob("*.xosc") for run in rvads.files.read_runs(path)}
    for run, rule in failed:
        assert rvads.check(written[run], rule).status is Status.FAIL
    printed = re.findall(r"^export    (\S+)$", result.stdout.str(), re.MULTILINE)
    assert {pytester.path / name for name in printed} == set(folder.glob("*.xosc"))


def test_passing_runs_are_not_exported(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    pytester.runpytest("-p", "no:cacheprovider", "-k", "no_collision", "--rvads-export=out").assert_outcomes(passed=2)
    assert not (pytester.path / "out").exists()


def test_older_file_of_another_run_is_replaced(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    options = ("-p", "no:cacheprovider", "-k", "2222 and red", "--rvads-export=out")
    pytester.runpytest(*options)
    (path,) = (pytester.path / "out").glob("*.xosc")
    good = path.read_bytes()
    path.write_text("something else", encoding="utf-8")
    pytester.runpytest(*options)
    assert path.read_bytes() == good


def test_missing_library_ends_the_session_before_any_run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(FAILING)
    monkeypatch.setitem(__import__("sys").modules, "scenariogeneration.xosc", None)
    result = pytester.runpytest("--rvads-export=out")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    (message,) = [line for line in result.errlines if "scenariogeneration" in line]
    assert "pip install 'pytest-rvads[openscenario]'" in message


def test_write_error_keeps_the_verdicts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    (pytester.path / "out").write_text("", encoding="utf-8")
    result = pytester.runpytest("-p", "no:cacheprovider", "-k", "2222 and red", "--rvads-export=out")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["export    not written: *light4.xodr can't be copied to *"])
