"""Signs, lights and stop lines on lanes, the control of a junction that follows from them, and green phases.

A stopping line is a line marked on the road. Without a marked line, vehicles stop before they enter the junction. The place of a
stop sign decides only how far before the junction a stop counts.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

from pytest_rvads.geometry.turns import Turn

_AT_LINE = 0.01


class JunctionControl(StrEnum):
    """Control of a whole junction, by the signs and lights at its entrances."""

    STOP = "stop"
    """Stop signs at all entrances."""
    LIGHTS = "lights"
    """Lights at all entrances."""
    NONE = "none"
    """No signs and no lights: a vehicle gives way to a vehicle from its right."""
    YIELD = "yield"
    """Yield or priority signs at some or all entrances, and no stop sign or light."""
    PARTIAL = "partial"
    """Stop signs or lights at some entrances only, or both stop signs and lights."""


class Sign(StrEnum):
    """Control of an entrance: its sign or light, or none."""

    STOP = "stop"
    YIELD = "yield"
    PRIORITY = "priority"
    LIGHTS = "lights"
    NONE = "none"


class ObjectKind(StrEnum):
    """Kinds of objects of a map that matter to the rules, such as stop signs."""

    STOP = "stop"
    YIELD = "yield"
    PRIORITY = "priority"
    LIGHT = "light"
    LINE = "line"
    NO_TURN_ON_RED = "no turn on red"


@dataclass(frozen=True, slots=True)
class MapObject:
    """A sign, light or stop line with its position on the metric graph."""

    id: str
    kind: ObjectKind
    junction: str
    edge: str
    """The edge of the entrance that the object regulates."""
    station: float
    """Station along the edge; the end of the edge if the object stands in or beyond the junction [m]."""
    setback: float | None
    """Distance of a line or sign before the entrance vertex [m]; None for lights and for distant lines and signs.

    It is negative for a line that is painted behind the vertex.
    """
    arrows: frozenset[Turn] = frozenset()
    """Turns that a light with arrows regulates; empty for a light without arrows and for other objects."""
    point: tuple[float, float] | None = field(default=None, compare=False)
    """Place of a light in the plane of the map [m]; None for signs and lines, and where the format gives no place."""


def signs_of(controlled: Sequence[set[ObjectKind]]) -> tuple[Sign, ...]:
    """Return the sign or light that controls each entrance."""
    regulating = {
        ObjectKind.LIGHT: Sign.LIGHTS,
        ObjectKind.STOP: Sign.STOP,
        ObjectKind.YIELD: Sign.YIELD,
        ObjectKind.PRIORITY: Sign.PRIORITY,
    }
    common = set(regulating).intersection(*controlled)
    decisive = ((kinds & common) or kinds for kinds in controlled)
    return tuple(next((sign for kind, sign in regulating.items() if kind in kinds), Sign.NONE) for kinds in decisive)


def sign_of_arm(signs: Sequence[Sign]) -> Sign:
    """Return the most frequent sign of the entrances of an arm; on a tie the sign nearest to the kerb; NONE without entrances."""
    return max(signs, key=lambda sign: (signs.count(sign), -signs.index(sign)), default=Sign.NONE)


def control_of(signs: Iterable[Sign]) -> JunctionControl:
    """Return the control of a junction from the signs of its entrances."""
    kinds = set(signs)
    for sign, control in ((Sign.STOP, JunctionControl.STOP), (Sign.LIGHTS, JunctionControl.LIGHTS)):
        if kinds == {sign}:
            return control
    if kinds & {Sign.STOP, Sign.LIGHTS}:
        return JunctionControl.PARTIAL
    return JunctionControl.YIELD if kinds & {Sign.YIELD, Sign.PRIORITY} else JunctionControl.NONE


def setback_of(objects: Iterable[MapObject]) -> float:
    """Return the distance of the nearest marked stopping line before the vertex [m]; 0 without a marked line.

    A line behind the vertex, with a negative distance, counts only if no line is marked before the vertex.
    Without a marked line, vehicles stop before they enter the junction (California Vehicle Code 22450(a), Uniform Vehicle Code
    11-403).
    """
    lines = [item.setback for item in objects if item.kind is ObjectKind.LINE and item.setback is not None]
    return min((line for line in lines if line >= 0.0), default=max(lines, default=0.0))


def sign_setback_of(objects: Sequence[MapObject]) -> float | None:
    """Return the distance of the nearest stop sign before the vertex [m]; None if no sign stands away from the stopping line."""
    signs = [item.setback for item in objects if item.kind is ObjectKind.STOP and item.setback is not None and item.setback >= 0]
    return min(signs) if signs and abs(min(signs) - setback_of(objects)) > _AT_LINE else None


def phase_groups(
    arms: Sequence[int],
    opposite: frozenset[tuple[int, int]],
    controllers: Iterable[frozenset[int]] = (),
    protected: Container[int] = (),
) -> tuple[frozenset[int], ...]:
    """Return the groups of entrances that have green together, sorted by the lowest entrance number of each group."""
    groups = [group for group in controllers if group]
    fits = all(arms[a] == arms[b] or (a, b) in opposite for group in groups for a in group for b in group)
    covers = sorted(e for group in groups for e in group) == list(range(len(arms)))
    if not (fits and covers and any(len(group) > 1 for group in groups)):
        groups = [frozenset([entrance]) for entrance in range(len(arms))]
        for a, b in (*sorted(opposite), *((a, b) for a, b in combinations(range(len(arms)), 2) if arms[a] == arms[b])):
            apart = [group for group in groups if not group & {a, b}]
            groups = [*apart, frozenset().union(*(group for group in groups if group & {a, b}))]
        arrows = frozenset(e for e in range(len(arms)) if e in protected)
        groups = [part for group in groups for part in (group - arrows, group & arrows) if part]
    return tuple(sorted(groups, key=min))
