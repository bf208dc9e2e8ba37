"""Falsification: what it finds is real, simple, the same every time, and printed so that it can be run again."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest
from hypothesis import settings
from hypothesis.database import DirectoryBasedExampleDatabase

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.search.falsify import broken, pasteable
from pytest_rvads.simulators.loop import usual
from pytest_rvads.simulators.patience import Watch

from ..drivers.blind import BlindLeft
from .looking import look_for

NONE: dict[str, Any] = {"i1": False, "i2": False, "i3": False, "i4": False, "i5": False}


def lgsvl(deficiency: str) -> partial[rvads.LgsvlLike]:
    return partial(rvads.LgsvlLike, **(NONE | {deficiency: True}))


def vehicles(counterexample: Any) -> int:
    return sum(map(bool, counterexample.scenario.directions))


@pytest.mark.slow
def test_ignored_ties_are_found_reproducibly_with_two_vehicles() -> None:
    first, second = (look_for("paper_stop4", lgsvl("i3"), "p2", budget=60) for _ in range(2))
    assert first is not None
    assert vehicles(first) == 2
    assert first.scenario == second.scenario
    assert (first.found, first.simulations) == (second.found, second.simulations)
    run = rvads.simulate(rvads.Case(first.scenario, lgsvl("i3")))
    assert rvads.check(run, "p2").status is rvads.Status.FAIL


@pytest.mark.extended
def test_reference_survives() -> None:
    assert look_for("stop4", rvads.Reference, "p1", budget=12, partial=False) is None


def test_unavoidable_violation_is_no_counterexample() -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1111"), rvads.Reference))
    verdict = rvads.check(run, "p2")
    assert verdict.status is rvads.Status.FAIL
    assert not broken(run, verdict)
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("paper_stop4"), "2200"), lgsvl("i3")))
    verdict = rvads.check(run, "p2")
    assert verdict.status is rvads.Status.FAIL
    assert broken(run, verdict)


def test_provoked_violation_is_no_counterexample() -> None:
    starts: dict[str, Any] = {"distance": (16.4, 16.8, 10.4, 10.0), "speed": (0.0, 0.0, 3.8, 3.8), "wait": 2.48}
    scenario = rvads.Scenario(rvads.find("stop4"), "3233", subject=1, duration=12, **starts)
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference, rvads.traffic("stopped")))
    verdict = rvads.check(run, "p3")
    assert (verdict.status, verdict.provoked) == (rvads.Status.OPEN, True)
    assert not broken(run, verdict)


def test_fault_is_reported_with_the_scenario() -> None:
    class Broken:
        def control(self, seen: Observation) -> Control:
            raise ValueError("no")

    with pytest.raises(rvads.errors.RunError, match=r"(?s)Scenario.*can't be judged by p1: .*Broken driving"):
        look_for("stop4", Broken, "p1", budget=5)


def test_pasteable_test_has_all_values_other_than_the_defaults() -> None:
    scenario = rvads.Scenario(rvads.find("light4"), "0110", distance=(20, 3.5, 5, 20), speed=(0, 0, 1.25, 0), wait=2.5)
    text = pasteable(scenario, "p5")
    assert (
        "@rvads.scenario('light4', scenarios='0110', distances=(20, 3.5, 5, 20), speeds=(0, 0, 1.25, 0), rules='p5', wait=2.5)"
        in text
    )


class Parked(rvads.Autopilot):
    """It brakes all the time."""

    def control(self, seen: Observation) -> Control:
        return Control(0.0, 1.0, 0.0)


def test_driver_that_never_crosses_survives_no_search() -> None:
    """It waits at the red light for the whole run, with reason, so p4 applies and is never broken."""
    with pytest.raises(rvads.errors.ScenarioError, match=r"p4 was not triggered in any of .* with a crossing"):
        look_for("light4", Parked, "p4", subject=0, duration=5, budget=15)


FAULTY = """
from functools import partial
import pytest
import pytest_rvads as rvads

@pytest.fixture
def rvads_autopilot():
    return partial(rvads.LgsvlLike, i1=False, i2=False, i4=False, i5=False)

@rvads.falsify("paper_stop4", rule="p2", budget=60)
def test_ties(tmp_path):
    assert tmp_path.exists()

@rvads.falsify("paper_stop4", rule="p1", budget=3, autopilot=rvads.Reference)
def test_reference(tmp_path):
    assert tmp_path.exists()
"""


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Path]:
    """Have Hypothesis keep its examples here."""
    before = settings.get_current_profile_name()
    settings.register_profile("here", database=DirectoryBasedExampleDatabase(tmp_path / "examples"))
    settings.load_profile("here")
    yield tmp_path / "examples"
    settings.load_profile(before)


@pytest.mark.extended
def test_printed_counterexample_reproduces_the_failure(pytester: pytest.Pytester, database: Path) -> None:
    pytester.makepyfile(test_faulty=FAULTY)
    result = pytester.runpytest("-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=1)
    out = result.stdout.str()
    assert re.search(r"RuleViolation: p2 at t=[\d.]+ s: a\d left entrance \d before a\d was in the junction", out)
    assert "Falsifying example" not in out
    snippet = re.search(r" *@rvads\.scenario\(.*\)\n.*\n.*monitor\.check\(rule\)", out)
    assert snippet
    fixture = FAULTY.split("@rvads.falsify")[0]
    pytester.makepyfile(test_again=fixture + dedent(snippet.group()) + "\n")
    again = pytester.runpytest("-p", "no:cacheprovider", "test_again.py")
    again.assert_outcomes(failed=1)
    assert any(database.rglob("*")), "the example database keeps it"


@pytest.mark.extended
def test_autopilot_option_overrides_the_fixture_in_a_search(pytester: pytest.Pytester, database: Path) -> None:
    pytester.makepyfile(test_faulty=FAULTY.replace("p2", "p1").replace("60", "2"))
    result = pytester.runpytest("-p", "no:cacheprovider", "--rvads-autopilot=stopped", "-k", "test_ties")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*p1 was not triggered in any of 2 simulations*"])


@pytest.mark.slow
def test_falsification_works_on_two_workers(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_faulty=FAULTY)
    pytester.runpytest_subprocess("-p", "no:cacheprovider", "-n", "2").assert_outcomes(passed=1, failed=1)


def test_search_in_a_method_reports_errors_by_line(pytester: pytest.Pytester) -> None:
    file = pytester.makepyfile("""
        import pytest_rvads as rvads

        class TestIt:
            @rvads.falsify(rvads.find("stop4"), rule="speed_limit", budget=2, autopilot=rvads.Reference)
            def test_method(self, tmp_path):
                assert tmp_path.exists() and isinstance(self, TestIt)

        @rvads.falsify("stop4", rule="p91", autopilot=rvads.Reference)
        def test_rule(): ...

        @rvads.falsify("stop4", rule="p1", autopilot=int)
        def test_driver(): ...
    """)
    result = pytester.runpytest("-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines([f"E *FormulaError: {file.name}:8: unknown rule 'p91', there are *"])
    result.stdout.fnmatch_lines([f"E *RunError: {file.name}:11: *int can't drive a*: an autopilot needs a method control*"])
    result.stdout.no_fnmatch_line("*plugin.py*")


@pytest.mark.parametrize(
    ("fixture", "says"),
    [
        ("rvads_autopilot", "AutopilotError: *.py:7: an autopilot must be a class or a callable that makes one, got None*"),
        ("rvads_simulator", "ScenarioError: *.py:7: simulator None has no __call__: *"),
        ("rvads_vehicle", "ScenarioError: *.py:7: a fleet, as the fixture rvads_vehicle, needs a rvads.Vehicle(...), got None"),
    ],
)
def test_empty_autopilot_fixture_is_reported_at_the_line_of_the_search(
    pytester: pytest.Pytester, fixture: str, says: str
) -> None:
    pytester.makepyfile(f"""
        import pytest
        import pytest_rvads as rvads

        @pytest.fixture
        def {fixture}(): ...

        @rvads.falsify("stop4", rule="p1", budget=1)
        def test_it(): ...
    """)
    result = pytester.runpytest("-p", "no:cacheprovider", *([] if "auto" in fixture else ["--rvads-autopilot=reference"]))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines([f"E *{says}"])


def test_error_of_a_simulator_is_printed_once_with_its_type_and_notes(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        test_it="""
        import pytest
        import pytest_rvads as rvads
        from pytest_rvads.simulators.loop import usual

        class Lost(rvads.errors.RunError):
            def __init__(self, host, port):
                super().__init__(f"{host}:{port} is gone")

        class Remote:
            name = "remote"
            vmax = usual().vmax

            def __call__(self, case, watch=None):
                error = Lost("here", 80)
                error.add_note("start it again")
                raise error

        @pytest.fixture
        def rvads_simulator():
            return Remote()

        @rvads.falsify("stop4", rule="p1", budget=1, autopilot=rvads.Reference)
        def test_it(): ...
    """
    )
    result = pytester.runpytest("-p", "no:cacheprovider")
    result.stdout.fnmatch_lines(["E *test_it.Lost: test_it.py:22: here:80 is gone", "*start it again"])
    result.stdout.no_fnmatch_line("*searching.py*")


def test_search_is_reported_at_the_line_of_its_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        test_it="""
        import pytest_rvads as rvads

        @rvads.falsify("stop4", rule="speed_limit", budget=1, autopilot=rvads.Reference)
        def test_it(request):
            assert request.node.location[:2] == ("test_it.py", 2)
    """
    )
    pytester.runpytest("-p", "no:cacheprovider").assert_outcomes(passed=1)


def test_search_starts_no_vehicle_above_its_safe_speed() -> None:
    bus = rvads.Vehicle(mass=20_000.0)
    scenarios: list[rvads.Scenario] = []

    class Watched:
        name = "watched"

        def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float:
            return 1.0 if vehicle == bus else 10.0

        def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
            scenarios.append(case.scenario)
            return usual()(case, watch)

    with pytest.raises(rvads.errors.ScenarioError, match="with a crossing"):  # no vehicle enters within a second
        look_for("stop4", rvads.Reference, "speed_limit", fleet=rvads.Fleet(bus), simulator=Watched(), budget=8, duration=1.0)
    assert 0 < max(max(scenario.speeds) for scenario in scenarios) <= 1.0


def test_misuse() -> None:
    with pytest.raises(rvads.errors.FormulaError, match="unknown rule 'p9'"):
        look_for("stop4", rvads.Reference, "p9")
    namesake = rvads.Rule("p1", "forall a. F a@j & true")
    with pytest.raises(rvads.errors.FormulaError, match="'p1' is a shipped rule and "):
        look_for("stop4", rvads.Reference, namesake)


class Heedless(rvads.Follower):
    """Drives at a constant speed and ignores all other vehicles."""

    def target_speed(self, seen: Observation) -> float:
        return 8.0


@pytest.mark.extended
def test_parallel_searches_give_the_answer_of_sequential_searches(pytestconfig: pytest.Config) -> None:
    space: dict[str, Any] = {"budget": 6, "seed": 5, "searches": 2}
    alone = look_for("stop4", Heedless, "no_collision", executor=1, **space)
    assert alone is not None
    single = [look_for("stop4", Heedless, "no_collision", budget=3, seed=seed) for seed in (5, 6)]
    assert alone == next(counterexample for counterexample in single if counterexample)
    assert alone == look_for("stop4", Heedless, "no_collision", executor=2, **space)

    @rvads.falsify("stop4", rule="no_collision", autopilot=Heedless, executor=2, **space)
    def test_beside() -> None:
        raise AssertionError("something was found, so this is not called")

    with pytest.raises(rvads.RuleViolation, match=r"no_collision at t=.* collide"):  # an older stored example may come first
        test_beside(pytestconfig=pytestconfig, rvads_vehicle=rvads.Vehicle(), rvads_simulator=usual())


@pytest.mark.parametrize("searches", [0, 11, 1.5])
def test_searches_must_not_exceed_the_budget(searches: int) -> None:
    with pytest.raises(rvads.errors.ScenarioError, match="from 1 to the budget of 10 simulations"):
        look_for("stop4", Heedless, "no_collision", budget=10, searches=searches)


@pytest.mark.extended
def test_controller_that_looks_only_to_its_right_is_found_by_a_collision() -> None:
    """The vehicle from the left or from ahead arrives shortly before the controller, which the reference lets pass."""
    searches = (look_for("stop4", BlindLeft, "no_collision", subject=0, seed=seed, budget=60) for seed in range(6))
    counterexample = next(filter(None, searches), None)
    assert counterexample is not None
    run = rvads.simulate(rvads.Case(counterexample.scenario, rvads.Reference, rvads.traffic("reference")))
    assert rvads.check(run, "no_collision").status is rvads.Status.PASS
