"""Traffic policies: each provokes what it is named for, a replay repeats a run, and `RollingStop` has its faults and no other."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.naming import chosen
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.traffic import HESITATION, Policy, Replay, RollingStop, traffic
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.standing import stopped
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.runfile import save_run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration, started
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError, ScenarioError

from ..policies import EVERYWHERE

Among = Callable[[str, str], Run]


class Parked(Follower):
    """Stands at its place far from the junction, so that nothing but the traffic happens."""

    def target_speed(self, seen: Observation) -> float:
        return 0.0


@pytest.mark.parametrize(("name", "kept"), [("reference", "PASS"), ("pytest_rvads:Reference", "FAIL")])
def test_reference_by_option_takes_close_arrivals_for_simultaneous(tmp_path: Path, name: str, kept: str) -> None:
    """The vehicle on the right of the subject arrives 0.01 s later: by `right_first` it goes first, by p3 the subject does."""
    place = find("stop3")
    case = Scenario(place, "112", subject=2, **started(configuration("C", 3), place, 0, 2, 0))
    assert check(simulate(Case(case, chosen(name, tmp_path), traffic=traffic("hesitant"))), "right_first").status == kept


@pytest.fixture(scope="module")
def among() -> Among:
    """Simulate one vehicle of a policy, alone in the junction but for a parked subject at entrance 0."""
    found: dict[tuple[str, str], Run] = {}

    def get(policy: str, junction: str) -> Run:
        key = policy, junction
        if key not in found:
            scenario = Scenario(find(junction), "2200", distance=(40, 25, 0, 0), speed=(0, 8, 0, 0), subject=0, duration=40)
            found[key] = simulate(Case(scenario, Parked, traffic=traffic(policy)))
            assert found[key].fault is None
        return found[key]

    return get


def colour_at_entry(run: Run) -> Colour:
    entry = run.entry(1)
    assert entry is not None
    return Colour(int(run.lights[round(entry / DT), 1]))


def braking(run: Run) -> float:
    """Hardest braking before the junction [m/s^2]."""
    before = run.zone[:-1, 1] <= Zone.ENTRANCE
    return float(-np.where(before, np.diff(run.speed[:, 1]), 0.0).min() / DT)


@pytest.mark.parametrize("junction", ["stop4", "light4"])
def test_hesitant_policy_waits_longer_than_the_reference(among: Among, junction: str) -> None:
    reference, hesitant = among("reference", junction), among("hesitant", junction)
    assert hesitant.entry(1) >= reference.entry(1) + HESITATION
    assert hesitant.speed[:, 1].max() < 8.1, "it drives slowly"


def test_the_hesitant_one_waits_for_two_seconds_before_its_right_ends() -> None:
    """Alone at a green light, it could go from the first state on: after 3 s others need not wait for it any more."""
    scenario = Scenario(find("light4"), "2000", distance=0.3, subject=0, duration=5)
    entry = simulate(Case(scenario, traffic("hesitant"), traffic=traffic("stopped"))).entry(0)
    assert entry is not None
    assert 2.0 < entry < 3.0


def test_the_rolling_stop_does_not_stop(among: Among) -> None:
    assert not stopped(among("rolling_stop", "stop4"), 1).any()
    assert stopped(among("reference", "stop4"), 1).any()


@pytest.mark.parametrize("junction", ["stop4", "light4"])
def test_the_late_yielder_brakes_late_and_yields(among: Among, junction: str) -> None:
    late, reference = among("late_yielder", junction), among("reference", junction)
    assert braking(late) > 3.4 > braking(reference), "people brake for a stop sign with up to 3.4 m/s^2"
    assert stopped(late, 1).any()
    assert colour_at_entry(late) in (Colour.NONE, Colour.GREEN)


def test_the_red_light_runner_runs_the_red_light_and_the_stop_sign(among: Among) -> None:
    assert colour_at_entry(among("red_light_runner", "light4")) is Colour.RED
    assert colour_at_entry(among("reference", "light4")) is Colour.GREEN
    assert not stopped(among("red_light_runner", "stop4"), 1).any()


@pytest.mark.parametrize("junction", ["stop4", "light4"])
def test_the_stopped_one_stops_at_the_line_for_good(among: Among, junction: str) -> None:
    run = among("stopped", junction)
    assert run.entry(1) is None
    assert run.zone[-1, 1] == Zone.ENTRANCE
    assert run.speed[-1, 1] == 0.0


@pytest.mark.parametrize(("policy", "rule"), [("rolling_stop", "full_stop"), ("red_light_runner", "full_stop")])
def test_what_traffic_does_is_provoked_not_failed(among: Among, policy: str, rule: str) -> None:
    verdict = check(among(policy, "stop4"), rule)
    assert (verdict.status, verdict.provoked, verdict.responsible) == ("FAIL", True, ("a1",))


@pytest.mark.parametrize("policy", EVERYWHERE)
def test_reference_among_traffic_is_not_to_blame(policy: str) -> None:
    """Two vehicles whose ways cross: the road rules can always be met."""
    for junction, code in (("stop4", "2200"), ("light4", "3020")):
        scenario = Scenario(find(junction), code, distance=20, speed=8, subject=0, duration=40)
        run = simulate(Case(scenario, Reference, traffic=traffic(policy)))
        assert run.fault is None
        for rule in ("full_stop", "first_come", "red", "left_yields", "no_collision", "no_conflict", "keep_clear"):
            verdict = check(run, rule)
            assert verdict.provoked or verdict.status in ("PASS", "NA"), verdict.message


def test_a_replay_repeats_the_run_bit_by_bit(tmp_path: Path) -> None:
    start: dict[str, Any] = {"distance": 15, "speed": 6, "duration": 12}
    run = simulate(Case(Scenario(find("stop4"), "1133", **start), Reference))
    again = simulate(Case(Scenario(find("stop4"), "1133", subject=2, **start), Reference, traffic=Replay(run)))
    assert np.array_equal(again.station, run.station)
    save_run(run, tmp_path / "run.npz")
    kept = simulate(Case(Scenario(find("stop4"), "1133", subject=2, **start), Reference, traffic=Replay(tmp_path / "run.npz")))
    assert kept.hash == again.hash


def test_a_replay_started_elsewhere_catches_up() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2200", distance=(30, 20, 0, 0), duration=14), Reference))
    scenario = Scenario(find("stop4"), "2200", distance=(30, 21, 0, 0), duration=14, subject=0)
    again = simulate(Case(scenario, Parked, traffic=Replay(run)))
    off = np.abs(again.station[:, 1] - run.station[: again.steps, 1])
    assert off[0] == pytest.approx(1.0)
    standing = np.flatnonzero((run.zone[:, 1] == Zone.ENTRANCE) & (run.speed[:, 1] == 0.0))
    assert off[standing].max() < 0.2


def test_a_replay_needs_positions_and_the_same_movements() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2200", duration=0.1), Parked))
    other = simulate(Case(Scenario(find("stop4"), "1100", duration=0.1, subject=0), Parked, traffic=Replay(run)))
    assert "has no vehicle from entrance 1 to exit 2 that a1 could replay" in other.fault.reason
    bare = Run("bare", run.junction, run.agents, run.zone, run.lights)
    with pytest.raises(RunError, match="'bare' holds no positions"):
        Replay(bare)


def test_policies_have_names() -> None:
    assert Policy.of("hesitant").name == "hesitant"
    assert Policy.of(Parked).name == "Parked"
    assert Policy.of(lambda: Parked()).name == "lambda"
    assert Policy.of(Replay(simulate(Case(Scenario(find("stop4"), "2000", duration=0.02), Parked)))).name == "replay"
    with pytest.raises(ScenarioError, match=r"unknown traffic 'hesitent', there are reference, .*did you mean 'hesitant'"):
        traffic("hesitent")
    with pytest.raises(ScenarioError, match="traffic takes names of policies or classes of autopilots, got 3"):
        Policy.of(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("code", ["1122", "2222", "2233"])
def test_reference_lets_a_runner_leave_the_junction_first(code: str) -> None:
    """A conflicting vehicle that is in the junction on red keeps the reference out of it, wherever it is."""
    for seat in (0, 2):
        run = simulate(Case(Scenario(find("light4"), code, subject=seat), Reference, traffic=traffic("red_light_runner")))
        for rule in ("no_conflict", "no_collision", "red"):
            verdict = check(run, rule)
            assert verdict.provoked or verdict.status in ("PASS", "NA"), f"{run.label}: {verdict.message}"


def test_green_is_not_held_for_a_standing_vehicle_let_in_on_red() -> None:
    """A right turn on red waits for who comes from the left; one that does not use its green is not waited for for ever."""
    run = simulate(Case(Scenario(find("light4"), "2100", subject=1), Reference, traffic=traffic("stopped")))
    assert run.agents[1].turn == "right"
    entry = run.entry(1)
    assert entry is not None
    assert 20.0 <= entry < 26.0, "its light is green from 20 s on"
    verdict = check(run, "p5")
    assert (verdict.status, verdict.provoked) == ("FAIL", True), "the other one could have gone for five seconds"


def test_rear_end_collision_at_a_yield_line_is_the_fault_of_the_follower() -> None:
    """At a yield sign, with nobody due yet: the paper's stack follows too closely."""
    start = Scenario(find("yield4"), "2333", distance=(20, 75, 42, 42), speed=8, subject=0, followers=1)
    run = simulate(Case(start, Reference, traffic=traffic("lgsvl")))
    assert [hit.agents for hit in run.collisions] == [("a0", "a0+1")]
    assert check(run, "no_collision").responsible == ("a0+1",)


@pytest.mark.extended
def test_a_subject_that_vehicles_stuck_in_the_junction_keep_at_its_line_does_not_hold_up_the_order() -> None:
    start = Scenario(find("stop4"), "2332", distance=(46, 56, 21, 36), speed=8, subject=3, followers=2, duration=30)
    run = simulate(Case(start, traffic("reference"), traffic=traffic("red_light_runner")))
    assert run.entry(list(run.agents).index(next(a for a in run.agents if a.name == "a3"))) is None
    verdict = check(run, "first_come")
    assert verdict.provoked or verdict.status in ("PASS", "NA"), verdict.message


def test_rolling_stop_rolls_over_a_free_line_at_walking_pace() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=10), RollingStop))
    before = run.zone[:, 0] <= Zone.ENTRANCE
    assert 2.0 < run.speed[before, 0].min() < 3.0
    assert check(run, "full_stop").status == "FAIL"
    assert check(simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=10), Reference)), "full_stop").status == "PASS"


def test_rolling_stop_ignores_the_order_of_arrival() -> None:
    # a0 is held up by a3 and waits; a1, from the right, comes later and goes first.
    case = Scenario(find("stop4"), "2203", distance=[3, 21, 20, 0.3])
    assert check(simulate(Case(case, RollingStop)), "p3").status == "FAIL"
    assert check(simulate(Case(case, Reference)), "p3").status in ("PASS", "NA")


def test_two_rolling_stops_that_face_each_other_enter_together() -> None:
    case = Scenario(find("stop4"), "2020", distance=20, speed=5)
    run = simulate(Case(case, RollingStop))
    assert check(run, "p1").status == "FAIL"
    assert not run.collisions
    assert check(simulate(Case(case, Reference)), "p1").status == "PASS"


def test_rolling_stop_turns_right_on_red_without_looking() -> None:
    # a1 turns right at red; a0 comes from its left at green.
    case = Scenario(find("light4"), "2100", distance=[0.3, 0.3, 0, 0])
    run = simulate(Case(case, RollingStop))
    assert check(run, "p5").status == "FAIL"
    assert check(simulate(Case(case, Reference)), "p5").status == "PASS"
    alone = simulate(Case(Scenario(find("light4"), "0100", distance=20, speed=8), RollingStop))
    assert alone.speed[alone.zone[:, 0] <= Zone.ENTRANCE, 0].min() > 2.0


@pytest.mark.parametrize("code", ["2222", "1313", "1321"])
def test_rolling_stop_obeys_lights_otherwise(code: str) -> None:
    run = simulate(Case(Scenario(find("light4"), code, distance=20, speed=10), RollingStop))
    assert check(run, "p4").status == "PASS"
    assert check(run, "p6").status in ("PASS", "NA")
    assert run.provenance["end"] == "left"


def test_rolling_stop_yields_pass_fail_and_na() -> None:
    facing = simulate(Case(Scenario(find("stop4"), "2222", distance=[10, 20, 10, 20]), RollingStop))
    in_turn = simulate(Case(Scenario(find("stop4"), "2222", distance=[10, 11, 12, 13]), RollingStop))
    pairs = simulate(Case(Scenario(find("stop4"), "2222", distance=[0.3, 0.3, 20, 20]), RollingStop))
    assert [check(facing, rule).status.value for rule in ("p1", "p4")] == ["FAIL", "NA"]
    assert check(in_turn, "p3").status == "FAIL"
    assert [check(pairs, rule).status.value for rule in ("p1", "p2", "p3")] == ["PASS"] * 3
