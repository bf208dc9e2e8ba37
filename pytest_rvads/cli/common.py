"""Functions that commands share: signals, progress, reading lines and printing."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING, TypeAlias

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import printable

if TYPE_CHECKING:
    from pytest_rvads.report.session_report import Report

__all__ = ["LINE_LIMIT", "Subparsers", "clear", "lines", "progress", "progress_for", "say", "show", "terminable", "warn"]

LINE_LIMIT = 2**20
"""Longest line that is read [bytes]; to answer it may take a hundred times as much memory."""

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""The object to which a module adds its commands."""


@contextmanager
def terminable() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does, unless somebody ignores or handles them."""
    main = threading.current_thread() is threading.main_thread()
    names = [name for name in ("SIGTERM", "SIGHUP") if main and hasattr(signal, name)]
    numbers = [number for name in names if signal.getsignal(number := signal.Signals[name]) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def progress(done: int, total: int, what: str = "runs") -> None:
    """Draw a bar on standard error; where that is no terminal, a line per quarter."""
    if sys.stderr.isatty():
        full = 40 * done // total
        end = "\n" if done == total else ""
        print(f"\r[{'#' * full}{' ' * (40 - full)}] {done}/{total} {what}", end=end, file=sys.stderr, flush=True)
    elif 4 * done // total > 4 * (done - 1) // total:
        print(f"{done}/{total} {what}", file=sys.stderr)


def progress_for(options: argparse.Namespace) -> Callable[[int, int], None] | None:
    """Return the progress display; None for a program that wants JSON, which may read standard error together with it."""
    return None if options.json and not sys.stderr.isatty() else progress


def clear() -> None:
    """Erase the progress bar, so that a line can be printed in its place."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def lines() -> Iterator[bytes]:
    """Yield the lines of standard input, but for empty ones.

    Raises:
        RvadsError: a line is too long; those before it have been yielded.
    """
    for number in count(1):
        line = sys.stdin.buffer.readline(LINE_LIMIT + 1)
        if len(line) > LINE_LIMIT:
            raise RvadsError(f"line {number} of standard input is too long, expected at most {LINE_LIMIT:,} bytes")
        if not line:
            return
        if line.strip():
            yield line


def say(text: str) -> None:
    """Print an answer; control characters in foreign names are made harmless."""
    print(printable(text, len(text)), flush=True)


def show(report: Report) -> None:
    """Print the summary of a report, as wide as the terminal."""
    from pytest_rvads.report.terminal import summary

    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    print(summary(report, colour=sys.stdout.isatty(), width=shutil.get_terminal_size().columns, unicode=unicode), end="")


def warn(text: str) -> None:
    """Print a text on standard error, without control characters."""
    print(printable(text, len(text)), file=sys.stderr)
