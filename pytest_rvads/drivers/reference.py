"""The reference autopilot, which obeys every rule and decides from its own observation alone."""

from __future__ import annotations

import math
from typing import Protocol

from pytest_rvads.drivers.at_light import Light
from pytest_rvads.drivers.crossing import Meetings, ahead_in_lane
from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.give_way import GiveWay, clear_of_meetings
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.spacing import (
    Stopping,
    behind,
    behind_leader,
    clear_of_bodies,
    clear_of_crossing,
    clear_of_standing,
    held_back,
    no_room,
)
from pytest_rvads.drivers.stop_sign import HOLD, StopSign
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.room import room
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION
from pytest_rvads.support.errors import AutopilotError

__all__ = ["Gate", "Reference", "by_zones"]


class Gate(Protocol):
    """Decides when to enter the junction."""

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter now; called in every step before the junction."""


QUEUED = 2.0
"""The driver does not enter behind a leader that is slower than this and has yet to enter [m/s]."""


class Reference(Follower):
    """Drives as the paper's rules and the law demand.

    At a stop sign the driver stops before the line, inside the entrance zone. The driver enters when no other vehicle is in the
    junction and the own turn has come: first come, first served; on ties the vehicle without a vehicle to its right. Vehicles
    whose ways do not meet do not take turns. Where four vehicles arrive at once, every vehicle has a vehicle to its right, and
    patience decides: the patience grows in the order of creation, so that a single vehicle sets off. A vehicle that has the turn,
    could go and stands for 3.5 s has waived its right, and the driver no longer waits for this vehicle.

    At a light the driver stops on yellow where that is possible, and on red always. On red the driver turns right after a full
    stop, when no vehicle with green comes whose way meets the own way. On a left turn the driver yields to oncoming traffic,
    unless that traffic stands at green for 3.5 s. The driver never gets into the way of a vehicle that is still in the junction.

    At junctions with yield signs, mixed signs, no signs or several lanes per arm the driver looks at the vehicles whose ways meet
    the own way. The driver gives way as `Junction.yields` says, stops at a stop sign, and waits for green at a light. At an
    all-way stop the driver gives way to the vehicles that came first. The driver passes a vehicle with the better right that
    stands at its line only after that vehicle has waived its right. A vehicle with the right of way goes on, unless a body blocks
    the way. Where all standing vehicles wait for each other, the vehicle that came first goes.

    At every junction the driver keeps a distance to the vehicle ahead, queues behind it, and stops before a body in the own way.
    The driver enters only if the exit has room.

    Args:
        tie: arrivals within this time count as simultaneous at an all-way stop, and the vehicle on the right goes first [s]; at
            most 0.5. The road rulebook has such a window of 0.5 s: ``functools.partial(Reference, tie=0.5)``. With 0 the driver
            keeps the paper's rules, which know neither such a window nor waivers.

    Raises:
        AutopilotError: a `tie` out of range.
    """

    def __init__(self, tie: float = 0.0) -> None:
        if not 0.0 <= tie <= HOLD:
            raise AutopilotError(f"tie must be 0 to {HOLD:g} s, the time that everybody stands at the sign, got {tie!r}")
        self._tie = tie
        self._stopping = Stopping()
        self._gate: Gate | None = None
        self._narrow = False
        """Whether vehicles before their lines may leave no room for others, see `room`; only where zones do not decide."""
        self._meetings: Meetings | None = None
        """The meetings with other vehicles in the junction; None where zones decide, see `by_zones`."""

    def make_gate(self, seen: Observation) -> Gate:
        """Return the gate that decides when to enter; called once, with the first observation."""
        if not by_zones(seen.junction):
            return GiveWay(seen, self.track(seen), self._tie)
        return Light(paper=not self._tie) if seen.junction.control is JunctionControl.LIGHTS else StopSign(self._tie)

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering."""
        acceleration = self.towards(seen, self.target_speed(seen))
        zone = seen.me.zone
        stops = False
        leader = ahead_in_lane(seen)
        if zone is APPROACH or zone is ENTRANCE:
            if self._gate is None:
                self._gate = self.make_gate(seen)
                if not by_zones(seen.junction):
                    self._meetings = Meetings(seen.junction, seen.itinerary)
                    self._narrow = bool(room(seen.junction))
            queues = leader is not None and leader.zone <= ENTRANCE and leader.speed < QUEUED
            stops = queues or not self._gate.allows(seen)
            if self._narrow:
                self._stopping.back = held_back(seen)
                stops = stops or no_room(seen, self._track or self.track(seen))
            if stops:
                stop = self._stopping.acceleration(seen)
                acceleration = stop if stop < acceleration else acceleration
            else:
                self._stopping.reset()
        if seen.others and acceleration > -math.inf:
            if not stops:
                # Vehicles of other lanes are followed only once the own vehicle need not stop at the line.
                gap = behind_leader(seen)
                acceleration = gap if gap < acceleration else acceleration
            if leader is not None:
                acceleration = min(acceleration, behind(seen, leader))
            gap = clear_of_bodies(seen, self._track or self.track(seen), leader, foresees=self._meetings is not None)
            acceleration = min(acceleration, gap, clear_of_standing(seen, self._track or self.track(seen)))
            if zone is JUNCTION:
                crossing = clear_of_crossing(seen) if self._meetings is None else clear_of_meetings(seen, self._meetings)
                acceleration = min(acceleration, crossing)
        return self.drive(seen, acceleration)


def by_zones(junction: Junction) -> bool:
    """Return whether the zones of the vehicles decide who may enter: at all-way stops and lights with one lane per arm."""
    return junction.one_lane_each and junction.control in (JunctionControl.STOP, JunctionControl.LIGHTS)
