"""The book of rules of a session, and those of its test files: what a file registers is known in that file alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from pytest_rvads.logic.rules.current import Desk, desk, own_desk

__all__ = ["close_setup", "open_book", "open_session"]

_SESSION: pytest.StashKey[Desk] = pytest.StashKey()
"""Where the rules and predicates are that all test files know."""
_OPEN: pytest.StashKey[Desk] = pytest.StashKey()
"""Where the book is that an item or collector works with."""
_FILES: pytest.StashKey[dict[str, Any]] = pytest.StashKey()
"""By test file its book, with what all knew when it was last closed. A file may be collected twice and is imported once."""


@contextmanager
def open_session(config: pytest.Config) -> Iterator[None]:
    """Open the session's own book: what is registered in it is forgotten at its end."""
    known = desk().book
    with own_desk(Desk(known, index=Desk(known))) as config.stash[_SESSION]:
        yield


@contextmanager
def open_book(node: pytest.Item | pytest.Collector) -> Iterator[None]:
    """Open the book of the test file that a node stands in, with what all know by now."""
    module = node.getparent(pytest.Module)
    if module is None:
        yield
        return
    file, files = str(module.path), node.config.stash.setdefault(_FILES, {})
    common = node.config.stash.get(_SESSION, desk())  # the process's, where a conftest loads the plugin after the session began
    book = files.get(file) or common.book
    if book is not common.book and common.book is not None:
        from pytest_rvads.logic.rules.book import joined  # only where somebody registers

        book = joined(common.book, book)
    with own_desk(Desk(book, file, common.index or Desk(book))) as node.stash[_OPEN]:
        yield
        if isinstance(node, pytest.Collector):
            files[file] = node.stash[_OPEN].book


def close_setup(item: pytest.Item) -> None:
    """Keep what fixtures have registered for the other tests of the file; what the test registers from here on ends with it."""
    opened = item.stash.get(_OPEN, None)
    if opened is not None:
        item.config.stash[_FILES][opened.file] = opened.book
        opened.index = None
