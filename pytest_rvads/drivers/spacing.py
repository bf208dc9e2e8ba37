"""Braking: for a stop before the junction, and for vehicles that drive or stand ahead."""

from __future__ import annotations

import math

from pytest_rvads.drivers.crossing import conflicts
from pytest_rvads.drivers.follower import resistance
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.way_ahead import Track
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.sweep import BEHIND
from pytest_rvads.logic.conduct.room import PLACES, leaves_room, room, stand_back
from pytest_rvads.runs.states import ENTRANCE, EXIT, JUNCTION, VehicleState

__all__ = [
    "CREEP",
    "STAND_OFF",
    "Stopping",
    "behind",
    "behind_leader",
    "can_stop",
    "clear_of_bodies",
    "clear_of_crossing",
    "clear_of_standing",
    "held_back",
    "no_room",
    "stop_before",
    "time_to",
]

STAND_OFF = 0.35
"""Distance of the place to stop before the stopping line [m]: well inside the entrance zone."""
MISSED = 0.3
"""A vehicle this far beyond a place to stop farther back drives on to the line [m]."""
LAST_STOP = 0.15
"""Least distance between the end of a late stop and the entrance vertex [m]."""
COMFORT = 2.3
"""Braking for the line begins when the stop needs this deceleration [m/s^2]; people use up to 3.4 at stop signs."""
FIRM = 3.0
"""A vehicle that needs more deceleration than this to stop at the line brakes at once [m/s^2]."""
URGENT = 0.8
"""A vehicle that needs more than this share of all braking to stop before the entrance vertex brakes fully."""
CREEP = 0.3
"""A vehicle in the entrance zone that is slower than this stops at once [m/s]."""
CREEPING = 1.4
"""A vehicle before the junction that is slower than this may still stop [m/s]."""
GENTLE = 0.5
"""Highest acceleration of an approach at its place to stop, and its increase per metre before the place [m/s^2]."""
GAP = 2.0
"""Distance to a vehicle that stands ahead [m]."""
REACTION = 0.5
"""Time in which a speed error is corrected when following [s]."""
FOLLOW = 3.0
"""Own deceleration that following counts on [m/s^2]."""
BEFORE = 0.5
"""Distance before the place where the movements meet at which a crossing vehicle is let pass [m]."""
SIDE = 0.35
"""Room to the side of the own body that must be free [m]."""
NEAR = 0.1
"""Room around the own body that a standing vehicle must leave where the own body sweeps past [m]: the rear axle errs by less."""
ACROSS = 0.7
"""Cosine of 45 degrees: a vehicle that moves at a larger angle to the own heading crosses the way."""
LEEWAY = 0.5
"""Time between the moment when a crossing vehicle leaves a place and the own arrival there [s]."""


class Stopping:
    """Brakes evenly for a stop in the entrance zone, and remembers that braking has begun.

    Where a vehicle in the entrance zone would be in the way of others, the stop is farther from the line, see `stand_back`.
    """

    def __init__(self) -> None:
        self._braking = False
        self.back = STAND_OFF
        """Distance of the place to stop before the stopping line [m]."""

    def reset(self) -> None:
        """Forget the stop: the way is free."""
        self._braking = False

    def acceleration(self, seen: Observation) -> float:
        """Return the acceleration that a stop needs now [m/s^2].

        Returns:
            A positive limit while braking is too early; inf when a stop before the junction is no longer possible; -inf to hold
            the vehicle.
        """
        me, vehicle = seen.me, seen.vehicle
        line = seen.itinerary.line - me.station
        distance = line - self.back
        if distance < -MISSED or (not self._braking and _needed(me.speed, distance) > FIRM):
            distance = line - STAND_OFF
        if me.speed < CREEP and (distance < 0.02 or me.zone is ENTRANCE):
            return -math.inf
        needed = _needed(me.speed, distance)
        if not self._braking:
            # After the throttle is released the drive goes on for its lag, and the brake acts after its own lag.
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
        urgent = _needed(me.speed, -me.station)
        if urgent > most:
            return math.inf
        # The brake's lag uses up the reserve of a late stop, so a late stop begins with the full brake.
        return -full if urgent > URGENT * most else -min(needed, full)


def can_stop(seen: Observation, deceleration: float) -> bool:
    """Return whether braking at `deceleration` [m/s^2] from now on ends before the entrance vertex."""
    speed = seen.me.speed
    distance = -LAST_STOP - seen.me.station - speed * seen.vehicle.brake_lag
    return speed * speed <= 2.0 * deceleration * distance if speed > 0.1 else seen.me.station <= 0.0


def behind_leader(seen: Observation) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to vehicles ahead into the same exit; inf without any."""
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
    """Return the acceleration [m/s^2] that lets crossing vehicles pass that are first at the place; inf without any.

    Both vehicles are in the junction. The vehicle that comes to the common place later stops before the place. Vehicles that
    drive into the same exit are followed instead.
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
    """Return the acceleration [m/s^2] that keeps the distance to `leader`, ahead in the own lane; inf where ways part."""
    if leader.turn is not seen.me.turn and leader.zone > ENTRANCE:
        return math.inf
    return _follow(seen.me.speed, leader.station - leader.length - seen.me.station, leader.speed)


def clear_of_bodies(seen: Observation, track: Track, followed: VehicleState | None = None, *, foresees: bool = False) -> float:
    """Return the acceleration [m/s^2] that stops before a body that is in the way on `track`; inf without any.

    Args:
        seen: the observation.
        track: the own way.
        followed: a vehicle that is left out here, since `behind` keeps the distance to it.
        foresees: whether to drive on if a crossing vehicle will have left the way in time.
    """
    me = seen.me
    x, y, heading, speed = me.x, me.y, me.heading, me.speed
    reach = 3.0 + speed * (REACTION + speed / (2.0 * FOLLOW))
    least = math.inf
    cos, sin = math.cos(heading), math.sin(heading)
    for other in seen.others:
        dx, dy = other.x - x, other.y - y
        far = reach + other.length
        # The cheap comparison comes first: most other vehicles are far away or behind.
        if dx * dx + dy * dy < far * far and dx * cos + dy * sin > 0.0:
            if other is followed:
                continue
            if other.speed < CREEP and (track.planned or other.zone <= ENTRANCE):
                continue  # `clear_of_standing` looks at the body itself
            gap = _free(track.places(me.station, reach), other, me.width / 2.0 + SIDE)
            if gap < math.inf:
                along = other.speed * math.cos(other.heading - heading)
                if not (foresees and _gone_by(speed, gap, other, along)):
                    least = min(least, _follow(speed, gap, max(along, 0.0)))
    return least


def clear_of_standing(seen: Observation, track: Track) -> float:
    """Return the acceleration [m/s^2] that stops before the sweeping own body touches a standing body; inf without any."""
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
    """Return whether a vehicle before its line leaves no room for the own body on the whole movement, or will leave none.

    The other vehicle stands or creeps in the way, or comes so fast that it can stop only in the way.
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
    """Return how far before its line the own vehicle should stand to leave room for others, see `stand_back` [m].

    The distance is longer while a vehicle passes that needs more room.
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


def _gone_by(speed: float, gap: float, other: VehicleState, along: float) -> bool:
    """Return whether `other`, which moves across the own way, has left the way when the own vehicle arrives."""
    if other.speed < 1.0 or along > other.speed * ACROSS:
        return False
    return gap / max(speed, 1.0) > (other.length + other.width + 2.0 * SIDE) / other.speed + LEEWAY


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
    """Return the acceleration of an even stop after `distance` [m]; inf while it is too early to brake."""
    if distance < 0.1 and speed < 0.3:
        return -math.inf
    needed = _needed(speed, max(distance, 0.1))
    return -needed if needed > COMFORT / 2.0 or distance < 0.1 else math.inf


def _needed(speed: float, distance: float) -> float:
    """Return the deceleration of an even stop from `speed` [m/s] after `distance` [m]; inf where there is none."""
    return speed * speed / (2.0 * distance) if distance > 0.0 else math.inf


def _follow(speed: float, gap: float, leader: float) -> float:
    """Return the acceleration towards the safe speed of Gipps (1981), behind a leader at `gap` [m]."""
    room = gap - GAP
    if room <= 0.0 and speed < 0.3:
        return -math.inf
    lag = FOLLOW * REACTION
    safe = -lag + math.sqrt(lag * lag + leader * leader + 2.0 * FOLLOW * max(room, 0.0))
    return (safe - speed) / REACTION


def _touch(axle: Pose, back: float, me: VehicleState, other: VehicleState) -> bool:
    """Return whether the own body with its rear axle at a pose, extended by `NEAR`, meets the body of `other`.

    Two rectangles are apart if a side of a rectangle separates the two (separating axis theorem).
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
    """Return how many metres of the way ahead have `room` [m] beside the body of `other`; inf when all have."""
    cos, sin = math.cos(other.heading), math.sin(other.heading)
    aside, back = other.width / 2.0 + room, other.length + room
    for ahead, (x, y) in enumerate(places):
        dx, dy = x - other.x, y - other.y
        # The place in the frame of the other body, which reaches backwards from its bumper.
        if -aside < dy * cos - dx * sin < aside and -back < dx * cos + dy * sin < room:
            return float(ahead)
    return math.inf
