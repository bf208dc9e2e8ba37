"""Abstract scenarios and their structural equivalence classes (paper, sections 5.1 and 5.2).

An abstract scenario of an n-way junction is a tuple of n symbolic directions: entry i is the direction 1..n-1
of the vehicle at entrance i, 0 where nobody stands. Rotating the entrances gives an equivalent scenario, so
the classes of full scenarios are the necklaces of length n over n - 1 directions. Classes are numbered from 1
in the order of their representatives, the lexicographically least rotations; partial scenarios have number 0.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import accumulate
from math import gcd
from operator import index
from typing import TypeVar

from pytest_rvads.errors import ScenarioError

__all__ = [
    "WAYS",
    "Directions",
    "class_label",
    "class_number",
    "classes",
    "count_classes",
    "count_scenarios",
    "label",
    "members",
    "parse",
    "representative",
    "rotate",
    "rotations",
    "seats",
]

T = TypeVar("T")
Directions = tuple[int, ...]
_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
WAYS = range(3, 9)
"""Arities the method is defined for here."""


def parse(directions: str | Sequence[int]) -> Directions:
    """Read directions from a string such as ``"1133"``, or ``"13_2_0_31"`` where arms have several lanes, or from integers.

    Raises:
        ScenarioError: something else, or no vehicle at all.
    """
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
    """Return the directions as a string of digits.

    Args:
        code: the directions.
        lanes: per arm, how many entrances it has; where one has several, arms are parted by ``_``.
    """
    digits = "".join(_DIGITS[d] for d in code)
    if max(lanes, default=1) <= 1:
        return digits
    ends = accumulate(lanes)
    return "_".join(digits[end - count : end] for end, count in zip(ends, lanes, strict=True) if count)


def rotate(code: tuple[T, ...], rows: int) -> tuple[T, ...]:
    """Move every vehicle `rows` entrances on, keeping its symbolic direction; or whatever else is given per entrance."""
    rows %= len(code)
    return code[-rows:] + code[:-rows] if rows else code


def rotations(code: Directions) -> tuple[Directions, ...]:
    """Return the n rotations of a scenario, row 0 first; some coincide when it is symmetric."""
    return tuple(rotate(code, r) for r in range(len(code)))


def representative(code: Directions) -> Directions:
    """Return the lexicographically least rotation."""
    return min(rotations(code))


def members(code: Directions) -> tuple[Directions, ...]:
    """Return the distinct members of the class of `code`, in the order of the rows from `code` on."""
    return tuple(dict.fromkeys(rotations(code)))


def seats(code: Directions) -> tuple[int, ...]:
    """Return the occupied entrances of `code` that no symmetry of it takes to an earlier one.

    A vehicle under test among traffic breaks the symmetry of rotation: over all classes these seats are as many as there
    are scenarios, 81 at four ways and 8 at three.
    """
    return tuple(seat for seat in range(len(members(code))) if code[seat])


def count_scenarios(ways: int) -> int:
    """Return the number of full abstract scenarios, k^(k+1) with k = ways - 1 (paper, section 5.2)."""
    _check(ways)
    return int((ways - 1) ** ways)


def count_classes(ways: int) -> int:
    """Return the number of classes of full scenarios, by Burnside's lemma over the n rotations."""
    _check(ways)
    return sum(int((ways - 1) ** gcd(r, ways)) for r in range(ways)) // ways


def classes(ways: int) -> Iterator[Directions]:
    """Yield the representatives in order, class 1 first.

    This is the algorithm of Fredricksen, Kessler and Maiorana for necklaces in lexicographic order; memory
    does not grow with the number of classes.
    """
    _check(ways)
    top = ways - 1
    word = [1] * (ways + 1)
    yield tuple(word[1:])
    while True:
        i = ways
        while i and word[i] == top:
            i -= 1
        if not i:
            return
        word[i] += 1
        for j in range(i + 1, ways + 1):
            word[j] = word[j - i]
        if ways % i == 0:
            yield tuple(word[1:])


@lru_cache(maxsize=4096)
def class_number(code: Directions) -> int:
    """Return the number of the class of `code`, 1 for all-ones; 0 for a partial scenario."""
    if 0 in code:
        return 0
    return bisect_left(_ranks(len(code)), _value(representative(code))) + 1


@lru_cache(maxsize=4096)
def class_label(ways: int, number: int) -> str:
    """Return ``class07``: the number padded to the width of the count of classes, at least two digits."""
    return f"class{number:0{max(2, len(str(count_classes(ways))))}d}"


@lru_cache
def _ranks(ways: int) -> array[int]:
    return array("q", map(_value, classes(ways)))


def _value(code: Directions) -> int:
    value = 0
    for direction in code:
        value = value * len(code) + direction
    return value


def _check(ways: int) -> None:
    if ways not in WAYS:
        raise ScenarioError(f"the number of ways must be 3 to 8, got {ways!r}")
