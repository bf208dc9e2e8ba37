"""Sessions that are interrupted or can't write keep every verdict reached, and say what is missing."""

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

TESTS = """
    import os
    import time
    from pathlib import Path
    import pytest
    import pytest_rvads as rvads

    class Racer(rvads.Follower):
        def target_speed(self, seen):
            return 8.0

    @pytest.fixture
    def rvads_autopilot():
        return Racer

    @rvads.scenario("stop4", grid="B", rules="p1", duration=3)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
INTERRUPTED = (
    TESTS
    + """
    @pytest.fixture(autouse=True)
    def turns(request):
        # Two items get through; any other one waits for what is about to come.
        if not request.node.name.startswith(("test_rules[stop4-class01-", "test_rules[stop4-class02-")):
            Path(f"waits-{os.getpid()}").touch()
            while True:
                time.sleep(0.01)
"""
)
CONFTEST = """
    from pathlib import Path

    def pytest_rvads_verdict(record):
        Path("told").open("a").write("one")
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")])
def test_ctrl_c(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    """Every worker has come to an item that does not end, and the main process knows of both verdicts before."""
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(test_it=INTERRUPTED)
    session = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-v", "--rvads-report=out.json", *workers],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # in the background, shells have it ignored
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )

    def arrived() -> bool:
        told = Path("told").read_text(encoding="utf-8") if Path("told").exists() else ""
        return told == "oneone" and len(list(Path().glob("waits-*"))) == max(1, len(workers))

    while not arrived() and session.poll() is None:
        time.sleep(0.01)
    session.send_signal(signal.SIGINT)
    said, _ = session.communicate()
    assert session.returncode == pytest.ExitCode.INTERRUPTED, said
    content = json.loads(Path("out.json").read_text(encoding="utf-8"))
    counts = Counter(r["status"] for r in content["records"])
    assert counts["FAIL"] == said.count(" FAILED "), "every verdict that was reached is there"
    assert counts == {"FAIL": 2, "NOT RUN": 22}
    note = f"the session did not end by itself (exit status 2): {counts['NOT RUN']} items did not run"
    assert content["notes"] == [note]
    assert f"rvads: {note}" in said


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
    result = pytester.runpytest_subprocess("-n", "2", "--rvads-report=out.json")
    assert result.ret == pytest.ExitCode.INTERRUPTED
    note = "none of 24 items ended, and no worker came to say which of them ask for a run"
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


def test_what_should_be_kept_and_is_not_is_no_success(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("file").write_text("in the way", encoding="utf-8")
    result = pytester.runpytest("-k", "class01", "--rvads-keep=file", "--rvads-autopilot=reference")
    result.assert_outcomes(passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_a_baseline_does_not_excuse_what_is_missing(pytester: pytest.Pytester) -> None:
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


def test_an_earlier_report_outlives_a_failed_one(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    pytester.path.joinpath("out.json").write_text("earlier", encoding="utf-8")
    pytester.path.joinpath("out.json.part").mkdir()  # so that nothing can be written beside it
    result = pytester.runpytest("-k", "class01", "--rvads-report=out.json")
    result.stdout.fnmatch_lines(["rvads: the report could not be written: *"])
    assert pytester.path.joinpath("out.json").read_text(encoding="utf-8") == "earlier"
