"""The cycle of the lights in a scenario: its duration, the group that has green first, and the duration of runs."""

from __future__ import annotations

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.states import SLOT


def cycle(place: Junction) -> float:
    """Return the duration of a cycle of the lights [s]; 0 at a junction without lights."""
    return len(place.phase_groups) * SLOT


def first_green(place: Junction, rotation: int) -> int:
    """Return the number of the phase group with green at t = 0: the group of the entrance to which the rotation moves entrance 0.

    With one lane per arm, a rotation by an odd number of arms swaps the two groups, as in the paper, even if the map
    has other groups.
    """
    groups, count = place.phase_groups, len(place.entrances)
    if place.one_lane_each:
        return rotation % 2 if len(groups) > 1 else 0
    moved = [frozenset((entrance + rotation) % count for entrance in group) for group in groups[:1]]
    return next((groups.index(group) for group in moved if group in groups), 0)


def usual_duration(place: Junction) -> float:
    """Return the default duration of runs at a junction [s].

    The duration is 60 s, or, with more than two phase groups, a cycle of the lights and 30 s. So every vehicle has green once,
    and half a minute to leave after that.
    """
    return 60.0 if len(place.phase_groups) <= 2 else cycle(place) + 30.0
