"""The parts of an OpenSCENARIO file that the exports write, as plain values; `writing` turns the values into XML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.segment import Pose
from pytest_rvads.runs.states import AXLE, Agent, Colour, Kind
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["Actor", "Body", "Document", "Phase", "Trajectory", "body_of", "moved_back"]


@dataclass(frozen=True, slots=True)
class Body:
    """Size and axles of a vehicle, which other tools need to draw and drive the vehicle."""

    kind: Kind
    length: float
    """[m]."""
    width: float
    """[m]."""
    height: float
    """[m]."""
    back: float
    """Front bumper to the reference point of OpenSCENARIO, the middle of the rear axle [m]."""
    wheelbase: float
    """[m]."""
    vehicle: Vehicle
    """What else is asked for: mass, acceleration, braking, steering."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Where a reference point is at which time."""

    times: NDArray[np.float64]
    """Increasing, at least two, shape ``(vertices,)`` [s]."""
    poses: NDArray[np.float64]
    """x [m], y [m], heading [rad], shape ``(vertices, 3)``."""


@dataclass(frozen=True, slots=True, eq=False)
class Actor:
    """Somebody in a file: either on a trajectory, or on a route to be driven."""

    name: str
    body: Body
    start: Pose
    """Of its reference point."""
    speed: float
    """When it starts [m/s]."""
    trajectory: Trajectory | None = None
    route: tuple[Pose, ...] = ()
    """Waypoints, the start among them."""
    appears: float | None = None
    """When it is added [s]; None: it is there from the start."""
    leaves: float | None = None
    """When it is deleted [s]; None: it stays."""


@dataclass(frozen=True, slots=True)
class Phase:
    """What the lights show for a while."""

    duration: float
    """[s]."""
    colours: Mapping[str, Colour]
    """By id of a signal."""


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A file."""

    title: str
    """What it is, in one line."""
    map: str
    """Name of the OpenDRIVE file beside it."""
    note: tuple[str, str]
    """Name and value of the property that only we read."""
    actors: tuple[Actor, ...]
    phases: tuple[Phase, ...]
    """Phases of the single controller of all lights, which repeats the phases."""
    duration: float
    """When it ends [s]."""


def body_of(agent: Agent, vehicle: Vehicle | None = None) -> Body:
    """Return the body of an agent.

    Where no parameters are known that have its size, its rear axle lies as far back as that of a car (`AXLE`), and as its axles
    are taken to be centred in the body (`Vehicle.rear_axle_offset`), that tells its wheelbase, too.
    """
    usual = Vehicle()
    if vehicle is not None and agent.size in (None, (vehicle.length, vehicle.width)):
        back, wheelbase = vehicle.rear_axle_offset, vehicle.wheelbase
        return Body(agent.kind, vehicle.length, vehicle.width, vehicle.height, back, wheelbase, vehicle)
    length, width = agent.size or (usual.length, usual.width)
    return Body(agent.kind, length, width, usual.height, AXLE * length, (2 * AXLE - 1) * length, usual)


def moved_back(front: Pose, back: float) -> Pose:
    """Return the pose of the reference point of a body whose front is so far ahead of it [m]."""
    ahead = np.cos(front.heading), np.sin(front.heading)
    return Pose(float(front.x - back * ahead[0]), float(front.y - back * ahead[1]), front.heading)
