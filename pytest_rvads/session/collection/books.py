"""The rulebooks of a session, of its test files and of its tests: a rule that a test file registers is known in that file only.

The session has a desk until it ends. Each test file has a desk while the file is collected or run, and each test has a further
desk on top.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from pytest_rvads.logic.rules.current import PROCESS, Desk, desk, own_desk

__all__ = ["open_book", "open_session", "outliving"]

_SESSION: pytest.StashKey[Desk] = pytest.StashKey()
"""The desk with the rules and predicates that all test files know."""
_FILES: pytest.StashKey[dict[str, Any]] = pytest.StashKey()
"""Test file to its rulebook when the file was last closed. Python imports a file once, even if it is collected twice."""


@contextmanager
def open_session(config: pytest.Config) -> Iterator[None]:
    """Open the rulebook of a session: rules that are registered during the session are forgotten when the session ends.

    The rulebook begins with the rules of the process, without rules that a test registered before it started an inner session.
    """
    with own_desk(Desk(PROCESS.book, index=Desk(PROCESS.book))) as config.stash[_SESSION]:
        yield


@contextmanager
def open_book(node: pytest.Item | pytest.Collector) -> Iterator[None]:
    """Open the rulebook of a node's test file, joined with the rules of the session; for a test, open a further book on top."""
    outer = node.config.stash.get(_SESSION, desk())  # of the process, if a conftest.py loads the plugin
    with ExitStack() as opened:
        files, file = node.config.stash.setdefault(_FILES, {}), _test_file(node)
        if file:
            book = files.get(file) or outer.book
            if book is not outer.book and outer.book is not None:
                from pytest_rvads.logic.rules.book import joined  # imported only if a file registers rules

                book = joined(outer.book, book)
            outer = opened.enter_context(own_desk(Desk(book, file, outer.index or Desk(book))))
        if isinstance(node, pytest.Item):
            opened.enter_context(own_desk(Desk(outer.book, str(node.path), outer.index, test=True)))
        yield
        if file:
            files[file] = outer.book


@contextmanager
def outliving(fixture: pytest.FixtureDef[Any]) -> Iterator[None]:
    """Keep the rules that a fixture registers during its setup until the scope of the fixture ends."""
    opened = desk()
    before, opened.outlived = opened.outlived, opened.test and fixture.scope != "function"
    try:
        yield
    finally:
        opened.outlived = before


def _test_file(node: pytest.Item | pytest.Collector) -> str:
    """Return the path of the test file of a node; empty for a module collected only for its doctests."""
    module = node.getparent(pytest.Module)
    if module is None:
        return ""
    patterns: list[str] = node.config.getini("python_files")
    is_test_file = type(module) is pytest.Module or any(map(module.path.match, patterns))
    return str(module.path) if is_test_file else ""
