"""Which book of rules is open: that of the session that runs, or that of the process where none does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["PACKAGE", "Desk", "desk", "here", "own_desk"]

PACKAGE = "pytest-rvads"
"""The place of the rules and words that come with the package."""


class Desk:
    """Where a book lies open, so that whoever defines something leaves a new book there.

    Imports nothing, because every session of pytest has one, also where nobody asks for rules.
    """

    def __init__(self, book: Any = None) -> None:
        self.book: Any = book
        """A `RuleBook`; None for that of the shipped rules, not loaded yet."""


_DESKS = [Desk()]


def desk() -> Desk:
    """Return where the book lies that rules and predicates are looked up in and added to when no other is named."""
    return _DESKS[-1]


@contextmanager
def own_desk() -> Iterator[Desk]:
    """Open a book of one's own, with what is known so far; what is added to it is forgotten at the end."""
    own = Desk(desk().book)
    _DESKS.append(own)
    try:
        yield own
    finally:
        _DESKS.remove(own)


def here() -> str:
    """Return file and line of the nearest code that is not of this package."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __name__.partition(".")[0]:
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"
