"""Monitors that no other test has left behind; recordings of known runs, with noise, smoothed as tracks are."""

from collections.abc import Callable

import numpy as np
import pytest

from pytest_rvads.logic.judging.instances import forget
from pytest_rvads.logic.ltl.ltl3 import synthesize
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.smoothing import DERIVED, smoothed

Measure = Callable[..., Recording]


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests() -> None:
    """Every test builds its own monitors, so that it finds what it is there to find."""
    forget()
    synthesize.cache_clear()


@pytest.fixture(scope="session")
def measured() -> Measure:
    """Return a function that measures a run again.

    It takes the run, how often a second, the standard deviation of a coordinate [m], whether speeds are measured, and a seed.
    """

    def measure(run: Run, often: int = 10, accuracy: float = 0.1, speeds: bool = True, seed: int = 0) -> Recording:
        rng, every = np.random.default_rng(seed), round(1 / (often * run.dt))
        tracks = []
        for column, agent in enumerate(run.agents):
            here = np.flatnonzero(run.here[:, column])[::every]
            pose = run.need("pose")[here, column] + rng.normal(0, accuracy, (len(here), 3)) * (1, 1, 0)
            way = itinerary(run.junction, *agent.way.key)
            around = run.need("station")[here, column]
            station, lateral = np.array([way.project(x, y, near) for (x, y, _), near in zip(pose, around, strict=True)]).T
            fast = run.need("speed")[here, column] if speeds else None
            times = run.times[here]
            station, speed, spread = smoothed(times, station, fast, accuracy)
            place, ahead = way.centre(station)
            pose[:, :2] = place + smoothed(times, lateral, None, accuracy)[0][:, None] * np.column_stack(
                (-ahead[:, 1], ahead[:, 0])
            )
            tracks.append(Track(agent, times, station, speed, pose, spread))
        lights = {
            k: Changes(run.times[changed], run.lights[changed, k])
            for k in range(run.lights.shape[1])
            if len(changed := np.flatnonzero(np.diff(run.lights[:, k], prepend=-1)))
        }
        return Recording(run.label, run.junction, tuple(tracks), lights, run.facts, accuracy, 0.0 if speeds else DERIVED)

    return measure
