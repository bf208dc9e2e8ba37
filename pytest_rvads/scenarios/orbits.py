"""Orbits: abstract scenarios up to the rotations of their junction, counted and numbered without listing them.

A scenario is a word with a letter per *slot* (arm or lane): the letter is the direction of the vehicle in the slot. The rotations
of a junction that keep lanes, movements and signs move letters by multiples of a number of slots, a *block*. So a scenario is
also a word with a letter per block, and the rotations of a scenario form a necklace. Classes are numbered in the order of their
lexicographically least words.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import gcd, prod
from typing import TypeVar

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.support.errors import ScenarioError

T = TypeVar("T")
Directions = tuple[int, ...]
WAYS = range(3, 9)
"""Numbers of arms for which the paper's method is defined here."""
OCCUPANCIES = ("arms", "lanes")
"""The occupied entrances of a full scenario: one entrance on each arm, or all entrances."""


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
