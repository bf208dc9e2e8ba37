"""Functions that commands share: signals, progress, reading lines, finding rules and printing."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import printable

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.report.session_report import Report

LINE_LIMIT = 2**20
"""Longest line of input that is read [bytes]; the output for a line can take a hundred times as much memory."""

MAP_FORMATS = "OpenDRIVE, Lanelet2 or CommonRoad"
"""The formats of maps that are read, for the help of options."""
Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""The object of argparse to which a module adds its commands."""


def number(name: str, least: float, most: float, kind: type = float) -> Callable[[str], Any]:
    """Return the type of a number of an option; argparse prints `name` in its messages."""

    def read(text: str) -> Any:
        value = kind(text)
        if not least <= value <= most:
            raise ValueError
        return value

    read.__name__ = name
    return read


@contextmanager
def terminable() -> Iterator[None]:
    """Let the first SIGTERM or SIGHUP raise KeyboardInterrupt, unless the process ignores or handles these signals."""
    main = threading.current_thread() is threading.main_thread()
    names = [name for name in ("SIGTERM", "SIGHUP") if main and hasattr(signal, name)]
    numbers = [number for name in names if signal.getsignal(number := signal.Signals[name]) is signal.SIG_DFL]

    def interrupt(*_: object) -> None:
        for number in numbers:  # the command ends and writes what it has; `timeout` of coreutils sends the signal twice
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in numbers:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def progress(done: int, total: int, what: str = "runs") -> None:
    """Draw a progress bar on standard error; print a line per quarter if standard error is no terminal."""
    if sys.stderr.isatty():
        full = 40 * done // total
        end = "\n" if done == total else ""
        print(f"\r[{'#' * full}{' ' * (40 - full)}] {done}/{total} {what}", end=end, file=sys.stderr, flush=True)
    elif 4 * done // total > 4 * (done - 1) // total:
        print(f"{done}/{total} {what}", file=sys.stderr)


def progress_for(options: argparse.Namespace) -> Callable[[int, int], None] | None:
    """Return a function that shows progress; None if a program reads JSON, because the program can read standard error, too."""
    return None if options.json and not sys.stderr.isatty() else progress


def clear() -> None:
    """Erase the progress bar, so that a line can be printed in its place."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def listed_rules(names: Sequence[str]) -> tuple[str | Rule, ...]:
    """Return names of rules and rulebooks as they are, with the rules of files (``.rules``) in place of the names of files."""
    from pytest_rvads.logic.rules.book import load_rules, rules_for

    rules = tuple(rule for name in names for rule in (load_rules(name) if name.endswith(".rules") else [name]))
    rules_for(rules)
    return rules


def named_rules(names: Sequence[str]) -> tuple[Rule, ...]:
    """Return the rules that names of rules, rulebooks or files of rules (``.rules``) denote, each rule once."""
    from pytest_rvads.logic.rules.book import rules_for

    return rules_for(listed_rules(names))


def make_folder(option: str, folder: Path) -> None:
    """Make the folder that an option names, unless the folder exists."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RvadsError(
            f"{option} must name a folder to write to, got {str(folder)!r}, which can't be made ({error.strerror}): name another "
            "folder"
        ) from error


def say(text: str) -> None:
    """Print a text on standard output, with control characters escaped."""
    print(printable(text, len(text)), flush=True)


def show(report: Report) -> None:
    """Print the summary of a report in the width of the terminal."""
    from pytest_rvads.report.terminal import summary

    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    print(summary(report, colour=sys.stdout.isatty(), width=shutil.get_terminal_size().columns, unicode=unicode), end="")


def warn(text: str) -> None:
    """Print a text on standard error, without control characters."""
    print(printable(text, len(text)), file=sys.stderr)
