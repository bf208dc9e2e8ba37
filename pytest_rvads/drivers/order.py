"""Whose turn it is where everybody stops: first come, first served, and right before left on ties."""

from __future__ import annotations

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import ENTRANCE, VehicleState

__all__ = ["Queue"]

_MOVING = 0.15
"""A vehicle that stood at its entrance and is now faster than this has set off [m/s]."""
_STANDING = 0.05
"""Slower than this a vehicle stands [m/s]."""


class Queue:
    """What a driver remembers of the vehicles at the entrances: when each arrived, and who has set off again.

    Args:
        tie: who arrived within this time of each other arrived together [s].
    """

    def __init__(self, tie: float = 0.0) -> None:
        self._tie = round(tie / DT)
        self._outside: dict[str, int] = {}
        self._stood: set[str] = set()

    def watch(self, seen: Observation) -> None:
        """Take note of who is where; to be called in every step."""
        tick = round(seen.time / DT)
        outside, stood = self._outside, self._stood
        for state in (seen.me, *seen.others):
            name = state.name
            if state.zone is not ENTRANCE:
                outside[name] = tick
                if stood:
                    stood.discard(name)
            else:
                if name not in outside:
                    # At its entrance from the start: waiting times count from zero there.
                    outside[name] = tick
                if state.speed < _STANDING:
                    stood.add(name)

    def setting_off(self, other: VehicleState) -> bool:
        """Return whether `other` stood at its entrance and is on its way now."""
        return other.zone is ENTRANCE and other.speed > _MOVING and other.name in self._stood

    def stood(self, other: VehicleState) -> bool:
        """Return whether `other` is at its entrance and has stood there."""
        return other.name in self._stood

    def before(self, one: VehicleState, other: VehicleState) -> bool | None:
        """Return whether `one`, at its entrance as `other` is, came there earlier; None where both came together."""
        later = self._outside[one.name] - self._outside[other.name]
        return None if abs(later) <= self._tie else later < 0

    def first(self, seen: Observation) -> tuple[list[VehicleState], bool]:
        """Return who goes next among the vehicles at the entrances, and whether right before left decides it.

        Returns:
            Those that have to wait for nobody, and True; or, where everybody who came first has somebody to let go first,
            all of them, and False. Who came earlier stands first, of those that came at once who was created earlier.
            Of several behind each other at one entrance only the first counts. Nobody, and True, where nobody is there.
        """
        since = self._outside
        waiting = [s for s in seen.everybody() if s.zone is ENTRANCE]
        if len({s.entrance for s in waiting}) < len(waiting):
            heads = {s.entrance: s.name for s in sorted(waiting, key=lambda s: s.station)}
            waiting = [s for s in waiting if heads[s.entrance] == s.name]
        if not waiting:
            return [], True
        earliest = min(since[s.name] for s in waiting)
        tied = [s for s in waiting if since[s.name] - earliest <= self._tie]
        right_of = seen.junction.right_of

        def waits_for(s: VehicleState, other: VehicleState) -> bool:
            later = since[s.name] - since[other.name]
            return later > self._tie or (later >= -self._tie and (other.entrance, s.entrance) in right_of)

        free = [s for s in tied if not any(waits_for(s, other) for other in waiting)]
        return sorted(free or tied, key=lambda s: since[s.name]), bool(free)
