"""Runs for tests: some states of a run, and vehicles at constant speeds along their centre lines."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.scenario import Scenario


def coarse(run: Run, every: int, first: int = 0) -> Run:
    """Return a run of every so many states of a run, from a state on."""
    part = slice(first, None, every)
    arrays = {name: array[part] for name in ("station", "speed", "pose", "spread") if (array := getattr(run, name)) is not None}
    return replace(run, zone=run.zone[part], lights=run.lights[part], dt=run.dt * every, **arrays)


def gliding(scenario: Scenario, speeds: Sequence[float], steps: int, **more: Any) -> Run:
    """Return a run of the vehicles of a scenario, each at a speed [m/s] from 10 m before the junction, under its lights."""
    itineraries, plan = [itinerary for itinerary in scenario.itineraries() if itinerary], scenario.signals()
    station = -10.0 + np.array(speeds) * 0.01 * np.arange(steps)[:, None]
    zone = [[i.zone(s) for i, s in zip(itineraries, row, strict=True)] for row in station]
    lights = [plan.colours(t * 0.01, 4) for t in range(steps)]
    return Run(
        scenario.name,
        scenario.place,
        scenario.agents(),
        np.array(zone, dtype=np.int8),
        np.array(lights, dtype=np.int8),
        station=station,
        speed=np.tile(speeds, (steps, 1)),
        pose=np.array([[i.pose(s) for i, s in zip(itineraries, row, strict=True)] for row in station]),
        **more,
    )
