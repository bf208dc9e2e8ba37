"""The scheduler of a junction with stop signs: one queue for all, first in, first out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.lgsvl.zone import Guarded
from pytest_rvads.runs.states import VehicleState

__all__ = ["Scheduler"]


class _Waiting(NamedTuple):
    name: str
    entrance: int
    since: float
    """When it joined [s]."""


class Scheduler:
    """Lets the vehicles into the junction one after the other.

    Vehicles call the scheduler in creation order. So of two vehicles that arrive in the same tick the vehicle that was created
    first is first in the queue: that is deficiency I3.

    Args:
        roster: names of the scheduled vehicles.
        ties_ignored: deficiency I3; if False, among vehicles that arrive together a vehicle without a vehicle to its right goes
            first.
    """

    def __init__(self, roster: Iterable[str], ties_ignored: bool) -> None:
        self._roster = frozenset(roster)
        self._ties_ignored = ties_ignored
        self._queue: list[_Waiting] = []
        self._called: str | None = None
        self._inside = False

    def join(self, seen: Observation) -> None:
        """Add a vehicle to the queue."""
        self._queue.append(_Waiting(seen.me.name, seen.me.entrance, seen.time))

    def calls(self, seen: Observation, zone: Guarded) -> bool:
        """Return whether it is this vehicle's turn: it is first, and nobody is on the way through the zone."""
        if self._called is not None or self._first(seen) != seen.me.name:
            return False
        # Vehicles that this scheduler does not know drive as they like.
        if any(state.name not in self._roster and zone.holds(state) for state in seen.others):
            return False
        self._called = seen.me.name
        self._inside = False
        return True

    def leaves(self, state: VehicleState, zone: Guarded, gone: bool) -> bool:
        """Return whether a vehicle that was called has left the zone with its whole body; the next one may then come.

        Args:
            state: of the vehicle.
            zone: the guarded area.
            gone: its body is out of the junction: then it has left, even if it never touched the zone.
        """
        held = zone.holds(state)
        self._inside = self._inside or held
        if held or not (self._inside or gone):
            return False
        self._queue = [entry for entry in self._queue if entry.name != state.name]
        self._called = None
        return True

    def _first(self, seen: Observation) -> str:
        head = self._queue[0]
        if not self._ties_ignored:
            tied = [entry for entry in self._queue if entry.since == head.since]
            for entry in tied:
                if not any((other.entrance, entry.entrance) in seen.junction.right_of for other in tied):
                    return entry.name
        return head.name
