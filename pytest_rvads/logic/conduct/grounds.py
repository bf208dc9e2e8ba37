"""The static ground on which a vehicle may have to give way to another vehicle.

Each pair of vehicles has at most one ground. Lights decide between two vehicles with lights. At an all-way stop the order of
arrival decides. Elsewhere the map, the signs and the sides from which both vehicles come decide (`Junction.yields`).
"""

from __future__ import annotations

from enum import StrEnum

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.yielding import Reason
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError

__all__ = ["Ground", "ground_of", "in_turn", "lit", "may_owe"]

_MINOR = (Sign.STOP, Sign.YIELD)


class Ground(StrEnum):
    """The ground on which a vehicle gives way to another vehicle."""

    SIGN = "sign"
    """The vehicle comes past a stop or yield sign, and the other vehicle does not."""
    PRIORITY = "priority"
    """The other vehicle has a priority sign and this vehicle has no sign, or the map says which movement has priority."""
    SIDE = "side"
    """The other vehicle comes from the near side: the right, where traffic keeps right."""
    TURN = "turn"
    """The vehicle turns across the way of oncoming traffic."""
    MERGE = "merge"
    """According to the map, the lane of the vehicle joins the lane of the other vehicle."""


def lit(junction: Junction, entrance: int) -> bool:
    """Return whether an entrance, or the start of another way, has a light."""
    return junction.starts[entrance].sign is Sign.LIGHTS


def ground_of(junction: Junction, way: Key, other: Key) -> Ground | None:
    """Return the ground on which an agent on way `way` has to give way to an agent on way `other`, or None.

    Raises:
        RunError: the places of the lanes are unknown, and the ground depends on them.
    """
    if junction.control is JunctionControl.STOP:
        return None
    if junction.yields is None:
        raise RunError("the run holds no geometry of its junction")
    reason = junction.yields.get((way, other))
    if lit(junction, way[0]) and lit(junction, other[0]):
        return Ground.TURN if reason is Reason.TURN else None
    match reason:
        case Reason.SIGN:
            return Ground.SIGN if junction.entrances[way[0]].sign in _MINOR else Ground.PRIORITY
        case Reason.STATED:
            return Ground.PRIORITY
        case Reason.RIGHT:
            return Ground.SIDE
        case Reason.TURN:
            return Ground.TURN
        case Reason.MERGE:
            return Ground.MERGE
    return None


def in_turn(junction: Junction, way: Key, other: Key) -> bool:
    """Return whether the order of arrival at an all-way stop binds two movements.

    The order binds movements from different arms that share a stretch (California Vehicle Code 21800(a) protects a vehicle that
    has entered). If the places of the lanes are unknown, the order binds all movements from different arms.
    """
    if not junction.movements.keys() >= {way, other} or junction.entrances[way[0]].arm == junction.entrances[other[0]].arm:
        return False
    return junction.conflicts is None or (way, other) in junction.conflicts


def may_owe(run: Run | Cast, agent: int, other: int) -> bool:
    """Return whether the agent can owe the way to the other agent at all: on one of the grounds, or by a turn on red.

    Raises:
        RunError: the places of the lanes are unknown, and the answer depends on them.
    """
    me, you, junction = run.agents[agent], run.agents[other], run.junction
    if agent == other or junction.control is JunctionControl.STOP:
        return False
    if not lit(junction, me.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    if me.turn is junction.near:
        return True
    if not lit(junction, you.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    return me.turn is junction.far and you.turn is not junction.far and (me.entrance, you.entrance) in junction.opposite
