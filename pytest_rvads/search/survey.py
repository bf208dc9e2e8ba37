"""`rvads rules check`: rules against all scenarios of a junction and all orders of arrival."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.orbits import Directions, Orbits, rotate
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.abstraction import Model, weak_orders
from pytest_rvads.search.consistency import core, decide
from pytest_rvads.search.symmetry import rotations_of

__all__ = ["Contradiction", "Survey", "show", "show_order", "survey"]

APART = 60.0
"""Between two arrivals of different rank; longer than any tie window [s]."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """An abstract scenario and an order of arrival in which nobody can obey."""

    directions: Directions
    arrivals: tuple[float, ...]
    """When the vehicle at each occupied entrance arrives [s]."""
    rules: tuple[str, ...]
    """A minimal set of contradicting rules: vehicles can keep the set as soon as any rule of the set is dropped."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What was looked at, and what was found."""

    junction: Junction
    rules: tuple[Rule, ...]
    scenarios: int
    orders: int
    """Orders of arrival per scenario."""
    contradictions: tuple[Contradiction, ...]


def survey(
    place: Junction,
    rules: Sequence[Rule],
    *,
    scenarios: Sequence[Directions] | None = None,
    arrivals: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Survey:
    """Look for scenarios and orders of arrival in which no behaviour satisfies all rules and lets everyone through.

    Args:
        place: the junction.
        rules: those about another kind of junction don't count.
        scenarios: abstract scenarios; by default all full ones, with one vehicle on each arm.
        arrivals: when the vehicle at each entrance arrives [s]; all weak orders by default.
        progress: called with the number of pairs done and their total.

    Raises:
        ScenarioError: another number of arrivals than of entrances.
        FormulaError: a rule that can't be monitored.
    """
    count = len(place.entrances)
    chosen = list(Orbits.at(place).every()) if scenarios is None else list(scenarios)
    if arrivals is not None and len(arrivals) != count:
        raise ScenarioError(f"arrivals needs one time per entrance ({count}), got {len(arrivals)}: {tuple(arrivals)!r}")
    turns = [symmetry.rows for symmetry in rotations_of(place)]
    known: dict[tuple[Directions, tuple[float, ...]], tuple[str, ...]] = {}
    found = []
    pairs = [(code, times) for code in chosen for times in _patterns(code, arrivals)]
    for done, (code, times) in enumerate(pairs, start=1):
        key = min((rotate(code, r), rotate(times, r)) for r in turns)
        if key not in known:
            known[key] = _contradiction(place, rules, *key)
        if known[key]:
            present = tuple(time for time, direction in zip(times, code, strict=True) if direction)
            found.append(Contradiction(code, present, known[key]))
        if progress:
            progress(done, len(pairs))
    return Survey(place, tuple(rules), len(chosen), len(pairs) // len(chosen), tuple(found))


def _patterns(code: Directions, arrivals: Sequence[float] | None) -> Iterator[tuple[float, ...]]:
    """Yield arrival times per entrance, 0 where nobody comes [s]."""
    if arrivals is not None:
        yield tuple(time if direction else 0.0 for time, direction in zip(arrivals, code, strict=True))
        return
    for ranks in weak_orders(sum(map(bool, code))):
        rest = iter(ranks)
        yield tuple(APART * next(rest) if direction else 0.0 for direction in code)


def _contradiction(place: Junction, rules: Sequence[Rule], code: Directions, times: tuple[float, ...]) -> tuple[str, ...]:
    agents = Scenario(place, code).agents()
    model = Model(place, agents, [times[a.entrance] for a in agents])
    if decide(model, rules).possible:
        return ()
    return tuple(rule.name for rule in core(model, rules))


def show(result: Survey) -> str:
    """Return the findings as text, those of the same rules and order of arrival together."""
    names = " ".join(rule.name for rule in result.rules if rule.concerns(result.junction))
    pairs = result.scenarios * result.orders
    head = f"{result.junction.name}: {names}: {result.scenarios} scenarios x {result.orders} orders of arrival"
    if not result.contradictions:
        return f"{head}: nothing contradicts itself"
    lines = [f"{head}: in {len(result.contradictions)} of {pairs} no behaviour obeys and lets everyone through"]
    for rules, group in groupby(sorted(result.contradictions, key=lambda c: c.rules), key=lambda c: c.rules):
        members = list(group)
        orders = list(dict.fromkeys(map(show_order, members)))
        codes = list(dict.fromkeys(label(m.directions, result.junction.lanes) for m in members))
        lines.append(f"  {' + '.join(rules):20}  arrival {_some(orders, 'orders')}; scenario {_some(codes, 'scenarios')}")
    return "\n".join(lines)


def _some(found: Sequence[str], what: str) -> str:
    return found[0] if len(found) == 1 else f"{found[0]} and {len(found) - 1} more {what}"


def show_order(found: Contradiction) -> str:
    """Return the order of arrival by entrances: ``0 = 2 < 1``."""
    entrances = [e for e, direction in enumerate(found.directions) if direction]
    times = sorted(set(found.arrivals))
    together = [" = ".join(str(e) for e, t in zip(entrances, found.arrivals, strict=True) if t == time) for time in times]
    return " < ".join(together)
