"""What users register by name: rules and predicates, each with the place where it was registered.

One name means one thing: registering it again with something else is refused, so that no test file changes what another means.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

from pytest_rvads.errors import FormulaError

__all__ = ["Registry", "registries_kept"]

T = TypeVar("T")
_ALL: list[Registry[object]] = []


class Registry(Generic[T]):
    """Things by name.

    Args:
        same: whether two things of the same name are the same.
    """

    def __init__(self, same: Callable[[T, T], bool]) -> None:
        self._same = same
        self.things: dict[str, tuple[T, str]] = {}
        """What each name means, and where it was registered."""
        _ALL.append(self)  # type: ignore[arg-type]

    def add(self, name: str, thing: T, place: str | None = None) -> None:
        """Register a thing.

        Args:
            name: to be found by.
            thing: what it means.
            place: where it was registered; by default the line of the user's code that is running.

        Raises:
            FormulaError: the name means something else already.
        """
        place = place or _here()
        known = self.things.get(name)
        if known is not None and not self._same(known[0], thing):
            raise FormulaError(f"{name!r} is registered at {known[1]} and says something else at {place}: rename one of them")
        self.things[name] = thing, place if known is None else known[1]

    def get(self, name: str) -> T | None:
        """Return the thing of that name, or None."""
        known = self.things.get(name)
        return None if known is None else known[0]

    def all(self) -> tuple[T, ...]:
        """Return everything that was registered, in order."""
        return tuple(thing for thing, _ in self.things.values())


@contextmanager
def registries_kept() -> Iterator[None]:
    """Forget, at the end, what is registered meanwhile: one session must not change the next one in the same process."""
    before = {id(registry): dict(registry.things) for registry in _ALL}
    try:
        yield
    finally:
        for registry in _ALL:
            registry.things = before.get(id(registry), {})


def _here() -> str:
    """Return file and line of the nearest code that is not of this package."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __name__.partition(".")[0]:
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"
