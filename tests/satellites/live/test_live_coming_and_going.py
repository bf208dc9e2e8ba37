"""Live monitors of vehicles that come and go say in every state what the whole run says, and keep nothing of who has gone."""

import gc
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pytest_rvads.drivers.traffic import RollingStop
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import zones
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.satellites.live.instant import Decided, Seen
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import FormulaError, RunError
from studies.mutants import MUTANTS

from ...run_builders import coarse

LIMIT = 8.0
CROSSWALKS = ("crosswalk", "crosswalk_waiting", "crosswalk_turning", "crosswalk_clear")
ELSEWHERE = ("priority", "right_before_left", "on_lane_allowed", "merge", *CROSSWALKS)
"""Rules about none of these places, where nobody walks."""
PLACES, SEEDS = ("stop4", "light4", "yield4"), range(3)
ALL = ("paper", "variants", "road")


@cache
def crowd(name: str, seed: int, count: int = 7, steps: int = 1500) -> Run:
    """Return a run of vehicles that appear 14 m before their line and drive on by chance, through each other if need be."""
    junction, rng = find(name), np.random.default_rng(seed)
    ways = sorted(junction.movements)
    zone = np.full((steps, count), Zone.ABSENT, dtype=np.int8)
    station, speed, pose = np.full((steps, count), np.nan), np.full((steps, count), np.nan), np.full((steps, count, 3), np.nan)
    agents = []
    begins = np.sort(rng.integers(0, 500, count))
    for k, begin in enumerate(begins.tolist()):
        way = itinerary(junction, *ways[rng.integers(len(ways))])
        size = (4.6, 1.8) if rng.random() < 0.8 else (10.0, 2.5)
        agents.append(Agent(f"v{k}", junction.movements[way.entrance, way.exit], size=size))
        paces = np.repeat(rng.choice([0.0, 0.05, 1.0, 3.0, 5.0, 9.0], 60), rng.integers(30, 250, 60))[: steps - begin]
        along = way.line - 14.0 + np.concatenate(([0.0], np.cumsum(paces[:-1]) * 0.01))
        stay = int(np.searchsorted(along, way.leave))
        here = slice(begin, begin + stay)
        station[here, k], speed[here, k] = along[:stay], paces[:stay]
        beside = 0.8 * np.sin(along[:stay] / 4 + rng.random()) * (rng.random() < 0.3)
        line = np.array([way.pose(float(s)) for s in along[:stay]])
        line[:, 0] -= beside * np.sin(line[:, 2])
        line[:, 1] += beside * np.cos(line[:, 2])
        pose[here, k] = line
        zone[here, k] = zones(way.borders, along[:stay])
    lights = np.zeros((steps, len(junction.entrances)), dtype=np.int8)
    for group in junction.phase_groups:
        for entrance in group:
            lights[:, entrance] = np.repeat(rng.choice([Colour.GREEN, Colour.YELLOW, Colour.RED], 20), 140)[:steps]
    facts = Facts(speed_limit=LIMIT)
    return Run("crowd", junction, tuple(agents), zone, lights, station=station, speed=speed, pose=pose, facts=facts)


def states(run: Run) -> Iterator[list[Seen]]:
    """Yield who is there in every state."""
    station, speed, pose = (run.need(name).tolist() for name in ("station", "speed", "pose"))
    for tick, here in enumerate(run.here.tolist()):
        there = [k for k, is_here in enumerate(here) if is_here]
        yield [Seen(run.agents[k], station[tick][k], speed[tick][k], *pose[tick][k]) for k in there]


@cache
def violations(name: str, seed: int) -> dict[tuple[object, ...], int]:
    """Return what `check` finds violated in a crowd, and in which tick."""
    run = crowd(name, seed)
    found = ((rule.name, i) for rule in rules_for(ALL, run.junction) for i in check(run, rule).instances)
    return {(name, *sorted(i.binding)): i.failed for name, i in found if i.status is Status.FAIL and i.failed is not None}


@pytest.mark.extended
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", PLACES)
def test_every_violation_is_told_in_its_tick(name: str, seed: int) -> None:
    run = crowd(name, seed)
    monitor = RuleMonitor(ALL, run.junction, speed_limit=LIMIT)
    told: dict[tuple[object, ...], int] = {}
    for tick, (seen, lights) in enumerate(zip(states(run), run.lights, strict=True)):
        for found in monitor.see(seen, lights):
            assert found.time == pytest.approx(tick * run.dt)
            if found.verdict is Truth.FALSE:
                told[(found.rule, *sorted(found.binding.items()))] = tick
    assert told == violations(name, seed)
    assert not monitor.not_judged


@pytest.mark.extended
def test_much_goes_wrong_in_these_crowds() -> None:
    """What the test above compares."""
    broken = {str(key[0]) for name in PLACES for seed in SEEDS for key in violations(name, seed)}
    never = {rule.name for rule in rules_for(ALL)} - broken
    # What takes two that stand at their lines together is rare where all drive by chance; nobody leaves the road, or has no lane.
    assert never <= {"p2", "p5", "p6", "p6g", "first_come", "right_first", "progress", "on_route", *ELSEWHERE}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("fault", ["blind inside", "jostles", "runs red", "no yield turning left", "dawdles"])
def test_a_monitor_of_many_rules_says_of_each_what_the_run_says(place: str, fault: str) -> None:
    start = Scenario(find(place), "3123", distance=(8, 14, 10, 0.3), speed=(5, 6, 4, 0), duration=8)
    run = coarse(replace(simulate(Case(start, MUTANTS[fault])), collisions=None), 4)
    monitor = RuleMonitor(ALL, run.junction, run.agents, dt=run.dt, speed_limit=run.facts.speed_limit)
    broken: dict[str, int] = {}
    for tick in range(run.steps):
        motion = {name: run.need(name)[tick] for name in ("station", "speed", "pose")}
        monitor.step(run.zone[tick], run.lights[tick], **motion)
        for rule, verdict in monitor.verdicts.items():
            if verdict is Truth.FALSE:
                broken.setdefault(rule, tick)
    whole = {rule.name: check(run, rule) for rule in monitor.rules}
    failed = {name: round(v.time / run.dt) for name, v in whole.items() if v.status is Status.FAIL and v.time is not None}
    assert broken == failed


def parade(steps: int) -> Iterator[list[Seen]]:
    """Yield states of an endless row of vehicles, one more in each, each there for four of them, through a junction of stops."""
    junction = find("stop4")
    ways = sorted(junction.movements)
    stations = (-5.0, -0.5, 3.0, 30.0)
    for tick in range(steps):
        seen = []
        for age, station in enumerate(stations[: tick + 1]):
            way = itinerary(junction, *ways[(tick - age) * 5 % len(ways)])
            agent = Agent(f"v{tick - age}", junction.movements[way.entrance, way.exit], size=(4.6, 1.8))
            seen.append(Seen(agent, station, 3.0, *way.pose(station)))
        yield seen


@pytest.mark.extended
def test_three_thousand_vehicles_take_no_more_memory_than_a_thousand() -> None:
    monitor = RuleMonitor(["p1", "p3", "full_stop", "no_collision"], find("stop4"), dt=0.5)
    sizes, told = [], 0
    for tick, seen in enumerate(parade(3000)):
        told += sum(found.verdict is Truth.FALSE for found in monitor.see(seen))
        if tick % 1000 == 990:
            gc.collect()
            sizes.append(len(gc.get_objects()))
    assert told >= 2_990, "nobody of them stops"
    assert max(sizes) - min(sizes) < 200, "a tenth of an object per vehicle"


def test_each_instance_is_told_once_and_by_the_time_its_vehicles_have_gone() -> None:
    monitor = RuleMonitor("full_stop", find("stop4"), dt=0.5)
    told: list[Decided] = [found for seen in parade(40) for found in monitor.see(seen)]
    told += monitor.see([])
    who = [found.binding["a"] for found in told]
    assert sorted(who) == sorted(f"v{k}" for k in range(40)), "one instance each"
    early = [found for found in told if found.verdict is Truth.FALSE]
    # Who came in state k is inside in state k + 2, half a second each.
    assert {(f.binding["a"], f.time) for f in early} == {(f"v{k}", (k + 2) * 0.5) for k in range(38)}


def test_a_name_may_come_back_as_another_vehicle() -> None:
    junction = find("stop4")
    way = itinerary(junction, *min(junction.movements))
    agent = Agent("bus", junction.movements[way.entrance, way.exit], size=(10.0, 2.5))
    monitor = RuleMonitor("full_stop", junction)

    def pass_by() -> list[Truth]:
        return [f.verdict for s in (-0.5, 1.0, 2.0) for f in monitor.see([Seen(agent, s, 5.0, *way.pose(s))])]

    assert pass_by() == [Truth.FALSE]
    assert monitor.violated == ({"a": "bus", "j.en": f"entrance {way.entrance}"},)
    monitor.see([])
    assert monitor.violated == ()
    assert monitor.verdict is Truth.FALSE, "what was violated stays so"
    assert pass_by() == [Truth.FALSE]


def test_wrong_use_of_live_monitors_is_refused() -> None:
    junction = find("stop4")
    way = itinerary(junction, *min(junction.movements))
    agent = Agent("a", junction.movements[way.entrance, way.exit], size=(4.6, 1.8))
    here = Seen(agent, -5.0, 1.0, *way.pose(-5.0))
    with pytest.raises(RunError, match="two vehicles of a state have the same name"):
        RuleMonitor("p1", junction).see([here, here])
    with pytest.raises(RunError, match="vehicle 'a': what is seen must be finite numbers, got"):
        RuleMonitor("p1", junction).see([here._replace(speed=float("nan"))])
    with pytest.raises(RunError, match="lights of a state must be 4 finite numbers"):
        RuleMonitor("p1", junction).see([here], [0])
    with pytest.raises(RunError, match="step reads vehicles that are known beforehand"):
        RuleMonitor("p1", junction).step([0])
    with pytest.raises(RunError, match="see reads vehicles that come and go"):
        RuleMonitor("p1", junction, [agent]).see([here])
    with pytest.raises(RunError, match="the run holds no speed limit"):
        RuleMonitor("speed_limit", junction).see([here])
    alone = Rule("alone", "forall a. G(a@j -> !(exists a'. a != a' & a'@j))")
    crowded = Rule("crowded", "forall a: agent, b: agent, c: agent. G(a@j & b@j & c@j -> a = b | b = c | a = c)")
    for rule in (alone, crowded):
        with pytest.raises(FormulaError, match=f"rule '{rule.name}' is about more than two vehicles at once"):
            RuleMonitor(rule, junction).see([here])


def test_unjudgeable_rule_leaves_the_other_rules_judged() -> None:
    junction = find("stop4")
    way = itinerary(junction, *min(junction.movements))
    agent = Agent("a", junction.movements[way.entrance, way.exit])
    monitor = RuleMonitor(["road"], junction)
    told = [f for s in (-0.5, 1.0) for f in monitor.see([Seen(agent, s, 5.0, *way.pose(s))])]
    assert [(f.rule, f.verdict) for f in told] == [("full_stop", Truth.FALSE)]
    assert monitor.not_judged["speed_limit"] == "the run holds no speed limit"
    assert monitor.not_judged["keep_lane"] == "the run holds no size of its vehicles"
    assert "full_stop" not in monitor.not_judged


def test_zones_are_left_for_good() -> None:
    junction = find("stop4")
    way = itinerary(junction, *min(junction.movements))
    agent = Agent("a", junction.movements[way.entrance, way.exit], size=(4.6, 1.8))
    monitor = RuleMonitor(Rule("gone_in", "forall a. G(a@j -> N a@j)"), junction)
    told = [found.verdict for s in (-0.1, 0.1, -0.1, 0.2) for found in monitor.see([Seen(agent, s, 0.0, *way.pose(s))])]
    assert told == [], "a reading that falls back over the line is no leaving of the junction"


@pytest.mark.parametrize("block", [7, pytest.param(10, marks=pytest.mark.extended)])
@pytest.mark.parametrize("name", PLACES)
def test_blocks_of_states_tell_what_single_states_tell(name: str, block: int) -> None:
    run = crowd(name, 1, 4, 700)
    monitors = [RuleMonitor(ALL, run.junction, speed_limit=LIMIT, block=size) for size in (1, block)]
    told: list[list[Decided]] = [[], []]
    for tick, (seen, lights) in enumerate(zip(states(run), run.lights, strict=True)):
        for decided, monitor in zip(told, monitors, strict=True):
            decided += monitor.see(seen, lights)
        assert all(tick * run.dt - found.time < block * run.dt for found in told[1][len(told[0]) :])
    told[1] += monitors[1].flush()
    single, blocks = ([(d.rule, *sorted(d.binding.items()), str(d.verdict), d.time) for d in decided] for decided in told)
    assert single == blocks
    assert any("F" in decision for decision in single)
    assert monitors[0].verdicts == monitors[1].verdicts


def test_block_of_states_of_vehicles_that_are_known_beforehand() -> None:
    """The violation in one of ten states is told with the last one, and `flush` judges states that make no block."""
    start = Scenario(find("stop4"), "3123", distance=(8, 14, 10, 0.3), speed=(5, 6, 4, 0), duration=8)
    run = replace(simulate(Case(start, RollingStop)), collisions=None)
    single, blocks = (RuleMonitor(ALL, run.junction, run.agents, speed_limit=LIMIT, block=size) for size in (1, 10))
    truths: list[list[str]] = [[], []]
    steps = run.steps - run.steps % 10 - 4
    for tick in range(steps):
        motion = {name: run.need(name)[tick] for name in ("station", "speed", "pose")}
        for told, monitor in zip(truths, (single, blocks), strict=True):
            told.append(str(monitor.step(run.zone[tick], run.lights[tick], **motion)))
    first = truths[0].index("F")
    assert truths[1].index("F") == first // 10 * 10 + 9
    assert blocks.flush() == ()
    assert single.violated == blocks.violated
    assert single.verdicts == blocks.verdicts
    for block in (0, 1.5, "ten"):
        with pytest.raises(RunError, match=f"block must be a whole number of states from 1 on, got {block!r}"):
            RuleMonitor("full_stop", run.junction, block=block)  # type: ignore[arg-type]
