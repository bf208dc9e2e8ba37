"""How many runs of the default cover show the fault of a mutant that meets pedestrians wrongly, and which rules break?

The runs are drawn from the default covers of `zebra4` and `walk4` in turn, with pedestrians of every behaviour. The mutant drives
the vehicle under test among traffic of the reference autopilot. A rule finds the mutant in a run in which the mutant breaks the
rule and the reference autopilot keeps it. Only rules about others count, and `progress`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from random import Random

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.walking import BEHAVIOURS
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.starts.lines import Fault, fault_of
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import Orbits
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.pedestrians import walks_of
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.executors import Progress, spread
from studies.mutants import AT_CROSSWALKS

JUNCTIONS = ("zebra4", "walk4")
BUDGET = 300
"""Runs after which a mutant survives."""


@dataclass(frozen=True, slots=True)
class Found:
    """What finds a mutant."""

    mutant: str
    runs: int
    """Runs up to the first that shows the fault; all runs if none does."""
    rules: tuple[str, ...]
    """The rules that this run breaks; empty if the mutant survives."""
    scenario: str
    """The id of this run; empty if the mutant survives."""


def cover(seed: int = 0) -> Iterator[Scenario]:
    """Yield scenarios of the default covers: classes, configurations, seats and pedestrians, drawn at random one by one."""
    random = Random(seed)
    places = [find(name).walked for name in JUNCTIONS]
    for number in count():
        place = places[number % len(places)]
        behaviour = random.choice(list(BEHAVIOURS))
        drawn = Selection(
            place,
            (random.choice(grid(ARRIVALS, len(place.entrances), place.control)),),
            classes=(random.randint(1, Orbits.at(place).count),),
            subject="all",
            senses=(Senses(occlusion=True) if BEHAVIOURS[behaviour].parked else IDEAL,),
            pedestrians=(random.choice(walks_of(behaviour)),),
        )
        if scenarios := list(drawn.fitting(lambda _: None)):
            yield random.choice(scenarios)


def find_all(executor: Executor | int | None = None, progress: Progress | None = None) -> list[Found]:
    """Return what finds every mutant of `AT_CROSSWALKS`."""
    return list(spread(found_by, list(AT_CROSSWALKS), executor, progress, batch=1))


def found_by(name: str, budget: int = BUDGET) -> Found:
    """Return what finds the mutant with a name."""
    for number, scenario in enumerate(islice(cover(), budget), 1):
        if rules := shown(AT_CROSSWALKS[name], scenario):
            return Found(name, number, rules, scenario.name)
    return Found(name, budget, (), "")


def shown(mutant: Factory, scenario: Scenario) -> tuple[str, ...]:
    """Return the rules that a mutant breaks in a scenario and the reference autopilot keeps there."""
    broken = _broken(mutant, scenario)
    return tuple(rule for rule in broken if rule not in _broken(partial(Reference, tie=TIE), scenario)) if broken else ()


def _broken(driver: Factory, scenario: Scenario) -> list[str]:
    run = simulate(Case(scenario, driver))
    rules = (rule for rule in rules_for("road", run.junction) if fault_of(rule.name) is not Fault.MANNERS)
    return [rule.name for rule in rules if check(run, rule).outcome.bad]


def table(found: Sequence[Found]) -> str:
    """Return a Markdown table: what is wrong with a mutant, after how many runs it is found, and by which rules."""
    lines = ["| mutant | what is wrong | runs | rules |", "|---|---|---:|---|"]
    for f in found:
        fault, runs = " ".join((AT_CROSSWALKS[f.mutant].__doc__ or "").split()), f"{'' if f.rules else '> '}{f.runs}"
        lines.append(f"| {f.mutant} | {fault} | {runs} | {', '.join(f.rules) or '**survives**'} |")
    return "\n".join(lines)
