"""Mutants that see something wrong; they decide and drive like the reference autopilot."""

from __future__ import annotations

from collections import deque

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Colour, VehicleState, Zone

_REACH = 12.0
"""How far the short-sighted one sees [m]."""
_LATE = 0.6
"""By how much the late one is behind [s]."""


class Misled(Reference):
    """Drives by what `perceive` makes of the observation."""

    def perceive(self, seen: Observation) -> Observation:
        """Return what this mutant believes to see."""
        others = tuple([other for other in seen.others if self.notices(seen, other)])
        return seen._replace(others=others)

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        """Return whether it sees `other` at all."""
        return True

    def control(self, seen: Observation) -> Control:
        return super().control(self.perceive(seen))


class BlindLeft(Misled):
    """Does not see vehicles from the left until it has left the junction."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        return other.zone >= Zone.EXIT or (seen.me.entrance, other.entrance) not in seen.junction.right_of


class BlindRight(Misled):
    """Does not see vehicles from the right until it has left the junction."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        return other.zone >= Zone.EXIT or (other.entrance, seen.me.entrance) not in seen.junction.right_of


class BlindAhead(Misled):
    """Does not see vehicles from the opposite entrance until it has left the junction."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        return other.zone >= Zone.EXIT or (seen.me.entrance, other.entrance) not in seen.junction.opposite


class BlindInside(Misled):
    """Does not see vehicles in the junction."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        return other.zone is not Zone.JUNCTION


class ShortSighted(Misled):
    """Sees vehicles within 12 m only."""

    def notices(self, seen: Observation, other: VehicleState) -> bool:
        dx, dy = other.x - seen.me.x, other.y - seen.me.y
        return dx * dx + dy * dy < _REACH * _REACH


class NoSpeeds(Misled):
    """Assumes that all other vehicles stand."""

    def perceive(self, seen: Observation) -> Observation:
        return seen._replace(others=tuple([other._replace(speed=0.0, acceleration=0.0) for other in seen.others]))


class LateSight(Misled):
    """Sees the other vehicles as they were 0.6 s ago."""

    def __init__(self) -> None:
        super().__init__()
        self._past: deque[tuple[VehicleState, ...]] = deque(maxlen=round(_LATE / DT))

    def perceive(self, seen: Observation) -> Observation:
        self._past.append(seen.others)
        return seen._replace(others=self._past[0])


class _Coloured(Misled):
    """Takes some colours for others."""

    taken: dict[Colour, Colour] = {}

    def perceive(self, seen: Observation) -> Observation:
        return seen._replace(lights=tuple([self.taken.get(colour, colour) for colour in seen.lights]))


class Yellow(_Coloured):
    """Takes yellow for green."""

    taken = {Colour.YELLOW: Colour.GREEN}


class RunsRed(_Coloured):
    """Takes red for green."""

    taken = {Colour.RED: Colour.GREEN}


class Unlit(_Coloured):
    """Takes green for red: never goes, except to the right."""

    taken = {Colour.GREEN: Colour.RED}
