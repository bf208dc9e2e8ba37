"""Samples: some of many things, spread evenly over the groups they belong to, and the same ones in every process.

A draw depends on names and seed alone. Runs that are not drawn are not planned, and reports say how many they are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from hashlib import sha256
from heapq import heappush, heappushpop
from typing import TypeVar

from pytest_rvads.errors import RvadsError

__all__ = ["draw"]

T = TypeVar("T")
_Path = tuple[str, ...]


def draw(things: Iterable[T], size: int, seed: int, stratum: Callable[[T], tuple[str, ...]], name: Callable[[T], str]) -> list[T]:
    """Return `size` of the things, all where there are no more, in their order.

    The size is shared over the groups named first in the strata, each share over the groups within, and so on: groups of one
    group get equally many, give or take one, but those that have fewer. Who gets one more, and who is drawn, is decided by the
    SHA-256 of seed and name, so that it hangs neither on the order of the things nor on the process. What is in memory grows
    with the strata and the size, not with the things.

    Args:
        things: what there is; gone through twice.
        size: how many, 1 or more.
        seed: other seeds draw others.
        stratum: gives the names of the groups of a thing, the outermost first; equally many of each thing.
        name: gives the name of a thing, which no other one has.

    Raises:
        RvadsError: a size below 1, or things that can be gone through only once.
    """
    if size < 1:
        raise RvadsError(f"a sample has a size of 1 or more, got {size!r}")
    if iter(things) is things:
        raise RvadsError(f"a sample is drawn from what can be gone through twice, got {things!r:.60}: make a list of it")
    counts = Counter(map(stratum, things))
    if size >= counts.total():
        return list(things)
    shares: dict[_Path, int] = {}
    _share(counts, (), size, seed, shares)
    # Per stratum a heap of those drawn so far, the one to go next at its top; ranks are negative for that.
    drawn: dict[_Path, list[tuple[int, int, T]]] = {}
    for place, thing in enumerate(things):
        path = stratum(thing)
        if share := shares.get(path):
            kept = drawn.setdefault(path, [])
            (heappush if len(kept) < share else heappushpop)(kept, (-_rank(seed, name(thing)), place, thing))
    return [thing for _, thing in sorted(((place, thing) for kept in drawn.values() for _, place, thing in kept), key=_place)]


def _place(found: tuple[int, object]) -> int:
    return found[0]


def _share(counts: Mapping[_Path, int], group: _Path, size: int, seed: int, shares: dict[_Path, int]) -> None:
    """Share `size` over what is in a group, and put the shares of its strata into `shares`."""
    if group in counts:
        shares[group] = size
        return
    parts: dict[_Path, dict[_Path, int]] = {}
    for path, count in counts.items():
        parts.setdefault(path[: len(group) + 1], {})[path] = count
    most = {part: sum(inside.values()) for part, inside in parts.items()}
    for part, share in _even(most, size, sorted(most, key=lambda part: _rank(seed, repr(part)))).items():
        if share:
            _share(parts[part], part, share, seed, shares)


def _even(most: Mapping[_Path, int], size: int, order: Sequence[_Path]) -> dict[_Path, int]:
    """Return how many each group gets, where none can get more than it has; the first in order get what remains."""
    given: dict[_Path, int] = {}
    rest = list(order)
    while rest:
        each, over = divmod(size, len(rest))
        scarce = {group for group in rest if most[group] <= each}
        if not scarce:
            return given | {group: each + (k < over) for k, group in enumerate(rest)}
        given |= {group: most[group] for group in scarce}
        size -= sum(most[group] for group in scarce)
        rest = [group for group in rest if group not in scarce]
    return given


def _rank(seed: int, name: str) -> int:
    return int.from_bytes(sha256(f"{seed} {name}".encode("utf-8", "surrogatepass")).digest())
