"""Abstract scenarios and their structural equivalence classes (paper, sections 5.1 and 5.2).

An abstract scenario of a junction is a tuple of symbolic directions: entry i is the direction of the vehicle at entrance i, 0 for
an entrance without a vehicle. Rotating a junction onto itself gives an equivalent scenario. With one entrance per arm, all
movements and equal signs, the classes of full scenarios are the necklaces of length n over n - 1 directions. Classes are numbered
from 1 in the order of their representatives, the lexicographically least rotations; partial scenarios have number 0. See
`Orbits`. The functions here that take a number of ways are about the junctions of the paper.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate
from operator import index

from pytest_rvads.scenarios.orbits import WAYS, Directions, Orbits, rotate
from pytest_rvads.support.errors import ScenarioError

__all__ = [
    "WAYS",
    "Directions",
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

_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"


def parse(directions: str | Sequence[int]) -> Directions:
    """Read directions from a string such as ``"1133"``, or ``"13_2_0_31"`` for arms with several lanes, or from integers.

    Raises:
        ScenarioError: `directions` is neither, or has no vehicle.
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
        lanes: number of entrances per arm. If an arm has several entrances, ``_`` separates the arms.
    """
    digits = "".join(_DIGITS[d] for d in code)
    if max(lanes, default=1) <= 1:
        return digits
    ends = accumulate(lanes)
    return "_".join(digits[end - count : end] for end, count in zip(ends, lanes, strict=True) if count)


def rotations(code: Directions) -> tuple[Directions, ...]:
    """Return the n rotations of a scenario, row 0 first; a symmetric scenario has equal rotations."""
    return Orbits.plain(len(code)).turns(code)


def representative(code: Directions) -> Directions:
    """Return the lexicographically least rotation."""
    return Orbits.plain(len(code)).representative(code)


def members(code: Directions) -> tuple[Directions, ...]:
    """Return the distinct members of the class of `code`, in the order of the rows from `code` on."""
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
    """Yield the representatives in order, class 1 first."""
    return iter(Orbits.plain(ways))


def class_number(code: Directions) -> int:
    """Return the number of the class of `code`, 1 for all-ones; 0 for a partial scenario."""
    return Orbits.plain(len(code)).number(code)
