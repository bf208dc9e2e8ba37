"""Stratified samples: a sample is spread evenly over groups, and is the same in every process.

A sample depends only on the names of the things and the seed. Runs outside of a sample are not planned, and reports state their
number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from hashlib import sha256
from heapq import heappush, heappushpop
from typing import TypeVar

from pytest_rvads.support.errors import RvadsError

T = TypeVar("T")
_Path = tuple[str, ...]


def draw(things: Iterable[T], size: int, seed: int, stratum: Callable[[T], tuple[str, ...]], name: Callable[[T], str]) -> list[T]:
    """Return a sample of `size` things in their order, or all things if there are no more than `size`.

    The size is divided over the outermost groups, the share of a group over the groups within it, and so on. Groups within the
    same group get equal shares, up to a difference of one; a group smaller than its share is taken as a whole. The SHA-256 of
    seed and name decides which group gets one thing more and which things are drawn, so the sample does not depend on the order
    of the things or on the process. Memory grows with the number of strata (innermost groups) and the size, not with the number
    of things.
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
    # Per stratum, a heap of the things drawn so far. Ranks are negative, so the next thing to drop is at the top of the heap.
    drawn: dict[_Path, list[tuple[int, int, T]]] = {}
    for place, thing in enumerate(things):
        path = stratum(thing)
        if share := shares.get(path):
            heap = drawn.setdefault(path, [])
            (heappush if len(heap) < share else heappushpop)(heap, (-_rank(seed, name(thing)), place, thing))
    sample = {place: thing for heap in drawn.values() for _, place, thing in heap}
    return [sample[place] for place in sorted(sample)]


def _share(counts: Mapping[_Path, int], group: _Path, size: int, seed: int, shares: dict[_Path, int]) -> None:
    """Divide `size` over the groups within a group, and put the shares of its innermost groups (strata) into `shares`."""
    if group in counts:
        shares[group] = size
        return
    parts: dict[_Path, dict[_Path, int]] = {}
    for path, count in counts.items():
        parts.setdefault(path[: len(group) + 1], {})[path] = count
    most = {part: sum(inside.values()) for part, inside in parts.items()}
    groups = sorted(most, key=lambda part: _rank(seed, repr(part)))
    # The groups get equal shares, at most their numbers of things; the first groups get the remainder.
    while groups:
        each, remainder = divmod(size, len(groups))
        split = {group: most[group] for group in groups if most[group] <= each}
        if not split:
            split = {group: each + (k < remainder) for k, group in enumerate(groups)}
        for group, share in split.items():
            if share:
                _share(parts[group], group, share, seed, shares)
        size -= sum(split.values())
        groups = [group for group in groups if group not in split]


def _rank(seed: int, name: str) -> int:
    return int.from_bytes(sha256(f"{seed} {name}".encode("utf-8", "surrogatepass")).digest())
