"""Which rule, and which metamorphic relation, tells a mutant of the reference autopilot from the reference itself?"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache, partial

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.relations.metamorphic import compare
from pytest_rvads.satellites.relations.variants import RELATIONS
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.falsify import broken
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.executors import Progress, spread
from studies.mutants import MUTANTS

CELLS = (
    ("stop4", "1231", "C"),
    ("stop4", "2222", "E"),
    ("stop4", "2323", "D"),
    ("stop4", "0033", "D"),
    ("light4", "3121", "I"),
    ("light4", "1232", "J"),
    ("light4", "3222", "H"),
    ("light4", "3313", "I"),
)
"""Junction, directions, configuration: each turn meets each, at rest and on the move, together and one after the other."""
TURNED = (("stop4", "2200", "C"),)
"""Where the relations are tried."""


@dataclass(frozen=True, slots=True)
class Killing:
    """What kills a mutant."""

    mutant: str
    fault: str
    """What is wrong with it, in a sentence."""
    rules: tuple[str, ...]
    relations: tuple[str, ...]


def kill_all(
    executor: Executor | int | None = None, progress: Progress | None = None, simulator: str | None = None
) -> list[Killing]:
    """Try every mutant, in runs by the simulator of that name."""
    return list(spread(partial(killed_by, simulator=simulator), list(MUTANTS), executor, progress, batch=1))


def killed_by(name: str, simulator: str | None = None) -> Killing:
    """Return the rules that a mutant breaks where the reference autopilot keeps them, and the relations that it breaks."""
    mutant = MUTANTS[name]
    rules: dict[str, None] = {}
    for cell in CELLS:
        scenario = _scenario(*cell)
        rules |= dict.fromkeys(r for r in _broken(scenario, mutant, simulator) if r not in _by_reference(scenario, simulator))
    turned, plant = [Case(_scenario(*cell), mutant) for cell in TURNED], named(simulator)
    relations = [
        relation
        for relation in RELATIONS
        if any(compare(case, ("paper", "road"), relations=relation, simulator=plant).differences for case in turned)
    ]
    return Killing(name, " ".join((mutant.__doc__ or "").split()), tuple(rules), tuple(relations))


def _scenario(junction: str, directions: str, letter: str) -> Scenario:
    point = configuration(letter, len(directions))
    return Scenario(find(junction), directions, distance=point.distances, speed=point.speeds, configuration=letter)


@lru_cache(maxsize=len(CELLS))
def _by_reference(scenario: Scenario, simulator: str | None) -> list[str]:
    return _broken(scenario, Reference, simulator)


def _broken(scenario: Scenario, factory: Factory, simulator: str | None) -> list[str]:
    run = simulate(Case(scenario, factory), named(simulator))
    rules = rules_for(("paper", "road"), run.junction)
    return [rule.name for rule in rules if broken(run, check(run, rule))]
