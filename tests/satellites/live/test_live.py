"""A rule followed state by state says in every state what the whole run up to there says."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.drivers.traffic import RedLightRunner, RollingStop
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import get_rule, rulebook
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

Make = Callable[..., Run]
GREEN, RED = Colour.GREEN, Colour.RED


def follow(run: Run, rule: str | Rule, **more: Any) -> list[Truth]:
    """Feed a run of positions to a monitor, state by state."""
    facts = run.facts
    monitor = RuleMonitor(rule, run.junction, run.agents, speed_limit=facts.speed_limit, **more)
    hits: dict[int, list[tuple[str, str]]] = {}
    for c in run.collisions or ():
        hits.setdefault(round(c.time / run.dt), []).append(c.agents)
    motion = [{name: run.need(name)[k] for name in ("station", "speed", "pose")} for k in range(run.steps)]
    return [
        monitor.step(run.zone[k], run.lights[k], **motion[k], collisions=None if run.collisions is None else hits.get(k, ()))
        for k in range(run.steps)
    ]


@pytest.fixture(scope="module")
def traffic(drive: Make) -> dict[str, Run]:
    """Runs in which much goes wrong: rolling through, standing in the junction, speeding, touching, waiting in vain."""
    stop = {
        0: (2, -6.0, [(0, 4.0), (110, 0.05), (120, 4.0), (500, 0.0), (940, 3.0)]),
        1: (1, -1.5, [(0, 5.0)], 1.4),
        2: (3, -0.8, [(0, 0.0), (60, 6.0), (200, 13.0)]),
        3: (2, -3.0, [(0, 1.0), (200, 0.0), (900, 5.0)]),
    }
    lights = {e: [(0, RED if e % 2 else GREEN), (400, GREEN if e % 2 else RED)] for e in range(4)}
    return {
        "stop": drive("stop4", stop, 1000, collisions=[(310, "a0", "a2"), (650, "a3", "a1")]),
        "lights": drive("light4", stop, 1000, lights, [(310, "a0", "a2")]),
    }


@pytest.fixture(scope="module")
def waiting(drive: Make) -> list[Run]:
    """Runs in which somebody waits in vain: for nobody, and after its light has turned green; and one in which nobody does."""
    vain = {0: (2, -0.5, [(0, 0.0), (1300, 8.0)]), 1: (2, -2.5, [(0, 1.0), (200, 0.0), (250, 8.0)])}
    late, comes = {0: (2, -0.5, [(0, 0.0)])}, {0: (2, -90.0, [(0, 8.0)])}
    lights = {0: [(0, RED), (200, GREEN)]}
    return [drive("stop4", vain, 1400), drive("light4", late, 1300, lights), drive("light4", comes, 1100, lights)]


DRIVES = (
    (Scenario(find("stop4"), "2332", distance=(8, 12, 9, 14), speed=8, duration=7), RedLightRunner),
    (Scenario(find("light4"), "3122", distance=(12, 0.3, 14, 8), speed=(6, 0, 6, 6), duration=7), RedLightRunner),
    (Scenario(find("light4"), "3231", distance=(12, 15, 10, 5), speed=6, duration=7), RollingStop),
)


@pytest.fixture(scope="module")
def simulated() -> list[Run]:
    """What these drivers make of their starts; collisions are left to the monitor."""
    return [replace(simulate(Case(start, driver)), collisions=None) for start, driver in DRIVES]


CARRIED = ("stopped", "blocks", "idles", "owes", "obstructs")
"""Words that hang on states before."""
RULES = [r for book in ("paper", "variants", "road") for r in rulebook(book)]


@pytest.mark.extended
@pytest.mark.parametrize("rule", RULES, ids=[r.name for r in RULES])
def test_step_by_step_says_what_the_whole_run_says(
    traffic: dict[str, Run], waiting: list[Run], simulated: list[Run], rule: Rule
) -> None:
    carried = any(f"{name}(" in rule.text for name in CARRIED)
    for run in (*traffic.values(), *((*waiting, *simulated) if carried else simulated[1:2])):
        if not rule.concerns(run.junction):
            continue
        told, whole = follow(run, rule), check(run, rule)
        broken = [k for k, verdict in enumerate(told) if verdict is Truth.FALSE]
        if whole.status is Status.FAIL:
            assert whole.time is not None
            assert broken == list(range(round(whole.time / run.dt), run.steps))
        else:
            assert not broken


def test_much_goes_wrong_in_these_runs(traffic: dict[str, Run], waiting: list[Run], simulated: list[Run]) -> None:
    runs = (*traffic.values(), *waiting, *simulated)
    failed = {r.name for r in RULES for run in runs if check(run, r).status is Status.FAIL}
    assert failed >= {
        *("p1", "p3", "p4", "full_stop", "first_come", "red", "right_on_red", "left_yields"),
        *("no_collision", "no_conflict", "keep_clear", "progress", "keep_lane", "speed_limit"),
    }


def test_live_monitor_names_the_violated_instances(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 150, 300)}, 200)
    monitor = RuleMonitor("p2", run.junction, run.agents)
    told = [str(monitor.step(zone)) for zone in run.zone]
    assert told == ["?"] * 50 + ["F"] * 150
    assert monitor.violated == ({"j.en": "entrance 1", "j.en'": "entrance 0", "a": "a1", "a'": "a0"},)


def test_a_rule_that_is_met_for_good_is_true(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 60)
    monitor = RuleMonitor(Rule("gets_in", "forall a. F a@j"), run.junction, run.agents)
    assert str(monitor.verdict) == "?"
    assert [str(monitor.step(zone)) for zone in run.zone] == ["?"] * 50 + ["T"] * 10
    nobody = RuleMonitor("p2", run.junction, run.agents)
    assert str(nobody.step(run.zone[0])) == "T", "one vehicle alone can't break it"


def test_the_tie_window_is_the_rule_s(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 150, 200), 1: (2, 40, 100, 300)}, 200)
    strict = replace(get_rule("first_come"), name="strict", tie=0.0)
    for rule, verdict in ((strict, Truth.FALSE), (get_rule("first_come"), Truth.UNKNOWN)):
        monitor = RuleMonitor(rule, run.junction, run.agents)
        assert [monitor.step(zone) for zone in run.zone][-1] is verdict


def test_wrong_use_is_told(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 10, 50, 200)}, 60)
    with pytest.raises(RunError, match="p4 is about junctions with lights, and this junction has stop"):
        RuleMonitor("p4", run.junction, run.agents)
    monitor = RuleMonitor("full_stop", run.junction, run.agents)
    for zone in ([0], [0, float("nan")], [[0, 0]]):
        with pytest.raises(RunError, match="zone of a state must be 2 finite numbers, got"):
            monitor.step(zone)
    with pytest.raises(RunError, match="the run holds no positions"):
        monitor.step([1, 0])
    with pytest.raises(RunError, match="the run holds no speed limit"):
        RuleMonitor("speed_limit", run.junction, run.agents).step([0, 0], speed=[1.0, 1.0])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lights": [0, 0, 0]}, "lights of a state must be 4 finite numbers"),
        ({"station": [1.0]}, "station of a state must be 2 finite numbers"),
        ({"speed": [1.0, float("inf")]}, "speed of a state must be 2 finite numbers"),
        ({"pose": [0.0, 0.0, 0.0]}, r"pose of a state must be finite numbers of shape \(2, 3\)"),
    ],
)
def test_an_array_of_another_shape_is_refused_by_name(make: Make, given: dict[str, Any], message: str) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 10, 50, 200)}, 60)
    with pytest.raises(RunError, match=f"{message}, got"):
        RuleMonitor("p1", run.junction, run.agents).step([0, 0], **given)


# Reference points, in the middle of the front bumpers, 6 m apart, one behind the other: who is 5 m long ends 1 m before.
@pytest.mark.parametrize(
    ("size", "verdict"),
    [((5.0, 2.0), "?"), ((7.0, 2.0), "F"), ([(5.0, 2.0), (7.0, 2.0)], "?"), ([(7.0, 2.0), (5.0, 2.0)], "F")],
)
def test_vehicles_have_the_size_that_is_given(make: Make, size: Any, verdict: str) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 10, 50, 200)}, 60)
    monitor = RuleMonitor("no_collision", run.junction, run.agents, vehicle_size=size)
    assert str(monitor.step([0, 0], station=[-20.0, -26.0], speed=[0.0, 0.0], pose=[(6.0, 0.0, 0.0), (0.0, 0.0, 0.0)])) == verdict


@pytest.mark.parametrize("size", [5.0, (5.0, 2.0, 1.5), [(5.0, 2.0)] * 3, (5.0, 0.0), (5.0, float("nan"))])
def test_invalid_vehicle_size_is_refused(make: Make, size: Any) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 10, 50, 200)}, 60)
    with pytest.raises(RunError, match=r"vehicle_size must be a length and width \[m\], for all 2 vehicles or for each, got"):
        RuleMonitor("no_collision", run.junction, run.agents, vehicle_size=size)
