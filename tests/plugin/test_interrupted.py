"""Sessions that are interrupted or can't write keep every verdict reached, and say what is missing."""

import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from textwrap import dedent

import pytest

from tests.inner_sessions import driven_by

TESTS = driven_by(
    "Racer",
    """
    import os
    import time
    from pathlib import Path

    @rvads.scenario("stop4", grid="B", rules="p1", duration=3)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
""",
)
INTERRUPTED = TESTS + dedent("""
    @pytest.fixture(autouse=True)
    def turns(request):
        # Two items get through; any other one waits for what is about to come.
        if not request.node.name.startswith(("test_rules[stop4-class01-", "test_rules[stop4-class02-")):
            Path(f"waits-{os.getpid()}").touch()
            while True:
                try:
                    time.sleep(0.01)
                except KeyboardInterrupt:
                    if "STUBBORN" not in os.environ:
                        raise
""")
CONFTEST = """
    from pathlib import Path

    def pytest_rvads_verdict(record):
        Path("told").open("a").write("one")
"""
ENDING = """
    import time
    from pathlib import Path

    def pytest_sessionfinish(session):
        if not hasattr(session.config, "workerinput"):
            Path("ends").touch()
            while not Path("again").exists():
                time.sleep(0.01)
"""


LONG = 60
"""No session takes longer to end [s]."""
Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(pytester: pytest.Pytester) -> Iterator[Start]:
    """Start a session of its own; what is left of it is killed at the end."""
    sessions: list[subprocess.Popen[str]] = []

    def begin(*options: str, ignoring: tuple[int, ...] = (), **variables: str) -> "subprocess.Popen[str]":
        def handle() -> None:
            signal.alarm(LONG)
            for number in ignoring:
                signal.signal(number, signal.SIG_IGN)

        sessions.append(
            subprocess.Popen(
                [sys.executable, "-m", "pytest", "-v", "--rvads-report=out.json", "--junitxml=out.xml", *options],
                preexec_fn=handle,
                start_new_session=True,
                env=os.environ | variables,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        return sessions[-1]

    yield begin
    for session in sessions:
        with suppress(ProcessLookupError):
            os.killpg(session.pid, signal.SIGKILL)
        session.communicate()


def wait_for(session: "subprocess.Popen[str]", arrived: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LONG
    while not arrived():
        assert session.poll() is None, session.communicate()[0]
        assert time.monotonic() < deadline
        time.sleep(0.01)


def stuck(session: "subprocess.Popen[str]", workers: tuple[str, ...]) -> list[int]:
    """Wait until two verdicts are known and every other process is in an item that does not end; return the processes."""

    def arrived() -> bool:
        told = Path("told").read_text(encoding="utf-8") if Path("told").exists() else ""
        return told == "oneone" and len(list(Path().glob("waits-*"))) == max(1, len(workers))

    wait_for(session, arrived)
    return [int(path.name.partition("-")[2]) for path in Path().glob("waits-*")]


def gone(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return True
    return state == "Z"  # nobody has asked how it ended


@pytest.fixture
def tests(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(test_it=INTERRUPTED)


@pytest.mark.extended
@pytest.mark.usefixtures("tests")
@pytest.mark.parametrize(
    ("number", "workers"),
    [
        (signal.SIGINT, ()),
        (signal.SIGTERM, ()),
        (signal.SIGHUP, ()),
        pytest.param(signal.SIGINT, ("-n", "2"), marks=pytest.mark.slow),
        (signal.SIGTERM, ("-n", "2")),
    ],
)
def test_terminated_session_reports_its_records(start: Start, number: int, workers: tuple[str, ...]) -> None:
    session = start(*workers)
    processes = stuck(session, workers)
    session.send_signal(number)
    said, _ = session.communicate(timeout=LONG)
    assert session.returncode == pytest.ExitCode.INTERRUPTED, said
    assert all(map(gone, processes))
    assert ET.parse("out.xml").getroot() is not None
    content = json.loads(Path("out.json").read_text(encoding="utf-8"))
    counts = Counter(r["status"] for r in content["records"])
    assert counts["FAIL"] == said.count(" FAILED "), "every verdict that was reached is there"
    assert counts == {"FAIL": 2, "NOT RUN": 22}
    note = f"the session did not end by itself (exit status 2): {counts['NOT RUN']} items did not run"
    assert content["notes"] == [note]
    assert f"rvads: {note}" in said


@pytest.mark.extended
@pytest.mark.usefixtures("tests")
@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "2"), marks=pytest.mark.slow)])
def test_ctrl_c_again_does_not_keep_reports_from_being_written(
    pytester: pytest.Pytester, start: Start, workers: tuple[str, ...]
) -> None:
    pytester.makeconftest(CONFTEST + ENDING)
    session = start(*workers, **({"STUBBORN": "workers"} if workers else {}))
    processes = stuck(session, workers)
    session.send_signal(signal.SIGINT)
    wait_for(session, Path("ends").exists)
    session.send_signal(signal.SIGINT)
    Path("again").touch()
    said, _ = session.communicate(timeout=LONG)
    assert session.returncode == pytest.ExitCode.INTERRUPTED, said
    assert "Traceback" not in said
    assert all(map(gone, processes))
    assert Counter(r["status"] for r in json.loads(Path("out.json").read_text(encoding="utf-8"))["records"])["FAIL"] == 2
    assert ET.parse("out.xml").getroot() is not None


@pytest.mark.extended
@pytest.mark.usefixtures("tests")
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere workers are given some seconds to notice")
def test_workers_end_with_the_main_process(start: Start) -> None:
    workers = ("-n", "2")
    session = start(*workers, STUBBORN="workers")
    processes = stuck(session, workers)
    session.kill()
    session.wait()
    deadline = time.monotonic() + 3  # execnet, which they talk by, would end them after some 15 s, and none that is busy in C
    while not all(map(gone, processes)):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert not json.loads(Path("out.json").read_text(encoding="utf-8"))["complete"]


@pytest.mark.extended
@pytest.mark.usefixtures("tests")
def test_a_signal_that_is_ignored_stays_ignored(start: Start) -> None:
    session = start(ignoring=(signal.SIGHUP,))
    stuck(session, ())
    session.send_signal(signal.SIGHUP)
    session.send_signal(signal.SIGTERM)
    said, _ = session.communicate(timeout=LONG)
    assert "KeyboardInterrupt: SIGTERM" in said


@pytest.mark.extended
def test_a_child_of_a_test_ends_by_sigterm_as_ever(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import os, signal, time

        def test_it():
            for _ in range(20):
                child = os.fork()
                if not child:
                    time.sleep(10)
                    os._exit(0)
                os.kill(child, signal.SIGTERM)  # at once, which is when it could get lost
                assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
    """)
    pytester.runpytest_subprocess(timeout=LONG).assert_outcomes(passed=1)


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "1"), marks=pytest.mark.slow)])
def test_interruption_of_the_collection_is_reported(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makepyfile(test_it=TESTS, test_late="raise KeyboardInterrupt")
    result = pytester.runpytest_subprocess("--rvads-report=out.json", *workers, timeout=LONG)
    assert result.ret == pytest.ExitCode.INTERRUPTED
    content = json.loads(Path("out.json").read_text(encoding="utf-8"))
    assert content["exitstatus"] == pytest.ExitCode.INTERRUPTED
    assert "the items to run were not yet known" in content["notes"][0] or workers


@pytest.mark.extended
def test_what_is_interrupted_before_any_worker_s_first_report_says_how_much_was_collected(pytester: pytest.Pytester) -> None:
    pytester.makeconftest("""
        class Interrupting:
            def pytest_runtest_logstart(self):
                raise KeyboardInterrupt

        def pytest_configure(config):
            if not hasattr(config, "workerinput"):
                config.pluginmanager.register(Interrupting())
    """)
    pytester.makepyfile(test_it=TESTS)
    result = pytester.runpytest_subprocess("-n", "1", "--rvads-report=out.json")
    assert result.ret == pytest.ExitCode.INTERRUPTED
    note = "none of 24 items ended, and no worker reported which of them belong to pytest-rvads"
    (said,) = json.loads(Path("out.json").read_text(encoding="utf-8"))["notes"]
    assert said == f"the session did not end by itself (exit status 2): {note}"


def test_artefacts_that_can_t_be_written_cost_no_verdict(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("file").write_text("in the way", encoding="utf-8")
    result = pytester.runpytest("-k", "class01 or class02", "--rvads-keep=file", "--rvads-artefacts=file")
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(
        ["look      not drawn: *", "stop4: *2 verdicts: 2 fail", "rvads: the runs of 2 items could not be kept: *"]
    )
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_failed_write_of_a_kept_run_is_no_success(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("file").write_text("in the way", encoding="utf-8")
    result = pytester.runpytest("-k", "class01", "--rvads-keep=file", "--rvads-autopilot=reference")
    result.assert_outcomes(passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED


@pytest.mark.extended
def test_baseline_does_not_excuse_missing_runs(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("file").write_text("in the way", encoding="utf-8")
    pytester.runpytest("-k", "class01", "--rvads-report=old.json")
    known = ("-k", "class01", "--rvads-baseline=old.json", "--rvads-fail-on=new")
    assert pytester.runpytest(*known).ret == 0
    assert pytester.runpytest(*known, "--rvads-keep=file").ret == pytest.ExitCode.TESTS_FAILED


def test_a_damaged_run_is_kept_again(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.runpytest("-k", "class01", "--rvads-keep=runs")
    (kept,) = pytester.path.joinpath("runs").iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(whole[:100])
    pytester.runpytest("-k", "class01", "--rvads-keep=runs").stdout.no_fnmatch_line("*could not be kept*")
    assert kept.read_bytes() == whole


@pytest.mark.extended
def test_an_earlier_report_outlives_a_failed_one(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("out.json").write_text("earlier", encoding="utf-8")
    pytester.makeconftest("""
        import errno
        from pytest_rvads.report import files

        def full(path, content):
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

        files.write_file = full
    """)
    result = pytester.runpytest_subprocess("-k", "class01", "--rvads-report=out.json", timeout=LONG)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["rvads: the report could not be written: *No space left on device*"])
    assert pytester.path.joinpath("out.json").read_text(encoding="utf-8") == "earlier"
