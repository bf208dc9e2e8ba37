"""What was made last, kept as long as it may be asked for again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

__all__ = ["Lately"]

T = TypeVar("T")


class Lately(Generic[T]):
    """The last few things that were asked for, by what tells them apart.

    Args:
        most: how many are kept.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: dict[Hashable, T] = {}
        """What was asked for last is last."""

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the thing of a key, made if it is not kept."""
        found = self._kept[key] = self._kept.pop(key) if key in self._kept else make()
        if len(self._kept) > self._most:
            del self._kept[next(iter(self._kept))]
        return found
