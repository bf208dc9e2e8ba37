"""How the reference autopilot behaves at a traffic light."""

from __future__ import annotations

from pytest_rvads.drivers.crossing import conflicts, exit_blocked, not_queued, runs_through
from pytest_rvads.drivers.follower import STANDING
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.spacing import can_stop, time_to
from pytest_rvads.drivers.stop_sign import WAIVER
from pytest_rvads.geometry.segment import Turn
from pytest_rvads.logic.conduct.standing import stop_place
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION, Colour, VehicleState

__all__ = ["Light"]

YELLOW = 3.2
"""A driver that can stop with this deceleration stops on yellow [m/s^2]; people do at 2.2 to 5.9."""
DRIVE = 2.5
"""Own acceleration that decisions count on [m/s^2]."""
SET_OFF = 0.35
"""Time from the command to set off until the drive answers [s]."""
EAGER = 3.0
"""Highest assumed acceleration of other vehicles [m/s^2]."""
MARGIN = 1.0
"""Time kept between leaving a place and the arrival there of a vehicle with priority [s]."""
_GREEN, _YELLOW, _RED = Colour.GREEN, Colour.YELLOW, Colour.RED
_STRAIGHT, _RIGHT = Turn.STRAIGHT, Turn.RIGHT
"""The members as names of the module, like those of `Zone`, because every step reads them."""


class Light:
    """Stops on yellow and red, turns right on red after a stop, and yields when turning.

    Args:
        paper: whether to wait as the paper's rules demand: for a vehicle that was to be let in until this vehicle is in the
            junction or the own light is green. Otherwise the right of way of a vehicle ends with its green light, and after the
            vehicle has stood at green for `WAIVER`.
    """

    def __init__(self, *, paper: bool = True) -> None:
        self._paper = paper
        self._stood = False
        self._owed: set[str] = set()
        self._idle: dict[str, float] = {}
        """Per name of a vehicle, the time since which the vehicle stands at green [s]."""
        self._parked: set[str] = set()
        """Names of vehicles that have stood at green for `WAIVER`."""

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; to be called in every step before it."""
        me = seen.me
        colour = seen.lights[me.entrance]
        if me.zone is ENTRANCE and me.speed < STANDING:
            self._stood = True
        prior = self._prior(seen, colour) if me.turn is not _STRAIGHT else []
        if colour is _YELLOW:
            return not can_stop(seen, YELLOW)
        if colour is _RED and not (self._stood and me.turn is _RIGHT and not seen.junction.left_hand):
            return False
        if self._owed or not all(_leaves_time(seen, other) for other in prior):
            return False
        for k, other in enumerate(seen.others):
            if other.zone is JUNCTION:
                if conflicts(seen, other):
                    return False
            elif _comes_first(seen, other, k < seen.created) or _runs_red(seen, other):
                return False
        return not exit_blocked(seen)

    def owes(self, seen: Observation) -> bool:
        """Return whether a vehicle still has to be let in by the paper's rules; to be called in every step."""
        self._prior(seen, seen.lights[seen.me.entrance])
        return bool(self._owed)

    def _prior(self, seen: Observation, colour: Colour) -> list[VehicleState]:
        """Return the vehicles on their way to the junction that go first."""
        prior = [other for other in seen.others if self._has_priority(seen, other, colour)]
        if self._paper:
            self._remember(seen, prior)
            return prior
        self._watch(seen)
        return [other for _, other in not_queued(seen) if other in prior and other.name not in self._parked]

    def _has_priority(self, seen: Observation, other: VehicleState, colour: Colour) -> bool:
        """Return whether `other`, before the junction, has priority over the own vehicle."""
        if other.zone is not APPROACH and other.zone is not ENTRANCE:
            return False
        me, junction = seen.me, seen.junction
        far = junction.far
        if me.turn is far and other.turn is not far and (me.entrance, other.entrance) in junction.opposite:
            return True
        if colour is not _RED or me.turn is not _RIGHT:
            return False
        goes = seen.lights[other.entrance] is not _RED and bool(conflicts(seen, other))
        return goes or (self._paper and (me.entrance, other.entrance) in junction.right_of)

    def _remember(self, seen: Observation, prior: list[VehicleState]) -> None:
        """Remember the vehicles to let in first, from when both vehicles are at their entrances until the own light is green.

        The light of the other vehicle does not matter. At green, only vehicles that still have priority have to be let in.
        """
        me = seen.me
        if prior and me.zone is ENTRANCE:
            # A left turn on green into the own exit has priority over a right turn on red; the paper's rules do not speak of it.
            relation = seen.junction.opposite if me.turn is seen.junction.far else seen.junction.right_of
            at_entrance = (other for other in prior if other.zone is ENTRANCE)
            self._owed |= {other.name for other in at_entrance if (me.entrance, other.entrance) in relation}
        if self._owed:
            self._owed &= {other.name for other in seen.others if other.zone is ENTRANCE}
        if self._owed and seen.lights[me.entrance] is _GREEN:
            self._owed &= {other.name for other in prior}

    def _watch(self, seen: Observation) -> None:
        idle, parked = self._idle, self._parked
        for other in seen.others:
            stands = other.zone is ENTRANCE and other.speed <= STANDING
            if parked and not stands:
                parked.discard(other.name)
            if stands and seen.lights[other.entrance] is _GREEN:
                if seen.time - idle.setdefault(other.name, seen.time) >= WAIVER:
                    parked.add(other.name)
            elif idle:
                idle.pop(other.name, None)


def _leaves_time(seen: Observation, other: VehicleState) -> bool:
    """Return whether the own vehicle can pass before `other`, which has priority, needs the place."""
    if other.station >= stop_place(seen.junction, other.entrance)[0]:
        return False
    line = -seen.junction.setbacks[other.entrance] - other.station
    me = seen.me
    delay = SET_OFF if me.speed < 1.0 else 0.0
    cruise = min(seen.speed_limit, 5.0)
    speed = min(me.speed, cruise)
    # The other vehicle must not come to its entrance while the own vehicle is still at its own entrance.
    enter = delay + time_to(-me.station, speed, DRIVE, cruise)
    if time_to(line - ENTRANCE_ZONE, other.speed, EAGER, seen.limit_of(other)) < enter + MARGIN / 2:
        return False
    for shared in conflicts(seen, other):
        leave = delay + time_to(shared.mine.end + me.length - me.station, speed, DRIVE, cruise)
        if time_to(shared.yours.start - other.station, other.speed, EAGER, seen.limit_of(other)) < leave + MARGIN:
            return False
    return True


def _comes_first(seen: Observation, other: VehicleState, earlier: bool) -> bool:
    """Return whether the oncoming vehicle `other`, with the same turn and the same right to go, is nearer to the junction.

    If both vehicles are equally near, the vehicle that was created `earlier` goes first. Both drivers see the same states, so
    exactly one of the two vehicles waits. Two oncoming left turns may cross each other.
    """
    me = seen.me
    if other.turn is not me.turn or (me.entrance, other.entrance) not in seen.junction.opposite:
        return False
    if other.zone is not APPROACH and other.zone is not ENTRANCE:
        return False
    if other.station < me.station or (other.station == me.station and not earlier):
        return False
    return bool(conflicts(seen, other)) and not _leaves_time(seen, other)


def _runs_red(seen: Observation, other: VehicleState) -> bool:
    return seen.lights[other.entrance] is _RED and runs_through(other) and bool(conflicts(seen, other))
