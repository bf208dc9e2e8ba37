"""Mutants that decide wrongly when to enter the junction."""

from __future__ import annotations

from typing import ClassVar

from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Gate, Reference, by_zones
from pytest_rvads.drivers.signs_and_lights import HOLD, PATIENCE, Light, Queue, StopSign
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Colour, VehicleState, Zone

_SHORT = 1.5
"""Slower than this, the short stop counts as one [m/s]."""


class _Queued(StopSign):
    def __init__(self, queue: Queue) -> None:
        super().__init__()
        self._queue = queue


class _Gated(Reference):
    """Has other gates than the reference autopilot at stop signs, at lights, or at both, or another order at stop signs.

    Elsewhere, where the reference autopilot looks at movements and not at zones, it drives like it.
    """

    sign: ClassVar[type[Gate]] = StopSign
    light: ClassVar[type[Gate]] = Light
    queue: ClassVar[type[Queue] | None] = None

    def make_gate(self, seen: Observation) -> Gate:
        if not by_zones(seen.junction):
            return super().make_gate(seen)
        if seen.junction.control is JunctionControl.LIGHTS:
            return self.light()
        return self.sign() if self.queue is None else _Queued(self.queue())


class _Open:
    def allows(self, seen: Observation) -> bool:
        return not any(in_the_way(seen, other) for other in seen.others)


class IgnoresStop(_Gated):
    """Does not stop at a stop sign, unless a vehicle in the junction is in its way."""

    sign = _Open


class _Short(StopSign):
    def allows(self, seen: Observation) -> bool:
        if self._stood_since is None and seen.me.zone is Zone.ENTRANCE and seen.me.speed < _SHORT:
            self._stood_since = seen.time - HOLD
        return super().allows(seen)


class ShortStop(_Gated):
    """Slows down to 1.5 m/s at a stop sign instead of stopping."""

    sign = _Short


def _waiting(seen: Observation) -> list[VehicleState]:
    return [s for s in (seen.me, *seen.others) if s.zone is Zone.ENTRANCE]


class _ByNumber(Queue):
    def first(self, seen: Observation) -> tuple[list[VehicleState], int]:
        return [min(_waiting(seen), key=lambda s: s.entrance)], 1


class NumberFirst(_Gated):
    """At a stop sign, lets the vehicle at the entrance with the lowest number go first."""

    queue = _ByNumber


class _LastFirst(Queue):
    def first(self, seen: Observation) -> tuple[list[VehicleState], int]:
        return [max(_waiting(seen), key=lambda s: (self._outside[s.name], -s.entrance))], 1


class Backwards(_Gated):
    """At a stop sign, lets the vehicle that came last go first."""

    queue = _LastFirst


class _LeftQueue(Queue):
    def first(self, seen: Observation) -> tuple[list[VehicleState], int]:
        waiting = _waiting(seen)
        earliest = min(self._outside[s.name] for s in waiting)
        tied = [s for s in waiting if self._outside[s.name] == earliest]
        right_of = seen.junction.right_of
        free = [s for s in tied if not any((s.entrance, o.entrance) in right_of for o in tied)]
        return ([min(free, key=lambda s: s.entrance)], 1) if free else (tied, 0)


class LeftFirst(_Gated):
    """At a stop sign, lets the vehicle on its left go first if both arrive together."""

    queue = _LeftQueue


class _Polite(StopSign):
    def _my_turn(self, seen: Observation) -> bool:
        _, free = self._queue.first(seen)
        return free > 0 and super()._my_turn(seen)


class Deadlocks(_Gated):
    """Waits for ever if every vehicle has a vehicle on its right."""

    sign = _Polite


class _Equal(StopSign):
    def _my_turn(self, seen: Observation) -> bool:
        # Standing at entrance 0 in this respect: everybody's patience ends in the same tick.
        mine = super()._my_turn(seen)
        return mine or (self._stuck_since is not None and seen.time - self._stuck_since >= PATIENCE)


class EqualPatience(_Gated):
    """Waits as long as all other vehicles if every vehicle has a vehicle on its right."""

    sign = _Equal


class _EarlySign(StopSign):
    def allows(self, seen: Observation) -> bool:
        left = [o for o in seen.others if o.zone is not Zone.JUNCTION or in_the_way(seen, o)]
        return super().allows(seen._replace(others=tuple(left)))


class Tailgates(_Gated):
    """At a stop sign, enters as soon as the vehicle in the junction is out of its way."""

    sign = _EarlySign


class _Deaf(Queue):
    def setting_off(self, others: object) -> bool:
        return False


class Jostles(_Gated):
    """At a stop sign, does not notice that another vehicle has set off already."""

    queue = _Deaf


class _Rushes(Light):
    def __init__(self) -> None:
        super().__init__()
        self._stood = True


class NoRightOnRedStop(_Gated):
    """Turns right on red without stopping, but yields."""

    light = _Rushes


class _NoRedYield(Light):
    def _has_priority(self, seen: Observation, other: VehicleState, colour: Colour) -> bool:
        on_red = colour is Colour.RED and seen.me.turn is Turn.RIGHT
        return not on_red and super()._has_priority(seen, other, colour)


class NoRightOnRedYield(_Gated):
    """Turns right on red after a stop, without yielding to the left."""

    light = _NoRedYield


class _NoYield(Light):
    def _has_priority(self, seen: Observation, other: VehicleState, colour: Colour) -> bool:
        return seen.me.turn is not Turn.LEFT and super()._has_priority(seen, other, colour)


class NoYield(_Gated):
    """Turns left without yielding to oncoming traffic."""

    light = _NoYield


class _HalfYield(Light):
    def _has_priority(self, seen: Observation, other: VehicleState, colour: Colour) -> bool:
        right = seen.me.turn is Turn.LEFT and other.turn is Turn.RIGHT
        return not right and super()._has_priority(seen, other, colour)


class HalfYield(_Gated):
    """Turning left, yields to oncoming vehicles that go straight on, but not to those that turn right."""

    light = _HalfYield


class _Early(Light):
    def allows(self, seen: Observation) -> bool:
        if all(colour is Colour.RED for colour in seen.lights):
            # Everybody has red: the next green is the own one, as long as nobody else thinks so first.
            seen = seen._replace(lights=tuple(Colour.GREEN for _ in seen.lights))
        return super().allows(seen)


class Anticipates(_Gated):
    """Sets off while all lights are red."""

    light = _Early
