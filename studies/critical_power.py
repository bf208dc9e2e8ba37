"""Which deficiencies and mutants do critical starts find, after how many runs, and by which rule?

A driver is found at a start at which the driver breaks a rule, and at which the driver without the fault keeps the rule. The
lines come from the junctions in turn; the search of a line is not cut short.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product, zip_longest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.starts.critical import critical_starts
from pytest_rvads.satellites.starts.lines import Begin, Fault, Line, Setting, fault_of, lines_at
from pytest_rvads.scenarios.scenario import Scenario
from studies.detection import DEFICIENCIES, autopilot
from studies.mutants import MUTANTS

JUNCTIONS = ("stop4", "light4", "yield4", "right4")
"""Where mutants are tried."""
TRAFFIC = ("reference", "lgsvl")
"""The drivers of the other vehicle; the second, which goes out of turn, only for a mutant that the first does not expose."""
_BY_NUMBER = ("I2", "lowest number first")
"""The drivers that tell lines apart which are equal up to a rotation."""


@dataclass(frozen=True, slots=True)
class Find:
    """What critical starts find of a driver."""

    driver: str
    runs: int
    """Runs until a rule was broken; all runs if no rule was broken."""
    rules: tuple[str, ...]
    """The rules that were broken first, at the starts of one side of a line; empty if no rule was broken."""
    safety_runs: int
    """Runs until a rule about other vehicles was broken; all runs if no such rule was broken."""
    safety_rules: tuple[str, ...]
    line: Line | None
    """The line on which the safety rules were broken, or else the rules."""
    traffic: str = "reference"
    """The driver of the other vehicle; the LGSVL-like autopilot with a deficiency drives both vehicles."""


def found_by(name: str) -> Find:
    """Return what critical starts find of the deficiency or the mutant with a name."""
    runs, first = 0, Find(name, 0, (), 0, (), None)
    for traffic, line in product(TRAFFIC if name in MUTANTS else TRAFFIC[:1], _lines(name)):
        if first.rules and traffic != first.traffic:
            break
        faulty, sound = settings(name, traffic)
        for side in critical_starts([[line]], faulty, executor=1):
            runs += len(side.tried)
            broken = dict.fromkeys(
                rule
                for start in side.tried
                if start.failed()
                for rule in kept_by(sound, line.scenario(start.lead), [rule for rule, _ in start.failed()])
            )
            if not broken:
                continue
            first = first if first.rules else replace(first, runs=runs, rules=tuple(broken), line=line, traffic=traffic)
            if safety := safety_rules(broken):
                return replace(first, safety_runs=runs, safety_rules=safety, line=line)
    return replace(first, runs=first.runs or runs, safety_runs=runs)


def safety_rules(rules: Iterable[str]) -> tuple[str, ...]:
    """Return the rules that are about other vehicles."""
    return tuple(rule for rule in rules if fault_of(rule) is Fault.BOLD)


def junctions_of(name: str) -> Sequence[str]:
    """Return the junctions at which the fault of a deficiency or a mutant can show."""
    return JUNCTIONS if name in MUTANTS else (DEFICIENCIES[name],)


def settings(name: str, traffic: str = TRAFFIC[0]) -> tuple[Setting, Setting]:
    """Return the setting of the driver with the fault, and the setting of the driver without the fault.

    The LGSVL-like autopilot schedules both vehicles. A mutant drives the subject among traffic.
    """
    rules = rules_for(("paper", "road"))
    if name in MUTANTS:
        return Setting.of(MUTANTS[name], rules, traffic), Setting.of(Reference, rules, traffic)
    return Setting.of(autopilot(name), rules, traffic=None), Setting.of(autopilot(None), rules, traffic=None)


def kept_by(sound: Setting, scenario: Scenario, rules: Collection[str]) -> list[str]:
    """Return the rules that the driver without the fault keeps in a scenario."""
    _, verdicts = sound.judged(scenario)
    return [verdict.rule for verdict in verdicts if verdict.rule in rules and not verdict.outcome.bad]


def _lines(name: str) -> Iterator[Line]:
    """Yield the lines on which a driver is tried, from its junctions in turn; those from rest and on red come last.

    Of lines that are equal up to a rotation, only the first is tried, unless the driver goes by the numbers of the entrances.
    """
    groups = [lines_at(find(junction)) for junction in junctions_of(name)]
    most = max(len(group) for g in groups for group in g) if name in _BY_NUMBER else 1
    for moves in (True, False):
        for number in range(most):
            lines = [[group[number] for group in g if number < len(group) and _moves(group[0]) is moves] for g in groups]
            yield from (line for line in chain.from_iterable(zip_longest(*lines)) if line is not None)


def _moves(line: Line) -> bool:
    """Return whether both vehicles move at the starts of a line, and the subject does not turn on red."""
    return line.begin is Begin.MOVING
