"""The side to which a lane or a way turns, and the word for the turn of a movement.

Drivers, rules and lights use `Turn`, the side to which a movement turns. Texts for people use the word. A movement is a U-turn if
its entrance and its exit lie on one arm. A fourth value of `Turn`, for U-turns, would show observers more than an indicator does,
and would change every rule and driver that asks for a left turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Protocol

UTURN = "U-turn"
_BEND = math.radians(44.0)
"""Least change of heading of a turn [rad]; as in SUMO's netconvert, a degree below the angle between the arms of a regular 8-way
junction, so that rounding gives neighbouring arms the same turn type."""


class Turn(StrEnum):
    """Turn type of a lane (the paper's tau): the side to which vehicles turn and indicate; a U-turn has the side of its arc."""

    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"

    @classmethod
    def of(cls, turning: float) -> Turn:
        """Return the turn type of a total change of heading [rad]."""
        return cls.STRAIGHT if abs(turning) < _BEND else cls.LEFT if turning > 0 else cls.RIGHT


class _Lane(Protocol):
    @property
    def arm(self) -> int: ...


class _Place(Protocol):
    """A junction or the report of a junction."""

    @property
    def entrances(self) -> Sequence[_Lane]: ...
    @property
    def exits(self) -> Sequence[_Lane]: ...


class _Way(Protocol):
    @property
    def entrance(self) -> int: ...
    @property
    def exit(self) -> int: ...
    @property
    def turn(self) -> Turn: ...


def turn_word(place: _Place, way: _Way) -> str:
    """Return ``left``, ``straight`` or ``right``, or ``U-turn`` for a movement that leaves by the arm of its entrance."""
    return UTURN if place.entrances[way.entrance].arm == place.exits[way.exit].arm else way.turn.value
