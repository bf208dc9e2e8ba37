"""Imperfect senses and slow commands: each parameter does what it says, from a seed, and nothing by default."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import VehicleState, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.simulators.seat import Perception, hidden
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import ScenarioError

START: dict[str, Any] = {"distance": 20, "speed": 6, "subject": 0}


class Note:
    """Stands, and keeps what it saw."""

    def __init__(self) -> None:
        NOTES.append([])

    def control(self, seen: Observation) -> Control:
        NOTES[-1].append(seen)
        return Control(brake=1.0)


NOTES: list[list[Observation]] = []


def watch(senses: Senses, directions: str = "2202", duration: float = 3.0, **start: Any) -> tuple[list[Observation], Run]:
    NOTES.clear()
    scenario = Scenario(find("stop4"), directions, senses=senses, duration=duration, **START | start)
    run = simulate(Case(scenario, Note, traffic=Reference))
    assert run.fault is None
    return NOTES[-1], run


def test_nothing_changes_by_default() -> None:
    plain, ideal = Scenario(find("stop4"), "2202", **START), Scenario(find("stop4"), "2202", senses=Senses(), **START)
    assert plain == ideal
    assert plain.name == ideal.name == "stop4-class00-as2202-s0-cfgd20.00v06.00"
    assert plain.record()["senses"] == {}
    seen, run = watch(Senses())
    assert [o.others[0].station for o in seen] == list(run.station[:-1, 1])


@pytest.mark.parametrize("delay", [0.01, 0.2, 0.5])
def test_delay_shows_earlier_states_of_other_vehicles(delay: float) -> None:
    seen, run = watch(Senses(delay=delay))
    late = round(delay / DT)
    assert [o.others[0].station for o in seen[late:]] == list(run.station[: -1 - late, 1])
    assert seen[0].others[0].station == run.station[0, 1], "before, the oldest that there is"
    assert [o.me.station for o in seen] == list(run.station[:-1, 0]), "the own state is known"


def test_nobody_is_seen_beyond_the_range() -> None:
    ideal, _ = watch(Senses(), duration=8)
    apart = sorted(math.hypot(o.x - seen.me.x, o.y - seen.me.y) for seen in ideal for o in seen.others)
    limit = apart[len(apart) // 2]
    seen, _ = watch(Senses(range=limit), duration=8)
    for full, cut in zip(ideal, seen, strict=True):
        near = [o.name for o in full.others if math.hypot(o.x - full.me.x, o.y - full.me.y) <= limit]
        assert [o.name for o in cut.others] == near
    assert 0 < sum(len(o.others) for o in seen) < len(apart)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_a_share_of_the_looks_fails(share: float) -> None:
    seen, _ = watch(Senses(dropout=share))
    looks = np.array([len(o.others) for o in seen])
    assert len(looks) * 2 == 600
    # Six standard deviations of a binomial share.
    assert looks.sum() / 600 == pytest.approx(1 - share, abs=6 * math.sqrt(share * (1 - share) / 600) + 1e-12)


def test_noise_has_the_deviation_asked_for() -> None:
    ideal, _ = watch(Senses(), duration=8)
    seen, _ = watch(Senses(position_noise=0.5, speed_noise=0.2), duration=8)
    pairs = [(t, n) for full, noisy in zip(ideal, seen, strict=True) for t, n in zip(full.others, noisy.others, strict=True)]
    off = np.array([(n.x - t.x, n.y - t.y, n.speed - t.speed) for t, n in pairs if t.speed > 2])
    assert len(off) > 300
    assert off[:, :2].std(axis=0) == pytest.approx([0.5, 0.5], rel=0.2)
    assert off[:, 2].std() == pytest.approx(0.2, rel=0.2)
    assert np.abs(off.mean(axis=0)).max() < 0.15
    assert min(n.speed for _, n in pairs) == 0.0, "no noise drives anybody backwards"


def test_the_zone_seen_is_that_of_the_place_seen() -> None:
    seen, run = watch(Senses(position_noise=1.0), distance=2, speed=2, duration=6)
    length = run.junction.movements[run.agents[1].entrance, run.agents[1].exit].length
    zones = set()
    for other in (o.others[0] for o in seen if o.others):
        zones.add(other.zone)
        assert (other.zone is Zone.JUNCTION) == (0 < other.station < length)
        assert (other.zone is Zone.ENTRANCE) == (-run.junction.setbacks[1] - 1 <= other.station <= 0)
    assert {Zone.APPROACH, Zone.ENTRANCE} <= zones


def state(name: str, x: float, y: float, heading: float = 0.0) -> VehicleState:
    return VehicleState(name, 0, Turn.STRAIGHT, Zone.APPROACH, 0.0, x, y, heading, 0.0, 0.0, 4.6, 1.86)


@pytest.mark.parametrize(
    ("between", "blocked"),
    [
        (state("b", 12.0, 0.0), True),
        (state("b", 12.0, 3.0), False),
        (state("b", 12.0, 2.3, math.pi / 2), True),
        (state("b", 12.0, 9.0, math.pi / 2), False),
        (state("b", -2.0, 0.0), False),
        (state("b", 40.0, 0.0), False),
        (state("b", 12.0, 1.5, math.pi / 4), True),
    ],
)
def test_who_stands_behind_a_body_is_hidden(between: VehicleState, blocked: bool) -> None:
    """Looking east from the origin at a vehicle 20 m away; another body stands somewhere."""
    me, other = state("me", 0.0, 0.0), state("a", 20.0, 0.0)
    assert hidden(me, other, (me, other, between)) == blocked
    assert not hidden(me, other, (me, other))


@pytest.mark.parametrize("front", [0.0, 6.0, 12.0])
def test_of_a_long_vehicle_whatever_part_stands_out_is_seen(front: float) -> None:
    """A body 12 m long across the view, of which another one hides the front, the centre or the rear."""
    across = state("a", 20.0, front, math.pi / 2)._replace(length=12.0)
    assert not hidden(state("me", 0.0, 0.0), across, (state("b", 12.0, 0.0),))
    assert hidden(state("me", 0.0, 0.0), across, tuple(state(f"b{y}", 12.0, 1.9 * y) for y in range(-4, 5)))


@pytest.mark.extended
def test_occlusion_hides_vehicles_behind_vehicles() -> None:
    """Four vehicles: two drive across between the subject and the one on the other side of the junction."""
    ideal, _ = watch(Senses(), "2222", duration=25)
    seen, _ = watch(Senses(occlusion=True), "2222", duration=25)
    lost = [{o.name for o in full.others} - {o.name for o in cut.others} for full, cut in zip(ideal, seen, strict=True)]
    assert 0 < sum(map(bool, lost)) < len(lost)
    for full, names in zip(ideal, lost, strict=True):
        assert names == {o.name for o in full.others if hidden(full.me, o, full.others)}


def test_draws_come_from_the_seed_and_the_vehicle() -> None:
    senses = Senses(position_noise=0.5, dropout=0.2, jitter=0.1)

    def hashes(one: Senses) -> str:
        return simulate(Case(Scenario(find("stop4"), "1133", senses=one, duration=4, **START), Reference, traffic=Reference)).hash

    assert hashes(senses) == hashes(senses)
    assert hashes(senses) != hashes(replace(senses, seed=1))
    place, views = find("stop4"), []
    for key in ("x a0", "x a1"):
        perception = Perception(Senses(position_noise=1.0), key)
        seen = Observation(0.0, state("a0", 0, 0), (state("a1", 9, 0),), (), None, place, None, 11.0)
        perception.watch(seen)
        views.append(perception.view(seen).others[0].x)
    assert views[0] != views[1]


class Brake:
    """Brakes from 1 s on."""

    def control(self, seen: Observation) -> Control:
        return Control(brake=float(seen.time >= 1.0 - 1e-9))


def test_commands_are_late_by_jitter_alone() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", duration=2, speed=6, senses=Senses(jitter=0.3)), Brake))
    assert 1.0 < np.flatnonzero(run.controls[:, 0, 1])[0] * DT <= 1.3


@pytest.mark.parametrize("latency", [0.0, 0.05, 0.3])
def test_commands_take_effect_after_the_latency(latency: float) -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", duration=2, speed=6, senses=Senses(latency=latency)), Brake))
    assert np.flatnonzero(run.controls[:, 0, 1])[0] == round((1.0 + latency) / DT)


def test_jitter_adds_up_to_its_bound_and_keeps_the_order() -> None:
    class Count:
        period = 0.05

        def __init__(self) -> None:
            self.asked = 0

        def control(self, seen: Observation) -> Control:
            self.asked += 1
            return Control(throttle=self.asked / 100)

    run = simulate(Case(Scenario(find("stop4"), "2000", duration=3, senses=Senses(latency=0.1, jitter=0.2)), Count))
    steps = [int(np.flatnonzero(np.isclose(run.controls[:, 0, 0], k / 100))[0]) for k in range(1, 40) if k / 100 in run.controls]
    delays = np.array([np.flatnonzero(run.controls[:, 0, 0] >= k / 100 - 1e-9)[0] - 5 * (k - 1) for k in range(1, 50)]) * DT
    assert (np.diff(run.controls[:-1, 0, 0]) >= 0).all(), "none overtakes another"
    assert steps == sorted(steps)
    assert 0.1 - 1e-9 <= delays.min() < 0.15
    assert 0.2 < delays.max() <= 0.3 + 1e-9


def test_traffic_sees_everything() -> None:
    """With a subject, only the subject is impaired."""
    blind = Scenario(find("stop4"), "2220", duration=15, senses=Senses(range=0.0), **START)
    clear = Scenario(find("stop4"), "2220", duration=15, **START)
    one, two = (simulate(Case(s, Note, traffic=Reference)) for s in (blind, clear))
    assert np.array_equal(one.station, two.station)


def test_labels_name_what_is_not_ideal() -> None:
    senses = Senses(delay=0.2, range=40, occlusion=True, seed=3)
    assert senses.label == "delay00.20.range40.00.occlusion.seed3"
    scenario = Scenario(find("stop4"), "1133", senses=senses, **START)
    assert scenario.name == "stop4-class07-as1133-s0-cfgd20.00v06.00.delay00.20.range40.00.occlusion.seed3"
    assert scenario.record()["senses"] == {"delay": 0.2, "range": 40.0, "occlusion": True, "seed": 3}


def test_a_grid_of_senses_is_their_product() -> None:
    grid = Senses.grid({"delay": [0, 0.2], "range": 40, "dropout": (0.0, 0.5)})
    assert [(s.delay, s.range, s.dropout) for s in grid] == [(0, 40, 0), (0, 40, 0.5), (0.2, 40, 0), (0.2, 40, 0.5)]


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"delay": -0.1}, "delay must be a number of 0 or more, got -0.1"),
        ({"latency": math.nan}, "latency must be a number of 0 or more, got nan"),
        ({"jitter": math.inf}, "jitter must be finite, got inf"),
        ({"dropout": 1.5}, "dropout must be a share, 0 to 1, got 1.5"),
        ({"occlusion": 1}, "occlusion must be True or False, got 1"),
        ({"seed": -1}, "seed must be a whole number of 0 or more, got -1"),
        ({"range": "far"}, "range must be a number of 0 or more, got 'far'"),
    ],
)
def test_invalid_senses_are_refused(fields: dict[str, object], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        Senses(**fields)  # type: ignore[arg-type]


def test_invalid_axes_of_senses_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"got 'delai'; did you mean 'delay'\?"):
        Senses.grid({"delai": 0.1})
    with pytest.raises(ScenarioError, match="lists of at least one value"):
        Senses.grid({"delay": []})
    with pytest.raises(ScenarioError, match=r"senses must be rvads.Senses\(...\), got 0.2"):
        Scenario(find("stop4"), "1133", senses=0.2)  # type: ignore[arg-type]
