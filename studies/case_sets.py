"""Sets of cases on which simulators are compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice, product
from pathlib import Path

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.readers import read_recorded
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.paper.tables import TABLES, Setup, entries
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import Orbits
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario
from studies.agreement import Mutant, Trial
from studies.contact_cases import contact_cases
from studies.mutants import MUTANTS
from studies.predicted import site_of
from studies.requests import RULES

LETTERS = "ABCDEFGHIJ"
"""All configurations of the paper."""


def paper_trials() -> Iterator[Trial]:
    """Yield the runs of the paper's tables, with the rules of their cells."""
    setup = Setup()
    for table in TABLES:
        for entry in entries(table):
            yield Trial(Case(entry.scenario(setup.wait), setup.system()), table.rules)


def class_trials(junctions: Sequence[str], letters: str = LETTERS, most: int | None = None) -> Iterator[Trial]:
    """Yield the reference autopilot in every class, judged by the rules of the paper and of the road.

    Args:
        most: classes of a junction, evenly from all; None for every one.
    """
    for name in junctions:
        place = find(name)
        for code, letter in product(_representatives(place, most), letters):
            point = configuration(letter, len(code))
            scenario = Scenario(place, code, distance=point.distances, speed=point.speeds, configuration=letter)
            yield Trial(Case(scenario, Reference), _all_rules(place))


def recorded_trials(path: str | Path) -> Iterator[Trial]:
    """Yield the predictions of a recorded file, see `predicted.compare`."""
    for run in read_recorded(path):
        yield Trial(Case(site_of(run), LgsvlLike), RULES[run.junction.control])


def contact_trials() -> Iterator[Trial]:
    """Yield the cases in which vehicles touch, judged by the rules of the road."""
    for case in contact_cases().values():
        yield Trial(case, tuple(rule.name for rule in rules_for("road", case.scenario.place)))


SETS: dict[str, Callable[[], Iterator[Trial | Mutant]]] = {
    "paper": paper_trials,
    "classes": lambda: class_trials(("stop3", "stop4", "light3", "light4")),
    "signs": lambda: class_trials(("yield4", "right4", "lanes4", "roundabout4"), "CD", most=8),
    "mutants": lambda: map(Mutant, MUTANTS),
    "contacts": contact_trials,
}
"""By name; recorded runs are those of a user's files."""


def _representatives(place: Junction, most: int | None) -> Iterator[tuple[int, ...]]:
    orbits = Orbits.at(place)
    return islice(orbits, 0, None, 1 if most is None else -(-orbits.count // most))


def _all_rules(place: Junction) -> tuple[str, ...]:
    return tuple(rule.name for rule in rules_for(("paper", "road"), place))
