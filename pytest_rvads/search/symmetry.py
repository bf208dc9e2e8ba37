"""Which rotations of a junction change nothing that rules can see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pytest_rvads.junctions.junction import Junction

__all__ = ["Symmetry", "broken_by", "rotations_of"]


@dataclass(frozen=True, slots=True)
class Symmetry:
    """A rotation of a junction onto itself."""

    arms: int
    """Every arm moves on by this many."""
    rows: int
    """Every entrance moves on by this many."""


@lru_cache(maxsize=64)
def rotations_of(junction: Junction) -> tuple[Symmetry, ...]:
    """Return the rotations that preserve lanes, signs, right-of, opposite, turns and, as a set, the phase groups; identity first.

    All four in an X, none but the identity in a T.
    """
    found = []
    for arms in range(junction.ways):
        images = junction.image(arms)
        if images and not broken_by(junction, arms):
            found.append(Symmetry(arms, images[0][0]))
    return tuple(found)


def broken_by(junction: Junction, arms: int) -> tuple[str, ...]:
    """Return what a rotation by `arms` arms changes; empty for a symmetry."""
    images = junction.image(arms)
    if images is None:
        return ("lanes",)
    entrances, exits = images

    def pairs(relation: frozenset[tuple[int, int]]) -> frozenset[tuple[int, int]]:
        return frozenset((entrances[a], entrances[b]) for a, b in relation)

    changed = []
    if any(lane.sign is not junction.entrances[entrances[e]].sign for e, lane in enumerate(junction.entrances)):
        changed.append("signs")
    if pairs(junction.right_of) != junction.right_of:
        changed.append("right-of")
    if pairs(junction.opposite) != junction.opposite:
        changed.append("opposite")
    turns = {key: m.turn for key, m in junction.movements.items()}
    if {(entrances[a], exits[b]): turn for (a, b), turn in turns.items()} != turns:
        changed.append("turns")
    groups = frozenset(junction.phase_groups)
    if frozenset(frozenset(entrances[e] for e in group) for group in groups) != groups:
        changed.append("light groups")
    return tuple(changed)
