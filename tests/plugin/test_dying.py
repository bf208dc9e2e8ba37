"""Sessions that die, or lie about how they ended, are not taken for ones that passed."""

import json
import subprocess
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from shutil import copytree
from textwrap import dedent

import pytest

from pytest_rvads.cli import main
from pytest_rvads.report.files import journal_of, load

LONG = 60
"""No session takes longer [s]."""
TESTS = """
    import os, sys
    import pytest
    import pytest_rvads as rvads

    class Mortal(rvads.Reference):
        def control(self, seen):
            if "class03" in os.environ["PYTEST_CURRENT_TEST"]:
                exec(os.environ.get("HOW", ""))
            return super().control(seen)

    @pytest.fixture
    def rvads_autopilot():
        return Mortal

    @rvads.scenario("stop4", classes=(1, 2, 3, 4), grid="E", rules="p1", duration=2)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
WAYS = {
    "exits": "os._exit(0)",
    "becomes another program": "os.execv(sys.executable, [sys.executable, '-c', ''])",
    "exits in a thread": "import threading, time; threading.Thread(target=os._exit, args=(0,)).start(); time.sleep(30)",
}
REPORTS = tuple(f"--rvads-report=out.{ending}" for ending in ("json", "html", "md", "csv"))
OK = pytest.ExitCode.OK


@pytest.fixture
def tests(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(test_it=TESTS)
    return pytester


@pytest.fixture(scope="module")
def passed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a session has passed."""
    folder = tmp_path_factory.mktemp("passed")
    (folder / "test_it.py").write_text(dedent(TESTS), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *REPORTS]
    assert subprocess.run(command, cwd=folder, timeout=LONG, check=False).returncode == OK
    return folder


@pytest.fixture
def green(passed: Path, pytester: pytest.Pytester) -> pytest.Pytester:
    """An earlier session has passed."""
    copytree(passed, pytester.path, dirs_exist_ok=True)
    assert main(["report", "check", "out.json"]) == OK
    return pytester


@pytest.mark.extended
@pytest.mark.parametrize("how", WAYS.values(), ids=WAYS)
def test_dying_process_leaves_incomplete_reports(
    green: pytest.Pytester, how: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOW", how)
    assert green.runpytest_subprocess(*REPORTS, timeout=LONG).ret == OK, "which is why nobody should go by it"
    for ending in ("json", "html", "md"):
        assert "INCOMPLETE" in Path(f"out.{ending}").read_text(encoding="utf-8")
    assert Path("out.csv").read_text(encoding="utf-8").count("NOT RUN") == 4
    capsys.readouterr()
    assert main(["report", "check", "out.json"]) == 2
    assert (
        "2 of 4 items have a verdict, the first items without a verdict: test_it.py::test_rules[stop4-class03"
        in capsys.readouterr().err
    )
    assert main(["report", "merge", "out.json", "-o", "all.json"]) == 2
    assert "stop4: 2/24 classes, 2/81 scenarios, 2 runs, 4 verdicts: 2 pass, 2 not run" in capsys.readouterr().out
    assert main(["report", "check", "all.json"]) == 2


@pytest.mark.extended
def test_a_worker_that_ends_itself_is_accounted_for(green: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOW", "os._exit(0)")
    assert green.runpytest(*REPORTS, "-n", "1").ret == pytest.ExitCode.TESTS_FAILED
    assert Counter(record.status for record in load(Path("out.json")).records) == {"PASS": 3, "ERROR": 1}
    assert main(["report", "check", "out.json"]) == pytest.ExitCode.TESTS_FAILED


CODE = {
    "conftest exits": "import sys; sys.exit(0)",
    "conftest ends the process": "import os; os._exit(0)",
    "collecting ends the session": "import pytest\ndef pytest_collection(): pytest.exit('enough', returncode=0)",
    "a hook ends the session": "import pytest\ndef pytest_runtest_setup(): pytest.exit('enough', returncode=0)",
    "a hook ends the session with 256": "import pytest\ndef pytest_runtest_setup(): pytest.exit('enough', returncode=256)",
    "the plugin is put away": "def pytest_collection_finish(session):\n"
    "    manager = session.config.pluginmanager\n"
    "    manager.unregister(manager.get_plugin('rvads_session'))",
    "the first failure ends it all": "import pytest\ndef pytest_runtest_setup(item): item.session.shouldfail = 'enough'",
}


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "2"), marks=pytest.mark.slow)])
@pytest.mark.parametrize("code", CODE.values(), ids=CODE)
def test_an_earlier_success_is_not_taken_for_that_of_a_session_without_verdicts(
    green: pytest.Pytester, code: str, workers: tuple[str, ...]
) -> None:
    green.makeconftest(code)
    # An exit from conftest.py ends a whole process, so that one of its own is needed.
    run = partial(green.runpytest_subprocess, timeout=LONG) if "exit(0)" in code else green.runpytest
    run(*REPORTS, *workers)
    assert main(["report", "check", "out.json"]) != OK


@pytest.mark.parametrize("option", ["--collect-only", "--markers", "--fixtures", "--help"])
def test_who_only_asks_keeps_the_report(green: pytest.Pytester, option: str) -> None:
    before = Path("out.json").read_bytes()
    assert green.runpytest(*REPORTS, option).ret == OK
    assert Path("out.json").read_bytes() == before
    assert main(["report", "check", "out.json"]) == OK


def test_a_session_that_is_refused_leaves_the_report_in_doubt(green: pytest.Pytester) -> None:
    before = Path("out.json").read_bytes()
    assert green.runpytest_subprocess(*REPORTS, "--no-such-option", timeout=LONG).ret == pytest.ExitCode.USAGE_ERROR
    assert Path("out.json").read_bytes() == before, "somebody mistyped"
    assert main(["report", "check", "out.json"]) == 2, "but who asks about this session is told that it did not end"


def test_a_report_may_replace_its_own_baseline(green: pytest.Pytester) -> None:
    result = green.runpytest("--rvads-baseline=out.json", *REPORTS)
    assert result.ret == OK
    result.stdout.fnmatch_lines(["against out.json: 4 UNCHANGED"])


@pytest.mark.extended
def test_an_incomplete_report_is_no_baseline(green: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOW", "os._exit(0)")
    green.runpytest_subprocess(*REPORTS, timeout=LONG)
    result = green.runpytest("--rvads-baseline=out.json")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*rvads_baseline: *out.json is incomplete, its session has not ended, or died: *"])


@pytest.mark.extended
def test_concurrent_sessions_write_whole_files(tests: pytest.Pytester) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rvads-keep=runs", *REPORTS]
    sessions = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) for _ in range(3)]
    for session in sessions:
        said, _ = session.communicate(timeout=LONG)
        assert session.returncode == OK, said
    assert main(["report", "check", "out.json"]) == OK
    assert len(list(Path("runs").glob("*.npz"))) == 4
    assert not list(Path().rglob("*.part"))
    assert not journal_of(Path("out.json")).exists()


def test_check_tells_of_every_report(green: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    Path("damaged.json").write_text("{", encoding="utf-8")
    failed = json.loads(Path("out.json").read_text(encoding="utf-8")) | {"exitstatus": 1}
    Path("failed.json").write_text(json.dumps(failed), encoding="utf-8")
    Path("wraps.json").write_text(json.dumps(failed | {"exitstatus": 256}), encoding="utf-8")
    capsys.readouterr()
    assert main(["report", "check", "out.json", "failed.json"]) == 1
    assert (
        capsys.readouterr().out == "out.json: complete, 4 items, exit status 0\nfailed.json: complete, 4 items, exit status 1\n"
    )
    Path("cut.json").write_text(json.dumps(failed | {"exitstatus": 0, "complete": False}), encoding="utf-8")
    assert main(["report", "merge", "cut.json"]) == 2
    for other in ("damaged.json", "none.json", "wraps.json", "cut.json"):
        assert main(["report", "check", "failed.json", other, "out.json"]) == 2
        said = capsys.readouterr()
        assert said.out.count("complete") == 2, "the others are told of as well"
        assert other in said.err


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "1"), marks=pytest.mark.slow)])
def test_a_writer_that_fails_costs_its_own_file(tests: pytest.Pytester, workers: tuple[str, ...]) -> None:
    tests.makeconftest("""
        from pytest_rvads.report import files, terminal

        def broken(*args, **kwargs):
            raise KeyError("stack")

        files.FORMATS[".md"] = terminal.summarise = broken
    """)
    result = tests.runpytest_subprocess(*REPORTS, *workers, timeout=LONG)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.assert_outcomes(passed=4)
    result.stdout.no_fnmatch_line("*INTERNALERROR*")
    said = [
        "rvads: the report could not be written: KeyError: 'stack'",
        "rvads: the summary could not be shown: KeyError: 'stack'",
    ]
    result.stdout.fnmatch_lines(said)
    assert len(load(Path("out.json")).records) == 4
    assert main(["report", "check", "out.json"]) == pytest.ExitCode.TESTS_FAILED
    assert not Path("out.md").exists(), "neither at the beginning nor at the end could it be written"


@pytest.mark.parametrize("raises", ["sys.exit(0)", "pytest.skip('no')", "pytest.exit('no', returncode=0)"])
def test_a_hook_that_wants_out_ends_no_session(tests: pytest.Pytester, raises: str) -> None:
    tests.makeconftest(f"import sys, pytest\ndef pytest_rvads_verdict(record):\n    {raises}")
    result = tests.runpytest()
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["stop4: *4 verdicts: 4 pass", "rvads: a hook pytest_rvads_verdict raised *"])


def test_unreadable_record_costs_one_item(tests: pytest.Pytester) -> None:
    tests.makeconftest("""
        import pytest

        @pytest.hookimpl(tryfirst=True)
        def pytest_runtest_logreport(report):
            if "class02" in report.nodeid and hasattr(report, "rvads"):
                report.rvads["hash"] = object()
    """)
    result = tests.runpytest("--rvads-report=out.json")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    records = list(load(Path("out.json")).records)
    assert Counter(record.status for record in records) == {"PASS": 3, "ERROR": 1}
    assert "the record of this item can't be read" in records[1].message


def test_who_stops_listening_loses_no_report(tests: pytest.Pytester) -> None:
    session = subprocess.Popen([sys.executable, "-m", "pytest", *REPORTS], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    session.stdout.close()
    assert session.wait(LONG) != OK
    assert main(["report", "check", "out.json"]) != OK
    assert journal_of(Path("out.json")).exists() or len(load(Path("out.json")).records) == 4
