"""v(d)max of a closed loop: how fast a vehicle may start, d metres before a line, so that its own autopilot stops there.

The envelope of `pytest_rvads.physics.braking` is the plant's. An autopilot that brakes late, or drives off before it looks,
reaches less; the difference is its own.
"""

from __future__ import annotations

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.finder import find
from pytest_rvads.physics.braking import STANDING, greatest_safe
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


def closed_vmax(
    distance: float,
    driver: Factory,
    aggression: int = 1,
    vehicle: Vehicle | None = None,
    simulator: Simulator | None = None,
) -> float | None:
    """Return the greatest speed from which `driver` stops a lone vehicle at a red light, straight ahead.

    Args:
        distance: reference point to stopping line at the start [m].
        driver: as for `Case`.
        aggression: 1, 2 or 3, the scenario's.
        vehicle: the parameters; a passenger car by default.
        simulator: what makes the runs, as for `simulate`.

    Returns:
        The speed up to which it stopped in every test, at most the plant's v(d)max [m/s]; None where it drives over the line
        even from a standstill.

    Raises:
        ScenarioError: as for `vmax`, or a distance that does not fit on the approach.
        RunError: a run ended by a fault.
    """
    vehicle = vehicle or Vehicle()
    limit, place = vmax(distance, aggression, vehicle, simulator), find("light4")

    def safe(speed: float) -> bool:
        scenario = Scenario(place, "0200", distance=distance, speed=speed, aggression=aggression, duration=_RED)
        run = simulate(Case(scenario, driver, fleet=Fleet(vehicle)), simulator)
        if run.fault is not None:
            raise RunError(f"no v(d)max at {distance:g} m: {run.fault.reason}")
        stands = run.speed is not None and abs(float(run.speed[-1, 0])) < STANDING
        return stands and bool((run.zone < Zone.JUNCTION).all())

    return None if limit is None or not safe(0.0) else greatest_safe(safe, limit, PROBES)
