"""Whether two simulators tell the same: verdicts, order of entry, collisions, and by how much their times differ."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors import Progress, spread
from studies.killing import killed_by

_SIMULATING = "simulating"
"""What a simulator that can't simulate a case is judged by in place of rules."""
Entries = Mapping[str, tuple[float | None, float | None]]
"""Per vehicle when it enters the junction, in the one run and in the other [s]; None: never."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A case and what its runs are judged by."""

    case: Case
    rules: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name of its scenario."""
        return self.case.scenario.name


@dataclass(frozen=True, slots=True)
class Mutant:
    """A mutant of the reference autopilot; what comes out is which rules and relations kill it."""

    name: str


@dataclass(frozen=True, slots=True)
class _Told:
    """What one simulator says of a case."""

    statuses: Mapping[str, str]
    entries: Mapping[str, float | None] = field(default_factory=dict)
    touched: tuple[tuple[str, str], ...] = ()
    """Who collided."""
    impact: float | None = None
    """When the first collision was [s]."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What two simulators say of one case."""

    name: str
    statuses: Mapping[str, tuple[str, str]]
    """By rule: what both make of it; of a mutant, what kills it. Where a simulator can't simulate the case, why."""
    entries: Entries
    touched: tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]
    """Who collided in the one run and in the other."""
    impacts: tuple[float | None, float | None]
    """When the first collision was [s]."""

    @property
    def same_order(self) -> bool:
        """Whether every two vehicles enter in the same order, or together, in both."""
        return same_order(self.entries)

    @property
    def same(self) -> bool:
        """Whether all outcomes are the same; times may differ."""
        return all(a == b for a, b in self.statuses.values()) and self.same_order and self.touched[0] == self.touched[1]

    @property
    def shifts(self) -> list[float]:
        """By how much entry times differ, of vehicles that enter in both [s]."""
        return [abs(a - b) for a, b in self.entries.values() if a is not None and b is not None]


def same_order(entries: Entries) -> bool:
    """Return whether every two vehicles enter in the same order, or together, in two runs; who never enters comes last."""
    return all(_sign(entries[a][0], entries[b][0]) == _sign(entries[a][1], entries[b][1]) for a, b in combinations(entries, 2))


def agree(
    simulators: tuple[str, str],
    trials: Sequence[Trial | Mutant],
    *,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> Iterator[Agreement]:
    """Yield what two simulators say of every case, in order."""
    return spread(partial(_both, simulators), trials, executor, progress, batch=1)


def differences(found: Agreement, simulators: tuple[str, str]) -> list[str]:
    """Return a line for every outcome that is not the same, and for a case that neither can simulate."""
    one, two = simulators
    lines = [f"{found.name}: {_SIMULATING} is {why} by both" for why in _by_neither(found)]
    lines += [f"{found.name}: {rule} is {a} by {one}, {b} by {two}" for rule, (a, b) in found.statuses.items() if a != b]
    if not found.same_order:
        times = ", ".join(f"{name} {_time(a)} and {_time(b)}" for name, (a, b) in found.entries.items())
        lines.append(f"{found.name}: another order of entry by {one} and {two}, {times}")
    if found.touched[0] != found.touched[1]:
        told = " and ".join(f"{_pairs(pairs)} by {name}" for pairs, name in zip(found.touched, simulators, strict=True))
        lines.append(f"{found.name}: collided {told}")
    return lines


def text_agreements(sets: Mapping[str, Sequence[Agreement]], simulators: tuple[str, str]) -> str:
    """Return a Markdown table with a row per set of cases, and below it a list of outcomes that differ.

    Times are those of the runs, in seconds; their differences are of vehicles that enter, and of runs that collide, in both.
    """
    lines = [
        f"| {' and '.join(simulators)} | runs | same verdicts | same order of entry | same collisions | entry times differ by "
        "at most, on average [s] | impacts by at most [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, found in sets.items():
        lines.append(f"| {name} | {len(found)} | {' | '.join(_row(found))} |")
    told = [f"- {line}" for found in sets.values() for one in found for line in differences(one, simulators)]
    return "\n".join([*lines, *(["", *told] if told else [])])


def _row(found: Sequence[Agreement]) -> Iterator[str]:
    cells = [pair for one in found if not _by_neither(one) for pair in one.statuses.values()]
    yield f"{sum(a == b for a, b in cells)} of {len(cells)}"
    driven = [one for one in found if one.entries]
    yield f"{sum(one.same_order for one in driven)} of {len(driven)}" if driven else ""
    collided = [one for one in driven if any(one.touched)]
    yield f"{sum(one.touched[0] == one.touched[1] for one in collided)} of {len(collided)}" if collided else ""
    shifts = [shift for one in found for shift in one.shifts]
    yield f"{max(shifts):.2f}, {math.fsum(shifts) / len(shifts):.4f}" if shifts else ""
    impacts = [abs(a - b) for a, b in (one.impacts for one in collided) if a is not None and b is not None]
    yield f"{max(impacts):.2f}" if impacts else ""


def _both(simulators: tuple[str, str], trial: Trial | Mutant) -> Agreement:
    one, two = (_told(trial, simulator) for simulator in simulators)
    # A simulator that can't simulate a case says nothing of its rules.
    rules = dict.fromkeys([*one.statuses, *two.statuses])
    return Agreement(
        trial.name,
        {rule: (one.statuses.get(rule, "nothing"), two.statuses.get(rule, "nothing")) for rule in rules},
        {name: (one.entries.get(name), two.entries.get(name)) for name in dict.fromkeys([*one.entries, *two.entries])},
        (one.touched, two.touched),
        (one.impact, two.impact),
    )


def _told(trial: Trial | Mutant, simulator: str) -> _Told:
    try:
        if isinstance(trial, Mutant):
            killing = killed_by(trial.name, simulator)
            return _Told({"rules": _listed(killing.rules), "relations": _listed(killing.relations)})
        run = simulate(trial.case, named(simulator))
        statuses = {rule: _word(check(run, rule)) for rule in trial.rules}
    except RvadsError as error:
        return _Told({_SIMULATING: f"refused ({error})"})
    if run.fault is not None:
        statuses["fault"] = run.fault.reason
    collisions = sorted(run.collisions or (), key=lambda collision: collision.time)
    return _Told(
        statuses,
        {agent.name: run.entry(column) for column, agent in enumerate(run.agents)},
        tuple(sorted(collision.agents for collision in collisions)),
        collisions[0].time if collisions else None,
    )


def _by_neither(found: Agreement) -> list[str]:
    """Return why neither simulator can simulate a case, if they say the same."""
    one, two = found.statuses.get(_SIMULATING, ("", ""))
    return [one] if one and one == two else []


def _word(verdict: Verdict) -> str:
    """Return the status, or why it is not held against anybody."""
    return "UNAVOIDABLE" if verdict.unavoidable else "PROVOKED" if verdict.provoked else str(verdict.status)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    return ", ".join(" with ".join(pair) for pair in pairs) or "nobody"


def _sign(one: float | None, two: float | None) -> int:
    first, second = (math.inf if entry is None else entry for entry in (one, two))
    return (first > second) - (first < second)


def _time(entry: float | None) -> str:
    return "never" if entry is None else f"{entry:.2f} s"
