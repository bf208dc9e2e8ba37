"""Verdicts that change within a session are FLAKY, and the session is not green."""

import pytest

from tests.inner_sessions import records_of

AGAIN = """
    import pytest
    from _pytest.runner import runtestprotocol

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(item, nextitem):
        '''Runs an item a second time if it fails, and hides the first time, as the plugin `flaky` does.'''
        for attempt in range(2):
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            if not any(report.failed for report in reports):
                break
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        return True
"""
REPEATED = """
    import pytest_rvads as rvads

    ATTEMPTS = []


    @rvads.scenario("stop4", classes=1, grid="C", rules="speed_limit", duration=2)
    def test_it(run, rule, monitor):
        monitor.check(rule)
        ATTEMPTS.append(1)
        assert len(ATTEMPTS) != {failing}
"""
BY_PROCESS = """
    import os
    import pytest
    import pytest_rvads as rvads

    class Moody(rvads.Follower):
        def target_speed(self, seen):
            return 2.0 + int(os.environ["PYTEST_XDIST_WORKER"][-1])

    @pytest.fixture
    def rvads_autopilot():
        return Moody

    @rvads.scenario("stop4", classes=1, grid="C", rules=("speed_limit", "keep_lane", "no_collision", "p1"), duration=1)
    def test_it(run, rule, monitor):
        monitor.check(rule)
"""


def told(pytester: pytest.Pytester) -> set[str]:
    return {record["status"] for record in records_of(pytester.path)}


@pytest.mark.parametrize(("failing", "passed", "status", "code"), [(1, 1, "FLAKY", 1), (9, 1, "PASS", 0)])
def test_item_that_fails_once_and_then_passes_is_flaky(
    pytester: pytest.Pytester, reference: None, failing: int, passed: int, status: str, code: int
) -> None:
    pytester.makeconftest(AGAIN)
    pytester.makepyfile(REPEATED.format(failing=failing))
    result = pytester.runpytest("--rvads-report=out.json")
    result.assert_outcomes(passed=passed)
    assert told(pytester) == {status}
    assert result.ret == code
    if code:
        result.stdout.fnmatch_lines(["rvads: FLAKY, though nothing failed: 1 item, first *: FAIL at first, PASS afterwards, *"])


@pytest.mark.extended
def test_rules_judged_on_different_runs_of_one_start_are_flaky(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(BY_PROCESS)
    result = pytester.runpytest_subprocess("-n2", "--dist=load", "--rvads-report=out.json")
    result.assert_outcomes(passed=3, skipped=1)
    assert told(pytester) == {"FLAKY"}
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["rvads: FLAKY, though nothing failed: 4 items, first *: it was judged on another run than *"])
