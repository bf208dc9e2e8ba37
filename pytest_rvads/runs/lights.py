"""The signal plan of a junction with lights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pytest_rvads.runs.states import Colour

__all__ = ["STEADY", "SignalPlan"]

GREEN, YELLOW, CLEARANCE = 15.0, 3.0, 2.0
"""Durations [s] of the recorded junctions: green, yellow, all red before the next group."""
STEADY = 1.0
"""Colours change at whole multiples of this and at no other time [s]."""
_SLOT = GREEN + YELLOW + CLEARANCE
_NONE, *_PHASES = Colour  # green, yellow, red


@dataclass(frozen=True, slots=True)
class SignalPlan:
    """Fixed-time plan: the phase groups have green one after the other.

    With two groups one shows green 15, yellow 3, red 22 s, the other red 20, green 15, yellow 3, red 2 s.
    """

    groups: tuple[frozenset[int], ...]
    """Entrances per phase group."""
    first: int = 0
    """Group that has green at t = 0."""

    def colours(self, time: float, entrances: int) -> tuple[Colour, ...]:
        """Return the colour at each of so many entrances at `time` [s]; NONE for an entrance in no group."""
        if not self.groups:
            return (_NONE,) * entrances
        # Times are sums of steps of 0.01 s; rounding keeps a phase change on its tick.
        turn, within = divmod(round(time, 6), _SLOT)
        phase = 0 if within < GREEN else 1 if within < GREEN + YELLOW else 2
        return _shown(self.groups, entrances)[(int(turn) + self.first) % len(self.groups)][phase]


@lru_cache(maxsize=256)  # asked for in every step, and changes every few seconds
def _shown(groups: tuple[frozenset[int], ...], entrances: int) -> list[list[tuple[Colour, ...]]]:
    """Return the colour at each entrance while a group has its turn, and it is green, yellow and red there."""
    lit = frozenset[int]().union(*groups)
    return [
        [tuple(now if i in group else Colour.RED if i in lit else Colour.NONE for i in range(entrances)) for now in _PHASES]
        for group in groups
    ]
