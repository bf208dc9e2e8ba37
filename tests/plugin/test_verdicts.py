"""Verdicts reach pytest: pass, failure in one line, NA as a skip, known deficiencies as strict xfail."""

import re
import shlex
from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from pytest_rvads.fixtures.monitoring import Monitor
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RuleViolation
from tests.inner_sessions import driven_by

CONFTEST = driven_by(
    '{"racer": Racer, "parked": Parked}.get(request.function.__name__.split("_")[1], rvads.Reference)',
    """
    class Parked(rvads.Follower):
        def target_speed(self, seen):
            return 0.0
""",
)

TESTS = """
    import pytest_rvads as rvads

    here = rvads.scenario("stop4", classes=7, grid="C", rules=("p1", "p3", "p4"))

    @here
    def test_reference(run, rule, monitor):
        verdict = monitor.check(rule)
        assert verdict.status == rvads.Status.PASS
        assert verdict

    @here
    def test_racer(run, rule, monitor):
        monitor.check(rule)
"""


@pytest.fixture
def files(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(TESTS)
    return pytester


def test_pass_fail_and_na(files: pytest.Pytester) -> None:
    # Four vehicles that never stop are in the junction together (p1); all arrive at once, so nobody is first (p3);
    # there are no lights (p4).
    result = files.runpytest("-rsf")
    result.assert_outcomes(passed=1, failed=1, skipped=4)
    result.stdout.fnmatch_lines(["*FAILED *test_racer*stop4-class07-as1133-cfgC-p1* - pytest_rvads.RuleViolation: p1 at t=*"])
    assert result.stdout.str().count("RuleViolation: p1") == 2, "once with the test, once in the short summary"
    result.stdout.no_fnmatch_line("*judging.py*")


@pytest.mark.parametrize("unavoidable", ["pass", "fail"])
def test_unavoidable_violation_raises_where_it_is_to_fail(make: Callable[..., Run], unavoidable: str) -> None:
    """Four arrive at once; a0 goes first, before the vehicle on its right, then each that has nobody on its right any more."""
    options: Any = SimpleNamespace(strict={"unavoidable"} if unavoidable == "fail" else set())
    run = make("stop4", {entrance: (2, 0, 100 * turn, 100 * turn + 100) for turn, entrance in enumerate((0, 3, 2, 1), 1)}, 600)
    asked = Monitor(run, [], options, None)
    with nullcontext() if unavoidable == "pass" else pytest.raises(RuleViolation, match="p2 at t="):
        assert asked.check("p2").unavoidable


@pytest.mark.extended
@pytest.mark.parametrize(("option", "failed"), [((), 0), (("--rvads-strict=open,unavoidable",), 1)])
def test_unavoidable_violation_passes_by_default(files: pytest.Pytester, option: tuple[str, ...], failed: int) -> None:
    """Four arrive at once at an all-way stop: whoever goes first breaks the rule of the right."""
    files.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=24, grid="C", rules=("p2", "p1"))
        def test_reference(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = files.runpytest(*option)
    result.assert_outcomes(passed=2 - failed, failed=failed)
    assert result.ret == (pytest.ExitCode.TESTS_FAILED if failed else pytest.ExitCode.OK)
    title = "causes of failures" if failed else "unavoidable: nobody could have kept the rule"
    result.stdout.fnmatch_lines(["*unavoidable*", title, "*1 x p2 (right-of-way): *"])


def test_the_failure_of_a_deliberate_probe_says_so(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", scenarios="1133", distances=5, speeds=[5, 11], probe=True, rules="p1")
        def test_racer(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-vv")
    result.assert_outcomes(failed=2)
    (shown,) = (line for line in result.outlines if line.startswith("probe     "))
    assert shown.startswith("probe     a deliberate probe: at 11 m/s nobody stops within 5 m, v(d)max is ")


def test_probe_depends_on_the_vehicle(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        @pytest.fixture
        def rvads_vehicle():
            return rvads.Vehicle(brake=(1.0, 1.0, 1.0))

        @rvads.scenario("stop4", scenarios="1133", distances=5, speeds=5, rules="p1")
        def test_racer(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["probe     a deliberate probe: at 5 m/s nobody stops within 5 m, v(d)max is *"])


@pytest.mark.extended
def test_the_explanation_has_start_and_a_rerun_line_that_works(files: pytest.Pytester) -> None:
    result = files.runpytest("-k", "racer and p1")
    result.stdout.fnmatch_lines(
        [
            "*- rvads p1 -*",
            "*p1*",
            "start     stop4-class07-as1133-cfgC (0->1 1->2 2->1 3->2)  d=(20 20 20 20) m  v=(0 0 0 0) m/s",
            'rerun     pytest "*"',
        ]
    )
    command = re.search(r'rerun     pytest "(.*)"', result.stdout.str())
    assert command
    files.runpytest(command[1]).assert_outcomes(failed=1)


@pytest.mark.extended
def test_the_rerun_line_says_again_what_the_command_line_said_of_the_run(files: pytest.Pytester) -> None:
    pytest.importorskip("mujoco")
    chosen = ["--rvads-simulator=mujoco", "--rvads-autopilot=red_light_runner", "-vv"]
    result = files.runpytest("-k", "racer and p1", *chosen)
    line = re.search(r"rerun     pytest (.*)", result.stdout.str())
    assert line
    assert shlex.split(line[1])[:-1] == ["--rvads-autopilot=red_light_runner", "--rvads-simulator=mujoco"]
    again = files.runpytest(*shlex.split(line[1]))
    again.assert_outcomes(failed=1)
    again.stdout.fnmatch_lines(["driven by *RedLightRunner*", "simulated by mujoco"])


@pytest.mark.extended
def test_na_is_a_skip_with_its_reason_at_the_users_test(files: pytest.Pytester) -> None:
    result = files.runpytest("-rs", "-k", "reference", "-v")
    result.stdout.fnmatch_lines(["*test_reference*-p4?*NA*"])
    result.stdout.fnmatch_lines(["NA [[]1] test_na_is_a_skip*.py:5: NA: *"])


@pytest.mark.extended
def test_known_deficiencies_are_strict(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        here = rvads.scenario("stop4", classes=(1, 7), grid="C", rules=("p1", "p4"), duration=12)

        @rvads.known("races", rule="p1", cls=(7, 8), reason="never stops")
        @here
        def test_racer_known(run, rule, monitor):
            monitor.check(rule)

        @rvads.known("races", rule="p1")
        @here
        def test_reference_known(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-rxX")
    result.assert_outcomes(xfailed=1, failed=3, skipped=4)
    result.stdout.fnmatch_lines(["XFAIL *test_racer_known*class07*-p1* - races: never stops*"])
    result.stdout.fnmatch_lines(["*XPASS(strict)* races*"])


def test_an_open_obligation_fails_by_default(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        # a0 and a1 wait at their lines from the start, the others arrive later, and nobody ever moves on.
        @rvads.scenario("stop4", classes=1, distances=0.3, rules="p2", duration=2)
        def test_parked(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*OpenObligation: p2*"])
    pytester.runpytest("--rvads-strict=none").assert_outcomes(skipped=1)


@pytest.mark.extended
def test_asserting_on_the_run(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=7, grid="C")
        def test_racer(run):
            assert not run.collisions

        @rvads.scenario("stop4", classes=7, grid="C")
        def test_reference(run):
            assert not run.collisions
        """
    )
    # Nobody looks: a right turn and a left turn from across, into the same exit at the same time.
    result = pytester.runpytest()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*assert not (Collision(*", "stop4: *2 verdicts: 1 pass, 1 fail*"])


def test_a_run_is_simulated_once_for_all_rules(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        made = []

        @pytest.fixture
        def rvads_autopilot():
            def make(speed=5.0):
                made.append(speed)
                return rvads.Reference()
            return make  # a new function for every test, with the same code

        @rvads.scenario("stop4", classes=(1, 2), grid="BC", rules=("p1", "p2", "p3", "p4"), duration=5)
        def test_rules(run, rule, monitor):
            monitor.verdict(rule)

        def test_count():
            assert len(made) == 4 * 4, "four vehicles in each of four runs"
        """
    )
    pytester.runpytest().assert_outcomes(passed=17)


@pytest.mark.extended
def test_summary_shows_matrix_causes_and_coverage(files: pytest.Pytester) -> None:
    result = files.runpytest()
    result.stdout.fnmatch_lines(
        [
            "*rvads verdicts*",
            "*stop4*test_reference*",
            "*07*pass*NA*NA*",
            "*stop4*test_racer*",
            "*07*FAIL*NA*NA*",
            "stop4: 1/24 classes, 1/81 scenarios, 2 runs, 6 verdicts: 1 pass, 1 fail, 4 NA*(never applicable: p3, p4)*",
            "*short test summary info*",
            "*rvads causes*",
            "causes of failures",
            "*1 x p1 (no two vehicles in the junction): *",
            "*first: pytest *",
        ]
    )


def test_no_summary_where_nothing_of_ours_ran(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_plain(): ...")
    pytester.runpytest().stdout.no_fnmatch_line("*rvads verdicts*")


@pytest.mark.parametrize(
    "options", [("-p", "no:terminal"), ("-p", "no:cacheprovider"), ("-x",), ("--collect-only",), ("--tb=no", "-q")]
)
def test_other_options_of_pytest(files: pytest.Pytester, options: tuple[str, ...]) -> None:
    result = files.runpytest("-k", "racer", *options)
    assert result.ret == (0 if "--collect-only" in options else 1)


def test_the_summary_can_be_asked_for_as_a_whole(files: pytest.Pytester) -> None:
    assert "slowest: " in files.runpytest("-vv").stdout.str()
