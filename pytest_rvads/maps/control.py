"""What regulates a junction: stop signs, lights and stop lines on lanes, the kind of control they make up, green phases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

__all__ = ["JunctionControl", "MapObject", "ObjectKind", "Sign", "control_of", "phase_groups", "setback_of", "signs_of"]


class JunctionControl(StrEnum):
    """What regulates a junction: the same object at all entrances, at none, or only at some."""

    STOP = "stop"
    LIGHTS = "lights"
    NONE = "none"
    PARTIAL = "partial"


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
    LIGHT = "light"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class MapObject:
    """A stop sign, light or stop line with its position on the metric graph."""

    id: str
    kind: ObjectKind
    junction: str
    edge: str
    """The edge of the entrance it is for."""
    station: float
    """Along that edge; at its end where the object stands in or beyond the junction [m]."""
    setback: float | None
    """Distance of a stop line or stop sign before the entrance vertex, None where it is too far away and for lights [m]."""


def signs_of(controlled: Sequence[set[ObjectKind]]) -> tuple[Sign, ...]:
    """Return what regulates each entrance, from the kinds of objects there; what all have counts, else a light before a sign."""
    regulating = {ObjectKind.LIGHT: Sign.LIGHTS, ObjectKind.STOP: Sign.STOP}
    common = set(regulating).intersection(*controlled)
    kinds = ((here & common) or here for here in controlled)
    return tuple(next((sign for kind, sign in regulating.items() if kind in here), Sign.NONE) for here in kinds)


def control_of(signs: Iterable[Sign]) -> JunctionControl:
    """Return what regulates a junction as a whole, from what regulates its entrances."""
    found = set(signs)
    for sign, control in ((Sign.STOP, JunctionControl.STOP), (Sign.LIGHTS, JunctionControl.LIGHTS)):
        if found == {sign}:
            return control
    return JunctionControl.PARTIAL if found & {Sign.STOP, Sign.LIGHTS} else JunctionControl.NONE


def setback_of(objects: Iterable[MapObject]) -> float:
    """Return the distance of the stopping line before the vertex [m]: the nearest stop line, else stop sign, else 0."""
    back = [((item.kind is not ObjectKind.LINE), item.setback) for item in objects if item.setback is not None]
    return min(back, default=(True, 0.0))[1]


def phase_groups(
    ways: int, opposite: frozenset[tuple[int, int]], controllers: Iterable[frozenset[int]] = ()
) -> tuple[frozenset[int], ...]:
    """Return the entrances that have green together, the group of entrance 0 first.

    Args:
        ways: number of entrances.
        opposite: pairs of entrances facing each other.
        controllers: entrances per controller; they count only where each one's are pairwise opposite, they cover
            every entrance once, and they say more than "one controller per signal".
    """
    given = [group for group in controllers if group]
    fits = all((a, b) in opposite for group in given for a in group for b in group if a != b)
    covers = sorted(e for group in given for e in group) == list(range(ways))
    if not (fits and covers and any(len(group) > 1 for group in given)):
        given = [frozenset([entrance]) for entrance in range(ways)]
        for a, b in sorted(opposite):
            apart = [group for group in given if not group & {a, b}]
            given = [*apart, frozenset().union(*(group for group in given if group & {a, b}))]
    return tuple(sorted(given, key=min))
