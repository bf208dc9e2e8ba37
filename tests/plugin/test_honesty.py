"""Nothing is silently green: no verdict of another run, no pass without judging, no session that judged nothing."""

import json
from pathlib import Path

import pytest

from tests.inner_sessions import driven_by, records_of

PILOT = """
    import pytest
    import pytest_rvads as rvads

    class Pilot(rvads.Follower):
        def target_speed(self, seen):
            return {speed}

    @pytest.fixture
    def rvads_autopilot():
        return lambda: Pilot()

    @rvads.scenario("stop4", classes=7, grid="C")
    def test_speed(run):
        assert {low} < run.speed.max() < {high}
"""


def test_equal_code_in_two_files_drives_two_runs(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        test_slow=PILOT.format(speed=2.0, low=1.8, high=2.2),
        test_fast=PILOT.format(speed=4.0, low=3.8, high=4.2),
    )
    pytester.runpytest().assert_outcomes(passed=2)


@pytest.mark.extended
def test_a_fixture_that_changes_its_class_between_items(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        class Pilot(rvads.Follower):
            wanted = 0.0

            def target_speed(self, seen):
                return self.wanted

        @pytest.fixture(params=[2.0, 4.0])
        def speed(request):
            return request.param

        @pytest.fixture
        def rvads_autopilot(speed, monkeypatch):
            monkeypatch.setattr(Pilot, "wanted", speed)
            return Pilot

        @rvads.scenario("stop4", classes=7, grid="C")
        def test_speed(run, speed):
            assert abs(run.speed.max() - speed) < 0.2
        """
    )
    pytester.runpytest().assert_outcomes(passed=2)


@pytest.mark.extended
def test_an_assertion_after_a_pass_is_a_failure_in_every_report(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=7, grid="E", rules="p1")
        def test_more(run, rule, monitor):
            monitor.check(rule)
            assert run.duration < 1.0
        """
    )
    result = pytester.runpytest("--rvads-report=out.json")
    result.stdout.fnmatch_lines(["*07*FAIL*", "*1 x p1: assert *"])
    assert records_of(pytester.path)[0]["status"] == "FAIL"


@pytest.mark.extended
@pytest.mark.usefixtures("reference")
def test_session_without_verdicts_on_a_worker_is_no_success(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=7, grid="C", rules="p4", duration=1)
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-n", "1")
    result.assert_outcomes(skipped=1)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    result.stdout.fnmatch_lines(["*nothing was judged*"])


def test_rulebook_without_applicable_rules_is_refused(pytester: pytest.Pytester, shared: Path) -> None:
    pytester.makepyfile(
        f"""
        import pytest_rvads as rvads

        @rvads.scenario("123", map={str(shared / "maps" / "Town07.xodr")!r})  # a junction without signs and lights
        def test_rules(run, rule, monitor): ...
        """
    )
    pytester.runpytest().stdout.fnmatch_lines(["*no rule of 'paper' is about a junction with control 'none'*"])


def test_a_report_that_can_t_be_written_is_no_success(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(PILOT.format(speed=2.0, low=0, high=99))
    result = pytester.runpytest("--rvads-report=/proc/nowhere/out.json")
    result.assert_outcomes(passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["*the report could not be written*"])


@pytest.mark.extended
def test_interrupted_session_keeps_its_records(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=(1, 2), grid="E", rules="p1", duration=2)
        def test_rules(run, rule, monitor):
            if run.label.startswith("stop4-class02"):
                raise KeyboardInterrupt
            monitor.check(rule)
        """
    )
    result = pytester.runpytest_subprocess("--rvads-report=out.json")
    assert result.ret == pytest.ExitCode.INTERRUPTED
    result.stdout.fnmatch_lines(
        ["stop4: 1/24 classes*2 verdicts: 1 pass, 1 not run*", "*did not end by itself*1 item did not run*"]
    )
    content = json.loads((pytester.path / "out.json").read_text(encoding="utf-8"))
    assert (content["exitstatus"], [r["status"] for r in content["records"]]) == (2, ["PASS", "NOT RUN"])


def test_a_picture_that_fails_costs_no_verdict(pytester: pytest.Pytester) -> None:
    tests = """
        import pytest_rvads.satellites.pages.replay

        @pytest.fixture(autouse=True)
        def broken(monkeypatch):
            def fails(*args, **beside):
                raise ValueError("no ink")
            monkeypatch.setattr(pytest_rvads.satellites.pages.replay, "replay", fails)
            yield

        @rvads.scenario("stop4", classes=7, grid="C", rules="p1")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
    """
    pytester.makepyfile(driven_by("Racer", tests))
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["look      not drawn: ValueError: no ink", 'rerun     pytest "*"'])
