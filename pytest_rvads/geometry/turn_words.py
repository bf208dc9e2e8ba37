"""The word for the turn of a movement, for people; drivers, rules and lights use its `Turn`, the side to which it turns.

A U-turn is recognised by its arms. A fourth `Turn` would show observers more than an indicator does, and would change every rule
and driver that asks for a left turn.
"""

from __future__ import annotations

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.conflicts import Way
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.paths import Route

__all__ = ["UTURN", "turn_word"]

UTURN = "U-turn"


def turn_word(place: Junction | JunctionReport, way: Way | Route) -> str:
    """Return ``left``, ``straight`` or ``right``, or ``U-turn`` for a movement that leaves by the arm of its entrance."""
    return UTURN if place.entrances[way.entrance].arm == place.exits[way.exit].arm else way.turn.value
