"""Computes how the reference driver comes to crosswalks where pedestrians walk.

The driver lets pedestrians cross, never stops on a crosswalk, and comes slowly to a kerb that a standing vehicle hides. "Own"
refers to the vehicle whose driver decides. The own side of a crosswalk is the half of the roadway that the own vehicle uses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from pytest_rvads.drivers.follower import Track
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.signs_and_lights import DRIVE, SET_OFF, WAIVER
from pytest_rvads.drivers.spacing import CREEP, FIRM, FOLLOW, GAP, NEAR, STAND_OFF, stop_before, time_to
from pytest_rvads.drivers.walking import WALKING
from pytest_rvads.geometry.conflicts import Stretch
from pytest_rvads.geometry.crosswalks import MODERATE, PERSON, SIDEWALK, Crossing, Side, half, hides
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import ENTRANCE, EXIT, JUNCTION, Colour, Kind, VehicleState

BEFORE = 0.5
"""Distance before the painted area at which the driver stops [m]."""
AHEAD, BARELY, INSIDE = 2.0, 0.2, 0.4
"""Times between the own leaving of a crosswalk and the arrival of a pedestrian [s].

A driver who can stop firmly passes `AHEAD` before a pedestrian comes onto the own half of the roadway. A driver who can stop
with the full brake alone passes `BARELY` before a pedestrian comes into the own lane. A driver who can't stop passes if a
pedestrian comes into the own lane at most `INSIDE` too early: a pedestrian needs this time from the edge of the lane to the body.
"""
STANDS = 0.3
"""A pedestrian slower than this stands [m/s]."""
AT_KERB = 1.0
"""A pedestrian who stands at most this far before the kerb or before the own side waits to cross [m]."""
WAITING = 1.5
"""The own vehicle waits for pedestrians if it stands at most this far before its stop [m]."""
BRIEFLY = 1.0
"""In the junction, the driver waits for this time for a pedestrian who stands [s], so that the junction stays clear."""
CALM = 2.5
"""Deceleration with which the driver can stop for a pedestrian who comes out from behind a standing vehicle [m/s^2]."""
PEEK = 1.0
"""Speed at which the driver comes onto a crosswalk whose kerb is hidden, so that the vehicle does not wait for ever [m/s]."""
SWING = 0.25
"""Distance from the own lane within which a pedestrian who stands is in the way, because a turning vehicle swings out [m]."""
_GAIN = 4.0
"""Deceleration per difference between the speed and the highest speed before a hidden kerb [1/s]."""


class _Side(NamedTuple):
    """The half of a crosswalk on which the vehicle drives, as pedestrians of one direction reach it."""

    half: Stretch
    """The own half of the roadway, as stations of the pedestrian [m]."""
    lane: Stretch
    """The stretch that the own vehicle takes up, as stations of the pedestrian [m]."""
    sidewalk: tuple[float, float]
    """The farthest point of the sidewalk from which a pedestrian comes [m]."""


class _Crosswalk(NamedTuple):
    """A crosswalk on the own way."""

    cover: Stretch
    """The stretch of the own way inside the painted area [m]."""
    last: float
    """Station at which the own vehicle must have stopped, to be out of the way of pedestrians [m]."""
    path: float
    """Station of the own front where it reaches the bodies of pedestrians [m]."""
    cruise: float
    """Highest speed of the own vehicle until it has left the crosswalk [m/s]; inf on a straight way."""
    at_line: bool
    """Whether the own vehicle waits at its line, because its body has no room between the line and the crosswalk."""
    sides: Mapping[int, _Side]
    """The own side for both directions in which pedestrians walk, by the number of the start of their way."""


class AtCrosswalks:
    """Brakes for pedestrians, for crosswalks without room behind them, and for hidden kerbs, on the way of one vehicle.

    The driver lets a pedestrian cross who is on the own side, who will be on the own side before the own vehicle has passed, or
    who waits at the kerb. The driver does not wait for a pedestrian who stands at red, or who has stood for `WAIVER` while the
    own vehicle waited.
    """

    def __init__(self, seen: Observation, track: Track) -> None:
        junction, way = seen.junction, seen.itinerary
        self._waited: dict[str, float] = {}
        """By name of a pedestrian who stands while the own vehicle waits, the time since which both do [s]."""
        self._braking: set[Stretch] = set()
        """The crosswalks before which the own vehicle brakes for a pedestrian."""
        self._crosswalks: list[_Crosswalk] = []
        key, length = (way.entrance, way.exit), seen.me.length
        crossings = [other for other, _, _ in junction.further if isinstance(other, Crossing)]
        for (number, own_key), cover in junction.covers.items():
            if own_key != key:
                continue
            mine, sides = cover, {}
            for crossing in crossings:
                shared = (junction.stretches or {}).get((key, crossing.key))
                if shared and crossing.crosswalk == number:
                    mine = shared.mine
                    enters = cover.start < way.length / 2.0  # the own vehicle, over the side of the entrances
                    own = half(junction.crossings[number], crossing, first=enters is (crossing.side is Side.NEAR))
                    start = itinerary(junction, *crossing.key).pose(-SIDEWALK)
                    lane = shared.yours
                    own = Stretch(min(own.start, lane.start), max(own.end, lane.end))
                    sides[crossing.entrance] = _Side(own, lane, (start.x, start.y))
            cruise = track.slowest(min(max(cover.end + length, 0.0), way.length))
            at_line = way.line <= cover.start < way.line + BEFORE + length
            path = (mine.start + mine.end - PERSON) / 2.0
            self._crosswalks.append(_Crosswalk(cover, mine.start - NEAR, path, cruise, at_line, sides))

    def acceleration(self, seen: Observation, traffic: Observation) -> float:
        """Return the acceleration [m/s^2] with which the own vehicle comes to its crosswalks; inf if nothing holds it up."""
        me, least = seen.me, math.inf
        for crosswalk in self._crosswalks:
            if me.station < crosswalk.path:
                least = min(least, self._before(seen, traffic, crosswalk))
        return least

    def _before(self, seen: Observation, traffic: Observation, crosswalk: _Crosswalk) -> float:
        """Return the acceleration [m/s^2] with which the own vehicle comes to a crosswalk; inf if nothing holds it up."""
        me, speed, cover = seen.me, seen.me.speed, crosswalk.cover
        at_line = crosswalk.at_line and me.zone <= ENTRANCE
        place = min(seen.itinerary.line - STAND_OFF if at_line else cover.start - BEFORE, crosswalk.last)
        brake = stop_before(speed, place - me.station)
        if brake == math.inf:  # it is too early to brake
            self._braking.discard(cover)
            return math.inf
        full, brakes = seen.vehicle.brake[seen.aggression - 1], cover in self._braking
        late = me.station + _reach(seen, full, brakes=brakes)
        stop = late if brakes else me.station + _reach(seen, FIRM)
        if at_line and stop > (0.0 if brakes else place):  # the driver can stop behind its line alone
            place = min(cover.start - BEFORE, crosswalk.last)
            brake = stop_before(speed, place - me.station)
        stops = me.station < cover.start and stop <= (crosswalk.last if brakes else place)
        margin = AHEAD if stops else BARELY if late <= crosswalk.last else -INSIDE
        if self._owed(seen, crosswalk, place, margin, stops=stops):
            self._braking.add(cover)
            return brake if stops else -full
        self._braking.discard(cover)
        if stops and me.station < cover.start and not _room(traffic, cover):
            return brake
        return self._calmly(seen, crosswalk, max(place - me.station, 0.0))

    def _calmly(self, seen: Observation, crosswalk: _Crosswalk, distance: float) -> float:
        """Return the acceleration toward a moderate speed [m/s^2] if pedestrians stand near, or a standing vehicle may hide them.

        The result is inf if there is no such pedestrian, or if the own vehicle is slow enough. The distance is that to the own
        stop [m].
        """
        speed, slow = seen.me.speed + CALM / _GAIN, max(math.sqrt(2.0 * CALM * distance), PEEK + CALM / _GAIN)
        braking = max(distance - MODERATE * MODERATE / (2.0 * FIRM), 0.0)
        moderate = math.sqrt(MODERATE * MODERATE + 2.0 * CALM * braking)
        if speed > slow:
            me = seen.me
            standing = [o for o in seen.others if o.speed < CREEP and o.kind is not Kind.PEDESTRIAN and o.entrance != me.entrance]
            hidden = any(
                hides((me.x, me.y), side.sidewalk, (o.x, o.y, o.heading), (o.length, o.width))
                for o in standing
                for side in crosswalk.sides.values()
            )
            if hidden:
                return max(_GAIN * (slow - speed), -FIRM)
        if speed <= moderate:
            return math.inf
        walkers = [abs(o.speed) for o in seen.others if o.station < 0.0 and o.entrance in crosswalk.sides]
        return max(_GAIN * (moderate - speed), -FIRM) if walkers and max(walkers) <= STANDS else math.inf

    def _owed(self, seen: Observation, crosswalk: _Crosswalk, place: float, margin: float, *, stops: bool) -> bool:
        """Return whether the own vehicle, whose stop is at `place` [m], has to let a pedestrian cross.

        The margin is the least time from the own leaving of the crosswalk to the arrival of a pedestrian [s].
        """
        me, cover = seen.me, crosswalk.cover
        cruise = min(crosswalk.cruise, MODERATE if stops else max(seen.speed_limit, me.speed))
        passed = time_to(cover.end + me.length - me.station, min(me.speed, cruise), DRIVE, cruise)
        passed += margin + (SET_OFF if me.speed < 1.0 else 0.0)
        owed = False
        for person in seen.others:
            side = crosswalk.sides.get(person.entrance)
            if side is not None:
                waived = self._waived(seen, person, place - me.station < WAITING)
                own = side.half if stops else side.lane
                owed = _comes(person, own, side.lane, seen.lights[person.entrance], passed, stops and not waived) or owed
        return owed

    def _waived(self, seen: Observation, person: VehicleState, near: bool) -> bool:
        """Return whether a pedestrian has stood for `WAIVER` while the own vehicle waited, or for `BRIEFLY` in the junction."""
        if abs(person.speed) > STANDS:
            self._waited.pop(person.name, None)
        elif near and seen.me.speed < CREEP:
            self._waited.setdefault(person.name, seen.time)
        patience = WAIVER if seen.me.zone <= ENTRANCE else BRIEFLY
        return seen.time - self._waited.get(person.name, seen.time) >= patience


def _reach(seen: Observation, deceleration: float, *, brakes: bool = False) -> float:
    """Return the distance in which the own vehicle stops with a deceleration [m/s^2]; -inf if it nearly stands already [m]."""
    speed, lag = seen.me.speed, 0.0 if brakes else seen.vehicle.brake_lag
    return speed * (lag + speed / (2.0 * deceleration)) if speed >= CREEP else -math.inf


def _comes(person: VehicleState, own: Stretch, lane: Stretch, light: Colour, passed: float, waits: bool) -> bool:
    """Return whether a pedestrian crosses the own side before the own vehicle.

    The own side and the own lane within it are stations of the pedestrian [m]. `passed` is the time until the own vehicle has
    left the crosswalk, and the time that it keeps to the pedestrian [s].
    """
    station, speed, back = person.station, person.speed, person.station - person.length
    if speed < -STANDS:  # the pedestrian has turned back
        station, back, speed = own.start + own.end - back, own.start + own.end - station, -speed
    if speed <= STANDS and station > max(lane.start - SWING, 0.0) and back < lane.end + SWING:
        return True
    if back > own.end or (back > lane.end and speed <= STANDS):
        return waits and back <= own.end
    if station > own.start:
        return True
    if speed <= STANDS:
        if station < -AT_KERB or (station <= 0.0 and light in (Colour.YELLOW, Colour.RED)):
            return False
        if station <= 0.0 or own.start - station <= AT_KERB:
            return waits
    return (own.start - station) / max(speed, WALKING) <= passed


def _room(traffic: Observation, cover: Stretch) -> bool:
    """Return whether the own vehicle finds room behind a crosswalk, which covers a stretch of its way, if vehicles ahead stop."""
    me, way = traffic.me, traffic.itinerary
    for other in traffic.others:
        if other.entrance == me.entrance:
            front = other.station
        elif other.zone is JUNCTION or other.zone is EXIT:
            left = (w.length - other.station for w in traffic.junction.by_turn[other.entrance, other.turn] if w.exit == way.exit)
            front = way.length - max(left, default=math.inf)
        else:
            continue
        rear = front - other.length + other.speed * other.speed / (2.0 * FOLLOW)
        if front > me.station and rear < cover.end + GAP + me.length:
            return False
    return True
