"""v(d)max of a closed loop: how fast a vehicle may start, d metres before a line, so that its own autopilot stops there.

The envelope of `pytest_rvads.physics.braking` is the plant's. An autopilot that brakes late, or drives off before it looks,
reaches less; the difference is its own.
"""

from __future__ import annotations

from dataclasses import replace

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.errors import RunError, ScenarioError
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import Sign
from pytest_rvads.physics.braking import STANDING, greatest_safe
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import Simulator, simulate, vmax

__all__ = ["closed_vmax"]

PROBES = 8
"""An autopilot need not be monotone, so that many speeds up to the plant's v(d)max are tried before the answer is refined."""
_RED = 19.9
"""Entrance 1 of the built-in junction with lights has red for that long [s]."""


def closed_vmax(  # noqa: PLR0913 - how, and where
    distance: float,
    driver: Factory,
    aggression: int = 1,
    vehicle: Vehicle | None = None,
    simulator: Simulator | None = None,
    *,
    place: Junction | None = None,
    movement: tuple[int, int] | None = None,
) -> float | None:
    """Return the greatest speed from which `driver` stops a lone vehicle at a red light, straight ahead.

    With `place` and `movement` the vehicle drives that movement and stops at the stop sign of its entrance. An entrance without a
    stop sign gets a red light for the test, because a lone vehicle gives way to no other vehicle. After the stop the vehicle may
    continue at a stop sign, and on a turn that crosses no other movement (right on red).

    Args:
        distance: reference point to stopping line at the start [m].
        driver: as for `Case`.
        aggression: 1, 2 or 3, the scenario's.
        vehicle: the parameters; a passenger car by default.
        simulator: what makes the runs, as for `simulate`.
        place: the junction, with `movement`; by default the built-in one with lights.
        movement: numbers of its entrance and its exit.

    Returns:
        The speed up to which it stopped in every test, at most the plant's v(d)max [m/s]; None where it drives over the line
        even from a standstill.

    Raises:
        ScenarioError: as for `vmax`, a distance that does not fit on the approach, or no such movement.
        RunError: a run ended by a fault.
    """
    vehicle = vehicle or Vehicle()
    where, code = (find("light4"), (0, 2, 0, 0)) if place is None or movement is None else _alone(place, movement)
    limit = vmax(distance, aggression, vehicle, simulator, where.top_limit)

    def safe(speed: float) -> bool:
        scenario = Scenario(where, code, distance=distance, speed=speed, aggression=aggression, duration=_RED)
        run = simulate(Case(scenario, driver, fleet=Fleet(vehicle)), simulator)
        if run.fault is not None:
            raise RunError(f"no v(d)max at {distance:g} m: {run.fault.reason}")
        return _stopped(run)

    return None if limit is None or not safe(0.0) else greatest_safe(safe, limit, PROBES)


def _alone(place: Junction, movement: tuple[int, int]) -> tuple[Junction, tuple[int, ...]]:
    """Return the junction with a red light at the entrance of a movement, unless it has a stop sign; and who comes there."""
    entrance = movement[0]
    directions = [direction for (_, direction), m in place.by_direction.items() if m.key == movement]
    if not directions:
        raise ScenarioError(
            f"junction {place.name!r} has no movement {movement!r}: name entrance and exit of one of {sorted(place.movements)}"
        )
    code = tuple(directions[0] if number == entrance else 0 for number in range(len(place.entrances)))
    if place.entrances[entrance].sign is Sign.STOP:
        return place, code
    # The lower phase is green first.
    lanes = [replace(e, sign=Sign.LIGHTS, phase=int(number == entrance)) for number, e in enumerate(place.entrances)]
    return replace(place, entrances=tuple(lanes)), code


def _stopped(run: Run) -> bool:
    """Return whether the vehicle stands at the line in the end, or stood there before it went on where that is allowed."""
    if run.speed is None:
        return False
    (agent,) = run.agents
    before = run.zone[:, 0] < Zone.JUNCTION
    standing = abs(run.speed[:, 0]) < STANDING
    if run.junction.entrances[agent.entrance].sign is Sign.STOP or agent.way.turn is run.junction.near:
        return bool(standing[before].any())
    return bool(standing[-1] and before.all())
