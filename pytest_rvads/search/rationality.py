"""Rationality and determinacy of an autopilot (after Li et al., Testing ADS: what really matters).

A pass stays a pass from farther away, and where everybody is and how fast is all that matters for what comes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pytest_rvads.conduct.presence import crossed
from pytest_rvads.errors import MetamorphicViolation, RunError, ScenarioError, require
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.orbits import rotate
from pytest_rvads.search.metamorphic import judged
from pytest_rvads.search.sidebyside import side_by_side
from pytest_rvads.simulators.simulator import Simulator

__all__ = ["determinate", "rational"]

FARTHER = (1.0, 5.0, 20.0)
"""By how much vehicles are put farther away [m]."""
_BAD = (Status.FAIL, Status.OPEN)


def rational(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    farther: Sequence[float] = FARTHER,
    simulator: Simulator | None = None,
) -> None:
    """Require that a rule which is kept from some distances is kept from greater ones with the same speeds.

    Args:
        case: the case to begin with.
        rules: a rulebook, rules, or both.
        farther: by how much all vehicles start farther away [m], one after the other.
        simulator: what makes the runs, as for `simulate`.

    Raises:
        MetamorphicViolation: a PASS turns into FAIL or OPEN.
        ScenarioError: no rule passes to begin with, or the approaches are too short.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "rational takes a rvads.Case(scenario, driver)", ScenarioError)
    chosen = rules_for(rules, case.scenario.place)
    run, before = judged(case, chosen, simulator)
    kept = [rule for rule in chosen if before[rule.name].status is Status.PASS]
    if not kept:
        statuses = ", ".join(f"{name} {verdict.status}" for name, verdict in before.items())
        raise ScenarioError(f"no rule passes in {case.scenario.name} ({statuses}), so nothing follows for greater distances")
    for more in farther:
        there = case.but(distance=[d + more for d in case.scenario.distances])
        other, after = judged(there, kept, simulator)
        for rule in kept:
            if after[rule.name].status in _BAD:
                what = f"{more:g} m farther away"
                raise _violation(run, before[rule.name], other, after[rule.name], what)


def determinate(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    at: float = 1.0,
    tolerance: float = 0.5,
    simulator: Simulator | None = None,
) -> None:
    """Require that a run which starts from the positions and speeds of another run at time `at` continues like that run.

    The autopilots of the second run have no memory of the time before `at`, so their memory must not matter. Every rule must have
    the same status, and all vehicles must enter the junction in the same order and, up to `tolerance`, at the same time.

    Args:
        case: the case to begin with; without lights, because they would start anew as well.
        rules: a rulebook, rules, or both.
        at: when to cut [s]; nobody may be past the stopping line.
        tolerance: by how much an entry may be earlier or later [s]; lags of drive and brake begin anew.
        simulator: what makes the runs, as for `simulate`.

    Raises:
        MetamorphicViolation: the continuation differs.
        ScenarioError: lights, followers, a time at which somebody is past the line or gone, or nobody gets across.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "determinate takes a rvads.Case(scenario, driver)", ScenarioError)
    junction = case.scenario.place
    if junction.phase_groups:
        raise ScenarioError(
            f"a run at {junction.name} can't be restarted: its lights would start anew; choose one without lights"
        )
    if case.scenario.followers:
        raise ScenarioError(
            f"{case.scenario.name} can't be restarted: followers start at a fixed gap, not where they were; choose followers=0"
        )
    chosen = rules_for(rules, junction)
    run, before = judged(case, chosen, simulator)
    if not crossed(run):
        raise ScenarioError(f"what drives does not get across in {case.scenario.name}, so nothing follows for what it remembers")
    other, after = judged(_restarted(case, run, at), chosen, simulator)
    what = f"restarted at {at:g} s"
    for rule in chosen:
        if before[rule.name].status is not after[rule.name].status:
            raise _violation(run, before[rule.name], other, after[rule.name], what)
    first, then = _entries(run, 0.0), _entries(other, at)
    late = [k for k in range(len(run.agents)) if abs(first[k].time - then[k].time) > tolerance]
    if late or [e.agent for e in sorted(first)] != [e.agent for e in sorted(then)]:
        rule = chosen[0]
        raise _violation(run, before[rule.name], other, after[rule.name], what, "who enters when")


@dataclass(frozen=True, slots=True, order=True)
class _Entry:
    time: float
    agent: str


def _entries(run: Run, since: float) -> list[_Entry]:
    times = [run.entry(k) for k in range(len(run.agents))]
    never = run.duration + since + 1.0
    return [_Entry(never if t is None else round(t + since, 9), a.name) for t, a in zip(times, run.agents, strict=True)]


def _restarted(case: Case, run: Run, at: float) -> Case:
    """Return the case that starts where the vehicles of `run` are at time `at`."""
    scenario, tick = case.scenario, round(at / DT)
    if run.station is None or run.speed is None:
        raise RunError(f"the run {run.label} holds no positions and speeds")
    if not 0 < tick < run.steps:
        raise ScenarioError(f"the run lasts {run.duration:.2f} s, so it can't be restarted at {at!r} s")
    distances, speeds = [0.0] * len(scenario.directions), [0.0] * len(scenario.directions)
    for k, agent in enumerate(run.agents):
        left = -scenario.place.setbacks[agent.entrance] - float(run.station[tick, k])
        if run.zone[tick, k] > Zone.ENTRANCE or left < 0:
            raise ScenarioError(f"{agent.name} is past the stopping line at {at:g} s: restart the run earlier")
        distances[agent.entrance], speeds[agent.entrance] = left, max(float(run.speed[tick, k]), 0.0)
    back = -scenario.rotation
    return case.but(
        distance=rotate(tuple(distances), back),
        speed=rotate(tuple(speeds), back),
        duration=max(scenario.duration - at, DT),
    )


def _violation(run: Run, one: Verdict, other: Run, two: Verdict, what: str, broken: str | None = None) -> MetamorphicViolation:
    change = f"changes {broken}" if broken else f"turns {one.rule} from {one.status} into {two.status}"
    error = MetamorphicViolation(f"{what}: {change} in {run.label}")
    error.add_note(side_by_side(run, one, other, two, range(len(run.junction.entrances)), what))
    return error
