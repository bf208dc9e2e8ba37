"""The open book of rules: of the running test, test file or session, or of the process if no session runs.

A book is a value, and a desk is the place where a book lies open. The file of the registering code, and the scope of the fixture
that runs it, decide for which tests a registration holds. The index of a session has every rule that is registered for more than
one test or that judges a test. A second text under a name of the index is an error that names both places.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["PACKAGE", "PROCESS", "Desk", "desk", "desks", "here", "own_desk"]

PACKAGE = "pytest-rvads"
"""The place of the shipped rules and words."""


class Desk:
    """A place for an open book; registering a rule or predicate puts a new book on the desk.

    This module imports no rules, because every pytest session has a desk, also a session that uses no rules.
    """

    def __init__(self, book: Any = None, file: str = "", index: Desk | None = None, *, test: bool = False) -> None:
        self.book: Any = book
        """A `RuleBook`; None for the shipped rules, which are not loaded yet."""
        self.file = file
        """The test file of the desk; empty for a desk of all tests."""
        self.index = index
        """Desk with all rules that the session registers for several tests, so that a name has one meaning in the session."""
        self.test = test
        """Whether the desk belongs to one test of the file, and is dropped with the test."""
        self.outlived = False
        """Whether a fixture shared with other tests is being set up, whose rules then stay with the test file."""

    def alone(self, frame: FrameType) -> bool:
        """Return whether the calling code registers for this test file or test alone.

        A module that is imported from another file is imported only once, so it registers for all tests.
        """
        if self.outlived:
            return False
        return (self.test and not _imported(frame)) or frame.f_globals.get("__file__", self.file) == self.file


PROCESS = Desk()
"""The desk of the book that is open outside of any session."""
_DESKS = [PROCESS]


def desk() -> Desk:
    """Return the desk of the open book, which looks up and takes rules and predicates if no other book is given."""
    return _DESKS[-1]


def desks() -> list[Desk]:
    """Return the desks for the rules that the calling code registers: of a test file alone, or of all tests."""
    frame, chosen = _caller(), []
    for candidate in reversed(_DESKS):
        chosen.append(candidate)
        if not candidate.file or candidate.alone(frame):
            break
    return list(dict.fromkeys([*chosen, *(candidate.index for candidate in chosen if candidate.index and not candidate.test)]))


@contextmanager
def own_desk(new_desk: Desk | None = None) -> Iterator[Desk]:
    """Open another desk, by default with the present book; its additions are dropped at the end."""
    new_desk = new_desk or Desk(desk().book)
    _DESKS.append(new_desk)
    try:
        yield new_desk
    finally:
        _DESKS.remove(new_desk)


def here() -> str:
    """Return file and line of the nearest caller outside this package."""
    frame = _caller()
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def _caller() -> FrameType:
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __name__.partition(".")[0]:
        frame = frame.f_back
    return frame


def _imported(frame: FrameType) -> bool:
    """Return whether code runs while its module is imported, also inside a class or function of the module."""
    while frame.f_back is not None and frame.f_back.f_globals is frame.f_globals:
        frame = frame.f_back
    return frame.f_code.co_name == "<module>"
