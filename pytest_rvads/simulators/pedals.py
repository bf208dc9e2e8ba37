"""What the pedals of a driver do in a simulation: the acceleration that follows from a position of throttle or brake.

A driver that somebody else wrote counts on the pedals of another vehicle. Its distances mean something here only if a pedal gives
the acceleration that the pedal gave at home. `calibrated` lets the driver drive alone on straight roads and through a bend, with
a green and with a red light ahead. The lag of the actuators, and the resistance of tyres and air, are taken out of the samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.follower import resistance
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.closed_loop import RED
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import RunError

__all__ = ["Pedal", "Used", "calibrated"]

_PROBES = (("2000", 110.0, 0.0), ("0200", 60.0, 10.0), ("3000", 60.0, 10.0))
"""Directions, distance to the line [m] and speed [m/s] of the starts at the built-in junction with lights: from a standstill and
straight on at green, towards a red light, and a left turn at green."""
_MOVING = 0.5
"""A vehicle slower than this may be held by its brake, so its acceleration says nothing [m/s]."""
_STRAIGHT = 0.02
"""Greatest angle of the front wheels of a sample [rad]: in a bend the tyres slow the vehicle down."""
_PRESSED, _FREE = 0.02, 0.001
"""Least position of a pressed pedal and greatest position of the other pedal."""
_BAND = 0.1
"""Width of the bands of positions."""


class Used(NamedTuple):
    """A band of positions of a pedal that a driver used."""

    position: float
    """Mean position, 0..1."""
    acceleration: float
    """Mean acceleration by the pedal; negative for a brake [m/s^2]."""
    seconds: float
    """Time for which the pedal was in the band [s]."""


class Pedal(NamedTuple):
    """What a pedal does in a simulation."""

    full: float | None
    """Acceleration by the full pedal, from a line through the samples [m/s^2]; None if the driver never pressed the pedal."""
    largest: float
    """Largest position that the driver used, 0..1."""
    used: tuple[Used, ...]
    """The bands of positions, from the lightest on."""


def calibrated(driver: Factory, simulator: Simulator | None = None, aggression: int = 1) -> tuple[Pedal, Pedal]:
    """Return what throttle and brake do in a simulation with a driver.

    Args:
        driver: the driver, as for `Case`. A driver that commands `Control` presses the pedals itself. For a driver with other
            commands, the tracking controller presses the pedals.
        simulator: the simulator, as for `simulate`.
        aggression: braking level 1, 2 or 3.

    Returns:
        Throttle and brake.

    Raises:
        RunError: a run ended by a fault, or the simulator records no speeds or no controls.
    """
    samples = np.concatenate([_samples(driver, simulator, aggression, *probe) for probe in _PROBES])
    throttle, brake, acceleration = samples.T
    return _pedal(throttle, acceleration, brake), _pedal(brake, acceleration, throttle)


def _samples(
    driver: Factory, simulator: Simulator | None, aggression: int, directions: str, distance: float, speed: float
) -> NDArray[np.float64]:
    """Return effective throttle, effective brake and acceleration without resistance of a run, shape ``(samples, 3)``."""
    scenario = Scenario(find("light4"), directions, distance=distance, speed=speed, aggression=aggression, duration=RED)
    run = simulate(Case(scenario, driver), simulator)
    if run.fault is not None:
        raise RunError(f"no calibration: {run.fault.reason}")
    if run.speed is None or run.controls is None:
        raise RunError(
            f"simulator {run.provenance.get('simulator')!r} records no speeds or no controls, which a calibration needs"
        )
    vehicle, speeds, controls = Vehicle(), run.speed[:, 0].astype(np.float64), run.controls[:-1, 0].astype(np.float64)
    lags = np.array([vehicle.drive_lag, vehicle.brake_lag])
    effective, pedals = np.zeros_like(controls[:, :2]), np.zeros(2)
    for step, wanted in enumerate(controls[:, :2]):
        pedals = pedals + (1.0 - np.exp(-DT / lags)) * (wanted - pedals)
        effective[step] = pedals
    free = np.diff(speeds) / DT + np.array([resistance(vehicle, speed) for speed in speeds[:-1]])
    usable = (speeds[1:] > _MOVING) & (np.abs(controls[:, 2]) < _STRAIGHT)
    return np.column_stack((effective, free))[usable]


def _pedal(positions: NDArray[np.float64], acceleration: NDArray[np.float64], other: NDArray[np.float64]) -> Pedal:
    """Return what a pedal does, from the samples in which it is pressed and the other pedal is free."""
    pressed = (positions > _PRESSED) & (other < _FREE)
    if not pressed.any():
        return Pedal(None, 0.0, ())
    position, pushed = positions[pressed], acceleration[pressed]
    bands = np.ceil(position / _BAND)
    used = [
        Used(float(position[bands == band].mean()), float(pushed[bands == band].mean()), float((bands == band).sum() * DT))
        for band in np.unique(bands)
    ]
    return Pedal(math.fsum(position * pushed) / math.fsum(position * position), float(position.max()), tuple(used))
