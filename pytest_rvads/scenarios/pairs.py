"""Pairs of movements: the pairs of a junction, and a few scenarios that contain all pairs.

The number of classes is a product over the entrances. A covering array instead has every pair in some row, and its number of rows
is logarithmic in the number of entrances. The scenarios are chosen in succession, each with as many new pairs as are compatible
with the first missing pair.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import combinations, product

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.orbits import Directions, Orbits
from pytest_rvads.support.errors import ScenarioError

__all__ = ["PAIRED", "Pair", "covering", "pairs_at", "pairs_in"]

PAIRED = ("pairs", "conflicts")
"""Covers by pairs: every pair of movements from different entrances, or the pairs that cross or merge."""

Pair = tuple[Key, Key]
"""Two movements; the movement from the entrance with the lower number is first."""
_Choice = tuple[int, int]
"""A slot and the rank of a letter in the slot."""


def pairs_at(place: Junction, *, conflicting: bool = False) -> tuple[Pair, ...]:
    """Return the pairs of movements from different entrances, in order, or only the pairs that conflict.

    Raises:
        ScenarioError: conflicting pairs are requested, and the places of the lanes are unknown.
    """
    if conflicting and place.conflicts is None:
        raise ScenarioError(f"the conflicts of junction {place.name!r} are not known, since it is not known where its lanes lie")
    pairs = combinations(sorted(place.movements), 2)
    return tuple(pair for pair in pairs if pair[0][0] != pair[1][0] and (not conflicting or pair in (place.conflicts or ())))


def pairs_in(place: Junction, code: Directions) -> Iterator[Pair]:
    """Yield the pairs of movements of an abstract scenario."""
    keys = sorted(place.leads(entrance, direction).key for entrance, direction in enumerate(code) if direction)
    yield from combinations(keys, 2)


def covering(place: Junction, orbits: Orbits, seat: int | None = None, *, conflicting: bool = False) -> tuple[Directions, ...]:
    """Return scenarios that contain every pair of movements that occurs in a scenario.

    Movements on which no car can keep its lane (`Junction.tight`) are left out; a slot without other movements is empty.

    Args:
        place: the junction.
        orbits: the scenarios of the junction.
        seat: an entrance with a vehicle in all returned scenarios; None for no such entrance.
        conflicting: whether to cover only pairs of conflicting movements; the remaining movements are chosen for as many of these
            pairs as possible.

    Raises:
        ScenarioError: no such pair is possible, or conflicting pairs are requested and the conflicts are unknown.
    """
    required = frozenset(pairs_at(place, conflicting=conflicting))
    slots = _placed(place, orbits, seat)
    moves = [[_movement(place, first, letter) for letter in letters] for first, letters in slots]
    missing = dict.fromkeys(pair for pair in _choices(moves) if _pair_of(moves, *pair) in required)
    if not missing:
        kind = "conflicting movements" if conflicting else "movements"
        but = f" without the {len(place.tight)} on which no car can keep its lane" if place.tight else ""
        raise ScenarioError(f"no two {kind} of junction {place.name!r} happen in one scenario{but}: choose another cover")
    rows = []
    while missing:
        row = _row(list(map(len, moves)), missing)
        for pair in combinations(enumerate(row), 2):
            missing.pop(pair, None)
        chosen = [letters[rank] for (_, letters), rank in zip(slots, row, strict=True)]
        rows.append(tuple(direction for letter in chosen for direction in letter))
    return tuple(rows)


def _placed(place: Junction, orbits: Orbits, seat: int | None) -> list[tuple[int, Sequence[Directions]]]:
    """Return, per slot, its first entrance and its letters without tight movements; at the seat, only letters with a vehicle."""
    slots: list[tuple[int, Sequence[Directions]]] = []
    first = 0
    for every in orbits.slots:
        # A slot without remaining movements has no vehicle.
        letters = [c for c in every if _movement(place, first, c) not in place.tight] or [(0,) * len(every[0])]
        lane = None if seat is None else seat - first
        inside = lane is not None and 0 <= lane < len(letters[0])
        with_vehicle = [letter for letter in letters if letter[lane or 0]] if inside else letters
        if not with_vehicle:
            raise ScenarioError(
                f"no movement on which a car can keep its lane leads from entrance {seat}, so no vehicle under test can stand "
                "there: choose another one"
            )
        slots.append((first, with_vehicle))
        first += len(letters[0])
    return slots


def _movement(place: Junction, first: int, letter: Directions) -> Key | None:
    """Return the movement of a letter, which has one vehicle; None for a letter without a vehicle."""
    return next((place.leads(first + k, direction).key for k, direction in enumerate(letter) if direction), None)


def _choices(moves: Sequence[Sequence[object]]) -> Iterator[tuple[_Choice, _Choice]]:
    for i, j in combinations(range(len(moves)), 2):
        yield from product(((i, rank) for rank in range(len(moves[i]))), [(j, rank) for rank in range(len(moves[j]))])


def _pair_of(moves: Sequence[Sequence[Key | None]], choice: _Choice, later: _Choice) -> Pair | None:
    """Return the movements of two letters of different slots, in the order of the slots and so of the entrances."""
    first, second = moves[choice[0]][choice[1]], moves[later[0]][later[1]]
    return None if first is None or second is None else (first, second)


def _row(sizes: Sequence[int], missing: Collection[tuple[_Choice, _Choice]]) -> list[int]:
    """Return the ranks of the letters of one scenario: of the first missing pair, then of letters with most new pairs.

    Args:
        sizes: number of letters per slot.
        missing: the missing pairs, in the order of the search.
    """
    row = dict(next(iter(missing)))
    while len(row) < len(sizes):
        best = max(
            ((slot, rank) for slot, size in enumerate(sizes) if slot not in row for rank in range(size)),
            key=lambda choice: (_new_pairs(choice, row.items(), missing), -choice[0], -choice[1]),
        )
        row[best[0]] = best[1]
    return [row[slot] for slot in range(len(sizes))]


def _new_pairs(choice: _Choice, chosen: Iterable[_Choice], missing: Collection[tuple[_Choice, _Choice]]) -> int:
    """Return the number of missing pairs that a choice adds to the chosen letters."""
    return sum(((choice, letter) if choice < letter else (letter, choice)) in missing for letter in chosen)
