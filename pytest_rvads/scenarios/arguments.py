"""Checks of the arguments of a scenario. Every check raises a `ScenarioError` that says which argument is wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.orbits import Directions, Orbits
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.support.errors import ScenarioError

MOST_FOLLOWERS = 9
"""Greatest number of vehicles that queue behind each vehicle."""


def within(value: object, count: int) -> bool:
    """Return whether `value` is a whole number of 0 or more below `count`."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def check_rotation(place: Junction, rotation: int) -> None:
    """Check that a rotation keeps lanes, movements and signs of the junction."""
    count, rows = len(place.entrances), Orbits.at(place).rows
    if not within(rotation, count):
        raise ScenarioError(f"rotation must be one of 0..{count - 1} for {count} entrances, got {rotation!r}")
    if rotation not in rows:
        raise ScenarioError(
            f"rotation must be one of {', '.join(map(str, rows))}, by so many entrances junction {place.name!r} keeps its lanes, "
            f"movements and signs, got {rotation}: give the directions as they stand on the map"
        )


def check_directions(place: Junction, placed: Directions) -> None:
    """Check that every vehicle has a movement."""
    for entrance, direction in enumerate(placed):
        if direction and (entrance, direction) not in place.by_direction:
            try:
                place.leads(entrance, direction)
            except ScenarioError as refused:
                raise ScenarioError(f"{refused}, and 0 is nobody, got {label(placed, place.lanes)!r}") from None


def checked_pedestrians(pedestrians: object) -> tuple[Pedestrian, ...]:
    """Return the pedestrians of a scenario as a tuple."""
    if isinstance(pedestrians, Sequence) and all(isinstance(walker, Pedestrian) for walker in pedestrians):
        return tuple(pedestrians)
    raise ScenarioError(f"pedestrians must be a list of rvads.Pedestrian(crossing, side, ...), got {pedestrians!r:.100}")


def checked_order(order: object, count: int) -> tuple[int, ...]:
    """Return the order in which the vehicles of `count` entrances are created as a tuple."""
    if isinstance(order, Sequence) and all(within(e, count) for e in order) and len({*order}) == len(order) == count:
        return tuple(order)
    raise ScenarioError(f"order must name each of the entrances 0..{count - 1} once, got {order!r}")


def check_followers(followers: int) -> None:
    """Check that a number of followers is 0 to `MOST_FOLLOWERS`."""
    if not within(followers, MOST_FOLLOWERS + 1):
        raise ScenarioError(f"followers must be a whole number from 0 to {MOST_FOLLOWERS}, got {followers!r}")


def check_numbers(duration: float | None, aggression: int, wait: float) -> None:
    """Check a duration [s], an aggression and a wait [s]; a duration of None is the default."""
    duration = 60.0 if duration is None else duration
    if not (within(aggression, 4) and aggression):
        raise ScenarioError(f"aggression must be 1, 2 or 3, got {aggression!r}")
    for name, seconds in (("duration", duration), ("wait", wait)):
        if isinstance(seconds, bool) or not isinstance(seconds, int | float):
            raise ScenarioError(f"{name} must be a number of seconds, got {seconds!r}")
    if not (math.isfinite(duration) and 0 < duration <= 3600):
        raise ScenarioError(f"duration must lie above 0 and up to 3600 s, got {duration!r}")
    if not (math.isfinite(wait) and wait >= 0):
        raise ScenarioError(f"wait must be 0 s or more, got {wait!r}")
