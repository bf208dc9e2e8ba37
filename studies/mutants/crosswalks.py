"""Mutants that meet pedestrians wrongly; among vehicles they drive like the reference autopilot."""

from __future__ import annotations

import math
from typing import ClassVar

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.let_cross import AtCrosswalks
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.crosswalks import Crossing, Side
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Kind, VehicleState
from studies.mutants.sight import Misled

_TOO_FAR = 2.0
"""How far beyond the right place the mutant stops that stops on crosswalks [m]."""
_LATE = 1.3
"""The late mutant brakes when it needs this many times the service brake."""
_TIGHT = -1.0
"""How long before a pedestrian comes the mutant that passes tightly has left [s]."""
_ASIDE = 1.2
"""Who is farther aside than this is not in front [m]."""


def _way(seen: Observation, other: VehicleState) -> Crossing | None:
    """Return the way of a pedestrian; None for a vehicle."""
    number = other.entrance - len(seen.junction.entrances)
    way = seen.junction.further[number].way if number >= 0 else None
    return way if isinstance(way, Crossing) else None


class IgnoresFarSide(Misled):
    """Does not see pedestrians who come from the other side of the roadway."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        way = _way(seen, other)
        if way is None:
            return True
        enters = seen.junction.starts[other.entrance].arm == seen.junction.starts[seen.me.entrance].arm
        return enters is (way.side is Side.NEAR)


class FrontOnly(Misled):
    """Yields only to pedestrians in front of its body."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        me = seen.me
        aside = (other.y - me.y) * math.cos(me.heading) - (other.x - me.x) * math.sin(me.heading)
        return _way(seen, other) is None or abs(aside) < _ASIDE


class BlindTurningRight(Misled):
    """Does not look for pedestrians when it turns right."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        return seen.me.turn is not Turn.RIGHT or _way(seen, other) is None


class _Otherwise(Reference):
    """Comes to crosswalks in another way than the reference autopilot."""

    manner: ClassVar[type[AtCrosswalks]]

    def control(self, seen: Observation) -> Control:
        if self._at_crosswalks is None and seen.junction.further:
            self._at_crosswalks = self.manner(seen, self.track(seen))
        return super().control(seen)


class _TooFar(AtCrosswalks):
    def acceleration(self, seen: Observation, traffic: Observation) -> float:
        me = seen.me
        return super().acceleration(seen._replace(me=me._replace(station=me.station - _TOO_FAR)), traffic)


class StopsOnCrosswalk(_Otherwise):
    """Stops 2 m too far on, with its front on the crosswalk."""

    manner = _TooFar


class _Patient(AtCrosswalks):
    def _waived(self, seen: Observation, person: VehicleState, near: bool) -> bool:
        return False


class WaitsForEver(_Otherwise):
    """Waits for ever for a pedestrian who stands at the kerb."""

    manner = _Patient


class _Tight(AtCrosswalks):
    def _owed(self, seen: Observation, crosswalk: object, place: float, margin: float, *, stops: bool) -> bool:
        return super()._owed(seen, crosswalk, place, min(margin, _TIGHT), stops=stops)  # type: ignore[arg-type]


class PassesTightly(_Otherwise):
    """Passes first if it has left the crosswalk 1 s after the pedestrian comes onto its half of the roadway."""

    manner = _Tight


class _Trusting(AtCrosswalks):
    def _calmly(self, seen: Observation, crosswalk: object, distance: float) -> float:
        walkers = tuple([other for other in seen.others if other.kind is Kind.PEDESTRIAN])
        return super()._calmly(seen._replace(others=walkers), crosswalk, distance)  # type: ignore[arg-type]


class IgnoresOcclusion(_Otherwise):
    """Passes a parked vehicle at full speed, although it may hide a pedestrian."""

    manner = _Trusting


class _Hasty(AtCrosswalks):
    def acceleration(self, seen: Observation, traffic: Observation) -> float:
        brake = super().acceleration(seen, traffic)
        return brake if brake < -_LATE * seen.vehicle.brake[seen.aggression - 1] else math.inf


class BrakesLate(_Otherwise):
    """Begins to brake for a crosswalk when it can no longer stop before it."""

    manner = _Hasty
