"""Ways to choose the next scenario to simulate, compared by `power`: each is an endless sequence that a seed determines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations, product
from random import Random

from pytest_rvads.geometry.finder import find
from pytest_rvads.physics.braking import vmax
from pytest_rvads.scenarios.classes import Directions, Orbits, classes
from pytest_rvads.scenarios.configurations import Configuration, grid
from pytest_rvads.scenarios.scenario import Scenario

Method = Callable[[str, int], Iterator[Scenario]]
"""Takes the junction and the seed."""

WAITS = (0.0, 1.0, 2.0, 3.0, 4.0)
"""Values of the draw of an autopilot at lights, the same for all methods [s]."""
NO_WAIT = 1.5
"""At stop signs nobody draws [s]."""
NEAR, FAR = 0.01, 20.0
"""Range of the distances of the grid and of the random methods [m]."""
PACE = 0.75
_POOL = 30
"""Scenarios per junction that the methods without a grid draw from."""
_TRIES = 30


def class_covering(junction: str, seed: int) -> Iterator[Scenario]:
    """One scenario per structural equivalence class and configuration, in random order; then again."""
    random = Random(seed)
    cells = [(code, 0, point) for code in classes(4) for point in _points(junction)]
    while True:
        random.shuffle(cells)
        for cell in cells:
            yield _at(junction, *cell, _wait(junction, random))


def uniform(junction: str, seed: int) -> Iterator[Scenario]:
    """Any of the 81 abstract scenarios in any configuration, with replacement."""
    random = Random(seed)
    rows = [(code, row) for code in classes(4) for row in range(len(Orbits.plain(4).members(code)))]
    points = _points(junction)
    while True:
        code, row = random.choice(rows)
        yield _at(junction, code, row, random.choice(points), _wait(junction, random))


def pairwise(junction: str, seed: int) -> Iterator[Scenario]:
    """Covering arrays of strength 2 over the four directions and the configuration, greedy with random tries; one by one."""
    random = Random(seed)
    points = _points(junction)
    levels = [(1, 2, 3)] * 4 + [tuple(range(len(points)))]
    while True:
        missing = {(i, a, j, b) for (i, one), (j, two) in combinations(enumerate(levels), 2) for a, b in product(one, two)}
        while missing:
            tries = [tuple(random.choice(level) for level in levels) for _ in range(_TRIES)]
            best = max(tries, key=lambda row: len(missing & _pairs(row)))
            missing -= _pairs(best)
            yield _at(junction, best[:4], 0, points[best[4]], _wait(junction, random))


def continuous(junction: str, seed: int) -> Iterator[Scenario]:
    """Directions at random, distances and speeds from continuous ranges inside v(d)max."""
    yield from _resampled(junction, seed, _continuous)


def hypothesis_unguided(junction: str, seed: int) -> Iterator[Scenario]:
    """What Hypothesis generates from `strategies.scenarios` when nothing leads it; with empty entrances."""
    yield from _resampled(junction, seed, _generated)


METHODS: Mapping[str, Method] = {
    "class-covering": class_covering,
    "uniform on the grid": uniform,
    "pairwise": pairwise,
    "continuous": continuous,
    "Hypothesis, unguided": hypothesis_unguided,
}


def _points(junction: str) -> tuple[Configuration, ...]:
    place = find(junction)
    return grid("paper", len(place.entrances), place.control)


def _wait(junction: str, random: Random) -> float:
    return random.choice(WAITS) if find(junction).phase_groups else NO_WAIT


def _at(junction: str, code: Directions, row: int, point: Configuration, wait: float) -> Scenario:
    return Scenario(
        find(junction), code, distance=point.distances, speed=point.speeds, rotation=row, configuration=point.label, wait=wait
    )


def _pairs(row: tuple[int, ...]) -> set[tuple[int, int, int, int]]:
    return {(i, a, j, b) for (i, a), (j, b) in combinations(enumerate(row), 2)}


def _resampled(junction: str, seed: int, pool: Callable[[str], list[Scenario]]) -> Iterator[Scenario]:
    """Draw with replacement from a pool that all seeds share, so that its scenarios are simulated once."""
    random = Random(seed)
    found = pool(junction)
    while True:
        yield random.choice(found)


def _continuous(junction: str) -> list[Scenario]:
    random = Random(0)
    found = []
    for _ in range(_POOL):
        code = tuple(random.randint(1, 3) for _ in range(4))
        starts = []
        for _ in range(4):
            distance = round(random.uniform(NEAR, FAR), 2)
            starts.append((distance, round(random.uniform(0, PACE * (vmax(distance) or 0.0)), 2)))
        places, speeds = zip(*starts, strict=True)
        found.append(Scenario(find(junction), code, distance=places, speed=speeds, wait=_wait(junction, random)))
    return found


def _range(junction: str) -> tuple[float, float]:
    return (WAITS[0], WAITS[-1]) if find(junction).phase_groups else (NO_WAIT, NO_WAIT)


def _generated(junction: str) -> list[Scenario]:
    from hypothesis import HealthCheck, Phase, given, seed, settings

    from pytest_rvads.search import strategies

    found: list[Scenario] = []

    @settings(max_examples=_POOL, database=None, phases=[Phase.generate], deadline=None, suppress_health_check=list(HealthCheck))
    @seed(0)
    @given(strategies.scenarios(junction, near=NEAR, far=FAR, pace=PACE, wait=_range(junction)))
    def collect(scenario: Scenario) -> None:
        found.append(scenario)

    collect()
    return found
