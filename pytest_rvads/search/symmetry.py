"""Which rotations and reflections of a junction change nothing that rules can see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from pytest_rvads.junctions.junction import Junction

__all__ = ["Symmetry", "broken_by", "rotations_of"]


@dataclass(frozen=True, slots=True)
class Symmetry:
    """A rotation of a junction onto itself."""

    rows: int
    """Every entrance moves on by this many."""
    swaps: bool
    """Phase groups change places, so the other one has to be green first."""


@lru_cache(maxsize=64)
def rotations_of(junction: Junction) -> tuple[Symmetry, ...]:
    """Return the rotations that preserve right-of, opposite, turns and, as a set, the phase groups; identity first.

    All four in an X, none but the identity in a T.
    """
    found = []
    for rows in range(junction.ways):
        if not broken_by(junction, rows):
            moved = frozenset((e + rows) % junction.ways for e in junction.phase_groups[0]) if junction.phase_groups else None
            found.append(Symmetry(rows, moved is not None and moved != junction.phase_groups[0]))
    return tuple(found)


def broken_by(junction: Junction, rows: int) -> tuple[str, ...]:
    """Return what a rotation by `rows` entrances changes; empty for a symmetry."""

    def turned(entrance: int) -> int:
        return (entrance + rows) % junction.ways

    return _changed(junction, turned)


def _changed(junction: Junction, image: Callable[[int], int]) -> tuple[str, ...]:
    def pairs(relation: frozenset[tuple[int, int]]) -> frozenset[tuple[int, int]]:
        return frozenset((image(a), image(b)) for a, b in relation)

    changed = []
    if pairs(junction.right_of) != junction.right_of:
        changed.append("right-of")
    if pairs(junction.opposite) != junction.opposite:
        changed.append("opposite")
    turns = {key: m.turn for key, m in junction.movements.items()}
    if {(image(a), image(b)): turn for (a, b), turn in turns.items()} != turns:
        changed.append("turns")
    groups = frozenset(junction.phase_groups)
    if frozenset(frozenset(image(e) for e in group) for group in groups) != groups:
        changed.append("light groups")
    return tuple(changed)
