"""A stack under pytest: ``--rvads-sut``, errors and verdicts side by side, and no process that outlives the session."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.inner_sessions import records_of

from .conftest import Find, wait_for

Session = Callable[..., subprocess.Popen[str]]
FAULTY = Path(__file__).with_name("faulty.py")
TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop3", subject="all", grid="C", rules=("speed_limit", "no_collision"), duration=2)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


def command(fault: str, scenario: int = 1, tag: str = "") -> str:
    return f"{sys.executable} -I -S {FAULTY} {fault} {scenario} 3 {tag}"


@pytest.mark.extended
def test_the_documented_steps_lead_from_nothing_to_verdicts(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, compiled: Path
) -> None:
    """Compile, then one command; no Python written."""
    monkeypatch.setenv("COLUMNS", "200")
    shutil.copy(compiled, pytester.path / "stack")
    result = pytester.runpytest_subprocess(
        "--rvads-sut", "./stack", "-k", "stop3-class02 and full_stop or light3-class02 and red"
    )
    outcomes = result.parseoutcomes()
    assert (outcomes["passed"], outcomes["skipped"]) == (5, 4), "three seats of 112 each; seat 0 has green, nobody turns on red"
    assert "failed" not in outcomes, "the example stops, and waits for green"
    result.stdout.fnmatch_lines(
        [
            "stop3 among reference traffic*",
            "stop3: 1/4 classes, 3/8 classes with a subject*",
            f"stack {pytester.path}/stack: * decisions in 6 runs, * ms each, * ms the longest",
        ]
    )


@pytest.mark.slow
def test_the_example_keeps_every_rule(pytester: pytest.Pytester, compiled: Path) -> None:
    """As its page says; two minutes."""
    shutil.copy(compiled, pytester.path / "stack")
    outcomes = pytester.runpytest_subprocess("--rvads-sut", "./stack").parseoutcomes()
    assert outcomes.keys() == {"passed", "skipped"}
    assert outcomes["passed"] > 1500


@pytest.mark.extended
def test_an_item_of_the_suite_is_run_by_its_id(pytester: pytest.Pytester) -> None:
    """As the lines that are printed name it, where no file of that name is."""
    name = "test_road.py::test_all_way_stop[stop3-class02-as112-s2-cfgS21-full_stop]"
    pytester.runpytest("--rvads-autopilot=reference", name).assert_outcomes(passed=1, deselected=1983)
    result = pytester.runpytest("--rvads-autopilot=reference", "test_road.py::test_nothing")
    result.stderr.fnmatch_lines(["ERROR: not found: test_road.py::test_nothing, among the tests that come with the plugin"])
    pytester.makepyfile(test_road="def test_own(): pass")
    pytester.runpytest("--rvads-autopilot=reference", "test_road.py").assert_outcomes(passed=1)


def test_errors_stay_beside_verdicts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TESTS)
    sut = command("crash", scenario=2)
    result = pytester.runpytest("--rvads-sut", sut, "--rvads-report=out.json")
    # Eight runs: in every process the second scenario crashes, so every second run is an error. The others are cut off after 2 s.
    result.assert_outcomes(skipped=8, errors=8)
    result.stdout.fnmatch_lines(
        [
            "*ERROR at setup of test_rules?stop3-class02-as112-s0-cfgC-*?*",
            "ERROR: stack *faulty.py* driving a0 at 0.10 s: it exited with status 1 *; *ends with: cannot open the map",
            "*Captured standard error of the stack,*",
            "*last words of crash*",
        ]
    )
    records = records_of(pytester.path)
    assert sorted(r["status"] for r in records) == ["ERROR"] * 8 + ["NA"] * 8


def test_tests_of_ones_own_are_preferred(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TESTS)
    pytester.runpytest("--rvads-sut", "true", "--collect-only", "-q").stdout.fnmatch_lines(["16 tests collected*"])


def test_the_command_line_overrides_the_fixture(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        @pytest.fixture
        def rvads_autopilot():
            return rvads.Reference

        @rvads.scenario("stop3", subject=0, scenarios="111", grid="C", duration=1)
        def test_it(run):
            assert run.provenance["autopilot"].startswith("stack ")
        """
    )
    pytester.runpytest("--rvads-sut", command("none")).assert_outcomes(passed=1)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--rvads-sut", "./no-such"), "*rvads_sut must be the command of a program that exists and may be executed*"),
        (("--rvads-sut", "'"), "*rvads_sut can't be read as a command: No closing quotation*"),
        (("--rvads-sut", "true", "--rvads-sut-timeout", "soon"), "*rvads_sut_timeout must be a number*"),
    ],
)
def test_invalid_options_of_stacks_are_usage_errors(pytester: pytest.Pytester, options: tuple[str, ...], says: str) -> None:
    pytester.makepyfile(TESTS)
    result = pytester.runpytest(*options)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([says])


@pytest.fixture
def session(pytester: pytest.Pytester, marked: Find) -> Iterator[Session]:
    """Start a session whose stack hangs at its third decision, and wait until the stack runs."""
    started = []

    def start(tag: str, *options: str, fault: str = "hang", shell: bool = False) -> subprocess.Popen[str]:
        pytester.makepyfile(TESTS)
        sut = command(fault, tag=tag)
        if shell:
            script = pytester.path / "start.sh"
            script.write_text(f"#!/bin/sh\n{sut}\necho done\n", encoding="utf-8")
            script.chmod(0o755)
            sut = f"./start.sh {tag}"
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rvads-sut", sut, "--rvads-sut-timeout=600", *options],
            cwd=pytester.path,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONPATH": str(FAULTY.parents[3])},
            start_new_session=True,
            preexec_fn=partial(signal.alarm, 60),  # a session that is left alone ends
        )
        started.append(process)
        assert wait_for(lambda: marked(tag) or process.poll() is not None, 60.0), "the stack runs, or has run"
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.extended
@pytest.mark.parametrize("shell", [False, True], ids=["program", "script"])
def test_ctrl_c_leaves_no_process(session: Session, marked: Find, shell: bool) -> None:
    tag = f"ctrl-c-{os.getpid()}-{shell}"
    process = session(tag, shell=shell)
    os.killpg(process.pid, signal.SIGINT)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == pytest.ExitCode.INTERRUPTED, output
    assert wait_for(lambda: not marked(tag))


@pytest.mark.extended
@pytest.mark.parametrize("shell", [False, True], ids=["program", "script"])
def test_a_killed_session_leaves_no_process(session: Session, marked: Find, shell: bool) -> None:
    tag = f"killed-{os.getpid()}-{shell}"
    process = session(tag, shell=shell)
    process.kill()
    assert wait_for(lambda: not marked(tag))


@pytest.mark.extended
def test_a_killed_worker_leaves_no_process(session: Session, marked: Find) -> None:
    tag = f"worker-{os.getpid()}"
    session(tag, "-n", "1", "--max-worker-restart=0")
    (stack,) = marked(tag)
    (worker,) = re.findall(r"PPid:\s+(\d+)", Path(f"/proc/{stack}/status").read_text(encoding="utf-8"))
    os.kill(int(worker), signal.SIGKILL)
    assert wait_for(lambda: stack not in marked(tag))


@pytest.mark.extended
def test_the_first_failure_leaves_no_process(session: Session, marked: Find) -> None:
    tag = f"exitfirst-{os.getpid()}"
    process = session(tag, "-x", fault="crash")
    output, _ = process.communicate(timeout=120)
    assert process.returncode == pytest.ExitCode.TESTS_FAILED, output
    assert wait_for(lambda: not marked(tag))
