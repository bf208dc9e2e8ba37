"""How many simulations until a deficiency is found? The methods of `methods`, the same monitors, the same budget.

A deficiency is detected by a run in which a rule is broken that the vehicles could have kept, and which the same autopilot
without the deficiency does not break there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import islice
from random import Random
from statistics import median

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.states import Zone
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.falsify import broken
from pytest_rvads.simulators.simulator import Simulator, named, simulate
from pytest_rvads.support.executors import Progress, spread
from studies.methods import METHODS

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

Job = tuple[str, Scenario, str | None, str | None]
"""Deficiency, scenario, the traffic policy where the scenario has a subject, and the simulator by name."""


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


def broken_rules(case: Case, simulator: Simulator | None = None) -> frozenset[str]:
    """Return the paper's rules that a run breaks although they could have been kept; a subject, by its own doing."""
    run = simulate(case, simulator)
    arrivals = (run.zone >= Zone.ENTRANCE).argmax(axis=0)
    circle = len(arrivals) == 4 and len(set(arrivals.tolist())) == 1  # each has somebody on its right: nobody can keep p2
    verdicts = {rule.name: check(run, rule) for rule in rules_for("paper", run.junction)}
    return frozenset(name for name, v in verdicts.items() if broken(run, v) and not (circle and name == "p2"))


def detects(job: Job) -> bool:
    """Return whether a scenario shows a deficiency."""
    deficiency, scenario, among, simulator = job
    plant = named(simulator)
    around = None if among is None else traffic(among)
    with_it, without = (Case(scenario, autopilot(which), around) for which in (deficiency, None))
    broken = broken_rules(with_it, plant)
    return bool(broken) and not broken <= broken_rules(without, plant)


def measure(
    seeds: int = SEEDS,
    budget: int = BUDGET,
    *,
    deficiencies: Iterable[str] = tuple(DEFICIENCIES),
    among: str | None = None,
    simulator: str | None = None,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> list[Power]:
    """Measure every method on every deficiency."""
    known: dict[Job, bool] = {}
    found = []
    for deficiency in deficiencies:
        for name, method in METHODS.items():
            place = DEFICIENCIES[deficiency]
            orders = [
                [(deficiency, _canonical(deficiency, s, among), among, simulator) for s in islice(method(place, seed), budget)]
                for seed in range(seeds)
            ]
            counts = _race(orders, known, executor, progress)
            found.append(Power(deficiency, name, tuple(counts), budget))
    return found


def _canonical(deficiency: str, scenario: Scenario, among: str | None) -> Scenario:
    """Return the row of the class to simulate: only the hidden zone of I2, or a seat, tells rows apart."""
    if among is not None:
        return scenario.but(subject=next(e for e, direction in enumerate(scenario.placed) if direction))
    return scenario if deficiency == "I2" or not scenario.rotation else scenario.but(rotation=0)


def _race(
    orders: list[list[Job]], known: dict[Job, bool], executor: Executor | int | None, progress: Progress | None
) -> list[int]:
    """Return, per order, how many scenarios come up to the first that detects; the seeds go on side by side."""
    done: dict[int, int] = {}
    budget = len(orders[0])
    for k in range(budget):
        racing = [i for i in range(len(orders)) if i not in done]
        jobs = list(dict.fromkeys(orders[i][k] for i in racing if orders[i][k] not in known))
        known |= dict(zip(jobs, spread(detects, jobs, executor, progress), strict=True)) if jobs else {}
        done |= {i: k + 1 for i in racing if known[orders[i][k]]}
    return [done.get(i, budget + 1) for i in range(len(orders))]


def interval(values: tuple[int, ...]) -> tuple[float, float]:
    """Return the 95 % bootstrap percentile interval of the median."""
    random = Random(0)
    found = sorted(median(random.choices(values, k=len(values))) for _ in range(RESAMPLES))
    return found[round(0.025 * RESAMPLES)], found[round(0.975 * RESAMPLES) - 1]
