"""The reference autopilot, which obeys every rule; every vehicle decides from its own observations, without communication."""

from __future__ import annotations

import math
from typing import Protocol

from pytest_rvads.drivers.crossing import Meetings, ahead_in_lane
from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.give_way import GiveWay, clear_of_meetings
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.let_cross import AtCrosswalks
from pytest_rvads.drivers.signs_and_lights import HOLD, Light, StopSign
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
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.room import room
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION
from pytest_rvads.support.errors import AutopilotError


class Gate(Protocol):
    """The protocol for the part of a driver that decides when to enter the junction."""

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction now; must be called in every step before the junction."""


QUEUED = 2.0
"""The driver waits behind a vehicle ahead that has not entered the junction and is slower than this [m/s]."""


class Reference(Follower):
    """The reference autopilot, which drives as the paper's rules and the law demand.

    At an all-way stop, the driver stops before the line, inside the entrance zone. The driver enters when no other vehicle is
    in the junction and it is the driver's turn. Vehicles whose ways meet take turns in the order of their arrival. Of vehicles
    that arrive together, a vehicle without a vehicle to its right goes first. If four vehicles arrive together, each of them
    has a vehicle to its right. Then each of the four waits for a time that grows in the order of creation, so that a single
    vehicle sets off. A vehicle that could go but stands for 3.5 s has waived its right, and the driver no longer waits for this
    vehicle (3 s by the rule first_come).

    At a light, the driver stops on yellow if a stop is still possible, and always stops on red. On red, the driver turns right
    after a full stop, if no vehicle with green comes whose way meets the driver's way. On a left turn, the driver yields to
    oncoming traffic, unless the oncoming traffic stands at green for 3.5 s. The driver never gets into the way of a vehicle
    that is still in the junction.

    At junctions with yield signs, mixed signs, no signs or several lanes per arm, the driver looks at the vehicles whose ways
    meet the driver's way. The driver gives way as `Junction.yields` says, stops at a stop sign, and waits for green at a light.
    At an all-way stop with several lanes, the driver gives way to the vehicles that arrived earlier. If a vehicle with priority
    stands at its line, the driver waits until that vehicle has waived its right. With the right of way, the driver goes on
    unless a vehicle blocks the way. If all standing vehicles wait for each other, the vehicle that arrived first goes.

    At every junction, the driver keeps a distance to the vehicle ahead, queues behind that vehicle, and stops before a vehicle
    that stands in the driver's way. The driver enters only if the exit has room.

    At a crosswalk, the driver lets a pedestrian cross who is on the driver's half of the roadway, who will be on this half
    before the driver has passed, or who waits at the kerb. The driver stops before the painted area, and does not drive onto a
    crosswalk without room behind the crosswalk. The driver does not wait for a pedestrian who stands at a red pedestrian light.
    For any other pedestrian who stands, the driver waits at most 3.5 s, and at most 1 s while the vehicle is in the junction.
    If pedestrians stand near a crosswalk, or a parked vehicle hides the kerb, the driver approaches the crosswalk at a moderate
    speed.

    Args:
        tie: arrivals within this time count as simultaneous at an all-way stop, and the vehicle on the right goes first [s]; at
            most 0.5. For the road rulebook, which has a window of 0.5 s, use ``functools.partial(Reference, tie=0.5)``. With 0,
            the driver keeps the paper's rules, which have neither such a window nor waived rights.

    Raises:
        AutopilotError: `tie` is out of range.
    """

    def __init__(self, tie: float = 0.0) -> None:
        if not 0.0 <= tie <= HOLD:
            raise AutopilotError(f"tie must be 0 to {HOLD:g} s, the time that everybody stands at the sign, got {tie!r}")
        self._tie = tie
        self._stopping = Stopping()
        self._gate: Gate | None = None
        self._narrow = False
        """Whether a car at its line can be in the way of cars that pass, see `room`; always False at junctions of `by_zones`."""
        self._meetings: Meetings | None = None
        """The stretches that the own movement shares with movements of other vehicles; None at junctions of `by_zones`."""
        self._at_crosswalks: AtCrosswalks | None = None
        """Brakes for pedestrians; None at junctions where nobody walks."""

    def make_gate(self, seen: Observation) -> Gate:
        """Return the object that decides when to enter the junction; called once, with the first observation."""
        if not by_zones(seen.junction):
            return GiveWay(seen, self.track(seen), self._tie)
        return Light(paper=not self._tie) if seen.junction.control is JunctionControl.LIGHTS else StopSign(self._tie)

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering for the next step, for the least of the accelerations that its parts ask for."""
        everybody, seen = seen, seen.on_movements()
        acceleration = self.towards(everybody, self.target_speed(everybody))
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
        if seen.others and acceleration > -math.inf:  # -inf holds a standing vehicle, see `Follower.drive`
            if not stops:
                # A vehicle that stops at its line need not keep a distance to vehicles from other lanes.
                follow = behind_leader(seen)
                acceleration = follow if follow < acceleration else acceleration
            if leader is not None:
                acceleration = min(acceleration, behind(seen, leader))
            clear = clear_of_bodies(seen, self._track or self.track(seen), leader, foresees=self._meetings is not None)
            acceleration = min(acceleration, clear, clear_of_standing(seen, self._track or self.track(seen)))
            if zone is JUNCTION:
                crossing = clear_of_crossing(seen) if self._meetings is None else clear_of_meetings(seen, self._meetings)
                acceleration = min(acceleration, crossing)
        if everybody is not seen and acceleration > -math.inf:
            if self._at_crosswalks is None:
                self._at_crosswalks = AtCrosswalks(everybody, self.track(everybody))
            acceleration = min(acceleration, self._at_crosswalks.acceleration(everybody, seen))
        return self.drive(everybody, acceleration)


def by_zones(junction: Junction) -> bool:
    """Return whether drivers decide by the zones of other vehicles, without computing where their movements meet.

    They do so at all-way stops and at junctions with lights, if each arm has a single lane.
    """
    return junction.one_lane_each and junction.control in (JunctionControl.STOP, JunctionControl.LIGHTS)
