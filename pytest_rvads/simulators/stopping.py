"""v(d)max of the autopilots that ship with the project, worked out on several processes and kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.executors import Progress, spread
from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.physics.cache import cached
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.simulators.closed_loop import closed_vmax
from pytest_rvads.simulators.planar import Planar
from pytest_rvads.simulators.simulator import named

__all__ = ["closed_by_movement", "closed_envelope"]

_Job = tuple[str, float, int, str | None, Junction | None, Key | None]
"""Autopilot, distance [m], aggression, simulator, and where that is not the usual place, a junction and a movement."""


def closed_envelope(
    name: str,
    distances: Sequence[float],
    aggressions: Sequence[int] = (1, 2, 3),
    *,
    simulator: str | None = None,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[int, tuple[float | None, ...]]:
    """Return what the autopilot `name` reaches of v(d)max [m/s] over `distances` [m], for every aggression.

    Raises:
        ScenarioError: there is no autopilot or simulator of this name; a distance or an aggression that can't be tested.
    """
    traffic(name, "autopilot")
    named(simulator)
    jobs: list[_Job] = [(name, float(distance), level, simulator, None, None) for level in aggressions for distance in distances]
    found = list(spread(_work, jobs, executor, progress))
    count = len(distances)
    return {level: tuple(found[k * count : (k + 1) * count]) for k, level in enumerate(aggressions)}


def closed_by_movement(
    name: str,
    distances: Sequence[float],
    place: Junction,
    *,
    simulator: str | None = None,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[Key, dict[float, float | None]]:
    """Return what the autopilot `name` reaches of v(d)max [m/s] on the way to every movement of a junction, at aggression 1.

    Distances [m] that its approach does not have are left out.

    Raises:
        ScenarioError: as for `closed_envelope`.
        MapError: it is not known where the lanes of the junction lie.
    """
    traffic(name, "autopilot")
    named(simulator)
    jobs: list[_Job] = [
        (name, float(distance), 1, simulator, place, key)
        for key in sorted(place.movements)
        for distance in distances
        if distance <= place.approach(key[0])
    ]
    found: dict[Key, dict[float, float | None]] = {key: {} for key in sorted(place.movements)}
    for (_, distance, _, _, _, key), speed in zip(jobs, spread(_work, jobs, executor, progress), strict=True):
        if key is not None:
            found[key][distance] = speed
    return found


def _work(job: _Job) -> float | None:
    name, distance, aggression, simulator, place, movement = job
    vehicle, plant = Vehicle(), named(simulator)

    def test() -> float | None:
        return closed_vmax(distance, traffic(name), aggression, vehicle, plant, place=place, movement=movement)

    if not isinstance(plant, Planar):  # of another one it is not known when its answers change
        return test()
    key = {"what": name, "distance": distance, "aggression": aggression, "vehicle": asdict(vehicle)}
    where = {} if place is None else {"junction": place.digest, "movement": movement}
    return cached({**key, **where}, test, plant.engine.library)
