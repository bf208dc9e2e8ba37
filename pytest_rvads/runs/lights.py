"""The signal plan of a junction with lights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pytest_rvads.runs.states import Colour

__all__ = ["SignalPlan"]

GREEN, YELLOW, CLEARANCE = 15.0, 3.0, 2.0
"""Durations [s] of the recorded junctions: green, yellow, all red before the next group."""


@dataclass(frozen=True, slots=True)
class SignalPlan:
    """Fixed-time plan: the phase groups have green one after the other.

    With two groups one shows green 15, yellow 3, red 22 s, the other red 20, green 15, yellow 3, red 2 s.
    """

    groups: tuple[frozenset[int], ...]
    """Entrances per phase group."""
    first: int = 0
    """Group that has green at t = 0."""

    def colours(self, time: float, ways: int) -> tuple[Colour, ...]:
        """Return the colour at each of `ways` entrances at `time` [s]; NONE for an entrance in no group."""
        slot = GREEN + YELLOW + CLEARANCE
        # Times are sums of steps of 0.01 s; rounding keeps a phase change on its tick.
        turn, within = divmod(round(time, 6), slot)
        if not self.groups:
            return (Colour.NONE,) * ways
        active = (int(turn) + self.first) % len(self.groups)
        now = Colour.GREEN if within < GREEN else Colour.YELLOW if within < GREEN + YELLOW else Colour.RED
        return _shown(self.groups, active, now, ways)


@lru_cache(maxsize=256)  # asked for in every step, and changes every few seconds
def _shown(groups: tuple[frozenset[int], ...], active: int, now: Colour, ways: int) -> tuple[Colour, ...]:
    """Return the colour at each entrance while the group `active` shows `now`."""
    lit = frozenset[int]().union(*groups)
    return tuple(now if i in groups[active] else Colour.RED if i in lit else Colour.NONE for i in range(ways))
