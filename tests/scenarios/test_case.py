"""Cases: everything that a run depends on, as one value; and the fleet."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.traffic import POLICIES, RollingStop
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import AutopilotError, ScenarioError

TRUCK = Vehicle(
    length=12.0,
    width=2.5,
    mass=16_000.0,
    front_axle=3.0,
    rear_axle=3.0,
    yaw_inertia=150e3,
    height=3.5,
    drive=1.5,
    kind=rvads.Kind.TRUCK,
)


def test_equal_cases_are_equal_and_hash_alike() -> None:
    one, other = (Case(Scenario(find("stop4"), "1133"), Reference) for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)
    assert one != one.but(distance=5.0)
    assert one != Case(one.scenario, Reference, fleet=Fleet(TRUCK))


def test_a_scenario_that_was_sent_to_another_process_is_the_same() -> None:
    scenario = Scenario(find("light4"), "1203", subject=1)
    sent = pickle.loads(pickle.dumps(scenario))
    assert sent == scenario
    assert sent.place is not scenario.place
    case = Case(scenario, Reference, POLICIES["hesitant"])
    assert simulate(case).hash == simulate(replace(case, scenario=sent)).hash


def test_traffic_around_a_subject_is_the_reference_where_none_is_named() -> None:
    scenario = Scenario(find("stop4"), "1133", subject=0)
    assert Case(scenario, RollingStop) == Case(scenario, RollingStop, POLICIES["reference"])
    assert Case(scenario.but(subject=None), RollingStop).traffic is None


def test_traffic_needs_a_subject() -> None:
    with pytest.raises(ScenarioError, match="give the scenario a subject"):
        Case(Scenario(find("stop4"), "1133"), Reference, RollingStop)
    with pytest.raises(AutopilotError, match="pass the class, not an instance"):
        Case(Scenario(find("stop4"), "1133"), Reference())  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match=r"needs a junction, such as rvads.find\('stop4'\), got 'stop4'"):
        Scenario("stop4", "1133")  # type: ignore[arg-type]


def test_vehicles_have_the_bodies_of_the_fleet(tmp_path: Path) -> None:
    case = Case(Scenario(find("stop4"), "2020", distance=15.0), Reference, fleet=Fleet(others={"a2": TRUCK}))
    run = simulate(case)
    assert [(agent.kind, agent.size) for agent in run.agents] == [("car", (4.6, 1.86)), ("truck", (12.0, 2.5))]
    assert list(run.provenance["others"]) == ["a2"]
    speed = run.need("speed")
    assert speed[150, 0] > 1.5 * speed[150, 1], "the truck accelerates half as hard"
    save_run(run, tmp_path / "run.npz")
    assert load_run(tmp_path / "run.npz").agents == run.agents
    with pytest.raises(ScenarioError, match="start inside each other"):
        simulate(replace(case, scenario=Scenario(find("stop4"), "1111", distance=0.3), fleet=Fleet(Vehicle(width=36.0))))


def scenario(directions: str = "1133") -> Scenario:
    return Scenario(find("stop4"), directions)


MISTAKES: dict[str, tuple[Callable[[Any], object], str]] = {
    "the old way to simulate": (
        lambda rvads: rvads.simulate(scenario(), Reference),
        r"write simulate\(rvads.Case\(scenario, driver",
    ),
    "a case of a name": (lambda rvads: rvads.Case("stop4", Reference), "begins with a rvads.Scenario"),
    "a case without a driver": (lambda rvads: rvads.Case(scenario(), None), "a callable that makes one, got None"),
    "a vehicle for a fleet": (lambda rvads: rvads.Case(scenario(), Reference, fleet=TRUCK), r"must be a rvads.Fleet\(vehicle\)"),
    "a number for a vehicle": (lambda rvads: rvads.Fleet(3), "as the fixture rvads_vehicle, needs a rvads.Vehicle.*got 3"),
    "one for another vehicle": (lambda rvads: rvads.Fleet(others={"a0": 3}), "needs a rvads.Vehicle.*got 3"),
    "a kind that is none": (
        lambda rvads: rvads.Vehicle(kind="truck"),
        "vehicle parameter kind must be a rvads.Kind, .*got 'truck'",
    ),
    "no mapping of vehicles": (lambda rvads: rvads.Fleet(others=TRUCK), "vehicles by the name of the agent"),
    "a body for nobody": (
        lambda rvads: rvads.Case(scenario("1030"), Reference, fleet=Fleet(others={"a1": TRUCK})),
        "a body for 'a1', the agents of .* are a0, a2",
    ),
    "equivalent": (lambda rvads: rvads.equivalent(scenario()), r"equivalent takes a rvads.Case\(scenario, driver\), got Scen"),
    "rational": (lambda rvads: rvads.rational(scenario()), "rational takes a rvads.Case"),
    "determinate": (lambda rvads: rvads.determinate(scenario()), "determinate takes a rvads.Case"),
    "check": (lambda rvads: rvads.check(scenario(), "p1"), "check takes a run, such as"),
    "validate": (lambda rvads: rvads.validate(scenario()), "validate takes a run"),
    "kpis": (lambda rvads: rvads.kpis(scenario()), "kpis takes a run"),
    "save": (lambda rvads: rvads.files.save_run(3, "run.npz"), "save_run takes a run"),
    "v(d)max of a text": (lambda rvads: rvads.vmax("x"), "a distance to the stopping line in metres, got 'x'"),
    "v(d)max of no vehicle": (lambda rvads: rvads.vmax(5.0, vehicle=3), "takes a rvads.Vehicle, got 3"),
    "find a number": (lambda rvads: rvads.find(3), "such as 'stop4', got 3"),
    "find nothing": (lambda rvads: rvads.find(None), "got None"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_arguments_of_wrong_type_are_refused(mistake: str) -> None:
    wrong, says = MISTAKES[mistake]
    with pytest.raises(rvads.errors.RvadsError, match=says):
        wrong(rvads)


def test_rule_argument_must_be_a_rule() -> None:
    run = simulate(Case(Scenario(find("stop4"), "1000", duration=0.1), Reference))
    with pytest.raises(rvads.errors.FormulaError, match="a rule is a Rule or the name of one, such as 'p1', got 3"):
        rvads.check(run, 3)  # type: ignore[arg-type]
