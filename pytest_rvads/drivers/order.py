"""The order of turns at an all-way stop: first come, first served, and right before left on ties."""

from __future__ import annotations

from pytest_rvads.drivers.crossing import may_meet
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.logic.conduct.standing import STANDSTILL, stop_place
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import APPROACH, ENTRANCE, VehicleState

__all__ = ["Queue"]

_MOVING = 0.15
"""A vehicle that stood before its line and is now faster than this has set off [m/s]."""


class Queue:
    """A driver's memory of the vehicles before the junction: when each vehicle arrived, and which vehicles have set off again.

    A vehicle arrives when it stops in the stop place with no vehicle ahead in its lane, or enters the entrance zone, whichever
    is earlier. The vehicle stays arrived until it enters the junction or backs out. Only vehicles whose ways meet take turns.

    Args:
        tie: arrivals within this time of each other count as simultaneous [s]. With 0, arrivals and turns are as in the paper's
            rules: a vehicle arrives when it enters the entrance zone, and takes turns with those of all other entrances.
    """

    def __init__(self, tie: float = 0.0) -> None:
        self._tie = round(tie / DT)
        self._outside: dict[str, int] = {}
        self._stood: set[str] = set()

    def watch(self, seen: Observation) -> None:
        """Remember arrivals and departures; to be called in every step."""
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
                    # The vehicle has arrived from the start: its waiting time counts from zero.
                    outside[name] = tick
                if state.speed <= STANDSTILL:
                    stood.add(name)

    def _in_stop_place(self, seen: Observation, state: VehicleState) -> bool:
        """Return whether `state`, on its approach, stands in the stop place since a stop with no vehicle ahead."""
        if not self._tie or state.station < stop_place(seen.junction, state.entrance)[0]:
            return False
        if state.name in self._stood or state.speed > STANDSTILL:
            return state.name in self._stood
        return not any(o.entrance == state.entrance and state.station < o.station <= 0.0 for o in (seen.me, *seen.others))

    def setting_off(self, other: VehicleState) -> bool:
        """Return whether `other` stood at its entrance and has set off."""
        return other.zone is ENTRANCE and other.speed > _MOVING and other.name in self._stood

    def stood(self, other: VehicleState) -> bool:
        """Return whether `other` has arrived and has stood since."""
        return other.name in self._stood

    def arrived(self, other: VehicleState) -> bool:
        """Return whether `other` is at its entrance, or waits in the stop place before it."""
        return other.zone is ENTRANCE or other.name in self._stood

    def since(self, state: VehicleState) -> int:
        """Return the tick at which `state` arrived; the present tick if the vehicle has not arrived."""
        return self._outside[state.name]

    def before(self, vehicle: VehicleState, other_vehicle: VehicleState) -> bool | None:
        """Return whether `vehicle` arrived earlier than `other_vehicle`; None if both arrived together."""
        later = self._outside[vehicle.name] - self._outside[other_vehicle.name]
        return None if abs(later) <= self._tie else later < 0

    def first(self, seen: Observation) -> tuple[list[VehicleState], int]:
        """Return the order in which the arrived vehicles may go, and the number of vehicles at its head that need not wait.

        Returns:
            First the vehicles that have to wait for no vehicle. Unless the turns are the paper's, the vehicles follow that wait
            for these only. If every vehicle has to wait for another vehicle, all vehicles are returned. Vehicles are sorted by
            arrival; in the same tick a vehicle without a vehicle to its right comes first, then the vehicle that was created
            first. So all drivers agree on the order. In a queue at one entrance only the first vehicle counts.
        """
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
