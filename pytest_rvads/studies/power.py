"""How many simulations until a deficiency is found? The methods of `methods`, the same monitors, the same budget.

A deficiency is detected by a run in which a rule is broken that the vehicles could have kept, and which the same autopilot
without the deficiency does not break there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from random import Random
from statistics import median

from pytest_rvads.drivers.lgsvl import LgsvlLike
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.falsify import avoidable, broken
from pytest_rvads.search.relations import with_fields
from pytest_rvads.simulators.bullet import simulate
from pytest_rvads.simulators.seat import Factory
from pytest_rvads.studies.methods import METHODS
from pytest_rvads.studies.pool import Progress, spread

__all__ = ["DEFICIENCIES", "Power", "broken_rules", "interval", "measure"]

DEFICIENCIES: Mapping[str, str] = {
    "I1": "paper_light4",
    "I2": "paper_stop4",
    "I3": "paper_stop4",
    "I4": "paper_light4",
    "I5": "paper_light4",
}
"""Where each can show."""
SEEDS, BUDGET = 100, 40
RESAMPLES = 2000
"""Of the bootstrap."""

Job = tuple[str, Scenario]


@dataclass(frozen=True, slots=True)
class Power:
    """Simulations until detection, one number per seed; the budget and one more where nothing was found."""

    deficiency: str
    method: str
    simulations: tuple[int, ...]
    budget: int

    @property
    def found(self) -> float:
        """Share of the seeds that found it within the budget."""
        return sum(n <= self.budget for n in self.simulations) / len(self.simulations)


def autopilot(deficiency: str | None) -> Factory:
    """Return the LGSVL-like autopilot with one deficiency, or with none."""
    i1, i2, i3, i4, i5 = (deficiency == f"I{k}" for k in range(1, 6))
    return partial(LgsvlLike, i1=i1, i2=i2, i3=i3, i4=i4, i5=i5)


def broken_rules(scenario: Scenario, factory: Factory) -> frozenset[str]:
    """Return the paper's rules that a run breaks although they could have been kept."""
    run = simulate(scenario, factory)
    return frozenset(
        rule.name for rule in rules_for("paper", run.junction.control) if broken(run, check(run, rule)) and avoidable(run, rule)
    )


def detects(job: Job) -> bool:
    """Return whether a scenario shows a deficiency."""
    deficiency, scenario = job
    broken = broken_rules(scenario, autopilot(deficiency))
    return bool(broken) and not broken <= broken_rules(scenario, autopilot(None))


def measure(
    seeds: int = SEEDS,
    budget: int = BUDGET,
    *,
    deficiencies: Iterable[str] = tuple(DEFICIENCIES),
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Power]:
    """Measure every method on every deficiency.

    Args:
        seeds: repetitions.
        budget: simulations after which a method gives up.
        deficiencies: names.
        workers: processes.
        progress: called after every scenario that had to be simulated; their number grows as the search goes on.
    """
    known: dict[Job, bool] = {}
    found = []
    for deficiency in deficiencies:
        for name, method in METHODS.items():
            place = DEFICIENCIES[deficiency]
            orders = [[_canonical(deficiency, s) for s in islice(method(place, seed), budget)] for seed in range(seeds)]
            counts = _race(deficiency, orders, known, workers, progress)
            found.append(Power(deficiency, name, tuple(counts), budget))
    return found


def _canonical(deficiency: str, scenario: Scenario) -> Scenario:
    """Return the row of the class to simulate: only the hidden zone of I2 tells rows apart."""
    return scenario if deficiency == "I2" or not scenario.rotation else with_fields(scenario, rotation=0)


def _race(
    deficiency: str, orders: list[list[Scenario]], known: dict[Job, bool], workers: int | None, progress: Progress | None
) -> list[int]:
    """Return, per order, how many scenarios come up to the first that detects; the seeds go on side by side."""
    done: dict[int, int] = {}
    budget = len(orders[0])
    for k in range(budget):
        racing = [i for i in range(len(orders)) if i not in done]
        jobs = list(dict.fromkeys(job for i in racing if (job := (deficiency, orders[i][k])) not in known))
        known |= dict(zip(jobs, spread(detects, jobs, workers, progress), strict=True)) if jobs else {}
        done |= {i: k + 1 for i in racing if known[deficiency, orders[i][k]]}
    return [done.get(i, budget + 1) for i in range(len(orders))]


def interval(values: tuple[int, ...], statistic: Callable[[list[int]], float] = median) -> tuple[float, float]:
    """Return the 95 % bootstrap percentile interval of a statistic."""
    random = Random(0)
    found = sorted(statistic(random.choices(values, k=len(values))) for _ in range(RESAMPLES))
    return found[round(0.025 * RESAMPLES)], found[round(0.975 * RESAMPLES) - 1]
