"""`rvads rules check`: checks whether vehicles can obey rules in all scenarios of a junction and all orders of arrival."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.orbits import Directions, Orbits, rotate
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.abstraction import Model, weak_orders
from pytest_rvads.search.consistency import core, decide
from pytest_rvads.search.remap import rotations_of
from pytest_rvads.support.errors import ScenarioError

__all__ = ["Contradiction", "Survey", "show", "show_order", "survey"]

APART = 60.0
"""Time between two arrivals of different rank [s], longer than any tie window."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """An abstract scenario and an order of arrival in which the vehicles can't obey the rules."""

    directions: Directions
    arrivals: tuple[float, ...]
    """Arrival time of the vehicle at each occupied entrance [s]."""
    rules: tuple[str, ...]
    """A minimal set of contradicting rules: vehicles can keep the set as soon as any rule of the set is dropped."""


@dataclass(frozen=True, slots=True)
class Survey:
    """The checked scenarios and orders of arrival, and the contradictions."""

    junction: Junction
    rules: tuple[Rule, ...]
    scenarios: int
    orders: int
    """Number of orders of arrival per scenario."""
    contradictions: tuple[Contradiction, ...]


def survey(
    place: Junction,
    rules: Sequence[Rule],
    *,
    scenarios: Sequence[Directions] | None = None,
    arrivals: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Survey:
    """Find the scenarios and orders of arrival in which no behaviour satisfies all rules and lets all vehicles pass.

    Args:
        place: the junction.
        rules: the rules; rules about other kinds of junctions are ignored.
        scenarios: abstract scenarios; by default all scenarios with a vehicle on each arm.
        arrivals: arrival time of the vehicle at each entrance [s]; all weak orders by default.
        progress: called with the number of finished pairs and the number of all pairs.

    Raises:
        ScenarioError: the number of arrivals is not the number of entrances.
        FormulaError: a rule can't be monitored.
    """
    count = len(place.entrances)
    chosen = list(Orbits.at(place).every()) if scenarios is None else list(scenarios)
    if arrivals is not None and len(arrivals) != count:
        raise ScenarioError(f"arrivals needs one time per entrance ({count}), got {len(arrivals)}: {tuple(arrivals)!r}")
    turns = [symmetry.rows for symmetry in rotations_of(place)]
    contradicting: dict[tuple[Directions, tuple[float, ...]], tuple[str, ...]] = {}
    contradictions = []
    pairs = [(code, times) for code in chosen for times in _arrival_patterns(code, arrivals)]
    for done, (code, times) in enumerate(pairs, start=1):
        key = min((rotate(code, r), rotate(times, r)) for r in turns)
        if key not in contradicting:
            contradicting[key] = _contradicting_rules(place, rules, *key)
        if contradicting[key]:
            present = tuple(time for time, direction in zip(times, code, strict=True) if direction)
            contradictions.append(Contradiction(code, present, contradicting[key]))
        if progress:
            progress(done, len(pairs))
    return Survey(place, tuple(rules), len(chosen), len(pairs) // len(chosen), tuple(contradictions))


def _arrival_patterns(code: Directions, arrivals: Sequence[float] | None) -> Iterator[tuple[float, ...]]:
    """Yield patterns of arrival times per entrance [s]; the time of an empty entrance is 0."""
    if arrivals is not None:
        yield tuple(time if direction else 0.0 for time, direction in zip(arrivals, code, strict=True))
        return
    for ranks in weak_orders(sum(map(bool, code))):
        remaining = iter(ranks)
        yield tuple(APART * next(remaining) if direction else 0.0 for direction in code)


def _contradicting_rules(place: Junction, rules: Sequence[Rule], code: Directions, times: tuple[float, ...]) -> tuple[str, ...]:
    agents = Scenario(place, code).agents()
    model = Model(place, agents, [times[a.entrance] for a in agents])
    if decide(model, rules).possible:
        return ()
    return tuple(rule.name for rule in core(model, rules))


def show(result: Survey) -> str:
    """Return the findings as text, with a line per set of contradicting rules."""
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
        lines.append(f"  {' + '.join(rules):20}  arrival {_first_of(orders, 'orders')}; scenario {_first_of(codes, 'scenarios')}")
    return "\n".join(lines)


def _first_of(texts: Sequence[str], plural: str) -> str:
    return texts[0] if len(texts) == 1 else f"{texts[0]} and {len(texts) - 1} more {plural}"


def show_order(contradiction: Contradiction) -> str:
    """Return the order of arrival of a contradiction by entrances, such as ``0 = 2 < 1``."""
    entrances = [e for e, direction in enumerate(contradiction.directions) if direction]
    times = sorted(set(contradiction.arrivals))
    groups = [" = ".join(str(e) for e, t in zip(entrances, contradiction.arrivals, strict=True) if t == time) for time in times]
    return " < ".join(groups)
