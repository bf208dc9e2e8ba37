"""What regulates a junction: signs, lights and stop lines on lanes, the kind of control they make up, green phases.

A stopping line is a marked line. Where no line is marked, vehicles stop before they enter the junction. The place of a sign
decides only from where on a stop counts.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations

from pytest_rvads.maps.segment import Turn

__all__ = [
    "JunctionControl",
    "MapObject",
    "ObjectKind",
    "Sign",
    "control_of",
    "phase_groups",
    "setback_of",
    "sign_of_arm",
    "sign_setback_of",
    "signs_of",
]


_AT_LINE = 0.01


class JunctionControl(StrEnum):
    """What regulates a junction as a whole."""

    STOP = "stop"
    """Stop signs at all entrances."""
    LIGHTS = "lights"
    """Lights at all entrances."""
    NONE = "none"
    """Nothing: right before left."""
    YIELD = "yield"
    """Yield or priority signs at some entrances or all, and no stop sign or light at any."""
    PARTIAL = "partial"
    """Anything else: stop signs or lights at some entrances only, or both."""


class Sign(StrEnum):
    """What regulates an entrance."""

    STOP = "stop"
    YIELD = "yield"
    PRIORITY = "priority"
    LIGHTS = "lights"
    NONE = "none"


class ObjectKind(StrEnum):
    """Kinds of objects that matter to the rules."""

    STOP = "stop"
    YIELD = "yield"
    PRIORITY = "priority"
    LIGHT = "light"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class MapObject:
    """A sign, light or stop line with its position on the metric graph."""

    id: str
    kind: ObjectKind
    junction: str
    edge: str
    """The edge of the entrance it is for."""
    station: float
    """Along that edge; at its end where the object stands in or beyond the junction [m]."""
    setback: float | None
    """Distance of a line or sign before the entrance vertex, None where it is too far away and for lights [m]."""
    arrows: frozenset[Turn] = frozenset()
    """Turns that a light with arrows is for; empty for a light without arrows and for everything else."""


def signs_of(controlled: Sequence[set[ObjectKind]]) -> tuple[Sign, ...]:
    """Return what regulates each entrance, from the kinds of objects there; what all have counts, else a light before a sign."""
    regulating = {
        ObjectKind.LIGHT: Sign.LIGHTS,
        ObjectKind.STOP: Sign.STOP,
        ObjectKind.YIELD: Sign.YIELD,
        ObjectKind.PRIORITY: Sign.PRIORITY,
    }
    common = set(regulating).intersection(*controlled)
    kinds = ((here & common) or here for here in controlled)
    return tuple(next((sign for kind, sign in regulating.items() if kind in here), Sign.NONE) for here in kinds)


def sign_of_arm(signs: Sequence[Sign]) -> Sign:
    """Return the most frequent sign of the entrances of an arm, on a tie the sign nearest to the kerb; NONE without entrances."""
    return max(signs, key=lambda sign: (signs.count(sign), -signs.index(sign)), default=Sign.NONE)


def control_of(signs: Iterable[Sign]) -> JunctionControl:
    """Return the control of a junction from the signs of its entrances."""
    found = set(signs)
    for sign, control in ((Sign.STOP, JunctionControl.STOP), (Sign.LIGHTS, JunctionControl.LIGHTS)):
        if found == {sign}:
            return control
    if found & {Sign.STOP, Sign.LIGHTS}:
        return JunctionControl.PARTIAL
    return JunctionControl.YIELD if found & {Sign.YIELD, Sign.PRIORITY} else JunctionControl.NONE


def setback_of(objects: Iterable[MapObject]) -> float:
    """Return the distance of the stopping line before the vertex [m]: that of the nearest marked line, 0 without a marked line.

    A sign is no line: without a marked line, vehicles stop before they enter (California Vehicle Code 22450(a), Uniform Vehicle
    Code 11-403).
    """
    return min((item.setback for item in objects if item.kind is ObjectKind.LINE and item.setback is not None), default=0.0)


def sign_setback_of(objects: Sequence[MapObject]) -> float | None:
    """Return the distance of the nearest stop sign before the vertex, where it does not stand at the stopping line [m]."""
    signs = [item.setback for item in objects if item.kind is ObjectKind.STOP and item.setback is not None]
    return min(signs) if signs and abs(min(signs) - setback_of(objects)) > _AT_LINE else None


def phase_groups(
    arms: Sequence[int],
    opposite: frozenset[tuple[int, int]],
    controllers: Iterable[frozenset[int]] = (),
    protected: Container[int] = (),
) -> tuple[frozenset[int], ...]:
    """Return the entrances that have green together, the group with the lowest number first.

    Args:
        arms: the arm of every entrance with a light.
        opposite: pairs of entrances facing each other.
        controllers: entrances per controller; they count only where each one's are pairwise opposite or of one arm, they cover
            every entrance once, and they say more than "one controller per signal".
        protected: entrances with an arrow for a turn across oncoming traffic, which therefore don't have green with it.
    """
    given = [group for group in controllers if group]
    fits = all(arms[a] == arms[b] or (a, b) in opposite for group in given for a in group for b in group)
    covers = sorted(e for group in given for e in group) == list(range(len(arms)))
    if not (fits and covers and any(len(group) > 1 for group in given)):
        given = [frozenset([entrance]) for entrance in range(len(arms))]
        for a, b in (*sorted(opposite), *((a, b) for a, b in combinations(range(len(arms)), 2) if arms[a] == arms[b])):
            apart = [group for group in given if not group & {a, b}]
            given = [*apart, frozenset().union(*(group for group in given if group & {a, b}))]
        arrows = frozenset(e for e in range(len(arms)) if e in protected)
        given = [part for group in given for part in (group - arrows, group & arrows) if part]
    return tuple(sorted(given, key=min))
