"""Metamorphic checks: runs that have to be judged alike, whatever the verdicts are (paper, section 5.2).

The only oracle is that two scenarios are equivalent: a controller that passes the first scenario and fails the second is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pytest_rvads.errors import MetamorphicViolation, RunError, ScenarioError, require, suggest
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.search.relations import RELATIONS, Incomparable, Variant
from pytest_rvads.search.sidebyside import side_by_side
from pytest_rvads.simulators.simulator import Simulator, simulate

__all__ = ["Comparison", "Difference", "compare", "equivalent", "judged"]


@dataclass(frozen=True, slots=True)
class Difference:
    """Two runs that a rule does not judge alike."""

    what: str
    """What was changed between them."""
    one: Verdict
    other: Verdict
    table: str
    """Both runs, side by side."""

    def __str__(self) -> str:
        return f"{self.what} turns {self.one.rule} from {self.one.status} into {self.other.status}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """What was compared, and what was found."""

    compared: tuple[str, ...]
    incomparable: tuple[Incomparable, ...]
    differences: tuple[Difference, ...]
    triggered: tuple[str, ...] = ()
    """Rules that applied in a run that was compared; only these were tried."""


def equivalent(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    relations: str | Iterable[str] = "rotation",
    simulator: Simulator | None = None,
) -> Comparison:
    """Require that equivalent scenarios are judged alike; statuses are compared, not who goes first.

    Args:
        case: the case to begin with.
        rules: a rulebook, rules, or both; of a rulebook those about this kind of junction.
        relations: one or several of ``rotation`` (the members of the structural equivalence class), ``creation`` (order of
            creation), ``renaming`` (names of the agents), ``motion`` (the map translated and rotated), ``mirror`` (the map in a
            mirror), ``approach`` (all vehicles start farther away).
        simulator: what makes the runs, as for `simulate`.

    Returns:
        What was compared, and what could not be.

    Raises:
        MetamorphicViolation: two runs are judged differently; its note shows them side by side.
        ScenarioError: an unknown relation, nothing that could be compared, or no rule that applied.
        RunError: a run ended by a fault.
    """
    __tracebackhide__ = True
    require(case, Case, "equivalent takes a rvads.Case(scenario, driver)", ScenarioError)
    found = compare(case, rules, relations=relations, simulator=simulator)
    if found.differences:
        first, *more = found.differences
        error = MetamorphicViolation(f"{first} in {case.scenario.name}" + (f" (the first of {len(more) + 1})" if more else ""))
        error.add_note(first.table)
        raise error
    if not found.compared:
        reasons = "; ".join(f"{item.what}: {item.why}" for item in found.incomparable)
        raise ScenarioError(f"nothing is equivalent to {case.scenario.name}, so nothing was compared: {reasons}")
    if not found.triggered:
        raise ScenarioError(f"no rule applied in {case.scenario.name}, nor in what is equivalent to it, so nothing was tried")
    return found


def compare(
    case: Case,
    rules: str | Rule | Sequence[str | Rule] = "paper",
    *,
    relations: str | Iterable[str] = "rotation",
    simulator: Simulator | None = None,
) -> Comparison:
    """Compare like `equivalent`, and return the differences instead of raising."""
    chosen = rules_for(rules, case.scenario.place)
    variants = [variant for name in _known(relations) for variant in RELATIONS[name](case)]
    usable = [v for v in variants if isinstance(v, Variant)]
    base, before = judged(case, chosen, simulator) if usable else (None, {})
    compared, differences = [], []
    triggered: dict[str, None] = {}
    for variant in usable:
        same = [rule for rule in chosen if variant.concerns(rule)]
        if not same or base is None:
            continue
        run, after = judged(variant.case, same, simulator)
        compared.append(variant.what)
        for rule in same:
            one, other = before[rule.name], after[rule.name]
            if {one.status, other.status} != {Status.NA}:
                triggered[rule.name] = None
            if one.status is not other.status:
                table = side_by_side(base, one, run, other, variant.image, variant.what)
                differences.append(Difference(variant.what, one, other, table))
    mute = tuple(
        Incomparable(v.what, "the rules name left and right") for v in usable if not any(v.concerns(rule) for rule in chosen)
    )
    incomparable = mute + tuple(v for v in variants if isinstance(v, Incomparable))
    return Comparison(tuple(compared), incomparable, tuple(differences), tuple(triggered))


def judged(case: Case, rules: Iterable[Rule], simulator: Simulator | None = None) -> tuple[Run, dict[str, Verdict]]:
    """Simulate and judge.

    Raises:
        RunError: the run ended by a fault.
    """
    run = simulate(case, simulator)
    verdicts = {rule.name: check(run, rule) for rule in rules}
    for verdict in verdicts.values():
        if verdict.status is Status.ERROR:
            raise RunError(f"{run.label} can't be judged by {verdict.rule}, so nothing follows from it: {verdict.reason}")
    return run, verdicts


def _known(relations: str | Iterable[str]) -> tuple[str, ...]:
    names = (relations,) if isinstance(relations, str) else tuple(relations)
    for name in names:
        if name not in RELATIONS:
            raise ScenarioError(f"unknown relation {name!r}, there are {', '.join(RELATIONS)}{suggest(name, RELATIONS)}")
    return names
