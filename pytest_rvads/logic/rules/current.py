"""Which book of rules is open: that of the test file or of the session that runs, or that of the process where none does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["PACKAGE", "PROCESS", "Desk", "desk", "desks", "here", "own_desk"]

PACKAGE = "pytest-rvads"
"""The place of the rules and words that come with the package."""


class Desk:
    """Where a book lies open, so that whoever defines something leaves a new book there.

    Imports nothing, because every session of pytest has one, also where nobody asks for rules.
    """

    def __init__(self, book: Any = None, file: str = "", index: Desk | None = None, *, test: bool = False) -> None:
        self.book: Any = book
        """A `RuleBook`; None for that of the shipped rules, not loaded yet."""
        self.file = file
        """The test file that it is open for; empty for one that is open for all."""
        self.index = index
        """Where all lies that a session registers for more than one test, so that a name means one thing in it."""
        self.test = test
        """Whether it is open for one test of the file, and dropped with it."""
        self.outlived = False
        """Whether a fixture is being set up that other tests have as well, so that what it registers stays with their file."""

    def alone(self, frame: FrameType) -> bool:
        """Tell whether what code registers is for the test file or test alone; another file is imported once, so for all."""
        if self.outlived:
            return False
        return (self.test and not _imported(frame)) or frame.f_globals.get("__file__", self.file) == self.file


PROCESS = Desk()
"""Where the book lies that is open outside of any session."""
_DESKS = [PROCESS]


def desk() -> Desk:
    """Return where the book lies that rules and predicates are looked up in and added to when no other is named."""
    return _DESKS[-1]


def desks() -> list[Desk]:
    """Return where what the calling code registers has to lie: for a test file alone, or for all."""
    frame, found = _caller(), []
    for one in reversed(_DESKS):
        found.append(one)
        if not one.file or one.alone(frame):
            break
    return list(dict.fromkeys([*found, *(one.index for one in found if one.index and not one.test)]))


@contextmanager
def own_desk(own: Desk | None = None) -> Iterator[Desk]:
    """Open a book of one's own, by default with what is known so far; what is added to it is forgotten at the end."""
    own = own or Desk(desk().book)
    _DESKS.append(own)
    try:
        yield own
    finally:
        _DESKS.remove(own)


def here() -> str:
    """Return file and line of the nearest code that is not of this package."""
    frame = _caller()
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def _caller() -> FrameType:
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __name__.partition(".")[0]:
        frame = frame.f_back
    return frame


def _imported(frame: FrameType) -> bool:
    """Tell whether code runs because its module is imported, be it in a class or in a function that is called there."""
    while frame.f_back is not None and frame.f_back.f_globals is frame.f_globals:
        frame = frame.f_back
    return frame.f_code.co_name == "<module>"
