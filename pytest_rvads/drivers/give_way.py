"""Decides when the reference driver enters a junction with yield signs, mixed signs, no signs, or several lanes per arm.

The driver looks at every vehicle whose possible movement shares a stretch with the own movement. For a vehicle that goes first,
the driver leaves enough time. The driver relies on every other vehicle to give way, unless the motion of this vehicle shows that
it will not.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.crossing import ROLLING, Meeting, Meetings, exit_blocked, may_meet, may_yield, not_queued, runs_through
from pytest_rvads.drivers.follower import STANDING, Track
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.signs_and_lights import EAGER, HOLD, SET_OFF, WAIVER, Light, OnYellow, Queue, may_get_green
from pytest_rvads.drivers.spacing import BEFORE, LEEWAY, stop_before, time_to
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.logic.conduct.room import stand_back
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION, Colour, VehicleState

DRIVE = 2.3
"""Acceleration that the driver expects of its own vehicle when it computes how soon it leaves a stretch [m/s^2]; how soon it can
arrive is computed with `EAGER`."""
TARDY, CRAWL = 1.5, 4.0
"""Acceleration [m/s^2] and final speed [m/s] that the driver expects at least of other vehicles that leave the junction."""
MARGIN = 1.6
"""Least time from the own leaving of a shared stretch to the arrival of a vehicle that goes first [s]; 1 s is a near miss."""
MOVING = 0.15
"""A vehicle faster than this counts as moving [m/s]."""
PATIENCE_STEP = 0.5
"""If all vehicles wait for one another, the vehicle that arrived first waits for this time, and each later vehicle waits for this
time longer than the vehicle before [s]. The time is long enough to see that another vehicle has set off."""
EARLY = 6.0
"""The driver begins to decide on entering at this distance before the point where it would have to brake gently [m]."""
_GENTLE = 1.5
"""Deceleration of gentle braking, with which the driver can stop if it decides to wait [m/s^2]."""
_GAP = 2.0
"""Distance that the own vehicle keeps behind a vehicle that drives into the same exit first [m]."""
_GREEN, _YELLOW, _RED = Colour.GREEN, Colour.YELLOW, Colour.RED


class GiveWay:
    """Decides when to enter: after a stop at a sign or light, in gaps between vehicles that go first, if the exit has room.

    Without `stops`, the driver treats stop signs as yield signs. `Queue` explains the tie [s].
    """

    def __init__(self, seen: Observation, track: Track, tie: float = 0.0, *, stops: bool = True) -> None:
        junction, itinerary = seen.junction, seen.itinerary
        entrance = junction.entrances[itinerary.entrance]
        self._meetings = Meetings(junction, itinerary)
        self._queue = Queue(tie)
        self._paper = Light() if junction.control is JunctionControl.LIGHTS and not tie else None
        """The paper's rules at lights, which the driver keeps in addition to giving way; None where they don't apply."""
        self._all_stop = junction.control is JunctionControl.STOP
        self._must_stop = stops and entrance.sign is Sign.STOP
        on_red = junction.turns_on_red(itinerary.entrance, itinerary.turn)
        self._on_red = on_red and entrance.lane == 0 and not junction.left_hand
        self._stop_signs = frozenset(k for k, lane in enumerate(junction.entrances) if lane.sign is Sign.STOP)
        # The lowest speed limit and the narrowest bend of the movement decide how soon the vehicle leaves the junction.
        limits = (itinerary.limit_at(max(station, 0.0)) for station, _ in itinerary.limits if station < itinerary.length)
        self._cruise = min((track.slowest(itinerary.length), *limits))
        self._back = stand_back(junction, itinerary.entrance)
        self._stood_since: float | None = None
        self._quiet_since: float | None = None
        self._released = False
        self._yellow = OnYellow()

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; must be called in every step before the junction."""
        me = seen.me
        speed = me.speed
        if me.zone is APPROACH and -me.station > EARLY + self._back + speed + speed * speed / (2.0 * _GENTLE):
            return False
        self._queue.watch(seen)
        if self._at_line(me) and speed < STANDING and self._stood_since is None:
            self._stood_since = seen.time
        stood = self._at_line(me) and self._stood_since is not None and seen.time - self._stood_since >= HOLD
        permitted = stood or not self._must_stop
        if permitted:
            colour, passes = seen.lights[me.entrance], self._yellow.allows(seen)
            permitted = passes if colour is _YELLOW else colour is not _RED or (self._on_red and self._stood_since is not None)
        if not permitted or (self._paper is not None and self._paper.owes(seen)):
            self._released, self._quiet_since = False, None
            return False
        meets = self._meetings.of
        waits_for = [other for k, other in not_queued(seen) if meets(other) and self._blocked(seen, other, k < seen.created)]
        if self._all_stop:
            waits_for += self._came_first(seen, me)
        moves = any(other.speed > MOVING or not self._queue.arrived(other) for other in waits_for)
        # The own vehicle would stop behind a vehicle from its entrance that stands in the junction.
        stuck = any(o.entrance == me.entrance and o.zone is JUNCTION and o.speed < 1.0 for o in seen.others)
        if moves or exit_blocked(seen) or stuck:
            self._released, self._quiet_since = False, None
            return False
        return not waits_for or self._patience_ends(seen, waits_for)

    def _at_line(self, me: VehicleState) -> bool:
        """Return whether the own vehicle is in its entrance zone, or has stopped before this zone to leave room for others."""
        return me.zone is ENTRANCE or (self._back > 0.0 and self._queue.stood(me))

    def _came_first(self, seen: Observation, vehicle: VehicleState) -> list[VehicleState]:
        """Return the vehicles at an all-way stop that have arrived and enter before `vehicle`, if their movements can meet."""
        junction, prior = seen.junction, []
        for other in seen.everybody():
            if self._queue.arrived(other) and may_meet(junction, (vehicle.entrance, vehicle.turn), (other.entrance, other.turn)):
                before = self._queue.before(other, vehicle)
                if before or (before is None and (other.entrance, vehicle.entrance) in junction.right_of):
                    prior.append(other)
        return prior

    def _blocked(self, seen: Observation, other: VehicleState, earlier: bool) -> bool:
        """Return whether the own vehicle has to wait for `other`."""
        if other.zone >= JUNCTION:
            for meeting in self._meetings.of(other):
                margin = MARGIN if meeting.mine or seen.lights[seen.me.entrance] is _RED else 0.0
                if not (self._after(seen, other, meeting) or self._before(seen, other, meeting, margin)):
                    return True
            return False
        colour = seen.lights[other.entrance]
        runs = runs_through(seen, other)
        if not runs and (colour is _RED or (colour is _YELLOW and other.speed < MOVING)):
            # The light of a vehicle that waits at red can turn green before the own vehicle has finished its turn on red.
            waits = seen.lights[seen.me.entrance] is _RED and self._queue.arrived(other) and may_get_green(seen, other)
            return waits and bool(self._meetings.of(other))
        queue = self._queue
        for meeting in self._meetings.of(other):
            if self._goes_first(seen, other, meeting, earlier):
                # The own vehicle need not wait if it leaves the shared stretch before `other` arrives, or arrives after `other`
                # has left. It does not pass before a vehicle that has arrived at its line, because this vehicle could set off.
                passes = (not queue.arrived(other) and self._before(seen, other, meeting, MARGIN)) or (
                    other.speed > ROLLING and not self._will_stop(other) and self._after(seen, other, meeting)
                )
            else:
                # `other` may have set off from its line while the own vehicle still stands at its line.
                sets_off = queue.setting_off(other) and not queue.setting_off(seen.me) and queue.stood(seen.me)
                passes = not (runs or sets_off) or self._after(seen, other, meeting)
                passes = passes or self._before(seen, other, meeting, MARGIN / 2.0)
            if not passes:
                return True
        return False

    def _goes_first(self, seen: Observation, other: VehicleState, meeting: Meeting, earlier: bool) -> bool:
        """Return whether `other`, which is still before the junction, enters before the own vehicle."""
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
                # The own vehicle does not wait for an oncoming vehicle that has to let a third vehicle go first.
                return False
        elif seen.lights[me.entrance] is _RED:
            return True
        if meeting.mine or meeting.yours:
            return meeting.mine
        return other.station > me.station or (other.station == me.station and earlier)

    def _before(self, seen: Observation, other: VehicleState, meeting: Meeting, margin: float) -> bool:
        """Return whether the own vehicle will have left the shared stretch at least `margin` [s] before `other` can arrive.

        If both vehicles drive into the same exit and `other` has priority, the own vehicle is in its way until it is `LEAVE` down
        the exit road. So the own vehicle also has to be so far down before `other` arrives at its present speed.
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
        # `other` will be faster than the own vehicle for a while; it must not have to brake, nor come close from behind.
        way = mine.start - me.station
        arrival = delay + time_to(way, speed, DRIVE, cruise)
        reached = min(math.sqrt(speed * speed + 2.0 * DRIVE * max(way, 0.0)), cruise)
        limit = max(seen.limit_of(other), other.speed)
        fast = min(math.sqrt(other.speed**2 + 2.0 * EAGER * (yours.start - other.station)), limit)
        closing = max(fast - reached, 0.0)
        gap = margin + (me.length + closing * closing / (2.0 * DRIVE)) / max(fast, 1.0)
        return arrival + gap < self._arrives(seen, other, yours.start)

    def _after(self, seen: Observation, other: VehicleState, meeting: Meeting) -> bool:
        """Return whether `other` will have left the shared stretch before the own vehicle can arrive."""
        me, (mine, yours, merges) = seen.me, meeting.shared
        end = yours.start + _GAP if merges else yours.end
        if other.station - other.length >= end:
            return True
        soonest = time_to(mine.start - me.station, me.speed, EAGER, max(seen.speed_limit, me.speed))
        # A standing vehicle can wait for the longer margin without a disadvantage; a moving vehicle would have to brake for it.
        return _leaves(other, end, meeting.slow) + (LEEWAY if me.speed > ROLLING else MARGIN) < soonest

    def _will_stop(self, other: VehicleState) -> bool:
        return other.entrance in self._stop_signs and other.zone < JUNCTION and not self._queue.stood(other)

    def _arrives(self, seen: Observation, other: VehicleState, place: float) -> float:
        """Return the least time until `other` can reach the station `place` [s], including the stop that its sign requires."""
        limit = seen.limit_of(other)
        if not self._will_stop(other):
            return time_to(place - other.station, other.speed, EAGER, limit)
        line = -seen.junction.setbacks[other.entrance]
        before = time_to(line - other.station, other.speed, EAGER, limit)
        return before + HOLD + time_to(place - max(line, other.station), 0.0, EAGER, limit)

    def _patience_ends(self, seen: Observation, waits_for: list[VehicleState]) -> bool:
        """Return whether the own vehicle has waited long enough to go before the standing vehicles `waits_for`.

        The wait counts while no vehicle moves whose movement can meet the own movement or a movement of `waits_for`. The wait is
        short if all vehicles of `waits_for` have to wait for other vehicles, and `WAIVER` if a vehicle of `waits_for` could go
        but stands. The wait is longer by `PATIENCE_STEP` for each vehicle that arrived earlier than the own vehicle, so that of
        several vehicles that wait for each other only one sets off.
        """
        me = seen.me
        if self._released and me.speed > MOVING:
            return True
        moving = [other for _, other in not_queued(seen) if other.speed > MOVING and other.zone <= JUNCTION]
        meets = any(o.station - o.length < meeting.shared.yours.end for o in moving for meeting in self._meetings.of(o))
        ways, moving_ways = ({(o.entrance, o.turn) for o in vehicles} for vehicles in (waits_for, moving))
        meets = meets or any(may_meet(seen.junction, way, moving_way) for way in ways for moving_way in moving_ways)
        if meets or not self._at_line(me) or me.speed > MOVING:
            self._quiet_since = None
            return False
        if self._quiet_since is None:
            self._quiet_since = seen.time
        since, own_rank = self._queue.since, (self._queue.since(me), seen.created)
        unlit = seen.lights[me.entrance] is Colour.NONE
        arrived = [(k, o) for k, o in enumerate(seen.others) if self._queue.arrived(o) and (unlit or self._meetings.of(o))]
        place = sum((since(other), k) < own_rank for k, other in arrived)
        if self._all_stop:
            held = all(self._came_first(seen, other) for other in waits_for)
        else:
            arrived_ways = [(o.entrance, o.turn) for o in seen.everybody() if self._queue.arrived(o)]
            held = all(
                seen.lights[other.entrance] is Colour.NONE
                and any(may_yield(seen.junction, (other.entrance, other.turn), way) for way in arrived_ways)
                for other in waits_for
            )
        patience = PATIENCE_STEP if held else WAIVER
        self._released = seen.time - self._quiet_since >= patience + PATIENCE_STEP * place
        return self._released


def clear_of_meetings(seen: Observation, meetings: Meetings) -> float:
    """Return the acceleration [m/s^2] with which the own vehicle stops before a stretch that a crossing vehicle reaches first.

    The result is inf if no stop is needed. The own vehicle does not stop for a vehicle that leaves the shared stretch in time.
    Vehicles that drive into the own exit are ignored, because the driver follows them at a distance.
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


def _leaves(other: VehicleState, end: float, slow: float) -> float:
    """Return the time until the body of `other`, at most as fast as `slow` [m/s], has left a stretch [s]; inf while it stands."""
    if other.speed < MOVING:
        return math.inf
    return time_to(end + other.length - other.station, min(other.speed, slow), TARDY, min(CRAWL, slow))
