"""The simulation loop: what a run holds, how it ends, and that it is the same every time."""

import json
import math
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.engines import usual
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Colour, Vehicle, Zone
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError, ScenarioError

from .conftest import Cruiser, Stander


def test_a_run_holds_states_of_all_agents(cruiser: type[Cruiser]) -> None:
    scenario = Scenario(find("stop4"), "1030", distance=[20, 0, 30, 0], speed=[5, 0, 6, 0])
    run = simulate(Case(scenario, cruiser))
    assert [a.name for a in run.agents] == ["a0", "a2"]
    assert run.label == scenario.name
    assert run.zone.shape == run.station.shape == run.speed.shape == (run.steps, 2)
    assert run.pose.shape == run.controls.shape == (run.steps, 2, 3)
    assert run.lights.shape == (run.steps, 4)
    assert run.station[0] == pytest.approx([-20.0, -30.0])
    assert run.speed[0] == pytest.approx([5.0, 6.0])
    assert not run.lights.any()


def test_zones_follow_the_station_and_none_is_skipped(cruiser: type[Cruiser]) -> None:
    run = simulate(Case(Scenario(find("stop4"), "1230", distance=(20, 45, 70, 20), speed=6), cruiser))
    itineraries = Scenario(find("stop4"), "1230").itineraries()
    for column, itinerary in enumerate(itineraries):
        zones = run.zone[:, column]
        assert [itinerary.zone(s) for s in run.station[:, column]] == list(zones)
        assert set(np.diff(zones)) <= {0, 1}
        assert zones[-1] >= Zone.EXIT


def test_poses_are_those_of_the_front_bumper(cruiser: type[Cruiser]) -> None:
    run = simulate(Case(Scenario(find("stop4"), "0200", distance=20, speed=6), cruiser))
    (itinerary,) = Scenario(find("stop4"), "0200").itineraries()
    for k in range(0, run.steps, 50):
        x, y, _ = itinerary.pose(float(run.station[k, 0]))
        # Straight on, the bumper is on the centre line.
        assert (x, y) == pytest.approx(tuple(run.pose[k, 0, :2]), abs=0.01)


def test_the_last_state_repeats_the_controls_before_it() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2200", distance=(20, 10, 0, 0), speed=8, duration=3), Reference))
    assert (run.controls[-1] == run.controls[-2]).all()
    assert (run.controls[-1] != run.controls[0]).any()
    assert (run.controls[-1, 0] != run.controls[-1, 1]).any()


def test_speed_is_the_change_of_place(cruiser: type[Cruiser]) -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=6), cruiser))
    assert np.diff(run.station[:, 0]) == pytest.approx(run.speed[1:, 0] * DT, abs=1e-9)


def test_the_run_ends_when_everybody_has_left(cruiser: type[Cruiser]) -> None:
    scenario = Scenario(find("stop4"), "2010", distance=[20, 20, 60, 20], speed=6)
    run = simulate(Case(scenario, cruiser))
    leave = [i.leave for i in scenario.itineraries()]
    assert run.provenance["end"] == "left"
    assert (run.station[-1] >= leave).all()
    assert not (run.station[-2] >= leave).all()


def test_the_run_ends_at_its_duration(stander: type[Stander]) -> None:
    run = simulate(Case(Scenario(find("stop4"), "1111", duration=0.5), stander))
    assert run.provenance["end"] == "duration"
    assert run.steps == 51
    assert run.duration == pytest.approx(0.5)


def test_departed_vehicle_leaves_the_world_and_observations() -> None:
    seen_by: dict[str, list[list[str]]] = {}

    class Witness(Cruiser):
        def target_speed(self, seen: Observation) -> float:
            seen_by.setdefault(seen.me.name, []).append([o.name for o in seen.others])
            return 14.0 if seen.me.entrance == 0 else 1.0

    run = simulate(Case(Scenario(find("stop4"), "2200", distance=5, speed=1, duration=20), Witness))
    assert run.zone[-1, 0] == Zone.GONE
    gone = int(np.flatnonzero(run.zone[:, 0] == Zone.GONE)[0])
    assert seen_by["a1"][gone - 1] == ["a0"]
    assert seen_by["a1"][gone] == []
    assert len(seen_by["a0"]) == gone
    assert (run.station[gone:, 0] == run.station[gone, 0]).all()


def test_everybody_decides_on_the_same_state() -> None:
    states = []

    class Recorder:
        def control(self, seen: Observation) -> Control:
            states.append((seen.time, {s.name: s for s in (seen.me, *seen.others)}))
            return Control(0.3)

    simulate(Case(Scenario(find("stop4"), "1111", duration=0.2), Recorder))
    for k in range(0, len(states), 4):
        assert states[k] == states[k + 1] == states[k + 2] == states[k + 3]
    assert [t for t, _ in states[::4]] == pytest.approx([k * DT for k in range(20)])


def test_others_come_in_creation_order() -> None:
    order = []

    class Named(Stander):
        def control(self, seen: Observation) -> Control:
            order.append((seen.me.name, [o.name for o in seen.others]))
            return Control(brake=1.0)

    simulate(Case(Scenario(find("stop4"), "1231", rotation=2, duration=DT), Named))
    assert order == [
        ("a2", ["a3", "a0", "a1"]),
        ("a3", ["a2", "a0", "a1"]),
        ("a0", ["a2", "a3", "a1"]),
        ("a1", ["a2", "a3", "a0"]),
    ]


def test_observations_tell_what_the_scenario_fixes() -> None:
    views = []

    class Curious(Stander):
        def control(self, seen: Observation) -> Control:
            views.append(seen)
            return Control(brake=1.0)

    vehicle = Vehicle(mass=1200.0)
    simulate(Case(Scenario(find("light4"), "1000", aggression=3, wait=2.5, duration=DT), Curious, fleet=Fleet(vehicle)))
    (view,) = views
    assert (view.aggression, view.wait, view.vehicle, view.junction) == (3, 2.5, vehicle, find("light4"))
    assert view.lights == (Colour.GREEN, Colour.RED, Colour.GREEN, Colour.RED)
    assert (view.itinerary.entrance, view.itinerary.exit) == (0, 1)
    assert (view.me.length, view.me.width) == (4.6, 1.86)


def test_lights_change_on_their_tick_and_swap_for_odd_rotations(stander: type[Stander]) -> None:
    run = simulate(Case(Scenario(find("light4"), "1111", duration=20.5), stander))
    turned = simulate(Case(Scenario(find("light4"), "1111", rotation=1, duration=1), stander))
    changes = {int(k) + 1: list(run.lights[k + 1]) for k in np.flatnonzero(np.diff(run.lights, axis=0).any(axis=1))}
    green, yellow, red = Colour.GREEN, Colour.YELLOW, Colour.RED
    assert changes == {1500: [yellow, red] * 2, 1800: [red, red] * 2, 2000: [red, green] * 2}
    assert list(turned.lights[0]) == [red, green] * 2


@pytest.mark.parametrize("aggression", [1, 2, 3])
def test_aggression_selects_the_brake(stander: type[Stander], aggression: int) -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", distance=60, speed=10, aggression=aggression, duration=1), stander))
    slowest = -np.diff(run.speed[:, 0]).min() / DT
    assert slowest == pytest.approx(Vehicle().brake[aggression - 1] + 0.12, abs=0.05)


def test_a_standing_vehicle_stands_exactly(stander: type[Stander]) -> None:
    run = simulate(Case(Scenario(find("stop4"), "1231", distance=0.01), stander))
    assert run.duration == 60.0
    assert (run.station == run.station[0]).all()
    assert (run.pose == run.pose[0]).all()
    assert not run.collisions


def test_collisions_come_with_time_pair_and_speed() -> None:
    class Blind(Cruiser):
        def target_speed(self, seen: Observation) -> float:
            return 8.0

    run = simulate(Case(Scenario(find("stop4"), "2222", distance=20, speed=8, duration=8), Blind))
    first = run.collisions[0]
    assert len({c.agents for c in run.collisions}) == len(run.collisions)
    k = round(first.time / DT)
    one, two = (next(i for i, a in enumerate(run.agents) if a.name == name) for name in first.agents)
    # They cross at right angles.
    assert first.speed == pytest.approx(math.hypot(run.speed[k, one], run.speed[k, two]), rel=0.02)
    assert np.hypot(*(run.pose[k, one, :2] - run.pose[k, two, :2])) < 4.6 + 1.86


def test_an_impact_ends_the_run() -> None:
    class Fast(Cruiser):
        def target_speed(self, seen: Observation) -> float:
            return 11.0

        def towards(self, seen: Observation, target: float) -> float:
            return 3.0

    run = simulate(Case(Scenario(find("stop4"), "2222", distance=[60, 60.5, 61, 61.5], speed=11, duration=20), Fast))
    assert (run.fault, run.provenance["end"], run.facts.strayed) == (None, "collision", ())
    assert [c.time for c in run.collisions] == pytest.approx([run.duration - DT] * len(run.collisions)), (
        "what follows is no driving"
    )


def test_vehicles_that_start_inside_each_other_are_refused(stander: type[Stander]) -> None:
    # At the vertices neighbours are 16.6 m apart in either direction.
    with pytest.raises(ScenarioError, match="a0 and a1 start inside each other in stop4-class00-as1100"):
        simulate(Case(Scenario(find("stop4"), "1100", distance=0), stander, fleet=Fleet(Vehicle(width=36.0))))
    assert (
        simulate(Case(Scenario(find("stop4"), "1100", distance=0, duration=DT), stander, fleet=Fleet(Vehicle(width=12.0)))).fault
        is None
    )


def test_a_world_that_fails_before_the_first_step_is_closed(stander: type[Stander]) -> None:
    closed = []

    class Failing:
        def __init__(self, _vehicles: Sequence[Vehicle], _starts: Sequence[Motion]) -> None: ...
        def motions(self) -> list[Motion]:
            raise RunError("the connection is lost")

        def step(self, forces: Sequence[float]) -> None: ...
        def contacts(self) -> list[tuple[int, int]]:
            return []

        def remove(self, body: int) -> None: ...
        def close(self) -> None:
            closed.append(self)

    with pytest.raises(RunError, match="the connection is lost"):
        Loop(Case(Scenario(find("stop4"), "1100"), stander), "failing", Failing, {})
    assert len(closed) == 1


def test_a_start_beyond_the_approach_is_refused(stander: type[Stander]) -> None:
    with pytest.raises(ScenarioError, match=r"distance 130 m does not fit on entrance 0 .* its approach is 120\.0 m long"):
        simulate(Case(Scenario(find("stop4"), "1111", distance=130), stander))


def test_meta_is_made_of_builtins(stander: type[Stander]) -> None:
    scenario = Scenario(find("stop4"), "1111", duration=DT)
    meta = simulate(Case(scenario, stander)).provenance
    assert set(json.loads(json.dumps(dict(meta)))) == set(meta)
    assert meta["scenario"] == scenario.record()
    assert meta["autopilot"].endswith("Stander")
    assert set(meta["versions"]) == {"pytest-rvads", usual().library, "numpy", "python"}


SCENARIOS = [
    Scenario(find("stop4"), "1133", distance=20, speed=10, duration=12),
    Scenario(find("stop4"), "3333", distance=0.3, duration=12),
    Scenario(find("light4"), "3232", distance=20, duration=12, rotation=1),
]
"""Some runs; also made by the process below."""

CODE = """
from pytest_rvads import Case, Reference, Scenario, find, simulate
for scenario in reversed([
    Scenario(find("stop4"), "1133", distance=20, speed=10, duration=12),
    Scenario(find("stop4"), "3333", distance=0.3, duration=12),
    Scenario(find("light4"), "3232", distance=20, duration=12, rotation=1),
]):
    print(simulate(Case(scenario, Reference)).hash)
"""


@pytest.mark.extended
def test_runs_are_bit_identical_in_any_order_and_any_process(cruiser: type[Cruiser]) -> None:
    first = [simulate(Case(s, Reference)).hash for s in SCENARIOS]
    simulate(Case(Scenario(find("stop3"), "121", distance=5, duration=3), cruiser))
    again = [simulate(Case(s, Reference)).hash for s in reversed(SCENARIOS)][::-1]
    other = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True).stdout.split()[::-1]
    assert first == again == other
    assert len(set(first)) == 3


def test_a_run_within_a_run_changes_neither(cruiser: type[Cruiser]) -> None:
    inner = Scenario(find("stop4"), "1000", distance=5, speed=3, duration=1)
    hashes = []

    class Planner(Cruiser):
        def target_speed(self, seen: Observation) -> float:
            if round(seen.time / DT) == 50:
                hashes.append(simulate(Case(inner, cruiser)).hash)
            return 6.0

    outer = Scenario(find("stop4"), "2000", distance=20, speed=6, duration=2)
    planned = simulate(Case(outer, Planner))
    assert planned.hash == simulate(Case(outer, cruiser)).hash
    assert hashes == [simulate(Case(inner, cruiser)).hash]


@pytest.mark.extended
def test_memory_stays_flat(stander: type[Stander]) -> None:
    resource = pytest.importorskip("resource")
    scenario = Scenario(find("stop4"), "1231", duration=0.05)
    for _ in range(300):
        simulate(Case(scenario, stander))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(700):
        simulate(Case(scenario, stander))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2048, "kilobytes over 700 runs"
