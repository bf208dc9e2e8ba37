"""Computes how a driver brakes: for a stop before the junction, and for vehicles that drive or stand ahead.

"Own" refers to the vehicle whose driver brakes.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.crossing import conflicts
from pytest_rvads.drivers.follower import Track, resistance
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.sweep import BEHIND
from pytest_rvads.logic.conduct.room import PLACES, leaves_room, room, stand_back
from pytest_rvads.runs.states import ENTRANCE, EXIT, JUNCTION, VehicleState

STAND_OFF = 0.35
"""Distance from the driver's stopping point to the stopping line [m]; the stopping point is well inside the entrance zone."""
MISSED = 0.3
"""A vehicle that is this far past a stopping point outside of the entrance zone drives on to the line [m]."""
LAST_STOP = 0.15
"""A late stop ends at least this far before the entrance vertex [m]."""
COMFORT = 2.3
"""Braking for the line begins when the stop needs this deceleration [m/s^2]; people use up to 3.4 m/s^2 at stop signs."""
FIRM = 3.0
"""A vehicle that needs a higher deceleration than this to stop at the line brakes at once [m/s^2]."""
URGENT = 0.8
"""A vehicle brakes fully if a stop before the entrance vertex needs more than this share of its highest deceleration."""
CREEP = 0.3
"""A vehicle in the entrance zone that is slower than this is stopped at once [m/s]."""
CREEPING = 1.4
"""A vehicle before the junction that is slower than this is checked as if it stopped where it is [m/s]."""
GENTLE = 0.5
"""Highest acceleration at the stopping point, and its increase per metre of distance from the stopping point [m/s^2]."""
GAP = 2.0
"""Distance that the driver keeps to a vehicle that stands ahead [m]."""
REACTION = 0.5
"""Reaction time in the car-following model, in which a difference to the safe speed is corrected [s]."""
FOLLOW = 3.0
"""Deceleration of both vehicles in the car-following model [m/s^2]."""
BEFORE = 0.5
"""Distance before a shared stretch at which the own vehicle stops for a crossing vehicle [m]."""
SIDE = 0.35
"""Free space that the own body needs on each side [m]."""
NEAR = 0.1
"""Distance that the own body keeps to a standing vehicle in a bend [m]; the rear axle leaves its path by less than this."""
ACROSS = 0.7
"""Cosine of 45 degrees: a vehicle that moves at a larger angle to the own heading crosses the own way."""
LEEWAY = 0.5
"""Least time from the moment when a crossing vehicle leaves a shared stretch to the own arrival [s]."""


class Stopping:
    """Brakes with constant deceleration for a stop in the entrance zone, and remembers that braking has begun.

    If a vehicle in the entrance zone would be in the way of others, the stop is farther from the line, see `stand_back`.
    """

    def __init__(self) -> None:
        self._braking = False
        self.back = STAND_OFF
        """Distance from the stopping point to the stopping line [m]."""

    def reset(self) -> None:
        """Forget that braking has begun, because the driver need not stop any more."""
        self._braking = False

    def acceleration(self, seen: Observation) -> float:
        """Return the acceleration for the stop [m/s^2]."""
        me, vehicle = seen.me, seen.vehicle
        line = seen.itinerary.line - me.station
        distance = line - self.back
        if distance < -MISSED or (not self._braking and _needed(me.speed, distance) > FIRM):
            distance = line - STAND_OFF
        if me.speed < CREEP and (distance < 0.02 or me.zone is ENTRANCE):
            return -math.inf
        needed = _needed(me.speed, distance)
        if not self._braking:
            # After the throttle is released, the vehicle accelerates for the lag of the drive, and brakes after the lag of the
            # brake.
            speed = me.speed + max(me.acceleration, 0.0) * vehicle.drive_lag
            ahead = distance - speed * vehicle.brake_lag
            if needed <= FIRM and _needed(speed, ahead) < COMFORT:
                return GENTLE + distance * GENTLE
        elif needed < COMFORT / 4.0:
            self._braking = False
            return 0.0
        self._braking = True
        full = vehicle.brake[seen.aggression - 1]
        most = full + resistance(vehicle, me.speed)
        urgent = _needed(me.speed, seen.itinerary.entry - me.station)
        if urgent > most:
            return math.inf
        # A late stop begins with the full brake, because the lag of the brake costs distance.
        return -full if urgent > URGENT * most else -min(needed, full)


def can_stop(seen: Observation, deceleration: float) -> bool:
    """Return whether the own vehicle stops before the junction if it brakes at `deceleration` [m/s^2] from now on."""
    speed = seen.me.speed
    distance = seen.itinerary.entry - LAST_STOP - seen.me.station - speed * seen.vehicle.brake_lag
    return speed * speed <= 2.0 * deceleration * distance if speed > 0.1 else seen.me.station <= seen.itinerary.entry


def behind_leader(seen: Observation) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to vehicles ahead that drive into the own exit; inf without any."""
    me, itinerary = seen.me, seen.itinerary
    remaining = itinerary.length - me.station
    least = math.inf
    for other in seen.others:
        zone = other.zone
        if zone is not JUNCTION and zone is not EXIT:
            continue
        for movement in seen.junction.by_turn[other.entrance, other.turn]:
            left = movement.length - other.station
            if movement.exit == itinerary.exit and left < remaining:
                least = min(least, _follow(me.speed, remaining - left - other.length, other.speed))
    return least


def clear_of_crossing(seen: Observation) -> float:
    """Return the acceleration [m/s^2] with which the own vehicle stops before a stretch that a crossing vehicle reaches first.

    The result is inf if no stop is needed. Vehicles that drive into the own exit are ignored, because the driver follows them at
    a distance.
    """
    me = seen.me
    least = math.inf
    for k, other in enumerate(seen.others):
        if other.zone is not JUNCTION:
            continue
        for shared in conflicts(seen, other):
            place = shared.mine.start
            if shared.merges or me.station >= place or other.station - other.length >= shared.yours.end:
                continue
            own_time = (place - me.station) / max(me.speed, 1.0)
            other_time = max(shared.yours.start - other.station, 0.0) / max(other.speed, 1.0)
            if other_time < own_time or (other_time == own_time and k < seen.created):
                least = min(least, stop_before(me.speed, place - BEFORE - me.station))
    return least


def behind(seen: Observation, leader: VehicleState) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to `leader`, ahead in the own lane; inf if it turns elsewhere."""
    if leader.turn is not seen.me.turn and leader.zone > ENTRANCE:
        return math.inf
    return _follow(seen.me.speed, leader.station - leader.length - seen.me.station, leader.speed)


def clear_of_bodies(seen: Observation, track: Track, followed: VehicleState | None = None, *, foresees: bool = False) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to any vehicle on the own way; inf if the way is free."""
    me = seen.me
    x, y, heading, speed = me.x, me.y, me.heading, me.speed
    reach = 3.0 + speed * (REACTION + speed / (2.0 * FOLLOW))
    least = math.inf
    cos, sin = math.cos(heading), math.sin(heading)
    for other in seen.others:
        dx, dy = other.x - x, other.y - y
        far = reach + other.length
        # The fast comparison comes first, because most vehicles are far away or behind.
        if dx * dx + dy * dy < far * far and dx * cos + dy * sin > 0.0:
            if other is followed:
                continue
            if other.speed < CREEP and (track.planned or other.zone <= ENTRANCE):
                continue  # `clear_of_standing` stops before this vehicle
            gap = _free(track.places(me.station, reach), other, me.width / 2.0 + SIDE)
            if gap < math.inf:
                along = other.speed * math.cos(other.heading - heading)
                if foresees and other.speed >= 1.0 and along <= other.speed * ACROSS:
                    crossed = (other.length + other.width + 2.0 * SIDE) / other.speed + LEEWAY
                    if gap / max(speed, 1.0) > crossed:
                        continue  # it crosses the own way and will have left it when the own vehicle arrives
                least = min(least, _follow(speed, gap, max(along, 0.0)))
    return least


def clear_of_standing(seen: Observation, track: Track) -> float:
    """Return the acceleration [m/s^2] that stops before the own body touches a standing vehicle; inf if the way is free."""
    me, least = seen.me, math.inf
    reach = 3.0 + me.speed * (REACTION + me.speed / (2.0 * FOLLOW))
    for other in seen.others:
        near = reach + me.length + other.length
        if other.speed < CREEP and (other.x - me.x) ** 2 + (other.y - me.y) ** 2 < near * near:
            for ahead, pose in enumerate(track.axles(me.station, reach)):
                if _touch(pose, seen.vehicle.rear_axle_offset, me, other):
                    least = min(least, stop_before(me.speed, ahead))
                    break
    return least


def no_room(seen: Observation, track: Track) -> bool:
    """Return whether the own body would touch a vehicle before its line somewhere on the own movement.

    The position of a vehicle that stands or creeps is checked. Of a faster vehicle, the position is checked at which it can stop.
    """
    me, junction, key = seen.me, seen.junction, (seen.itinerary.entrance, seen.itinerary.exit)
    for other in seen.others:
        if other.zone > ENTRANCE or (other.entrance, key) not in room(junction):
            continue
        if other.speed < CREEPING:
            poses = track.axles(me.station, seen.itinerary.length + BEHIND - me.station)
            if any(_touch(pose, seen.vehicle.rear_axle_offset, me, other) for pose in poses):
                return True
        elif -junction.setbacks[other.entrance] - other.station - other.speed**2 / (2.0 * FIRM) < min(
            leaves_room(junction, other.entrance, key), float(PLACES[-1])
        ):
            return True
    return False


def held_back(seen: Observation) -> float:
    """Return how far before its line the own vehicle should stop to leave room for other vehicles, see `stand_back` [m].

    The distance is longer while a vehicle passes for which this position would not leave room.
    """
    junction, entrance = seen.junction, seen.me.entrance
    passing = (
        way.key
        for other in seen.others
        if other.zone is JUNCTION or other.zone is EXIT
        for way in junction.by_turn[other.entrance, other.turn]
        if other.station - other.length < way.length
    )
    needed = (leaves_room(junction, entrance, key) for key in passing)
    return max(STAND_OFF, stand_back(junction, entrance), *(back for back in needed if back < math.inf))


def time_to(distance: float, speed: float, acceleration: float, limit: float) -> float:
    """Return the time [s] to drive `distance` [m] from `speed` [m/s], accelerating up to `limit` [m/s]."""
    if distance <= 0.0:
        return 0.0
    limit = max(limit, speed)
    ramp = (limit * limit - speed * speed) / (2.0 * acceleration)
    if distance <= ramp:
        return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
    return (limit - speed) / acceleration + (distance - ramp) / limit


def stop_before(speed: float, distance: float) -> float:
    """Return the constant acceleration that stops a vehicle after `distance` [m]; inf while it is too early to brake."""
    if distance < 0.1 and speed < 0.3:
        return -math.inf
    needed = _needed(speed, max(distance, 0.1))
    return -needed if needed > COMFORT / 2.0 or distance < 0.1 else math.inf


def _needed(speed: float, distance: float) -> float:
    """Return the constant deceleration that stops a vehicle from `speed` [m/s] after `distance` [m]; inf without a distance."""
    return speed * speed / (2.0 * distance) if distance > 0.0 else math.inf


def _follow(speed: float, gap: float, leader: float) -> float:
    """Return the acceleration toward the safe speed of Gipps's car-following model (1981) [m/s^2]."""
    room = gap - GAP
    if room <= 0.0 and speed < 0.3:
        return -math.inf
    lag = FOLLOW * REACTION
    safe = -lag + math.sqrt(lag * lag + leader * leader + 2.0 * FOLLOW * max(room, 0.0))
    return (safe - speed) / REACTION


def _touch(axle: Pose, back: float, me: VehicleState, other: VehicleState) -> bool:
    """Return whether the own body, extended by `NEAR` on all sides, would overlap the body of `other`.

    Two rectangles do not overlap if a line along a side of one of them separates the two (separating axis theorem). The rear axle
    is `back` behind the own front [m].
    """
    cos, sin = math.cos(axle.heading), math.sin(axle.heading)
    turned, ahead = other.heading - axle.heading, back - me.length / 2.0
    x, y = (other.x - axle.x) * cos + (other.y - axle.y) * sin - ahead, (other.y - axle.y) * cos - (other.x - axle.x) * sin
    across, along = abs(math.sin(turned)), abs(math.cos(turned))
    x, y = x - math.cos(turned) * other.length / 2.0, y - math.sin(turned) * other.length / 2.0
    own_size, other_size = (me.length / 2.0 + NEAR, me.width / 2.0 + NEAR), (other.length / 2.0, other.width / 2.0)
    return (
        abs(x) < own_size[0] + other_size[0] * along + other_size[1] * across
        and abs(y) < own_size[1] + other_size[0] * across + other_size[1] * along
        and abs(x * math.cos(turned) + y * math.sin(turned)) < other_size[0] + own_size[0] * along + own_size[1] * across
        and abs(y * math.cos(turned) - x * math.sin(turned)) < other_size[1] + own_size[0] * across + own_size[1] * along
    )


def _free(places: list[tuple[float, float]], other: VehicleState, room: float) -> float:
    """Return after how many metres the own way comes closer than `room` [m] to the body of `other`; inf if it never does."""
    cos, sin = math.cos(other.heading), math.sin(other.heading)
    aside, back = other.width / 2.0 + room, other.length + room
    for ahead, (x, y) in enumerate(places):
        dx, dy = x - other.x, y - other.y
        # The point is compared in the frame of the other vehicle, whose body reaches backwards from its front bumper.
        if -aside < dy * cos - dx * sin < aside and -back < dx * cos + dy * sin < room:
            return float(ahead)
    return math.inf
