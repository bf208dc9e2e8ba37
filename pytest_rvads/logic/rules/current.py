"""Finds the open book of rules: the book of the running test, test file or session, or of the process if no session runs.

A book is an unchangeable collection of rules. A desk is the place that holds the book of a test, test file, session or process;
registering a rule puts another book onto the desk. The file of the code that registers a rule, and the scope of the fixture that
runs this code, decide for which tests the rule is registered. The index of a session has every rule that is registered for more
than one test or that judges a test. A second text under a name of the index is an error that shows both places of registration.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

PACKAGE = "pytest-rvads"
"""The place of registration that shipped rules and words state, instead of a file and line."""


class Desk:
    """The place that holds the book of rules of a test, test file, session or process; registration replaces the book.

    The module of this class imports no rules, because every pytest session has a desk, also a session that uses no rules.
    """

    def __init__(self, book: Any = None, file: str = "", index: Desk | None = None, *, test: bool = False) -> None:
        self.book: Any = book
        """A `RuleBook`; None for the book of the shipped rules, which is not loaded yet."""
        self.file = file
        """The test file whose tests use the book; empty if all tests use the book."""
        self.index = index
        """The desk with all rules of the session, by which a name has a single meaning in the session; None outside a session."""
        self.test = test
        """Whether the desk belongs to a single test of the file, and is dropped with the test."""
        self.outlived = False
        """Whether a fixture that several tests share is being set up; rules that it registers are not for a single test."""

    def alone(self, frame: FrameType) -> bool:
        """Return whether the calling code registers rules for the test file or test of this desk alone.

        Code of a module that a test file imports registers rules for all tests, because the module is imported only once.
        """
        if self.outlived:
            return False
        if frame.f_globals.get("__file__", self.file) == self.file:
            return True
        if not self.test:
            return False
        # Code also runs while its module is imported if it stands inside a class or function of the module.
        while frame.f_back is not None and frame.f_back.f_globals is frame.f_globals:
            frame = frame.f_back
        return frame.f_code.co_name != "<module>"


PROCESS = Desk()
"""The desk of the book that is open outside of any session."""
_DESKS = [PROCESS]


def desk() -> Desk:
    """Return the desk of the open book, in which rules and predicates are looked up by default."""
    return _DESKS[-1]


def desks() -> list[Desk]:
    """Return the desks (places of books) on which the calling code registers rules: of a test or test file, or of all tests."""
    frame, chosen = _caller(), []
    for candidate in reversed(_DESKS):
        chosen.append(candidate)
        if not candidate.file or candidate.alone(frame):
            break
    return list(dict.fromkeys([*chosen, *(candidate.index for candidate in chosen if candidate.index and not candidate.test)]))


@contextmanager
def own_desk(new_desk: Desk | None = None) -> Iterator[Desk]:
    """Make another desk the place of the open book while the context lasts; by default a new desk with the present book."""
    new_desk = new_desk or Desk(desk().book)
    _DESKS.append(new_desk)
    try:
        yield new_desk
    finally:
        _DESKS.remove(new_desk)


def here() -> str:
    """Return the file and line of the nearest calling code outside this package."""
    frame = _caller()
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def _caller() -> FrameType:
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __name__.partition(".")[0]:
        frame = frame.f_back
    return frame
