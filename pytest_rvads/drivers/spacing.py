"""Braking: for a stop before the junction, and for whoever drives or stands ahead."""

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
"""Where to stop before the stopping line [m]: well inside the entrance zone."""
MISSED = 0.3
"""Who is this far beyond its place to stop, where that is not at the line, goes on to the line [m]."""
LAST_STOP = 0.15
"""Where a late stop may end at the latest, before the entrance vertex [m]."""
COMFORT = 2.3
"""Braking for the line begins when it takes this much [m/s^2]; people use up to 3.4 at stop signs."""
FIRM = 3.0
"""Who needs more than this to stop at the line brakes at once, whatever the drive still does [m/s^2]."""
URGENT = 0.8
"""Who needs more than this share of all braking to stop before the entrance vertex brakes fully."""
CREEP = 0.3
"""Slower than this in the entrance zone, a vehicle just stops there [m/s]."""
CREEPING = 1.4
"""A vehicle before the junction that is slower than this may still stop [m/s]."""
GENTLE = 0.5
"""How an approach speeds up: by this, and by as much again for every metre left [m/s^2]."""
GAP = 2.0
"""Distance to who stands ahead [m]."""
REACTION = 0.5
"""Time in which a speed error is corrected when following [s]."""
FOLLOW = 3.0
"""Deceleration counted on when following [m/s^2]."""
BEFORE = 0.5
"""Where to let a crossing vehicle pass, before the place where the movements meet [m]."""
SIDE = 0.35
"""Room to the side of the own body that must be free [m]."""
NEAR = 0.1
"""Room around the own body that a standing vehicle must leave where the own body sweeps past [m]: the rear axle errs by less."""
ACROSS = 0.7
"""Who moves at more than 45 degrees to the own heading crosses the way: cosine of that angle."""
LEEWAY = 0.5
"""Time left between who crosses leaving a place and the own arrival there [s]."""


class Stopping:
    """Brakes for a stop in the entrance zone, evenly; remembers that it has begun.

    Where a vehicle in the entrance zone would be in the way of others, the stop is farther from the line, see `stand_back`.
    """

    def __init__(self) -> None:
        self._braking = False
        self.back = STAND_OFF
        """Where to stop before the stopping line [m]."""

    def reset(self) -> None:
        """Forget the stop: the way is free."""
        self._braking = False

    def acceleration(self, seen: Observation) -> float:
        """Return the acceleration that a stop needs now [m/s^2].

        Returns:
            A positive limit while it is too early to brake; inf when it is too late to stop before the junction; -inf to
            hold the vehicle.
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
            # The drive goes on for its lag when the throttle is released, and the brake comes late by its own.
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
        # The brake's lag eats the reserve of a late stop, so that one begins with all there is.
        return -full if urgent > URGENT * most else -min(needed, full)


def can_stop(seen: Observation, deceleration: float) -> bool:
    """Return whether braking at `deceleration` [m/s^2] from now on ends before the entrance vertex."""
    speed = seen.me.speed
    distance = -LAST_STOP - seen.me.station - speed * seen.vehicle.brake_lag
    return speed * speed <= 2.0 * deceleration * distance if speed > 0.1 else seen.me.station <= 0.0


def behind_leader(seen: Observation) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to whoever drives ahead into the same exit; inf if nobody."""
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
    """Return the acceleration [m/s^2] that lets a crossing vehicle pass which is first at the place; inf if none is.

    Both in the junction already: whoever comes to the common place later stops before it. Who drives into the same exit is
    followed instead.
    """
    me = seen.me
    least = math.inf
    for k, other in enumerate(seen.others):
        if other.zone is not JUNCTION:
            continue
        for found in conflicts(seen, other):
            place = found.mine.start
            if found.merges or me.station >= place or other.station - other.length >= found.yours.end:
                continue
            mine = (place - me.station) / max(me.speed, 1.0)
            theirs = max(found.yours.start - other.station, 0.0) / max(other.speed, 1.0)
            if theirs < mine or (theirs == mine and k < seen.created):
                least = min(least, stop_before(me.speed, place - BEFORE - me.station))
    return least


def behind(seen: Observation, leader: VehicleState) -> float:
    """Return the acceleration [m/s^2] that keeps the distance to `leader`, ahead in the own lane; inf where ways part."""
    if leader.turn is not seen.me.turn and leader.zone > ENTRANCE:
        return math.inf
    return _follow(seen.me.speed, leader.station - leader.length - seen.me.station, leader.speed)


def clear_of_bodies(seen: Observation, track: Track, followed: VehicleState | None = None, *, foresees: bool = False) -> float:
    """Return the acceleration [m/s^2] that stops before a body that is in the way on `track`; inf if none is.

    Args:
        seen: what there is.
        track: the own way.
        followed: a vehicle that is left out here, since `behind` keeps the distance to it.
        foresees: count on who crosses the way to have left it in time.
    """
    me = seen.me
    x, y, heading, speed = me.x, me.y, me.heading, me.speed
    reach = 3.0 + speed * (REACTION + speed / (2.0 * FOLLOW))
    least = math.inf
    cos, sin = math.cos(heading), math.sin(heading)
    for other in seen.others:
        dx, dy = other.x - x, other.y - y
        far = reach + other.length
        # Cheap first: most others are nowhere near, or behind.
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
    """Return the acceleration [m/s^2] that stops before the sweeping own body touches a standing one; inf if none is."""
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

    While a vehicle passes that needs more room, the distance is longer.
    """
    junction, mine = seen.junction, seen.me.entrance
    passing = (
        way.key
        for other in seen.others
        if other.zone is JUNCTION or other.zone is EXIT
        for way in junction.by_turn[other.entrance, other.turn]
        if other.station - other.length < way.length
    )
    needed = (leaves_room(junction, mine, key) for key in passing)
    return max(STAND_OFF, stand_back(junction, mine), *(back for back in needed if back < math.inf))


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
    mine, theirs = (me.length / 2.0 + NEAR, me.width / 2.0 + NEAR), (other.length / 2.0, other.width / 2.0)
    return (
        abs(x) < mine[0] + theirs[0] * along + theirs[1] * across
        and abs(y) < mine[1] + theirs[0] * across + theirs[1] * along
        and abs(x * math.cos(turned) + y * math.sin(turned)) < theirs[0] + mine[0] * along + mine[1] * across
        and abs(y * math.cos(turned) - x * math.sin(turned)) < theirs[1] + mine[0] * across + mine[1] * along
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
