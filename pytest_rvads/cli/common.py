"""What the commands share."""

from __future__ import annotations

import argparse
import sys
from typing import TypeAlias

from pytest_rvads.wording import printable

__all__ = ["Subparsers", "progress", "say", "warn"]

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Where a module adds its commands."""


def progress(done: int, total: int, what: str = "runs") -> None:
    """Draw a bar on standard error; where that is no terminal, a line per quarter."""
    if sys.stderr.isatty():
        full = 40 * done // total
        end = "\n" if done == total else ""
        print(f"\r[{'#' * full}{' ' * (40 - full)}] {done}/{total} {what}", end=end, file=sys.stderr, flush=True)
    elif 4 * done // total > 4 * (done - 1) // total:
        print(f"{done}/{total} {what}", file=sys.stderr)


def say(text: str) -> None:
    """Print an answer in which names from elsewhere stand."""
    print(printable(text, len(text)), flush=True)


def warn(text: str) -> None:
    """Print such a text on standard error."""
    print(printable(text, len(text)), file=sys.stderr)
