"""The seam of simulators: chosen by name, by fixture and in every search; each with its own braking envelope."""

import json
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.errors import ScenarioError
from pytest_rvads.search.falsify import look_for
from pytest_rvads.simulators.bullet import bullet
from pytest_rvads.simulators.closed_loop import closed_vmax
from pytest_rvads.simulators.simulator import named

OWN = """
    from pytest_rvads import bullet

    class Counting:
        name = "counting"
        runs = 0

        def __call__(self, case):
            type(self).runs += 1
            return bullet(case)

        def vmax(self, distance, aggression=1, vehicle=None):
            return 1.0

    counting = Counting()
"""


class Counting:
    """Counts what it is asked for."""

    name = "counting"

    def __init__(self) -> None:
        self.cases: list[rvads.Case] = []

    def __call__(self, case: rvads.Case) -> rvads.Run:
        self.cases.append(case)
        return bullet(case)

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return bullet.vmax(distance, aggression, vehicle)


def case(junction: str, directions: str, **more: Any) -> rvads.Case:
    """One vehicle under test among traffic."""
    scenario = rvads.Scenario(rvads.find(junction), directions, **{"subject": 0, "distance": 8.0, "duration": 25.0, **more})
    return rvads.Case(scenario, rvads.Reference, rvads.traffic("reference"))


def test_every_search_takes_a_case_with_a_subject_and_a_simulator() -> None:
    counting = Counting()
    found = rvads.equivalent(case("stop4", "2200"), relations=("rotation", "creation", "renaming"), simulator=counting)
    assert len(found.compared) == 5
    assert {c.scenario.subject for c in counting.cases} == {0, 1, 2, 3}, "the seat is rotated with the scenario"
    rvads.rational(case("stop4", "2200"), farther=(5.0,), simulator=counting)
    rvads.determinate(case("stop4", "2200"), at=0.5, simulator=counting)
    rvads.sweep(case("stop4", "2200"), "p2", 0.0, 0.2, simulator=counting).check()
    before = len(counting.cases)
    assert look_for("stop4", rvads.Reference, "speed_limit", traffic="hesitant", subject=1, budget=4, simulator=counting) is None
    assert len(counting.cases) == before + 4
    assert all(c.scenario.subject == 1 and c.traffic is not None for c in counting.cases[before:])
    assert closed_vmax(0.3, rvads.Reference, simulator=counting) is not None
    assert counting.cases[-1].scenario.place.name == "light4"


def test_a_search_finds_what_the_subject_alone_does_wrong() -> None:
    found = look_for("stop4", rvads.RollingStop, "full_stop", traffic="reference", subject=0, budget=10)
    assert found is not None
    assert found.verdict.responsible == ("a0",)


def test_a_search_starts_within_the_envelope_of_what_simulates() -> None:
    class Careful(Counting):
        def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
            return 1.0

    careful = Careful()
    look_for("stop4", rvads.Reference, "p1", budget=20, simulator=careful)
    speeds = {speed for case in careful.cases for speed in case.scenario.speeds}
    assert max(speeds) <= 1.0
    assert len(speeds) > 1


@pytest.mark.usefixtures("own")
def test_commands_take_a_simulator(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["braking", "--simulator", "own:counting", "--json"]) == 0
    assert {speed for row in json.loads(capsys.readouterr().out).values() for speed in row.values()} == {1.0}
    arguments = ["--deficiency", "I3", "--seeds", "1", "--budget", "1", "--workers", "1"]
    assert main(["power", "--simulator", "own:counting", *arguments]) == 0
    assert sys.modules["own"].counting.runs > 0
    for command in (["braking"], ["power", *arguments]):
        assert main([*command, "--simulator", "own:nothing"]) == 2
        assert "simulator 'own:nothing' can't be loaded" in capsys.readouterr().err


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A module with a simulator in the working directory."""
    (tmp_path / "own.py").write_text(textwrap.dedent(OWN), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    sys.modules.pop("own", None)


def test_a_simulator_is_found_by_name() -> None:
    assert named("bullet") is bullet
    with pytest.raises(ScenarioError, match=r"unknown simulator 'bulet', there is bullet.*did you mean 'bullet'"):
        named("bulet")
    with pytest.raises(ScenarioError, match=r"can't be loaded: .*no_such_module"):
        named("no_such_module:thing")
    with pytest.raises(ScenarioError, match="has no vmax"):
        named("math:sqrt")


def test_the_option_chooses_what_simulates_and_how_fast_one_may_come(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own=OWN)
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, distances=20.0, speeds=[0.5, 5.0], rules="p1")
        def test_it(run, rule, monitor):
            monitor.check(rule)

        def test_it_counted(rvads_simulator):
            assert (rvads_simulator.name, rvads_simulator.runs) == ("counting", 1), "5 m/s is beyond its envelope"
    """)
    options = ("--rvads-autopilot=reference", "-p", "no:cacheprovider")
    result = pytester.runpytest(*options, "--rvads-simulator=own:counting")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["rvads: simulated by --rvads-simulator=own:counting"])
    result = pytester.runpytest(*options, "--rvads-simulator=own:nothing")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*simulator 'own:nothing' can't be loaded*"])


def test_a_failure_is_told_by_the_envelope_of_what_made_its_run(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own=OWN)
    pytester.makeconftest("""
        import pytest
        import pytest_rvads as rvads
        from own import counting

        @pytest.fixture(scope="session")
        def rvads_simulator():
            return counting
    """)
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", scenarios="1133", distances=20.0, speeds=5.0, rules="p2")
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    result = pytester.runpytest("--rvads-autopilot=lgsvl", "-p", "no:cacheprovider")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*a deliberate probe: at 5 m/s nobody stops within 20 m, v(d)max is 1.00 m/s"])


def test_a_simulator_that_returns_no_run_is_an_error_of_the_item(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own=OWN.replace("return bullet(case)", "return None"))
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="C", rules="p1")
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    result = pytester.runpytest("--rvads-autopilot=reference", "--rvads-simulator=own:counting", "-p", "no:cacheprovider")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*what rvads_simulator returns must answer a case with a Run, got None"])
