"""Eight cases in which vehicles that ignore each other touch, each in another geometry."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import inf
from typing import Any

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.states import Kind, Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario

TRUCK = Vehicle(
    mass=12000.0,
    yaw_inertia=90000.0,
    front_axle=2.6,
    rear_axle=2.6,
    gravity_height=1.3,
    length=9.0,
    width=2.5,
    height=3.6,
    front_stiffness=400e3,
    rear_stiffness=450e3,
    drive=1.5,
    kind=Kind.TRUCK,
)
"""A delivery truck of 12 t."""
CYCLIST = Vehicle(
    mass=90.0,
    yaw_inertia=12.0,
    front_axle=0.5,
    rear_axle=0.5,
    gravity_height=1.0,
    length=1.8,
    width=0.6,
    height=1.7,
    front_stiffness=5e3,
    rear_stiffness=5.5e3,
    kind=Kind.CYCLIST,
)
"""A bicycle with its rider."""


class Careless(Follower):
    """Follows its way at one speed, whoever is there.

    Args:
        speed: where the road is straight [m/s].
        swerve: angle of the front wheels [rad] instead, from `station` on.
        station: where it leaves its way, 0 at the entrance vertex [m].
    """

    def __init__(self, speed: float, swerve: float = 0.0, station: float = inf) -> None:
        self._speed, self._swerve, self._from = speed, swerve, station

    def target_speed(self, seen: Observation) -> float:  # noqa: ARG002 - asked by name
        """Return always the same [m/s]."""
        return self._speed

    def steer(self, seen: Observation) -> float:
        """Return the angle of the front wheels [rad]."""
        return self._swerve if seen.me.station >= self._from else super().steer(seen)


def contact_cases() -> Mapping[str, Case]:
    """Return the cases by the name of their geometry; in each the vehicle at entrance 0 and one other touch."""
    stop4, lanes4 = find("stop4"), find("lanes4")
    cruiser = partial(Careless, 6.0)  # equally fast and far, so that those whose ways cross meet there
    beside = [0] * len(lanes4.entrances)
    beside[0], beside[1] = lanes4.directions(0)[0], lanes4.directions(1)[0]
    moving: dict[str, Any] = {"subject": 0, "speed": 6.0, "duration": 10.0}
    crossing = Scenario(stop4, "2200", distance=12.0, **moving)
    queue = Scenario(stop4, "2000", distance=15.0, followers=1, **moving)
    return {
        "rear-end": Case(queue, partial(Careless, 2.0), cruiser),
        "standing vehicle hit": Case(queue.but(distance=1.0, speed=0.0), partial(Careless, 0.0), cruiser),
        "head-on": Case(Scenario(stop4, "2020", distance=20.0, **moving), partial(Careless, 6.0, 0.1, 5.0), cruiser),
        "crossing": Case(crossing, cruiser, cruiser),
        "corner to side": Case(Scenario(stop4, "3020", distance=12.0, **moving), cruiser, cruiser),
        "side-swipe": Case(Scenario(lanes4, beside, distance=20.0, **moving), partial(Careless, 6.0, 0.03, -19.0), cruiser),
        "truck and car": Case(crossing, cruiser, cruiser, Fleet(others={"a1": TRUCK})),
        "cyclist": Case(crossing.but(distance=(12.0, 14.0, 12.0, 12.0)), cruiser, cruiser, Fleet(others={"a1": CYCLIST})),
    }
