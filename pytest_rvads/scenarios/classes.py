"""Abstract scenarios: their structural equivalence classes (paper, sections 5.1 and 5.2), and sets that cover pairs of movements.

An abstract scenario of a junction is a tuple of symbolic directions: entry i is the direction of the vehicle at entrance i, 0 for
an entrance without a vehicle. A scenario is full if every arm (or every lane) has a vehicle, and partial if not. Rotating a
junction onto itself gives an equivalent scenario. With one entrance per arm, all movements and equal signs, the classes of full
scenarios are the necklaces of length n over n - 1 directions. Classes are numbered from 1 in the order of their representatives,
the lexicographically least rotations; partial scenarios have number 0. See `Orbits`. The functions of this module with an
argument `ways`, the number of arms, are about the junctions of the paper.

The number of classes grows like the product of the numbers of directions at all entrances. A covering array is a list of
scenarios in which every pair of movements occurs; the length of such a list is only logarithmic in the number of entrances. The
scenarios of a covering array are chosen one after the other. Each scenario contains the first pair that is still missing. The
remaining movements of the scenario are chosen so that each movement adds as many missing pairs as possible.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import accumulate, combinations, combinations_with_replacement, product
from operator import index

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.scenarios.orbits import Directions, Orbits
from pytest_rvads.support.errors import ScenarioError

_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"

PAIRED = ("pairs", "conflicts")
"""Names of the covers by pairs: all pairs of movements from different entrances, and the pairs that cross or merge."""

Pair = tuple[Key, Key]
"""Two movements; the movement from the entrance with the lower number is first."""
_Choice = tuple[int, int]
"""Number of a slot (an arm or lane), and number of a direction among the possible directions in the slot."""


def parse(directions: str | Sequence[int]) -> Directions:
    """Read directions from a string such as ``"1133"``, or ``"13_2_0_31"`` for arms with several lanes, or from integers."""
    digits: object = directions
    if isinstance(directions, str):
        plain = directions.replace("_", "")
        digits = [_DIGITS.index(d) for d in plain] if plain and set(plain) <= set(_DIGITS) else None
    try:
        code = tuple(map(index, digits))  # type: ignore[call-overload]
    except TypeError as refused:
        message = f"directions must be digits, one per entrance, such as '1133', got {directions!r}"
        raise ScenarioError(message) from refused
    if not all(0 <= d < len(_DIGITS) for d in code):
        raise ScenarioError(f"a direction is a number from 1 to {len(_DIGITS) - 1}, or 0 for nobody, got {directions!r}")
    if not any(code):
        raise ScenarioError(f"a scenario needs at least one vehicle, got {directions!r}")
    return code


def label(code: Directions, lanes: Sequence[int] = ()) -> str:
    """Return the directions as a string of digits."""
    digits = "".join(_DIGITS[d] for d in code)
    if max(lanes, default=1) <= 1:
        return digits
    ends = accumulate(lanes)
    return "_".join(digits[end - count : end] for end, count in zip(ends, lanes, strict=True) if count)


def rotations(code: Directions) -> tuple[Directions, ...]:
    """Return the rotations of a scenario by 0, 1, ... arms; rotations of a symmetric scenario can be equal."""
    return Orbits.plain(len(code)).turns(code)


def representative(code: Directions) -> Directions:
    """Return the lexicographically least rotation of a scenario."""
    return Orbits.plain(len(code)).representative(code)


def members(code: Directions) -> tuple[Directions, ...]:
    """Return the distinct scenarios in the class of `code`, beginning with `code` and in the order of rotation."""
    return Orbits.plain(len(code)).members(code)


def seats(code: Directions) -> tuple[int, ...]:
    """Return the occupied entrances of `code` that no symmetry of `code` maps to an earlier entrance, see `Orbits.seats`."""
    return Orbits.plain(len(code)).seats(code)


def count_scenarios(ways: int) -> int:
    """Return the number of full abstract scenarios, k^(k+1) with k = ways - 1 (paper, section 5.2)."""
    return Orbits.plain(ways).scenarios


def count_classes(ways: int) -> int:
    """Return the number of classes of full scenarios."""
    return Orbits.plain(ways).count


def classes(ways: int) -> Iterator[Directions]:
    """Yield the representative (lexicographically least scenario) of every class, class 1 first."""
    return iter(Orbits.plain(ways))


def pairs_at(place: Junction, *, conflicting: bool = False) -> tuple[Pair, ...]:
    """Return the pairs of movements from different entrances, in order, or only the pairs that conflict."""
    if conflicting and place.conflicts is None:
        raise ScenarioError(f"the conflicts of junction {place.name!r} are not known, since it is not known where its lanes lie")
    pairs = combinations(sorted(place.movements), 2)
    return tuple(pair for pair in pairs if pair[0][0] != pair[1][0] and (not conflicting or pair in (place.conflicts or ())))


def covering(
    place: Junction, orbits: Orbits, seat: int | None = None, *, conflicting: bool = False, walked: bool = False
) -> tuple[Directions, ...]:
    """Return a list of scenarios in which every possible pair of movements occurs, all with a vehicle at entrance `seat`, if any.

    Movements on which no car can keep its lane (`Junction.tight`) are left out. An arm or lane with only such movements has no
    vehicle.
    """
    required = frozenset(pairs_at(place, conflicting=conflicting))
    slots = _placed(place, orbits, seat)
    moves = [[key for _, key in slot] for slot in slots]
    missing: dict[tuple[_Choice, _Choice], None] = {}
    for i, j in combinations(range(len(moves)), 2):
        for (rank, key), (later_rank, later_key) in product(enumerate(moves[i]), enumerate(moves[j])):
            if (key, later_key) in required:
                missing[(i, rank), (j, later_rank)] = None
    if walked:  # a movement is missing as a pair with itself
        over = {key for _, key in place.covers if seat in (None, key[0])}
        single = [(slot, rank) for slot, keys in enumerate(moves) for rank, key in enumerate(keys) if key in over]
        missing |= dict.fromkeys(zip(single, single, strict=True))
    if not missing:
        kind = "conflicting movements" if conflicting else "movements"
        but = f" without the {len(place.tight)} on which no car can keep its lane" if place.tight else ""
        raise ScenarioError(f"no two {kind} of junction {place.name!r} happen in one scenario{but}: choose another cover")
    rows = []
    while missing:
        row = _row(list(map(len, moves)), missing)
        for pair in combinations_with_replacement(enumerate(row), 2):
            missing.pop(pair, None)
        chosen = (slot[rank] for slot, rank in zip(slots, row, strict=True))
        rows.append(tuple(direction for letter, _ in chosen for direction in letter))
    return tuple(rows)


def _placed(place: Junction, orbits: Orbits, seat: int | None) -> list[list[tuple[Directions, Key | None]]]:
    """Return, per slot (arm or lane), the possible directions at its entrances, with the movement of the only vehicle, if any.

    Movements on which no car can keep its lane are left out. If `seat` is an entrance, all directions in its slot place a vehicle
    at this entrance.
    """
    slots = []
    first = 0
    for letters in orbits.slots:
        lanes = len(letters[0])
        slot: list[tuple[Directions, Key | None]] = []
        for letter in letters:
            key = next((place.leads(first + k, direction).key for k, direction in enumerate(letter) if direction), None)
            if key not in place.tight:
                slot.append((letter, key))
        if not slot:  # a slot without remaining movements has no vehicle
            slot = [((0,) * lanes, None)]
        if seat is not None and first <= seat < first + lanes:
            slot = [(letter, key) for letter, key in slot if letter[seat - first]]
        if not slot:
            raise ScenarioError(
                f"no movement on which a car can keep its lane leads from entrance {seat}, so no vehicle under test can stand "
                "there: choose another one"
            )
        slots.append(slot)
        first += lanes
    return slots


def _row(sizes: Sequence[int], missing: Collection[tuple[_Choice, _Choice]]) -> list[int]:
    """Return a scenario with the first missing pair, and in the other slots the directions that add most missing pairs.

    The scenario is given per slot (arm or lane), by the number of a direction among the possible directions in the slot.
    """
    row = dict(next(iter(missing)))

    def gain(choice: _Choice) -> tuple[int, int, int]:
        pairs = ((choice, chosen) if choice < chosen else (chosen, choice) for chosen in row.items())
        return sum(pair in missing for pair in pairs), -choice[0], -choice[1]

    while len(row) < len(sizes):
        free = ((slot, rank) for slot, size in enumerate(sizes) if slot not in row for rank in range(size))
        slot, rank = max(free, key=gain)
        row[slot] = rank
    return [row[slot] for slot in range(len(sizes))]
