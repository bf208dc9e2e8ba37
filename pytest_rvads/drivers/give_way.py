"""When the reference driver enters a junction with yield signs, mixed signs, no signs, or several lanes per arm.

The driver looks at every vehicle whose possible movement shares a stretch with the own movement. The driver leaves time to the
vehicles that go first. The driver relies on all other vehicles to give way, unless their motion shows that they will not.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.at_light import EAGER, SET_OFF, YELLOW, Light
from pytest_rvads.drivers.crossing import ROLLING, Meeting, Meetings, exit_blocked, may_meet, may_yield, not_queued, runs_through
from pytest_rvads.drivers.follower import STANDING
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.order import Queue
from pytest_rvads.drivers.spacing import BEFORE, LEEWAY, can_stop, stop_before, time_to
from pytest_rvads.drivers.stop_sign import HOLD, WAIVER
from pytest_rvads.drivers.way_ahead import Track
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.logic.conduct.room import stand_back
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION, Colour, VehicleState

__all__ = ["GiveWay", "clear_of_meetings"]

DRIVE = 2.3
"""Own acceleration that decisions count on [m/s^2]; the earliest arrival is computed with `EAGER`."""
TARDY, CRAWL = 1.5, 4.0
"""Least assumed acceleration [m/s^2] and speed [m/s] of other vehicles that leave the junction."""
MARGIN = 1.6
"""Time kept between leaving a place and the arrival there of a vehicle that goes first [s]; at a near miss it is 1 s."""
MOVING = 0.15
"""A vehicle faster than this moves [m/s]."""
PATIENCE_STEP = 0.5
"""Where all vehicles wait for one another: how long the first vehicle waits, and how much longer each next vehicle [s]. In this
time a driver sees that another vehicle has set off."""
EARLY = 6.0
"""Distance before the beginning of braking from which on a decision is needed [m]."""
_GENTLE = 1.5
"""Deceleration that is still possible after a decision [m/s^2]."""
_GAP = 2.0
"""Distance kept behind a vehicle that merges first [m]."""
_GREEN, _YELLOW, _RED = Colour.GREEN, Colour.YELLOW, Colour.RED


class GiveWay:
    """Stops at the own stop sign or light, gives way to the vehicles that go first, and enters when the exit has room.

    Args:
        seen: the first observation.
        track: the own track.
        tie: arrivals within this time count as simultaneous at an all-way stop [s], see `Queue`.
        stops: whether the driver stops at stop signs; otherwise stop signs count as yield signs.
    """

    def __init__(self, seen: Observation, track: Track, tie: float = 0.0, *, stops: bool = True) -> None:
        junction, itinerary = seen.junction, seen.itinerary
        entrance = junction.entrances[itinerary.entrance]
        self._meetings = Meetings(junction, itinerary)
        self._queue = Queue(tie)
        self._paper = Light() if junction.control is JunctionControl.LIGHTS and not tie else None
        """The gate of the paper's rules at lights, which hold besides giving way; None elsewhere."""
        self._all_stop = junction.control is JunctionControl.STOP
        self._must_stop = stops and entrance.sign is Sign.STOP
        self._on_red = itinerary.turn is junction.near and entrance.lane == 0 and not junction.left_hand
        self._stop_signs = frozenset(k for k, lane in enumerate(junction.entrances) if lane.sign is Sign.STOP)
        # The slowest place of the movement decides how fast the vehicle clears the junction.
        limits = (itinerary.limit_at(max(station, 0.0)) for station, _ in itinerary.limits if station < itinerary.length)
        self._cruise = min((track.slowest(itinerary.length), *limits))
        self._back = stand_back(junction, itinerary.entrance)
        self._stood_since: float | None = None
        self._quiet_since: float | None = None
        self._released = False

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; to be called in every step before it."""
        me = seen.me
        speed = me.speed
        if me.zone is APPROACH and -me.station > EARLY + self._back + speed + speed * speed / (2.0 * _GENTLE):
            return False
        self._queue.watch(seen)
        if self._at_line(me) and speed < STANDING and self._stood_since is None:
            self._stood_since = seen.time
        if not self._permitted(seen) or (self._paper is not None and self._paper.owes(seen)):
            self._released, self._quiet_since = False, None
            return False
        meets = self._meetings.of
        waits_for = [other for k, other in not_queued(seen) if meets(other) and self._blocked(seen, other, k < seen.created)]
        if self._all_stop:
            waits_for += self._came_first(seen, me)
        moves = any(other.speed > MOVING or not self._queue.arrived(other) for other in waits_for)
        if moves or exit_blocked(seen) or _stuck(seen):
            self._released, self._quiet_since = False, None
            return False
        return not waits_for or self._patience_ends(seen, waits_for)

    def _permitted(self, seen: Observation) -> bool:
        """Return whether the own sign and the own light allow the entry."""
        stood = self._at_line(seen.me) and self._stood_since is not None and seen.time - self._stood_since >= HOLD
        if self._must_stop and not stood:
            return False
        colour = seen.lights[seen.me.entrance]
        if colour is _YELLOW:
            return not can_stop(seen, YELLOW)
        return colour is not _RED or (self._on_red and self._stood_since is not None)

    def _at_line(self, me: VehicleState) -> bool:
        """Return whether the own vehicle is at its entrance, or has stopped farther from the line so that others have room."""
        return me.zone is ENTRANCE or (self._back > 0.0 and self._queue.stood(me))

    def _came_first(self, seen: Observation, vehicle: VehicleState) -> list[VehicleState]:
        """Return the vehicles that have arrived at an all-way stop, may meet `vehicle`, and enter before it."""
        junction, prior = seen.junction, []
        for other in seen.everybody():
            if self._queue.arrived(other) and may_meet(junction, (vehicle.entrance, vehicle.turn), (other.entrance, other.turn)):
                before = self._queue.before(other, vehicle)
                if before or (before is None and (other.entrance, vehicle.entrance) in junction.right_of):
                    prior.append(other)
        return prior

    def _blocked(self, seen: Observation, other: VehicleState, earlier: bool) -> bool:
        """Return whether the own vehicle has to wait for `other`; `earlier` states whether `other` was created first."""
        if other.zone >= JUNCTION:
            red = seen.lights[seen.me.entrance] is _RED
            return not all(self._fits(seen, other, m, MARGIN if m.mine or red else 0.0) for m in self._meetings.of(other))
        colour = seen.lights[other.entrance]
        runs = runs_through(other)
        if not runs and (colour is _RED or (colour is _YELLOW and other.speed < MOVING)):
            return False
        for meeting in self._meetings.of(other):
            goes_first = self._goes_first(seen, other, meeting, earlier)
            if goes_first and not self._leaves_time(seen, other, meeting):
                return True
            if not goes_first and (runs or self._sets_off(seen, other)) and not self._fits(seen, other, meeting, MARGIN / 2.0):
                return True
        return False

    def _goes_first(self, seen: Observation, other: VehicleState, meeting: Meeting, earlier: bool) -> bool:
        """Return whether `other`, before the junction, goes first."""
        me = seen.me
        if self._all_stop:
            if not self._queue.arrived(other) or not self._queue.arrived(me):
                return self._queue.arrived(other)
            before = self._queue.before(other, me)
            if before is not None:
                return before
            right_of = seen.junction.right_of
            if (me.entrance, other.entrance) in right_of:
                return False
            if (other.entrance, me.entrance) not in right_of and self._came_first(seen, other):
                # A turning vehicle waits for an oncoming vehicle only if no vehicle goes before the oncoming vehicle.
                return False
        elif seen.lights[me.entrance] is _RED:
            return True
        if meeting.mine or meeting.yours:
            return meeting.mine
        return other.station > me.station or (other.station == me.station and earlier)

    def _sets_off(self, seen: Observation, other: VehicleState) -> bool:
        """Return whether `other` has set off from its line before the own vehicle did from its own."""
        return self._queue.setting_off(other) and not self._queue.setting_off(seen.me) and self._queue.stood(seen.me)

    def _leaves_time(self, seen: Observation, other: VehicleState, meeting: Meeting) -> bool:
        """Return whether this vehicle passes before `other`, which goes first, comes to the place, or after `other` has left it.

        No vehicle passes in front of a vehicle that is first at its line: the vehicle at the line may set off.
        """
        return (not self._queue.arrived(other) and self._before(seen, other, meeting, MARGIN)) or (
            other.speed > ROLLING and not self._will_stop(other) and self._after(seen, other, meeting)
        )

    def _fits(self, seen: Observation, other: VehicleState, meeting: Meeting, margin: float) -> bool:
        """Return whether `other`, which does not stop, and the own vehicle pass the place one after the other."""
        return self._after(seen, other, meeting) or self._before(seen, other, meeting, margin)

    def _before(self, seen: Observation, other: VehicleState, meeting: Meeting, margin: float) -> bool:
        """Return whether the own vehicle has passed `margin` [s] before the earliest arrival of `other`.

        A vehicle that joins the exit of another vehicle to which it owes the way is clear of it only `LEAVE` down the exit road:
        it also has to be clear before `other` comes at its present speed, since `other` may brake meanwhile.
        """
        me, (mine, yours, merges) = seen.me, meeting.shared
        if other.station >= yours.start:
            return False
        speed = min(me.speed, self._cruise)
        cruise, delay = min(self._cruise, seen.speed_limit), SET_OFF if me.speed < 1.0 else 0.0
        if not merges:
            leaves = delay + time_to(mine.end + me.length - me.station, speed, DRIVE, cruise)
            return leaves + margin < self._arrives(seen, other, yours.start)
        if (meeting.mine or seen.lights[me.entrance] is _RED) and not self._will_stop(other):
            inside = seen.itinerary.length - me.station
            fast = min(math.sqrt(speed * speed + 2.0 * DRIVE * inside), cruise)
            clear = delay + time_to(inside, speed, DRIVE, cruise) + time_to(LEAVE + me.length, fast, DRIVE, seen.speed_limit)
            if yours.start - other.station < other.speed * (clear + margin):
                return False
        # The vehicle behind is faster for a while: it must neither come near nor have to brake.
        way = mine.start - me.station
        arrival = delay + time_to(way, speed, DRIVE, cruise)
        reached = min(math.sqrt(speed * speed + 2.0 * DRIVE * max(way, 0.0)), cruise)
        limit = max(seen.limit_of(other), other.speed)
        fast = min(math.sqrt(other.speed**2 + 2.0 * EAGER * (yours.start - other.station)), limit)
        closing = max(fast - reached, 0.0)
        gap = margin + (me.length + closing * closing / (2.0 * DRIVE)) / max(fast, 1.0)
        return arrival + gap < self._arrives(seen, other, yours.start)

    def _after(self, seen: Observation, other: VehicleState, meeting: Meeting) -> bool:
        """Return whether `other` has left the shared stretch before the own earliest arrival, so that no stop is needed."""
        me, (mine, yours, merges) = seen.me, meeting.shared
        end = yours.start + _GAP if merges else yours.end
        if other.station - other.length >= end:
            return True
        soonest = time_to(mine.start - me.station, me.speed, EAGER, max(seen.speed_limit, me.speed))
        # A standing vehicle can wait for the longer margin; a moving vehicle would have to brake.
        return _leaves(other, end, meeting.slow) + (LEEWAY if me.speed > ROLLING else MARGIN) < soonest

    def _will_stop(self, other: VehicleState) -> bool:
        return other.entrance in self._stop_signs and other.zone < JUNCTION and not self._queue.stood(other)

    def _arrives(self, seen: Observation, other: VehicleState, place: float) -> float:
        """Return the earliest time at which `other` can be at `place` of its movement [s], after a stop at its stop sign."""
        limit = seen.limit_of(other)
        if not self._will_stop(other):
            return time_to(place - other.station, other.speed, EAGER, limit)
        line = -seen.junction.setbacks[other.entrance]
        before = time_to(line - other.station, other.speed, EAGER, limit)
        return before + HOLD + time_to(place - max(line, other.station), 0.0, EAGER, limit)

    def _patience_ends(self, seen: Observation, waits_for: list[VehicleState]) -> bool:
        """Return whether to go before the standing vehicles `waits_for`, because these vehicles wait as well or do not go.

        The patience runs while no vehicle moves that would meet the own vehicle or one of `waits_for`. The patience is longer for
        every vehicle that arrived earlier, so that a single vehicle breaks a circle of waiting vehicles: a second vehicle could
        take the way of a vehicle that may go by then.
        """
        me = seen.me
        if self._released and me.speed > MOVING:
            return True
        moving = [other for _, other in not_queued(seen) if other.speed > MOVING and other.zone <= JUNCTION]
        if not self._at_line(me) or me.speed > MOVING or any(self._concerns(seen, other, waits_for) for other in moving):
            self._quiet_since = None
            return False
        if self._quiet_since is None:
            self._quiet_since = seen.time
        since, own_rank = self._queue.since, (self._queue.since(me), seen.created)
        unlit = seen.lights[me.entrance] is Colour.NONE
        arrived = [(k, o) for k, o in enumerate(seen.others) if self._queue.arrived(o) and (unlit or self._meetings.of(o))]
        place = sum((since(other), k) < own_rank for k, other in arrived)
        patience = PATIENCE_STEP if all(self._held(seen, other) for other in waits_for) else WAIVER
        self._released = seen.time - self._quiet_since >= patience + PATIENCE_STEP * place
        return self._released

    def _held(self, seen: Observation, other: VehicleState) -> bool:
        """Return whether `other`, at its line, has to let another arrived vehicle go first."""
        if self._all_stop:
            return bool(self._came_first(seen, other))
        junction, way, arrived = seen.junction, (other.entrance, other.turn), self._queue.arrived
        unlit = seen.lights[other.entrance] is Colour.NONE
        return unlit and any(
            arrived(vehicle) and may_yield(junction, way, (vehicle.entrance, vehicle.turn)) for vehicle in seen.everybody()
        )

    def _concerns(self, seen: Observation, moving: VehicleState, waits_for: list[VehicleState]) -> bool:
        """Return whether this vehicle may be waiting for `moving`, directly or by way of a vehicle that it waits for."""
        if any(moving.station - moving.length < meeting.shared.yours.end for meeting in self._meetings.of(moving)):
            return True
        way = moving.entrance, moving.turn
        return any(may_meet(seen.junction, (other.entrance, other.turn), way) for other in waits_for)


def clear_of_meetings(seen: Observation, meetings: Meetings) -> float:
    """Return the acceleration [m/s^2] that lets pass crossing vehicles that are first at the place; inf without any.

    All these vehicles are in the junction. Vehicles that leave the place in time are not waited for. Vehicles that drive into the
    same exit are followed instead.
    """
    me = seen.me
    least = math.inf
    for k, other in enumerate(seen.others):
        if other.zone < JUNCTION:
            continue
        for (my, yours, merges), _, _, slow in meetings.of(other):
            place = my.start
            if merges or me.station >= place or other.station - other.length >= yours.end:
                continue
            own_time = (place - me.station) / max(me.speed, 1.0)
            other_time = max(yours.start - other.station, 0.0) / max(other.speed, 1.0)
            goes_first = other_time < own_time or (other_time == own_time and k < seen.created)
            if goes_first and _leaves(other, yours.end, slow) + LEEWAY > own_time:
                least = min(least, stop_before(me.speed, place - BEFORE - me.station))
    return least


def _stuck(seen: Observation) -> bool:
    """Return whether a vehicle from the own lane stands in the junction, so that the own vehicle would have to stop behind it."""
    entrance = seen.me.entrance
    return any(other.entrance == entrance and other.zone is JUNCTION and other.speed < 1.0 for other in seen.others)


def _leaves(other: VehicleState, end: float, slow: float) -> float:
    """Return the time until the body of `other` has left a place that ends at station `end` [s]; inf while `other` stands.

    Args:
        other: the other vehicle.
        end: station of the end of the place [m].
        slow: highest speed of the other vehicle in its bend [m/s].
    """
    if other.speed < MOVING:
        return math.inf
    return time_to(end + other.length - other.station, min(other.speed, slow), TARDY, min(CRAWL, slow))
