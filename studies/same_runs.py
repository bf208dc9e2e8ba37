"""How many runs do random starts, class covering and falsification need for the faults that `critical_power` measures?

Random starts and class covering: a pool of scenarios is simulated once per driver. A seed reads the pool in a random order of its
own, and counts the runs up to the first run that shows the fault. Falsification: every seed is a search of its own.

A run shows a fault if it breaks a rule that the driver without the fault keeps in the same scenario. Where critical starts found
the fault by a rule about other vehicles, only such rules count for the other methods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from random import Random
from statistics import median

from pytest_rvads.geometry.finder import find
from pytest_rvads.satellites.starts.lines import lines_at
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.search.falsify import look_for
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.executors import spread
from studies.critical_power import TRAFFIC, Find, found_by, junctions_of, kept_by, safety_rules, settings
from studies.detection import DEFICIENCIES
from studies.mutants import MUTANTS

SEEDS = 100
"""Number of random orders of a pool."""
RESAMPLES = 300
"""Number of pools that the bootstrap draws."""
SEARCHES, BUDGET = 3, 40
"""Seeds of a falsification, and its simulations before it gives up."""


@dataclass(frozen=True, slots=True)
class SameRuns:
    """What critical starts find of a driver, and what other methods find of the driver."""

    critical: Find
    pools: Mapping[str, tuple[tuple[str, ...], ...]]
    """Per method, the rules that each run of its pool shows to be broken."""
    searches: tuple[int, ...]
    """Per seed, simulations until a falsification found the driver; one more than its budget if it did not."""


def compare_all(names: Sequence[str] = (), executor: Executor | int | None = None) -> Iterator[SameRuns]:
    """Yield the comparison of every deficiency and every mutant, or of those with a name, as soon as it is measured."""
    return spread(compare, list(names or (*DEFICIENCIES, *MUTANTS)), executor, batch=1)


def compare(name: str) -> SameRuns:
    """Return the comparison of the methods for the deficiency or the mutant with a name."""
    critical = found_by(name)
    pools = {method: tuple(rules_shown(name, scenario) for scenario in pool(name)) for method, pool in POOLS.items()}
    return SameRuns(critical, pools, tuple(_search(critical, seed) for seed in range(SEARCHES)) if critical.line else ())


def random_starts(name: str, size: int = 50) -> list[Scenario]:
    """Return random starts of two vehicles: any line of critical starts of the driver, with any lead up to 12 s."""
    random, starts = Random(0), list[Scenario]()
    lines = [line for junction in junctions_of(name) for group in lines_at(find(junction)) for line in group]
    while len(starts) < size:
        line = random.choice(lines)
        try:
            starts.append(line.scenario(random.randint(*line.reach())))
        except ScenarioError:  # a vehicle has no room
            continue
    return starts


def covering(name: str, size: int = 25) -> list[Scenario]:
    """Return a random sample of the default cover: every class, seat and staggered configuration at the driver's junctions."""
    cells: list[Scenario] = []
    for place in map(find, junctions_of(name)):
        cells += Selection(place, grid(ARRIVALS, len(place.entrances), place.control), subject="all")
    return Random(0).sample(cells, size)


POOLS: Mapping[str, Callable[[str], list[Scenario]]] = {"random starts": random_starts, "class covering": covering}


def rules_shown(name: str, scenario: Scenario) -> tuple[str, ...]:
    """Return the rules that a driver breaks in a scenario, and that the driver without the fault keeps there."""
    faulty, sound = settings(name)
    _, verdicts = faulty.judged(scenario)
    broken = [verdict.rule for verdict in verdicts if verdict.outcome.bad]
    return tuple(kept_by(sound, scenario, broken)) if broken else ()


def _search(critical: Find, seed: int) -> int:
    """Return the simulations until a falsification breaks the rule of critical starts, at their junction and seat."""
    assert critical.line is not None
    faulty, sound = settings(critical.driver, critical.traffic)
    rule = (critical.safety_rules or critical.rules)[-1]
    subject, traffic = (critical.line.seat, critical.traffic) if faulty.traffic else (None, None)
    place = critical.line.place
    try:
        example = look_for(place, faulty.driver, rule, traffic=traffic, budget=BUDGET, seed=seed, subject=subject)
    except ScenarioError:  # the rule was never triggered
        return BUDGET + 1
    return example.found if example and kept_by(sound, example.scenario, [rule]) else BUDGET + 1


def first_runs(hits: int, size: int, random: Random, seeds: int = SEEDS) -> list[int]:
    """Return, for random orders of a pool, the runs up to the first that shows a fault; `size` + 1 if none does."""
    return [min(random.sample(range(1, size + 1), hits), default=size + 1) for _ in range(seeds)]


def interval_of_median(hits: int, size: int) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the median of `first_runs`; the pool and its orders are both drawn again."""
    random = Random(0)
    drawn = (sum(random.random() < hits / size for _ in range(size)) for _ in range(RESAMPLES))
    medians = sorted(median(first_runs(number, size, random)) for number in drawn)
    return medians[round(0.025 * RESAMPLES)], medians[round(0.975 * RESAMPLES) - 1]


def row(measured: SameRuns) -> str:
    """Return the row of a driver in the table."""
    critical = measured.critical
    safe = bool(critical.safety_rules)
    runs = critical.safety_runs if safe else critical.runs
    among = "" if critical.traffic == TRAFFIC[0] else f", among {critical.traffic}"
    cells = [f"{critical.driver}{among}"]
    cells += [*_found(critical.runs, critical.rules), *_found(critical.safety_runs, critical.safety_rules)]
    for shown in measured.pools.values():
        hits, size = sum(bool(safety_rules(rules) if safe else rules) for rules in shown), len(shown)
        cells.append(_cell(first_runs(hits, size, Random(1)), interval_of_median(hits, size), size, runs))
    searches = measured.searches
    cells.append(_cell(searches, (min(searches), max(searches)), BUDGET, runs) if searches else "–")
    return f"| {' | '.join(cells)} |"


def _found(runs: int, rules: Sequence[str]) -> tuple[str, str]:
    return (str(runs), ", ".join(rules)) if rules else (f"> {runs}", "–")


def _cell(counts: Sequence[int], interval: tuple[float, float], most: int, runs: int) -> str:
    """Return the median with an interval, and the share of seeds that needed no more than a number of runs."""
    middle, low, high = (f"> {most}" if value > most else f"{value:g}" for value in (median(counts), *interval))
    return f"{middle} ({low} to {high}), {sum(count <= min(runs, most) for count in counts) / len(counts):.0%}"


HEADING = """\
| driver | runs | rules | runs until safety | safety rules | random starts | class covering | falsification |
|---|---:|---|---:|---|---|---|---|"""


def summary(measured: Sequence[SameRuns], runs: Sequence[int] = (10, 30, 100, 300, 1000)) -> str:
    """Return a Markdown table: how many drivers each method finds by a rule about other vehicles within a number of runs.

    For random starts and class covering, it is the mean over the seeds; a number of runs beyond their pools is left out.
    """
    pools = list(POOLS)
    lines = [f"| runs | critical starts | {' | '.join(pools)} |", "|---:" * (len(pools) + 2) + "|"]
    for most in runs:
        cells = [str(sum(bool(m.critical.safety_rules) and m.critical.safety_runs <= most for m in measured))]
        for name in pools:
            shares = []
            for shown in (m.pools[name] for m in measured):
                counts = first_runs(sum(bool(safety_rules(rules)) for rules in shown), len(shown), Random(1))
                shares.append(sum(count <= most for count in counts) / SEEDS if most <= len(shown) else None)
            cells.append("–" if None in shares else f"{sum(filter(None, shares)):.1f}")
        lines.append(f"| {most} | {' | '.join(cells)} |")
    return "\n".join(lines)
