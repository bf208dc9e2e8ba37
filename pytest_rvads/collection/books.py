"""The book of rules of a session, those of its test files, and those of tests: what one registers is known there alone.

A session has a desk and drops it at its end. Each test file has a desk of its own while it is collected or run, and each test has
another desk on top.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from pytest_rvads.logic.rules.current import PROCESS, Desk, desk, own_desk

__all__ = ["open_book", "open_session", "outliving"]

_SESSION: pytest.StashKey[Desk] = pytest.StashKey()
"""Where the rules and predicates are that all test files know."""
_FILES: pytest.StashKey[dict[str, Any]] = pytest.StashKey()
"""By test file its book, with what all knew when it was last closed. A file may be collected twice and is imported once."""


@contextmanager
def open_session(config: pytest.Config) -> Iterator[None]:
    """Open the rulebook of a session: rules that are registered during the session are forgotten when the session ends.

    The rulebook begins with the rules of the process, without rules that a test registered before it started an inner session.
    """
    with own_desk(Desk(PROCESS.book, index=Desk(PROCESS.book))) as config.stash[_SESSION]:
        yield


@contextmanager
def open_book(node: pytest.Item | pytest.Collector) -> Iterator[None]:
    """Open the book of the test file that a node stands in, with what all know by now, and that of a test on top."""
    own = node.config.stash.get(_SESSION, desk())  # the process's, where a conftest loads the plugin after the session began
    with ExitStack() as opened:
        files, file = node.config.stash.setdefault(_FILES, {}), _test_file(node)
        if file:
            book = files.get(file) or own.book
            if book is not own.book and own.book is not None:
                from pytest_rvads.logic.rules.book import joined  # only where somebody registers

                book = joined(own.book, book)
            own = opened.enter_context(own_desk(Desk(book, file, own.index or Desk(book))))
        if isinstance(node, pytest.Item):
            opened.enter_context(own_desk(Desk(own.book, str(node.path), own.index, test=True)))
        yield
        if file:
            files[file] = own.book


@contextmanager
def outliving(fixture: pytest.FixtureDef[Any]) -> Iterator[None]:
    """Let what a fixture registers while it is set up end with the test only where the fixture does."""
    opened = desk()
    before, opened.outlived = opened.outlived, opened.test and fixture.scope != "function"
    try:
        yield
    finally:
        opened.outlived = before


def _test_file(node: pytest.Item | pytest.Collector) -> str:
    """Return the test file that a node stands in; a module that is collected for its examples alone is none."""
    module = node.getparent(pytest.Module)
    if module is None:
        return ""
    tests = type(module) is pytest.Module or any(module.path.match(pattern) for pattern in node.config.getini("python_files"))
    return str(module.path) if tests else ""
