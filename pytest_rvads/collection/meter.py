"""Progress of a long collection, on terminals only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sized
from contextlib import nullcontext
from typing import Any, TypeVar

import pytest

__all__ = ["watched"]

T = TypeVar("T")


def watched(config: pytest.Config, what: str, things: Iterable[T], least: int, most: int = 0) -> Iterator[T]:
    """Yield things and say how many of them are done, in one line that is written over.

    Nothing is said of fewer than `least`, in a pipe, by a worker, or with ``-q``. Things that have no length are `most`.
    """
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    capture: Any = config.pluginmanager.get_plugin("capturemanager")
    shown = reporter is not None and reporter.isatty and reporter.verbosity >= 0 and not hasattr(config, "workerinput")
    total = len(things) if isinstance(things, Sized) else most
    for done, thing in enumerate(things):
        if shown and total >= least and done % max(1, total // 100) == 0:
            with capture.global_and_fixture_disabled() if capture else nullcontext():
                reporter.rewrite(f"rvads: {what} {done:,}/{total:,}", erase=True)
        yield thing
