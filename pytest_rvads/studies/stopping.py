"""v(d)max of the autopilots that ship with the project, worked out on several processes and kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.physics.cache import cached
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.simulators.bullet import bullet
from pytest_rvads.simulators.closed_loop import closed_vmax
from pytest_rvads.simulators.simulator import named
from pytest_rvads.studies.pool import Progress, spread

__all__ = ["closed_envelope"]

_Job = tuple[str, float, int, str]


def closed_envelope(
    name: str,
    distances: Sequence[float],
    aggressions: Sequence[int] = (1, 2, 3),
    *,
    simulator: str = "bullet",
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[int, tuple[float | None, ...]]:
    """Return what the autopilot `name` reaches of v(d)max [m/s] over `distances` [m], for every aggression.

    Raises:
        ScenarioError: there is no autopilot or simulator of this name; a distance or an aggression that can't be tested.
    """
    traffic(name, "autopilot")
    named(simulator)
    jobs: list[_Job] = [(name, float(distance), level, simulator) for level in aggressions for distance in distances]
    found = list(spread(_work, jobs, workers, progress))
    count = len(distances)
    return {level: tuple(found[k * count : (k + 1) * count]) for k, level in enumerate(aggressions)}


def _work(job: _Job) -> float | None:
    name, distance, aggression, simulator = job
    vehicle, plant = Vehicle(), named(simulator)
    if plant is not bullet:  # of another one it is not known when its answers change
        return closed_vmax(distance, traffic(name), aggression, vehicle, plant)
    key = {"what": name, "distance": distance, "aggression": aggression, "vehicle": asdict(vehicle)}
    return cached(key, lambda: closed_vmax(distance, traffic(name), aggression, vehicle, plant))
