"""Decides when the reference autopilot enters at all-way stops, where vehicles take turns, and at traffic lights.

"Own" refers to the vehicle whose driver decides. Shared stretches are the parts of two movements on which vehicles can collide.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.crossing import conflicts, exit_blocked, may_meet, not_queued, runs_through
from pytest_rvads.drivers.follower import STANDING
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.spacing import can_stop, time_to
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.conduct.standing import STANDSTILL, stop_place
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import APPROACH, ENTRANCE, JUNCTION, Colour, VehicleState

_MOVING = 0.15
"""A vehicle that stood before its line and is now faster than this has set off [m/s]."""

HOLD = 0.5
"""Least time for which the driver stands at a stop sign [s]."""
PATIENCE, PATIENCE_STEP = 1.0, 0.7
"""If each vehicle has to wait for another vehicle, the first in the order waits for `PATIENCE` [s], and each later vehicle waits
for `PATIENCE_STEP` [s] longer than the vehicle before. A vehicle also gives the vehicles before it in the order this time to use
their turn. The order is the order of creation, which rotates with the scenario, so that rotated scenarios have equal runs."""
WAIVER = 3.5
"""Time for which the driver waits for a standing vehicle that could go first [s]; the vehicle waives its right after 3 s."""

YELLOW = 3.2
"""The driver stops on yellow if a deceleration of at most this suffices [m/s^2]; people stop with 2.2 to 5.9 m/s^2."""
DRIVE = 2.5
"""Acceleration that the driver expects of its own vehicle [m/s^2]."""
SET_OFF = 0.35
"""Time from the command to set off until the vehicle accelerates [s]."""
EAGER = 3.0
"""Acceleration that the driver expects at most of other vehicles [m/s^2]."""
MARGIN = 1.0
"""Least time from the own leaving of a shared stretch to the arrival of a vehicle with priority [s]."""
_GREEN, _YELLOW, _RED = Colour.GREEN, Colour.YELLOW, Colour.RED
_STRAIGHT, _RIGHT = Turn.STRAIGHT, Turn.RIGHT
"""Members of `Turn` as variables of the module, because every step reads them and variables are read faster."""


class Queue:
    """A driver's memory of the vehicles before the junction: when each vehicle arrived, and which vehicles have set off again.

    A vehicle arrives when it enters the entrance zone, or earlier, when it stops at its `stop_place` with no vehicle ahead in its
    lane. It counts as arrived until it enters the junction or backs out. Vehicles take turns only if their ways meet.

    Arrivals within the time `tie` of each other count as simultaneous [s]. With 0, the paper's rules hold: a vehicle arrives when
    it enters the entrance zone, and takes turns with the vehicles of all other entrances.
    """

    def __init__(self, tie: float = 0.0) -> None:
        self._tie = round(tie / DT)
        self._outside: dict[str, int] = {}
        self._stood: set[str] = set()

    def watch(self, seen: Observation) -> None:
        """Note which vehicles have arrived and which have left their entrances; must be called in every step."""
        tick = round(seen.time / DT)
        outside, stood = self._outside, self._stood
        for state in (seen.me, *seen.others):
            name = state.name
            if not (state.zone is ENTRANCE or (state.zone is APPROACH and self._in_stop_place(seen, state))):
                outside[name] = tick
                if stood:
                    stood.discard(name)
            else:
                if name not in outside:
                    # The vehicle has been at its entrance since the start of the run, so it arrives now.
                    outside[name] = tick
                if state.speed <= STANDSTILL:
                    stood.add(name)

    def _in_stop_place(self, seen: Observation, state: VehicleState) -> bool:
        """Return whether `state`, on its approach, stands at its stop place, and had no vehicle ahead when it stopped."""
        if not self._tie or state.station < stop_place(seen.junction, state.entrance)[0]:
            return False
        if state.name in self._stood or state.speed > STANDSTILL:
            return state.name in self._stood
        queue = (o for o in (seen.me, *seen.others) if o.entrance == state.entrance and o.zone <= ENTRANCE)
        return not any(state.station < other.station for other in queue)

    def setting_off(self, other: VehicleState) -> bool:
        """Return whether `other` stood at its entrance and has set off, but has not entered the junction."""
        return other.zone is ENTRANCE and other.speed > _MOVING and other.name in self._stood

    def stood(self, other: VehicleState) -> bool:
        """Return whether `other` has arrived and has come to a standstill since its arrival."""
        return other.name in self._stood

    def arrived(self, other: VehicleState) -> bool:
        """Return whether `other` is in its entrance zone, or waits at its stop place before this zone."""
        return other.zone is ENTRANCE or other.name in self._stood

    def since(self, state: VehicleState) -> int:
        """Return the tick at which `state` arrived; the present tick for a vehicle that has not arrived."""
        return self._outside[state.name]

    def before(self, vehicle: VehicleState, other_vehicle: VehicleState) -> bool | None:
        """Return whether `vehicle` arrived earlier than `other_vehicle`; None if both arrived together."""
        later = self._outside[vehicle.name] - self._outside[other_vehicle.name]
        return None if abs(later) <= self._tie else later < 0

    def first(self, seen: Observation) -> tuple[list[VehicleState], int]:
        """Return the arrived vehicles in the order in which they go, and the number of vehicles that need not wait."""
        since, junction = self._outside, seen.junction
        waiting = [s for s in seen.everybody() if self.arrived(s)]
        if len({s.entrance for s in waiting}) < len(waiting):
            heads = {s.entrance: s.name for s in sorted(waiting, key=lambda s: s.station)}
            waiting = [s for s in waiting if heads[s.entrance] == s.name]
        at = {(since[s.name], s.entrance) for s in waiting}
        right = {s.name: any((since[s.name], e) in at for e, to in junction.right_of if to == s.entrance) for s in waiting}
        waiting.sort(key=lambda s: (since[s.name], right[s.name]))

        def waits_for(s: VehicleState, other: VehicleState) -> bool:
            if self._tie and not may_meet(junction, (s.entrance, s.turn), (other.entrance, other.turn)):
                return False
            later = since[s.name] - since[other.name]
            return later > self._tie or (later >= -self._tie and (other.entrance, s.entrance) in junction.right_of)

        free = [s for s in waiting if not any(waits_for(s, other) for other in waiting)]
        if not free:
            return waiting, 0
        next_in_turn = [s for s in waiting if s not in free and all(o in free for o in waiting if waits_for(s, o))]
        return free + next_in_turn if self._tie else free, len(free)


class StopSign:
    """Decides at an all-way stop: the driver stops, waits for its turn, and enters when no other vehicle is in the junction.

    The tie, see `Queue`, is at most `HOLD`, so that all simultaneous arrivals have happened before the driver looks for its turn.
    """

    def __init__(self, tie: float = 0.0) -> None:
        self._queue = Queue(tie)
        self._stood_since: float | None = None
        self._stuck_since: float | None = None
        self._ahead: set[str] = set()
        self._released = False

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; must be called in every step before the junction."""
        self._queue.watch(seen)
        me = seen.me
        if me.zone is not ENTRANCE:
            return False
        if self._stood_since is None and me.speed < STANDING:
            self._stood_since = seen.time
        if self._stood_since is None or seen.time - self._stood_since < HOLD:
            return False
        # The driver stops again for a vehicle that sets off out of turn. Of two vehicles that set off at the same time, the
        # vehicle that has come farther goes on.
        own_rank = (me.station, -seen.created) if self._queue.setting_off(me) else (-math.inf, 0)
        for k, other in enumerate(seen.others):
            if other.zone is JUNCTION or (self._queue.setting_off(other) and (other.station, -k) > own_rank):
                self._released, self._stuck_since = False, None
                return False
        self._released = self._released or self._my_turn(seen)
        return self._released

    def _my_turn(self, seen: Observation) -> bool:
        # An entrance of a junction with stop signs can have a light as well, which the driver obeys.
        if seen.lights[seen.me.entrance] in (Colour.RED, Colour.YELLOW):
            return False
        entrance = seen.me.entrance
        if any(runs_through(seen, other) and other.entrance != entrance for other in seen.others) or exit_blocked(seen):
            self._stuck_since = None
            return False
        order, free = self._queue.first(seen)
        place = next((k for k, state in enumerate(order) if state.name == seen.me.name), None)
        if place is None or (free and place == 0):
            self._stuck_since = None
            return place == 0
        ahead = {state.name for state in order[:place]}
        if self._stuck_since is None or ahead != self._ahead:
            self._stuck_since, self._ahead = seen.time, ahead
        patience = WAIVER if free and place >= free else PATIENCE
        return seen.time - self._stuck_since >= patience + PATIENCE_STEP * place


class OnYellow:
    """Decides when a light turns yellow whether to stop, and keeps to the decision until the light changes again."""

    def __init__(self) -> None:
        self._stops: bool | None = None

    def allows(self, seen: Observation) -> bool:
        """Return False if the own light is yellow and the driver stops for it; must be called in every step."""
        if seen.lights[seen.me.entrance] is not _YELLOW:
            self._stops = None
        elif self._stops is None:
            self._stops = can_stop(seen, YELLOW)
        return not self._stops


class Light:
    """Decides at a light: the driver stops on yellow and red, turns right on red after a stop, and yields when turning.

    In the paper's rules, a vehicle keeps its right of way until it is in the junction or the own light is green. Otherwise, a
    vehicle loses its right of way when its green light ends, and when it has stood at green for `WAIVER`.
    """

    def __init__(self, *, paper: bool = True) -> None:
        self._paper = paper
        self._yellow = OnYellow()
        self._stood = False
        self._owed: set[str] = set()
        self._idle: dict[str, float] = {}
        """By name of a vehicle that stands at green, the time since which it has stood [s]."""
        self._parked: set[str] = set()
        """Names of vehicles that have stood at green for the time `WAIVER`, and still stand."""

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; must be called in every step before the junction."""
        me = seen.me
        colour = seen.lights[me.entrance]
        if me.zone is ENTRANCE and me.speed < STANDING:
            self._stood = True
        prior = self._prior(seen, colour) if me.turn is not _STRAIGHT else []
        passes = self._yellow.allows(seen)
        if colour is _YELLOW:
            return passes
        turns_on_red = seen.junction.turns_on_red(me.entrance, me.turn) and not seen.junction.left_hand
        if colour is _RED and not (self._stood and turns_on_red):
            return False
        if self._owed or not all(_leaves_time(seen, other) for other in prior):
            return False
        for k, other in enumerate(seen.others):
            if other.zone is JUNCTION or (seen.lights[other.entrance] is _RED and runs_through(seen, other)):
                if conflicts(seen, other):
                    return False
            elif other.turn is me.turn and (me.entrance, other.entrance) in seen.junction.opposite and other.zone <= ENTRANCE:
                # Of two oncoming left turns whose paths intersect, the vehicle that is nearer to the junction goes first, or the
                # vehicle that was created first. Both drivers see the same states, so only one of them waits.
                nearer = other.station > me.station or (other.station == me.station and k < seen.created)
                if nearer and conflicts(seen, other) and not _leaves_time(seen, other):
                    return False
        return not exit_blocked(seen)

    def owes(self, seen: Observation) -> bool:
        """Return whether the paper's rules oblige the driver to let another vehicle enter first; must be called in every step."""
        self._prior(seen, seen.lights[seen.me.entrance])
        return bool(self._owed)

    def _prior(self, seen: Observation, colour: Colour) -> list[VehicleState]:
        """Return the vehicles before the junction that have priority over the own vehicle and have not waived it."""
        me, prior = seen.me, [other for other in seen.others if self._has_priority(seen, other, colour)]
        if self._paper:
            # By the paper's rules, the obligation to let a vehicle enter first begins when both vehicles are at their entrances,
            # and holds whatever the light of the other vehicle shows later. When the own light turns green, the obligation
            # remains only toward vehicles that have priority at green.
            if prior and me.zone is ENTRANCE:
                # An oncoming left turn with green has priority over a right turn on red, which the paper's rules don't mention.
                relation = seen.junction.opposite if me.turn is seen.junction.far else seen.junction.right_of
                at_entrance = (other for other in prior if other.zone is ENTRANCE)
                self._owed |= {other.name for other in at_entrance if (me.entrance, other.entrance) in relation}
            if self._owed:
                self._owed &= {other.name for other in seen.others if other.zone is ENTRANCE}
            if self._owed and seen.lights[me.entrance] is _GREEN:
                self._owed &= {other.name for other in prior}
            return prior
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
        return [other for _, other in not_queued(seen) if other in prior and other.name not in parked]

    def _has_priority(self, seen: Observation, other: VehicleState, colour: Colour) -> bool:
        """Return whether `other` is before the junction and has priority over the own vehicle."""
        if other.zone is not APPROACH and other.zone is not ENTRANCE:
            return False
        me, junction = seen.me, seen.junction
        far = junction.far
        if me.turn is far and other.turn is not far and (me.entrance, other.entrance) in junction.opposite:
            return True
        if colour is not _RED or me.turn is not _RIGHT:
            return False
        goes = seen.lights[other.entrance] is not _RED or (other.zone is ENTRANCE and may_get_green(seen, other))
        return (goes and bool(conflicts(seen, other))) or (self._paper and (me.entrance, other.entrance) in junction.right_of)


def may_get_green(seen: Observation, other: VehicleState) -> bool:
    """Return whether the light of `other` can turn green before the own light, because it belongs to another phase."""
    lanes = seen.junction.entrances
    return lanes[other.entrance].phase != lanes[seen.me.entrance].phase


def _leaves_time(seen: Observation, other: VehicleState) -> bool:
    """Return whether the own vehicle can leave all shared stretches before `other`, which has priority, can reach them."""
    if other.station >= stop_place(seen.junction, other.entrance)[0]:
        return False
    line = -seen.junction.setbacks[other.entrance] - other.station
    me = seen.me
    delay = SET_OFF if me.speed < 1.0 else 0.0
    cruise = min(seen.speed_limit, 5.0)
    speed = min(me.speed, cruise)
    # `other` must not reach its entrance zone before the own vehicle has entered the junction.
    enter = delay + time_to(seen.itinerary.entry - me.station, speed, DRIVE, cruise)
    if time_to(line - ENTRANCE_ZONE, other.speed, EAGER, seen.limit_of(other)) < enter + MARGIN / 2:
        return False
    for shared in conflicts(seen, other):
        leave = delay + time_to(shared.mine.end + me.length - me.station, speed, DRIVE, cruise)
        if time_to(shared.yours.start - other.station, other.speed, EAGER, seen.limit_of(other)) < leave + MARGIN:
            return False
    return True
