"""How the reference autopilot behaves at a stop sign."""

from __future__ import annotations

import math

from pytest_rvads.drivers.crossing import exit_blocked, runs_through
from pytest_rvads.drivers.follower import STANDING
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.order import Queue
from pytest_rvads.runs.states import ENTRANCE, JUNCTION, Colour

__all__ = ["HOLD", "PATIENCE", "PATIENCE_STEP", "WAIVER", "StopSign"]

HOLD = 0.5
"""Shortest stand at the sign [s]."""
PATIENCE, PATIENCE_STEP = 1.0, 0.7
"""Where every vehicle has to wait for another: how long the first vehicle waits, and how much longer each next vehicle [s].
The next vehicle waits as long for the first vehicle to use its turn. Vehicles follow in the order of their creation, so that a
rotation of the scenario changes nothing."""
WAIVER = 3.5
"""How long a driver waits for a standing vehicle that may go first [s]: after 3 s that vehicle has waived its right."""


class StopSign:
    """Stops, waits for its turn, and enters when no other vehicle is in the junction.

    Args:
        tie: see `Queue`; no longer than `HOLD`, so that simultaneous arrivals are known when the turn is computed [s].
    """

    def __init__(self, tie: float = 0.0) -> None:
        self._queue = Queue(tie)
        self._stood_since: float | None = None
        self._stuck_since: float | None = None
        self._ahead: set[str] = set()
        self._released = False

    def allows(self, seen: Observation) -> bool:
        """Return whether to enter the junction; to be called in every step before it."""
        self._queue.watch(seen)
        me = seen.me
        if me.zone is not ENTRANCE:
            return False
        if self._stood_since is None and me.speed < STANDING:
            self._stood_since = seen.time
        if self._stood_since is None or seen.time - self._stood_since < HOLD:
            return False
        # A vehicle that goes out of turn is let in even if the own vehicle has set off. Of two vehicles that set off at once the
        # vehicle that has come farther goes on.
        own_rank = (me.station, -seen.created) if self._queue.setting_off(me) else (-math.inf, 0)
        for k, other in enumerate(seen.others):
            if other.zone is JUNCTION or (self._queue.setting_off(other) and (other.station, -k) > own_rank):
                self._released, self._stuck_since = False, None
                return False
        self._released = self._released or self._my_turn(seen)
        return self._released

    def _my_turn(self, seen: Observation) -> bool:
        # Where only some entrances have lights, the lights are obeyed as well.
        if seen.lights[seen.me.entrance] in (Colour.RED, Colour.YELLOW):
            return False
        entrance = seen.me.entrance
        if any(runs_through(other) and other.entrance != entrance for other in seen.others) or exit_blocked(seen):
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
