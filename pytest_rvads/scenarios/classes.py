"""Abstract scenarios: their structural equivalence classes (paper, sections 5.1 and 5.2), and sets that cover pairs of movements.

An abstract scenario of a junction is a tuple of symbolic directions: entry i is the direction of the vehicle at entrance i, 0 for
an entrance without a vehicle. A scenario is full if every arm (or every lane) has a vehicle, and partial if not. Rotating a
junction onto itself gives an equivalent scenario. With one entrance per arm, all movements and equal signs, the classes of full
scenarios are the necklaces of length n over n - 1 directions. Classes are numbered from 1 in the order of their representatives,
the lexicographically least rotations; partial scenarios have number 0. The functions of this module with an argument `ways`, the
number of arms, are about the junctions of the paper.

`Orbits` counts and numbers classes without listing them. A scenario is a word with a letter per *slot* (arm or lane): the letter
is the direction of the vehicle in the slot. The rotations of a junction that keep lanes, movements and signs move letters by
multiples of a number of slots, a *block*. So a scenario is also a word with a letter per block, and the rotations of a scenario
form a necklace.

The number of classes grows like the product of the numbers of directions at all entrances. A covering array is a list of
scenarios in which every pair of movements occurs; the length of such a list is only logarithmic in the number of entrances. The
scenarios of a covering array are chosen one after the other. Each scenario contains the first pair that is still missing. The
remaining movements of the scenario are chosen so that each movement adds as many missing pairs as possible.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import accumulate, combinations, combinations_with_replacement, product
from math import gcd, prod
from operator import index
from typing import TypeVar

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.support.errors import ScenarioError

T = TypeVar("T")
Directions = tuple[int, ...]
WAYS = range(3, 9)
"""Numbers of arms for which the paper's method is defined here."""
OCCUPANCIES = ("arms", "lanes")
"""The occupied entrances of a full scenario: one entrance on each arm, or all entrances."""
_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
"""The digits of directions in texts."""
PAIRED = ("pairs", "conflicts")
"""Names of the covers by pairs: all pairs of movements from different entrances, and the pairs that cross or merge."""
Pair = tuple[Key, Key]
"""Two movements; the movement from the entrance with the lower number is first."""
_Pick = tuple[int, int]
"""Number of a slot (an arm or lane), and number of a direction among the possible directions in the slot."""


def rotate(code: tuple[T, ...], rows: int) -> tuple[T, ...]:
    """Return values per entrance, such as symbolic directions, moved on by `rows` entrances: value 0 comes to entrance `rows`."""
    rows %= len(code)
    return code[-rows:] + code[:-rows] if rows else code


@dataclass(frozen=True)
class Orbits:
    """The abstract scenarios of a junction, and their classes under its rotations."""

    slots: tuple[tuple[Directions, ...], ...]
    """Per slot (arm or lane), the possible directions at its entrances, in ascending order."""
    blocks: int
    """Number of rotations that keep lanes, movements and signs: each moves all vehicles by a multiple of one number of slots."""
    partial: bool = False
    """Whether scenarios with empty slots are included; a scenario without any vehicle never is."""

    @classmethod
    def plain(cls, ways: int, *, partial: bool = False) -> Orbits:
        """Return the scenarios of the paper: one entrance per arm, with movements to every other arm."""
        if ways not in WAYS:
            raise ScenarioError(f"the number of ways must be 3 to 8, got {ways!r}")
        return _plain(ways, partial)

    @classmethod
    def at(cls, place: Junction, occupancy: str = "arms", *, partial: bool = False) -> Orbits:
        """Return the abstract scenarios of a junction."""
        if occupancy not in OCCUPANCIES:
            raise ScenarioError(f"occupancy must be one of {', '.join(OCCUPANCIES)}, got {occupancy!r}")
        return _at(place, occupancy, partial)

    @cached_property
    def size(self) -> int:
        """Number of entrances."""
        return sum(len(letters[0]) for letters in self.slots)

    @cached_property
    def rows(self) -> range:
        """Numbers of entrances by which the rotations move vehicles, 0 first."""
        return range(0, self.size, self.size // self.blocks)

    @cached_property
    def scenarios(self) -> int:
        """Number of abstract scenarios."""
        return self._fixed(0) - self.partial

    @cached_property
    def count(self) -> int:
        """Number of classes, by Burnside's lemma over the rotations."""
        return sum(map(self._fixed, range(self.blocks))) // self.blocks - self.partial

    def seated(self, entrance: int) -> int:
        """Return the number of scenarios with a vehicle at `entrance`."""
        return int(self._fixed(0) * self._share(entrance))

    def turned(self, entrance: int) -> int:
        """Return how many rotations of all representatives have a vehicle at `entrance`; equal rotations count separately."""
        return int(sum(map(self._fixed, range(self.blocks))) * self._share(entrance))

    def __contains__(self, code: Directions) -> bool:
        """Return whether `code` is one of these abstract scenarios."""
        return len(code) == self.size and self._word(code) is not None and any(code)

    def __iter__(self) -> Iterator[Directions]:
        """Yield the representative (lexicographically least scenario) of every class, class 1 first.

        The algorithm of Fredricksen, Kessler and Maiorana yields necklaces in lexicographic order; the memory that it needs does
        not grow with the number of classes.
        """
        length, top, each = self.blocks, self._top, len(self.slots) // self.blocks
        word, i = [0] * (length + 1), 1
        while i:
            if length % i == 0 and (any(word) or not self.partial):  # with empty slots, the first word has no vehicle
                code: list[int] = []
                for letter in word[1:]:
                    chosen: list[Directions] = []
                    for letters in self.slots[each - 1 :: -1]:
                        letter, rank = divmod(letter, len(letters))
                        chosen.append(letters[rank])
                    code += [direction for letter_of_slot in reversed(chosen) for direction in letter_of_slot]
                yield tuple(code)
            i = length
            while i and word[i] == top:
                i -= 1
            if i:
                word[i] += 1
            for j in range(i + 1, length + 1):
                word[j] = word[j - i]

    def turns(self, code: Directions) -> tuple[Directions, ...]:
        """Return the rotations of a scenario, the scenario itself first; rotations of a symmetric scenario can be equal."""
        return tuple(rotate(code, row) for row in self.rows)

    def representative(self, code: Directions) -> Directions:
        """Return the lexicographically least rotation of a scenario."""
        return min(self.turns(code))

    def members(self, code: Directions) -> tuple[Directions, ...]:
        """Return the distinct scenarios in the class of `code`, beginning with `code` and in the order of rotation."""
        return tuple(dict.fromkeys(self.turns(code)))

    def seats(self, code: Directions) -> tuple[int, ...]:
        """Return the occupied entrances of `code` that no symmetry of `code` maps to an earlier entrance.

        A vehicle under test among traffic breaks the symmetry of rotation, so each returned entrance gives a different test. The
        number of returned entrances, over all classes of full scenarios of the paper, is the number of scenarios: 81 with four
        arms and 8 with three.
        """
        period = len(self.members(code)) * (self.size // self.blocks)
        return tuple(seat for seat in range(period) if code[seat])

    def number(self, code: Directions) -> int:
        """Return the number of the class of `code`, 1 for the first class; 0 if `code` is none of the scenarios.

        The method counts the words whose rotations are all lexicographically at least the representative. These words are the
        closed walks of an automaton whose state is the number of matched letters of the representative.
        """
        word = self._word(self.representative(code)) if code in self else None
        if word is None:
            return 0
        length = self.blocks
        # Length of the longest proper prefix of the word that is a suffix of the word as well.
        border = next(k for k in range(length - 1, -1, -1) if word[:k] == word[length - k :])
        step = [[0] * length for _ in range(length)]
        for state, letter in enumerate(word):
            step[state][state + 1 if state + 1 < length else border] += 1
            step[state][0] += self._top - letter
        powers, columns = [step], list(zip(*step, strict=True))
        for _ in range(length - 1):
            powers.append([[sum(a * b for a, b in zip(row, c, strict=True)) for c in columns] for row in powers[-1]])
        traces = [sum(power[k][k] for k in range(length)) for power in powers]
        not_smaller = sum(traces[gcd(r, length) - 1] for r in range(1, length + 1)) // length
        return self.count - not_smaller + 1

    def label(self, number: int) -> str:
        """Return ``class07``: the number padded to the width of the count of classes, at least two digits."""
        return f"class{number:0{max(2, len(str(self.count)))}d}"

    @cached_property
    def _top(self) -> int:
        """The greatest letter of a block, as a number from 0 on."""
        return prod(len(letters) for letters in self.slots[: len(self.slots) // self.blocks]) - 1

    def _fixed(self, turn: int) -> int:
        """Return the number of words that a rotation by `turn` blocks leaves unchanged."""
        return int((self._top + 1) ** gcd(turn, self.blocks))

    def _share(self, entrance: int) -> Fraction:
        """Return the share of all words, of any period, that have a vehicle at `entrance`."""
        first = 0
        for letters in self.slots:
            lane, first = entrance - first, first + len(letters[0])
            if entrance < first:
                return Fraction(sum(letter[lane] > 0 for letter in letters), len(letters))
        raise ScenarioError(f"entrances are numbered from 0 to {self.size - 1}, got {entrance!r}")

    def _word(self, code: Directions) -> tuple[int, ...] | None:
        """Return a scenario as a word, a letter per block of slots; None if a direction is not possible in its slot."""
        word, first, each = [0] * self.blocks, 0, len(self.slots) // self.blocks
        for number, letters in enumerate(self.slots):
            letter = code[first : first + len(letters[0])]
            if letter not in letters:
                return None
            word[number // each] = word[number // each] * len(letters) + letters.index(letter)
            first += len(letter)
        return tuple(word)


@lru_cache
def _plain(ways: int, partial: bool) -> Orbits:
    return Orbits((_letters([tuple(range(1, ways))], partial),) * ways, ways, partial)


@lru_cache(maxsize=256)
def _at(place: Junction, occupancy: str, partial: bool) -> Orbits:
    if not place.movements:
        raise ScenarioError(f"junction {place.name!r} has no movements, so nobody can be placed there: choose another one")
    lanes = [[place.directions(entrance) for entrance in arm.entrances] for arm in place.arms]
    if occupancy == "lanes":
        slots = [_letters([lane], partial) for arm in lanes for lane in arm]
    else:
        slots = [_letters(arm, partial) for arm in lanes]
    return Orbits(tuple(slots), len(place.rotations), partial)


def _letters(lanes: Sequence[Directions], partial: bool) -> tuple[Directions, ...]:
    """Return the possible directions at the lanes of an arm, in ascending order: at most one lane has a vehicle."""
    nobody = (0,) * len(lanes)
    occupied = [(*nobody[:k], direction, *nobody[k + 1 :]) for k, lane in enumerate(lanes) for direction in lane]
    return tuple(sorted(occupied if occupied and not partial else [nobody, *occupied]))


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
    missing: dict[tuple[_Pick, _Pick], None] = {}
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


def _row(sizes: Sequence[int], missing: Collection[tuple[_Pick, _Pick]]) -> list[int]:
    """Return a scenario with the first missing pair, and in the other slots the directions that add most missing pairs.

    The scenario is given per slot (arm or lane), by the number of a direction among the possible directions in the slot.
    """
    row = dict(next(iter(missing)))

    def gain(choice: _Pick) -> tuple[int, int, int]:
        pairs = ((choice, chosen) if choice < chosen else (chosen, choice) for chosen in row.items())
        return sum(pair in missing for pair in pairs), -choice[0], -choice[1]

    while len(row) < len(sizes):
        free = ((slot, rank) for slot, size in enumerate(sizes) if slot not in row for rank in range(size))
        slot, rank = max(free, key=gain)
        row[slot] = rank
    return [row[slot] for slot in range(len(sizes))]
