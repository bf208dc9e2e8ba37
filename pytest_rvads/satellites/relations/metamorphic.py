"""Metamorphic checks: an autopilot must get the same verdicts on two related runs, whether PASS or FAIL (paper, section 5.2).

`equivalent` compares equivalent scenarios: an autopilot that passes in a scenario and fails in an equivalent scenario is wrong.

`rational` and `determinate` check two properties after Li et al., Testing ADS: what really matters. A rational autopilot that
obeys a rule in a scenario also obeys it if all vehicles start farther from the junction. The further driving of a determinate
autopilot depends only on the present positions and speeds of all vehicles.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.static_model import crossed
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Kind, Zone
from pytest_rvads.satellites.relations.variants import RELATIONS, Incomparable, Variant
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import rotate
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import MetamorphicViolation, RunError, ScenarioError, require, suggest

FARTHER = (1.0, 5.0, 20.0)
"""Distances by which all vehicles start farther from their stopping lines in the runs of `rational` [m]."""
_BAD = (Status.FAIL, Status.OPEN)


@dataclass(frozen=True, slots=True)
class Difference:
    """Two runs on which a rule has different statuses, although the statuses should be equal."""

    what: str
    """The change from the first run's scenario to the second run's scenario, in words."""
    one: Verdict
    """Verdict on the first run."""
    other: Verdict
    """Verdict on the second run."""
    table: str
    """Text table that shows the two runs side by side."""

    def __str__(self) -> str:
        return f"{self.what} turns {self.one.rule} from {self.one.status} into {self.other.status}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """The compared variants of a case (a scenario with drivers and vehicles), and the differences of their verdicts."""

    compared: tuple[str, ...]
    """Per compared variant, its change of the case, in words."""
    incomparable: tuple[Incomparable, ...]
    differences: tuple[Difference, ...]
    triggered: tuple[str, ...] = ()
    """Names of the rules that applied in a compared run; only these rules were tested."""


def equivalent(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    relations: str | Iterable[str] = "rotation",
    simulator: Simulator | None = None,
) -> Comparison:
    """Raise an error if the status of a rule differs between equivalent scenarios.

    Args:
        case: the case whose variants are compared with it.
        rules: a rulebook, rules, or both; of a rulebook, only the rules about this kind of junction.
        relations: how the case is changed, by one or several of ``rotation`` (all vehicles start at other arms, as in the paper's
            structural equivalence), ``creation`` (reverse order of creation), ``renaming`` (other names of vehicles), ``motion``
            (a translated and rotated map), ``mirror`` (a mirrored map), ``approach`` (all vehicles start farther away).
        simulator: the simulator of the runs, as for `simulate`.

    Returns:
        The compared variants, and the variants that can't be compared.

    Raises:
        MetamorphicViolation: a rule has different statuses on two runs; the note of the error shows the runs side by side.
        ScenarioError: a relation is unknown, no variant can be compared, or no rule applied.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "equivalent takes a rvads.Case(scenario, driver)", ScenarioError)
    comparison = compare(case, rules, relations=relations, simulator=simulator)
    if comparison.differences:
        first, *more = comparison.differences
        error = MetamorphicViolation(f"{first} in {case.scenario.name}" + (f" (the first of {len(more) + 1})" if more else ""))
        error.add_note(first.table)
        raise error
    if not comparison.compared:
        reasons = "; ".join(f"{item.what}: {item.why}" for item in comparison.incomparable)
        raise ScenarioError(f"no scenario is equivalent to {case.scenario.name}, so nothing was compared: {reasons}")
    if not comparison.triggered:
        raise ScenarioError(f"no rule applied in {case.scenario.name} or in an equivalent scenario, so nothing was tried")
    return comparison


def compare(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    relations: str | Iterable[str] = "rotation",
    simulator: Simulator | None = None,
) -> Comparison:
    """Compare the verdicts on a case with the verdicts on its variants as `equivalent` does, and return the differences."""
    checked_rules = rules_for(rules, case.scenario.place)
    names = (relations,) if isinstance(relations, str) else tuple(relations)
    for name in names:
        if name not in RELATIONS:
            raise ScenarioError(f"unknown relation {name!r}, there are {', '.join(RELATIONS)}{suggest(name, RELATIONS)}")
    variants = [variant for name in names for variant in RELATIONS[name](case)]
    usable = [v for v in variants if isinstance(v, Variant)]
    base_run, before = judged(case, checked_rules, simulator) if usable else (None, {})
    compared, differences = [], []
    triggered: dict[str, None] = {}
    for variant in usable:
        common_rules = [rule for rule in checked_rules if variant.concerns(rule)]
        if not common_rules or base_run is None:
            continue
        run, after = judged(variant.case, common_rules, simulator)
        compared.append(variant.what)
        for rule in common_rules:
            verdict_before, verdict_after = before[rule.name], after[rule.name]
            if {verdict_before.status, verdict_after.status} != {Status.NA}:
                triggered[rule.name] = None
            if verdict_before.status is not verdict_after.status:
                table = side_by_side(base_run, verdict_before, run, verdict_after, variant.image, variant.what)
                differences.append(Difference(variant.what, verdict_before, verdict_after, table))
    without_rules = tuple(
        Incomparable(v.what, "the rules name left and right")
        for v in usable
        if not any(v.concerns(rule) for rule in checked_rules)
    )
    incomparable = without_rules + tuple(v for v in variants if isinstance(v, Incomparable))
    return Comparison(tuple(compared), incomparable, tuple(differences), tuple(triggered))


def judged(case: Case, rules: Iterable[Rule], simulator: Simulator | None = None) -> tuple[Run, dict[str, Verdict]]:
    """Return the run of a case, and the verdict of each rule by name."""
    run = simulate(case, simulator)
    verdicts = {rule.name: check(run, rule) for rule in rules}
    for verdict in verdicts.values():
        if verdict.status is Status.ERROR:
            raise RunError(f"{run.label} can't be judged by {verdict.rule}, so nothing can be compared: {verdict.reason}")
    return run, verdicts


def side_by_side(run: Run, first: Verdict, other_run: Run, second: Verdict, image: Sequence[int], what: str) -> str:
    """Return a text table of two runs with a row per agent of `run` and the corresponding agent of `other_run`."""
    columns: dict[int, list[int]] = {}
    for k, agent in enumerate(other_run.agents):
        columns.setdefault(agent.entrance, []).append(k)
    named = {agent.name: k for k, agent in enumerate(other_run.agents)}
    rows = [
        ("", "first run", what),
        ("scenario", run.label, other_run.label),
        (first.rule, str(first.status), str(second.status)),
    ]
    for k, agent in enumerate(run.agents):
        other = columns[image[agent.entrance]].pop(0) if agent.entrance < len(image) else named[agent.name]
        rows.append(("pedestrian" if agent.kind is Kind.PEDESTRIAN else "vehicle", _fate(run, k), _fate(other_run, other)))
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"{a:{widths[0]}}  {b:{widths[1]}}  {c}".rstrip() for a, b, c in rows]
    lines += [f"{name:{widths[0]}}  {text}" for name, text in (("first run", first.message), (what, second.message))]
    return "\n".join(lines)


def _fate(run: Run, column: int) -> str:
    agent = run.agents[column]
    events = []
    for word, zone in (("arrives", Zone.ENTRANCE), ("enters", Zone.JUNCTION), ("leaves", Zone.EXIT)):
        reached = np.flatnonzero(run.zone[:, column] >= zone)
        events.append(f"{word} {reached[0] * run.dt:.2f} s" if len(reached) else f"never {word}")
    return f"{agent.name} {agent.entrance}->{agent.exit}: {', '.join(events)}"


def rational(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    farther: Sequence[float] = FARTHER,
    simulator: Simulator | None = None,
) -> None:
    """Raise an error if a rule passes in a case, but fails if the vehicles start farther away with the same speeds.

    Args:
        case: the case.
        rules: a rulebook, rules, or both.
        farther: additional distances of all vehicles to the stopping line [m], tried in this order.
        simulator: the simulator of the runs, as for `simulate`.

    Raises:
        MetamorphicViolation: a PASS turns into FAIL or OPEN.
        ScenarioError: no rule passes in the case, or the approaches are too short.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "rational takes a rvads.Case(scenario, driver)", ScenarioError)
    checked_rules = rules_for(rules, case.scenario.place)
    run, before = judged(case, checked_rules, simulator)
    passing = [rule for rule in checked_rules if before[rule.name].status is Status.PASS]
    if not passing:
        statuses = ", ".join(f"{name} {verdict.status}" for name, verdict in before.items())
        raise ScenarioError(f"no rule passes in {case.scenario.name} ({statuses}), so nothing follows for greater distances")
    for more in farther:
        farther_case = case.but(distance=[d + more for d in case.scenario.distances])
        farther_run, after = judged(farther_case, passing, simulator)
        for rule in passing:
            if after[rule.name].status in _BAD:
                what = f"{more:g} m farther away"
                raise _violation(run, before[rule.name], farther_run, after[rule.name], what)


def determinate(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    at: float = 1.0,
    tolerance: float = 0.5,
    simulator: Simulator | None = None,
) -> None:
    """Raise an error if vehicles drive differently when a run is restarted from its state at time `at`.

    The second run starts with the positions and speeds of the first run at time `at`. Its autopilots don't remember what happened
    earlier, so the check fails if this memory matters. Each rule must have the same status on the two runs. All vehicles must
    enter the junction in the same order and at the same times, up to `tolerance`.

    Args:
        case: the case of the first run, at a junction without lights, because a second run would begin with the first phase.
        rules: a rulebook, rules, or both.
        at: time at which the second run starts [s]; all vehicles must still be before their stopping lines.
        tolerance: largest difference between the entry times of a vehicle in the two runs [s]; a difference arises because the
            second run begins without acceleration or braking.
        simulator: the simulator of the runs, as for `simulate`.

    Raises:
        MetamorphicViolation: a status, the order of the entries or an entry time differs.
        ScenarioError: the junction has lights, the scenario has followers or pedestrians, a vehicle is past its line or gone at
            time `at`, or no vehicle crosses the junction in the run.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "determinate takes a rvads.Case(scenario, driver)", ScenarioError)
    junction = case.scenario.place
    if junction.phase_groups:
        raise ScenarioError(
            f"a run at {junction.name} can't be restarted: its lights would start anew; choose a junction without lights"
        )
    if case.scenario.followers:
        raise ScenarioError(f"{case.scenario.name} can't be restarted: followers always start at a fixed gap; choose followers=0")
    if case.scenario.pedestrians:
        raise ScenarioError(
            f"{case.scenario.name} can't be restarted: its pedestrians would start anew; choose a scenario without pedestrians"
        )
    checked_rules = rules_for(rules, junction)
    run, before = judged(case, checked_rules, simulator)
    if not crossed(run):
        raise ScenarioError(f"the run of {case.scenario.name} shows no crossing, so its continuation can't be compared")
    continuation, after = judged(_restarted_case(case, run, at), checked_rules, simulator)
    what = f"restarted at {at:g} s"
    for rule in checked_rules:
        if before[rule.name].status is not after[rule.name].status:
            raise _violation(run, before[rule.name], continuation, after[rule.name], what)
    entries = []
    for one, since in ((run, 0.0), (continuation, at)):
        times = [one.entry(k) for k in range(len(one.agents))]
        never = one.duration + since + 1.0
        entries.append([(never if t is None else round(t + since, 9), a.name) for t, a in zip(times, one.agents, strict=True)])
    first, second = entries
    shifted = any(abs(time - other) > tolerance for (time, _), (other, _) in zip(first, second, strict=True))
    if shifted or [name for _, name in sorted(first)] != [name for _, name in sorted(second)]:
        rule = checked_rules[0]
        raise _violation(run, before[rule.name], continuation, after[rule.name], what, "who enters when")


def _restarted_case(case: Case, run: Run, at: float) -> Case:
    """Return a case whose vehicles start with their positions and speeds in a run at time `at` [s]."""
    scenario, tick = case.scenario, round(at / DT)
    if run.station is None or run.speed is None:
        raise RunError(f"the run {run.label} has no positions or no speeds")
    if not 0 < tick < run.steps:
        raise ScenarioError(f"the run lasts {run.duration:.2f} s, so it can't be restarted at {at!r} s")
    distances, speeds = [0.0] * len(scenario.directions), [0.0] * len(scenario.directions)
    for k, agent in enumerate(run.agents):
        remaining = -scenario.place.setbacks[agent.entrance] - float(run.station[tick, k])
        if run.zone[tick, k] > Zone.ENTRANCE or remaining < 0:
            raise ScenarioError(f"{agent.name} is past the stopping line at {at:g} s: restart the run earlier")
        distances[agent.entrance], speeds[agent.entrance] = remaining, max(float(run.speed[tick, k]), 0.0)
    back = -scenario.rotation
    return case.but(
        distance=rotate(tuple(distances), back),
        speed=rotate(tuple(speeds), back),
        duration=max(scenario.duration - at, DT),
    )


def _violation(
    run: Run, verdict: Verdict, other_run: Run, other_verdict: Verdict, what: str, broken: str | None = None
) -> MetamorphicViolation:
    change = f"changes {broken}" if broken else f"turns {verdict.rule} from {verdict.status} into {other_verdict.status}"
    error = MetamorphicViolation(f"{what}: {change} in {run.label}")
    error.add_note(side_by_side(run, verdict, other_run, other_verdict, range(len(run.junction.entrances)), what))
    return error
