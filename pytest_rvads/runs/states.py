"""States of agents and lights (paper, section 4.2).

A `VehicleState` is made hundreds of times per simulated second; it is a named tuple because a frozen dataclass costs three
times as much to build.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from pytest_rvads.maps.segment import Turn

__all__ = [
    "APPROACH",
    "ENTRANCE",
    "EXIT",
    "GONE",
    "JUNCTION",
    "Agent",
    "Colour",
    "VehicleState",
    "Zone",
]


class Zone(IntEnum):
    """Which part of its itinerary the reference point of a vehicle is on; the parts touch, none overlap."""

    APPROACH = 0
    """On the road, before the entrance zone."""
    ENTRANCE = 1
    """From the entrance zone to the entrance vertex, which is included: ``a@j.en``."""
    JUNCTION = 2
    """On the movement, after the entrance vertex and before the exit vertex: ``a@j``."""
    EXIT = 3
    """On the exit road, from the exit vertex on."""
    GONE = 4
    """Past the end of the itinerary: the vehicle has left the run."""


APPROACH, ENTRANCE, JUNCTION, EXIT, GONE = Zone
"""The zones by themselves, for what asks thousands of times a second: looking one up in its class takes 20 times as long."""


class Colour(IntEnum):
    """Colour of the light that controls an entrance; NONE where no light does."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


@dataclass(frozen=True, slots=True)
class Agent:
    """What does not change about a vehicle during a run: the abstract part of its state."""

    name: str
    """Named by its entrance: a0 starts at entrance 0."""
    entrance: int
    exit: int
    turn: Turn
    """Turn type of its movement through the junction."""


class VehicleState(NamedTuple):
    """What can be seen of a vehicle from outside."""

    name: str
    entrance: int
    """Entrance it came from or stands at."""
    turn: Turn
    """Its indicator: the turn it is about to make or is making."""
    zone: Zone
    station: float
    """Reference point (centre of the front bumper) along its itinerary, 0 at the entrance vertex, negative before [m]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    speed: float
    """Forward speed [m/s]."""
    acceleration: float
    """Forward acceleration over the last step [m/s^2]."""
    length: float
    """Body from the reference point backwards [m]."""
    width: float
    """Body width [m]."""
