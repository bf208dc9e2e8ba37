"""The seam of simulators: chosen by name, by fixture and in every search; each with its own braking envelope."""

import csv
import json
import sys
import textwrap
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.runs.run import Collision
from pytest_rvads.satellites.relations.variants import RELATIONS
from pytest_rvads.search.falsify import look_for
from pytest_rvads.simulators.driver_dynamics import closed_vmax
from pytest_rvads.simulators.loop import usual
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.simulators.simulator import Choice, named
from pytest_rvads.support.errors import ScenarioError
from studies import killing, power, prediction
from studies.mutants import MUTANTS

OWN = """
    from pathlib import Path
    from pytest_rvads.simulators.loop import usual

    class Counting:
        name = "counting"
        runs = 0

        def __call__(self, case, watch=None):
            type(self).runs += 1
            with Path("runs").open("a") as runs:  # another process simulates
                runs.write("x")
            return usual()(case, watch)

        def vmax(self, distance, aggression=1, vehicle=None):
            return 1.0

    counting = Counting()
"""


class Counting:
    """Counts what it is asked for."""

    name = "counting"

    def __init__(self) -> None:
        self.cases: list[rvads.Case] = []

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        self.cases.append(case)
        return usual()(case, watch)

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return usual().vmax(distance, aggression, vehicle)


def case(junction: str, directions: str, **more: Any) -> rvads.Case:
    """One vehicle under test among traffic."""
    scenario = rvads.Scenario(rvads.find(junction), directions, **{"subject": 0, "distance": 8.0, "duration": 25.0, **more})
    return rvads.Case(scenario, rvads.Reference, rvads.traffic("reference"))


@pytest.mark.extended
def test_every_search_takes_a_case_with_a_subject_and_a_simulator() -> None:
    counting = Counting()
    found = rvads.equivalent(case("stop4", "2200"), relations=("rotation", "creation", "renaming"), simulator=counting)
    assert len(found.compared) == 5
    assert {c.scenario.subject for c in counting.cases} == {0, 1, 2, 3}, "the seat is rotated with the scenario"
    rvads.rational(case("stop4", "2200"), farther=(5.0,), simulator=counting)
    rvads.determinate(case("stop4", "2200"), at=0.5, simulator=counting)
    before = len(counting.cases)
    assert look_for("stop4", rvads.Reference, "speed_limit", traffic="hesitant", subject=1, budget=4, simulator=counting) is None
    assert len(counting.cases) == before + 4
    assert all(c.scenario.subject == 1 and c.traffic is not None for c in counting.cases[before:])
    assert closed_vmax(0.3, rvads.Reference, simulator=counting) is not None
    assert counting.cases[-1].scenario.place.name == "light4"


def test_mutants_are_tried_by_what_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(killing, "CELLS", (("stop4", "2000", "C"),))
    monkeypatch.setattr(killing, "TURNED", killing.CELLS)
    monkeypatch.setattr(killing, "RELATIONS", {"rotation": RELATIONS["rotation"]})
    counting = Counting()
    monkeypatch.setattr(killing, "named", {"counting": counting}.get)
    killing.killed_by(next(iter(MUTANTS)), "counting")
    assert len(counting.cases) == 1 + 4, "by the rules, which it keeps there, and in all four rotations"


def test_a_search_finds_what_the_subject_alone_does_wrong() -> None:
    found = look_for("stop4", rvads.RollingStop, "full_stop", traffic="reference", subject=0, budget=10)
    assert found is not None
    assert found.verdict.responsible == ("a0",)


@pytest.mark.extended
def test_a_search_starts_within_the_envelope_of_what_simulates() -> None:
    class Careful(Counting):
        def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
            return 1.0

    careful = Careful()
    look_for("stop4", rvads.Reference, "p1", budget=20, simulator=careful)
    speeds = {speed for case in careful.cases for speed in case.scenario.speeds}
    assert max(speeds) <= 1.0
    assert len(speeds) > 1


@pytest.mark.extended
@pytest.mark.usefixtures("own")
def test_commands_take_a_simulator(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", "braking", "--simulator", "own:counting", "--json"]) == 0
    assert {speed for row in json.loads(capsys.readouterr().out).values() for speed in row.values()} == {1.0}
    arguments = ["--deficiency", "I3", "--seeds", "1", "--budget", "1", "--workers", "1"]
    assert power.main(["--simulator", "own:counting", *arguments]) == 0
    assert Path("runs").read_text()
    for command, words in (
        (main, ["dynamics", "braking"]),
        (power.main, arguments),
        (power.main, ["--mutants"]),
        (prediction.main, ["--jsonl"]),
    ):
        assert command([*words, "--simulator", "own:nothing"]) == 2
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
    assert named(usual().name) is usual()
    with pytest.raises(ScenarioError, match=r"unknown simulator 'bulet', there is bullet.*did you mean 'bullet'"):
        named("bulet")
    with pytest.raises(ScenarioError, match=r"can't be loaded: .*no_such_module"):
        named("no_such_module:thing")
    with pytest.raises(ScenarioError, match="has no vmax"):
        named("math:sqrt")
    for wrong in (":mine", "own:", "own:a:b", "..own:mine", "own.:mine", "own:.mine", "no module:x"):
        with pytest.raises(ScenarioError, match=f"simulator {wrong!r} can't be loaded: expected module:name"):
            named(wrong)


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("\n1 / 0\n", r"raised ZeroDivisionError: division by zero \(own_broken.py:2\)$"),
        ("def (:\n", r"raised SyntaxError: invalid syntax \(own_broken.py, line 1\)$"),
    ],
)
def test_raising_simulator_module_is_named_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, says: str
) -> None:
    (tmp_path / "own_broken.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ScenarioError, match=rf"^simulator 'own_broken:mine' can't be loaded: own_broken {says}"):
        named("own_broken:mine")


@pytest.mark.parametrize(
    ("made", "wrong"),
    [
        ("Counting", "is a class"),
        ("type('Mine', (Counting,), {'name': 3})()", "is called 3, which is no name"),
        ("type('Mine', (Counting,), {'name': ''})()", "is called '', which is no name"),
        ("type('Mine', (Counting,), {'vmax': 1.0})()", "has no vmax"),
        ("type('Mine', (), {'name': 'x', 'vmax': lambda self: 1.0})()", "has no __call__"),
        ("type('Mine', (Counting,), {'__call__': lambda self, case: None})()", "can't be called with two arguments"),
    ],
)
def test_what_is_no_simulator_is_refused_as_option_fixture_and_argument(pytester: pytest.Pytester, made: str, wrong: str) -> None:
    pytester.makepyfile(own=f"{textwrap.dedent(OWN)}\nmine = {made}")
    pytester.makepyfile("""
        import pytest
        import pytest_rvads as rvads
        from own import mine

        @pytest.fixture
        def rvads_simulator():
            return mine

        @rvads.scenario("stop4", classes=1, grid="C", rules="p1")
        def test_fixture(rule, monitor):
            monitor.check(rule)

        def test_argument():
            rvads.vmax(1.0, simulator=mine)
    """)
    options = ("--rvads-autopilot=reference", "-p", "no:cacheprovider")
    result = pytester.runpytest(*options, "--rvads-simulator=own:mine")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"ERROR: simulator 'own:mine' {wrong}: it has to be an object with a name, *"])
    result = pytester.runpytest(*options)
    result.assert_outcomes(errors=1, failed=1)
    result.stdout.fnmatch_lines(
        [f"simulator <*own.*> {wrong}: it has to be an object *", f"E  *ScenarioError: simulator <*> {wrong}: *"]
    )


@pytest.mark.parametrize("speed", ["x", float("nan"), float("inf"), -1.0, True])
def test_invalid_vmax_names_the_simulator(speed: Any) -> None:
    class Wrong(Counting):
        def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
            answer: float = speed
            return answer

    says = f"the simulator 'counting' must give v\\(d\\)max as a speed of 0 m/s or more, or as None, got {speed!r} at 0.3 m"
    for ask in (
        lambda: rvads.vmax(0.3, simulator=Wrong()),
        lambda: closed_vmax(0.3, rvads.Reference, simulator=Wrong()),
        lambda: look_for("stop4", rvads.Reference, "p1", budget=20, near=0.3, far=0.5, simulator=Wrong()),
    ):
        with pytest.raises(rvads.errors.RunError, match=says):
            ask()


@pytest.mark.extended
def test_simulator_option_selects_simulator_and_vmax(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own=OWN)
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, distances=20.0, speeds=[0.5, 5.0], rules="p1")
        def test_it(run, rule, monitor):
            monitor.check(rule)

        def test_it_counted(rvads_simulator):
            assert (rvads_simulator.name, rvads_simulator.simulator.runs) == ("counting", 1), "5 m/s is beyond its envelope"
    """)
    options = ("--rvads-autopilot=reference", "-p", "no:cacheprovider")
    result = pytester.runpytest(*options, "--rvads-simulator=own:counting")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["rvads: simulated by --rvads-simulator=own:counting (own.py *)"])
    result = pytester.runpytest(*options, "--rvads-simulator=own:nothing")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*simulator 'own:nothing' can't be loaded*"])


@pytest.mark.extended
def test_probe_line_uses_the_vmax_of_the_simulator_of_the_run(pytester: pytest.Pytester) -> None:
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
    pytester.makepyfile(own=OWN.replace("return usual()(case, watch)", "return None"))
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="C", rules="p1")
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    result = pytester.runpytest("--rvads-autopilot=reference", "--rvads-simulator=own:counting", "-p", "no:cacheprovider")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*the simulator 'counting' must answer a case with its Run, got None"])


@pytest.mark.parametrize(
    ("answer", "wrong"),
    [
        (lambda case: 3, "3"),
        (lambda case: usual()(case.but(directions="1100")), "another agents: .*'a1 from 1 to 2'.* expected .*'a1 from 1 to 3'"),
        (lambda case: usual()(case.but(place=rvads.find("paper_stop4"))), "another junction: .* expected"),
        (lambda case: usual()(case.but(subject=1)), "another subject: a1, expected a0"),
        (
            lambda case: usual()(case.but(distance=9.0)),
            "another label: stop4-.*-cfgd09.00v00.00, expected stop4-.*-cfgd08.00v00.00",
        ),
    ],
)
def test_run_of_another_case_is_refused(answer: Any, wrong: str) -> None:
    class Wrong(Counting):
        def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
            found: rvads.Run = answer(case)
            return found

    asked, wrong = case("stop4", "2200", duration=0.1), f"simulator 'counting' must answer a case with its Run, got.*{wrong}"
    for ask in (
        lambda: rvads.simulate(asked, Wrong()),
        lambda: rvads.equivalent(asked, simulator=Wrong()),
        lambda: rvads.rational(asked, simulator=Wrong()),
        lambda: rvads.determinate(asked, simulator=Wrong()),
    ):
        with pytest.raises(rvads.errors.RunError, match=wrong):
            ask()


def part(run: rvads.Run, states: Any) -> rvads.Run:
    """Some of the states of a run, as if they were all."""
    arrays = {name: getattr(run, name)[states] for name in ("zone", "lights", "station", "speed", "pose", "controls")}
    return replace(run, **arrays)


def over_the_entrance(run: rvads.Run) -> rvads.Run:
    return replace(run, zone=np.where(run.zone == rvads.Zone.ENTRANCE, np.int8(rvads.Zone.APPROACH), run.zone))


def standing_until_26_s(run: rvads.Run) -> rvads.Run:
    longer = part(run, np.minimum(np.arange(2601), run.steps - 1))
    return replace(longer, speed=np.where(np.arange(2601)[:, None] < run.steps, longer.need("speed"), 0.0))


def backwards_for_a_second(run: rvads.Run) -> rvads.Run:
    speed = run.need("speed").copy()
    speed[100:200] *= -1.0
    return replace(run, speed=speed)


IMPOSSIBLE: dict[str, tuple[Callable[[rvads.Run], rvads.Run], str]] = {
    "cut": (lambda run: part(run, slice(301)), "it ends at 3.00 s without a reason: a0 and a1 had not left yet"),
    "too long": (standing_until_26_s, "it goes on for 100 states after the scenario's 25 s"),
    "zone skipped": (over_the_entrance, "a0 jumps on the graph at .* s: from approach to junction in one step"),
    "double step": (lambda run: replace(part(run, slice(0, None, 2)), dt=0.02), "its states are 0.02 s apart, expected 0.01 s"),
    "every other state": (lambda run: part(run, slice(0, None, 2)), "a0 moves ahead at .* m/s at .* s, its speed is given as"),
    "negative speeds": (lambda run: replace(run, speed=-run.speed), "a0 moves ahead at .* its speed is given as -"),
    "some negative speeds": (backwards_for_a_second, "a0 moves ahead at .* its speed is given as -"),
    "km/h": (lambda run: replace(run, speed=3.6 * run.speed), "a0 moves ahead at .* its speed is given as"),
    "strangers collide": (
        lambda run: replace(run, collisions=(Collision(1.0, ("a0", "b7"), 3.0),)),
        "the collisions name 'b7', which is none of the vehicles a0, a1",
    ),
    "NaN": (lambda run: replace(run, station=run.station * np.nan), "station of a0 at 0.00 s is not a finite number"),
}


@pytest.mark.parametrize(("change", "wrong"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_a_run_that_cannot_be_is_refused(change: Callable[[rvads.Run], rvads.Run], wrong: str) -> None:
    class Wrong(Counting):
        def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
            return change(usual()(case, watch))

    with pytest.raises(rvads.errors.RunError, match=rf"^the simulator 'counting' gives a run that can't be, stop4-.*: {wrong}"):
        rvads.simulate(case("stop4", "2200"), Wrong())


def test_a_cut_run_with_a_reason_is_judged() -> None:
    class Failing(Counting):
        def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
            return replace(part(usual()(case, watch), slice(301)), fault=rvads.values.Fault(3.0, "a0", "the plant failed"))

    assert rvads.simulate(case("stop4", "2200"), Failing()).duration == 3.0


def test_a_run_that_is_cut_without_a_reason_is_an_error_of_its_items(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        own=OWN.replace("return usual()(case, watch)", "return replace(usual()(case.but(duration=3.0)), label=LABEL)")
    )
    own = pytester.path / "own.py"
    label = "stop4-class01-as1111-cfgC"
    own.write_text(f"from dataclasses import replace\nLABEL = {label!r}\n{own.read_text(encoding='utf-8')}", encoding="utf-8")
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="C", rules=("p1", "full_stop"))
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    result = pytester.runpytest("--rvads-autopilot=reference", "--rvads-simulator=own:counting", "-p", "no:cacheprovider")
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines(["*it ends at 3.00 s without a reason: a0 and a1 and a2 and a3 had not left yet*"])


@pytest.mark.extended
def test_simulator_of_the_session_is_the_value_of_its_fixture(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own=OWN)
    pytester.makepyfile("""
        import pytest
        import pytest_rvads as rvads
        from hypothesis import find
        from own import counting
        from pytest_rvads.search.falsify import look_for
        from pytest_rvads.simulators.driver_dynamics import closed_vmax

        CASE = rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000", distance=1.0, duration=8.0), rvads.Reference)

        @pytest.mark.parametrize("ask", [
            lambda own: rvads.simulate(CASE, own),
            lambda own: rvads.equivalent(CASE, "full_stop", simulator=own),
            lambda own: rvads.rational(CASE, "full_stop", farther=(1.0,), simulator=own),
            lambda own: rvads.determinate(CASE, "full_stop", at=0.5, simulator=own),
            lambda own: look_for("stop4", rvads.Reference, "full_stop", budget=1, simulator=own),
            lambda own: closed_vmax(0.3, rvads.Reference, simulator=own),
        ])
        def test_it(ask, rvads_simulator):
            before = counting.runs
            ask(rvads_simulator)
            assert counting.runs > before

        def test_its_vehicles_brake_as_it_says(rvads_simulator):
            assert rvads.vmax(20.0, simulator=rvads_simulator) == 1.0
            starts = rvads.strategies.scenarios(simulator=rvads_simulator)
            assert max(find(starts, lambda scenario: any(scenario.speeds)).speeds) <= 1.0

        def test_who_names_no_simulator_gets_the_usual_one():
            before = counting.runs
            assert rvads.simulate(CASE).provenance["simulator"] != "counting"
            assert counting.runs == before
    """)
    pytester.runpytest("--rvads-simulator=own:counting", "-p", "no:cacheprovider").assert_outcomes(passed=8)
    assert Choice.of().simulator is usual()


def test_a_test_has_the_simulator_of_its_own_file_in_any_scope_and_every_result_says_which(pytester: pytest.Pytester) -> None:
    test = """
        import pytest
        import pytest_rvads as rvads
        from own import Counting

        class Mine(Counting):
            name = "mine"

        SCENARIO = rvads.scenario("stop4", scenarios="2000", distances=1.0, rules=["full_stop", "on_route"])

        @SCENARIO
        def test_it(rule, monitor):
            monitor.check(rule)
    """
    pytester.makepyfile(own=OWN)
    pytester.makepyfile(test_a_default=test)
    for scope in ("function", "module", "session"):
        fixture = f"""
        @pytest.fixture(scope={scope!r})
        def rvads_simulator():
            return Mine()

        def test_simulated_once():
            assert Mine.runs == 1
        """
        pytester.makepyfile(**{f"test_{scope}": test + fixture})
    files = ("out.json", "out.html", "out.md", "out.csv")
    result = pytester.runpytest(
        *("--rvads-autopilot=reference", "-p", "no:cacheprovider", "--junitxml=out.xml"),
        *(f"--rvads-report={name}" for name in files),
    )
    result.assert_outcomes(passed=11)
    result.stdout.fnmatch_lines([f"simulated by {usual().name} (*): 1 run", "simulated by mine: 1 run"])
    text = {name: (pytester.path / name).read_text(encoding="utf-8") for name in files}
    made = {record["nodeid"].partition("::")[0]: record["simulator"] for record in json.loads(text["out.json"])["records"]}
    assert made == {
        "test_a_default.py": usual().name,
        **dict.fromkeys(("test_function.py", "test_module.py", "test_session.py"), "mine"),
    }
    assert "simulated by mine: 1 run" in text["out.md"]
    assert "<dt>simulated by</dt><dd>mine: 1 run</dd>" in text["out.html"]
    assert {row["simulator"] for row in csv.DictReader(text["out.csv"].splitlines())} == {usual().name, "mine"}
    properties = [(p.get("name"), p.get("value")) for p in ET.parse(pytester.path / "out.xml").iter("property")]
    assert properties.count(("simulator", "mine")) == 6
