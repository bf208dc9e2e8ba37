"""Sessions in which nothing of the user's drives, something is left out, or an earlier report is compared with."""

import pytest

from pytest_rvads.cli import main
from pytest_rvads.report.figures import SIMULTANEOUS
from tests.inner_sessions import records_of
from tools.crossings import Layout, opendrive

from .attempts import CHECKED, FAILED, NOTHING, Session
from .shown import shows, shows_each

RULES = """
@here({more})
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""
GETS_IN = "rvads.rule('gets_in', 'forall a. F a@j')\n"
"""A rule that even who races keeps."""
PILOT = """
import pytest
import pytest_rvads as rvads

@pytest.fixture
def {name}():
    return rvads.Reference
"""


def rules(**more: object) -> str:
    """Return a file that checks rules in one scenario."""
    return RULES.format(more=", ".join(f"{key}={value!r}" for key, value in more.items()))


@shows("nobody_drives")
def test_without_a_driver_nothing_of_the_user_was_tested(session: Session) -> None:
    result = session(rules(duration=20), driver=None)
    result.assert_outcomes(passed=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: nothing says what drives in 1 item, *"])


@shows("everybody_arrives_at_once")
def test_a_session_without_a_gap_between_arrivals_says_so(session: Session) -> None:
    """In configuration D all vehicles start 20 m before their lines."""
    tests = rules(grid="D", duration=10)
    result = session(tests, driver="reference")
    assert result.ret == pytest.ExitCode.OK
    result.stdout.fnmatch_lines([f"rvads: {SIMULTANEOUS}"])
    result = session(tests, "--rvads-cov-arrivals=5", driver="reference")
    result.assert_outcomes(passed=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: the largest untested gap is above 5 s: *largest untested gap 6 s (-6 to 0 s)*"])


@shows("misspelt_fixture")
def test_a_misspelt_fixture_drives_nothing(session: Session, pytester: pytest.Pytester) -> None:
    (pytester.path / "conftest.py").write_text(PILOT.format(name="rvads_autopliot"), encoding="utf-8")
    result = session(rules(duration=20), driver=None)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: nothing says what drives in 1 item, *defines 'rvads_autopliot': is it misspelt?"])


@shows("fixture_next_door")
def test_a_fixture_in_another_test_file_drives_nothing(session: Session, pytester: pytest.Pytester) -> None:
    (pytester.path / "test_next.py").write_text(PILOT.format(name="rvads_autopilot") + "\ndef test_it(): ...\n", encoding="utf-8")
    result = session(rules(duration=20), driver=None)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: nothing says what drives in 1 item, *test_next.py has one that is not visible there*"])


@shows("let_the_reference_drive")
def test_report_names_the_driver(session: Session, pytester: pytest.Pytester) -> None:
    """The fixture names the racer, and an option lets the reference autopilot drive in its place."""
    result = session(rules(duration=20), "--rvads-autopilot=reference")
    result.stdout.fnmatch_lines(["rvads: driven by --rvads-autopilot=reference (pytest-rvads *)"])
    assert [str(record["driver"]).rpartition(".")[2] for record in records_of(pytester.path)] == ["Reference"]


@shows("drop_what_fails")
def test_items_that_vanish_are_missed(session: Session, pytester: pytest.Pytester) -> None:
    (pytester.path / "drops.py").write_text(
        "def pytest_collection_modifyitems(items):\n    items[:] = [item for item in items if '-p1]' not in item.nodeid]\n",
        encoding="utf-8",
    )
    pytester.syspathinsert()
    result = session(GETS_IN + rules(rules=("p1", "gets_in")), "-p", "drops")
    result.assert_outcomes(passed=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: 1 item vanished: a plugin or conftest.py dropped them without deselecting them"])
    assert sorted(str(record["status"]) for record in records_of(pytester.path)) == ["NOT RUN", "PASS"]


HOOKS = {
    "drop_before_anybody_looks": """
def pytest_collection_modifyitems(items):
    items[:] = [item for item in items if '-p1]' not in item.nodeid]
    return (yield)
""",
    "catch_failures_outside": """
def pytest_runtest_call():
    try:
        return (yield)
    except AssertionError:
        return None
""",
    "change_the_outcome": """
def pytest_runtest_makereport():
    report = yield
    report.outcome = "passed"
    return report
""",
}


@shows_each(HOOKS)
def test_a_hook_that_hides_failures_is_noticed(case: str, session: Session, pytester: pytest.Pytester) -> None:
    wrapper = f"import pytest\n\n@pytest.hookimpl(wrapper=True, tryfirst=True){case}"
    (pytester.path / "hides.py").write_text(wrapper, encoding="utf-8")
    pytester.syspathinsert()
    result = session(GETS_IN + rules(rules=("p1", "gets_in")), "-p", "hides")
    assert "failed" not in result.parseoutcomes()
    assert result.ret == FAILED
    dropped = "modifyitems" in case
    says = "vanished: *" if dropped else "passed in spite of a failure: * *-p1]"
    result.stdout.fnmatch_lines([f"rvads: 1 item {says}"])
    assert sorted(str(record["status"]) for record in records_of(pytester.path)) == ["NOT RUN" if dropped else "FAIL", "PASS"]


@shows("deselect_what_fails")
def test_deselecting_does_not_raise_coverage(session: Session) -> None:
    result = session(GETS_IN + rules(rules=("p1", "gets_in")), "-k", "gets_in", "--rvads-cov-fail-under=100")
    result.assert_outcomes(passed=1, deselected=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["rvads: coverage is below 100 %: 1/2 cells exercised (50.0 %): 1 not selected"])


@shows("no_time_for_anything")
def test_empty_time_budget_judges_nothing(session: Session, pytester: pytest.Pytester) -> None:
    result = session(rules(), "--rvads-time-budget=0")
    assert result.ret == NOTHING
    assert [record["status"] for record in records_of(pytester.path)] == ["NOT RUN"]


AGAINST = ("--rvads-baseline=old.json", "--rvads-fail-on=new")


def compared(session: Session, before: str, after: str, tests: str = rules(), later: str | None = None) -> pytest.RunResult:
    """Run a session with one version of a driver, and one with another version or file that only new failures are to fail."""
    session(tests, "--rvads-report=old.json", driver=f"pilot as {before}")
    return session(tests if later is None else later, *AGAINST, driver=f"pilot as {after}")


@shows("break_down_where_it_failed_before")
def test_an_error_is_not_the_old_failure(session: Session) -> None:
    result = compared(session, "racer", "raises")
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 NEW", "*was FAIL, is ERROR*"])


@shows("fail_where_it_broke_down_before")
def test_a_failure_is_not_the_old_error(session: Session) -> None:
    result = compared(session, "raises", "racer")
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 NEW", "*was ERROR, is FAIL*"])


@shows("ask_nothing_any_more")
def test_what_is_na_now_is_lost(session: Session) -> None:
    """Too short for anybody to get into the junction: p1 has nothing to say any more."""
    result = compared(session, "racer", "racer", later=rules(duration=0.1))
    assert result.ret in (FAILED, NOTHING)
    result.stdout.fnmatch_lines(["against old.json: 1 LOST", "*was FAIL, is NA*"])


@shows("skip_what_was_judged")
def test_what_is_skipped_now_is_lost(session: Session) -> None:
    other = GETS_IN + rules(rules="gets_in").replace("test_rules", "test_other")
    result = compared(session, "racer", "racer", later="@pytest.mark.skip" + rules() + other)
    result.assert_outcomes(passed=1, skipped=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 LOST, 1 ADDED", "*was FAIL, is skipped"])


@shows("judge_nothing_as_before")
def test_to_judge_nothing_is_no_old_failure(session: Session) -> None:
    result = compared(session, "racer", "racer", CHECKED.format("").replace("monitor.check(rule)", "pass"))
    result.assert_outcomes(failed=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 UNCHANGED"])


@shows("delete_the_test")
def test_a_test_that_is_gone_is_lost(session: Session) -> None:
    result = compared(session, "racer", "racer", later=GETS_IN + rules(rules="gets_in"))
    result.assert_outcomes(passed=1)
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 LOST, 1 ADDED", "*was FAIL, does not exist any more"])


@shows("call_it_known")
def test_known_failure_is_reported_against_the_baseline(session: Session) -> None:
    """It passed before; a failure that is marked as known fails no session, so the comparison says it."""
    other = "@rvads.known('races', reason='new style')" + rules(duration=20)
    result = compared(session, "reference", "racer", rules(duration=20), later=other)
    result.assert_outcomes(xfailed=1)
    result.stdout.fnmatch_lines(["against old.json: 1 KNOWN", "*KNOWN*races: new style*"])


@pytest.mark.extended
@shows("another_map_under_the_same_name")
def test_another_junction_is_no_repetition(session: Session, pytester: pytest.Pytester) -> None:
    """The file of the map is written anew with a smaller junction; all ids stay as they are."""
    tests = RULES.format(more="").replace(
        "@here()", "@rvads.scenario('1', map='crossing.xodr', scenarios='1111', grid='B', rules='p1', duration=15)"
    )
    (pytester.path / "crossing.xodr").write_text(opendrive(Layout(), "crossing"), encoding="utf-8")
    first = session(tests, "--rvads-report=old.json", driver="reference")
    first.assert_outcomes(passed=1)
    assert session(tests, *AGAINST, driver="reference").ret == pytest.ExitCode.OK
    (pytester.path / "crossing.xodr").write_text(opendrive(Layout(stop=10.0), "crossing"), encoding="utf-8")
    result = session(tests, *AGAINST, driver="reference")
    assert result.ret == FAILED
    result.stdout.fnmatch_lines(["against old.json: 1 LOST", "*was PASS, at a junction that is not the same any more"])


@shows("shard_that_judged_nothing")
def test_shard_without_verdicts_is_no_success(
    session: Session, pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]
) -> None:
    """One shard passes by p1; the other one skips its item for p2, which the gate counts, and is no success by itself."""
    session(rules(duration=20), "--rvads-report=a.json", "test_it.py", driver="reference")
    session("@pytest.mark.skip" + rules(rules="p2"), "--rvads-report=b.json", "test_other.py", name="test_other")
    full, empty = (str(pytester.path / f"{name}.json") for name in "ab")
    capsys.readouterr()
    assert main(["report", "merge", full]) == pytest.ExitCode.OK
    assert main(["report", "merge", full, empty, "--cov-fail-under", "100"]) == FAILED
    assert "1/2 cells exercised (50.0 %): 1 not run" in capsys.readouterr().err
    assert main(["report", "merge", empty]) == NOTHING


@shows("three_tests_on_one_run")
def test_three_failures_on_one_run_are_all_reported(session: Session, pytester: pytest.Pytester) -> None:
    """Three functions, one scenario, one driver: equal runs, and none of the failures is lost in the summary of causes."""
    tests = "".join(rules().replace("test_rules", f"test_{number}") for number in ("one", "two", "three"))
    result = session(tests)
    result.assert_outcomes(failed=3)
    assert result.ret == FAILED
    result.stdout.no_fnmatch_line("*INTERNALERROR*")
    assert len({record["hash"] for record in records_of(pytester.path)}) == 1
