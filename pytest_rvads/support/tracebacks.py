"""Tracebacks of errors in code of users that this package calls, such as drivers, words and hooks."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from traceback import extract_tb
from types import TracebackType

from pytest_rvads.support.wording import named_error

_HIDDEN = re.compile(re.escape(str(Path(__file__).parents[1]) + os.sep) + r"|.*[/\\]pluggy[/\\]")
"""Files of this package, and of pluggy, which calls hooks."""
_LIBRARY = re.compile(r".*[/\\](site|dist)-packages[/\\]|(?![/\\]|\w:)|" + re.escape(str(Path(os.__file__).parent) + os.sep))
"""Files of installed packages, code without a file, and Python's standard library."""


def own(files: Sequence[str]) -> int:
    """Return the index of the last file with code of the user, else of the last file of another package, else of the last."""
    others = [k for k, file in enumerate(files) if not _HIDDEN.match(file)]
    users = [k for k in others if not _LIBRARY.match(files[k])]
    return (users or others or [len(files) - 1])[-1]


def place(lines: Sequence[tuple[str, object]]) -> str:
    """Return name and line of the last file with code of the user; the name has no folder, which differs between computers."""
    file, line = lines[own([file for file, _ in lines])]
    return f"{Path(file).name}:{line}"


def place_of(error: BaseException) -> str:
    """Return name and line of the innermost code of the user in the traceback of an error."""
    return place([(entry.filename, entry.lineno) for entry in extract_tb(error.__traceback__)])


def located(error: BaseException) -> str:
    """Return "Type: text (file:line)" with the innermost code of the user, as far as the error came from a file."""
    line = place_of(error) if error.__traceback__ else "<frozen"
    return named_error(error) + ("" if line.startswith("<frozen") else f" ({line})")


def in_own_code(error: BaseException) -> list[TracebackType] | None:
    """Return two tracebacks of an error that code of a user raised when this package called it; None for other errors.

    Both leave out this package. The first one has all other entries, the second one ends in the innermost line of the user.
    """
    entry, entries = error.__traceback__, list[TracebackType]()
    while entry:
        entries.append(entry)
        entry = entry.tb_next
    files = [entry.tb_frame.f_code.co_filename for entry in entries]
    last = own(files)
    hidden = [bool(_HIDDEN.match(file)) for file in files]
    if not any(hidden[:last]) or hidden[last]:
        return None
    whole = cut = None
    for k in reversed([k for k in range(len(files)) if not hidden[k]]):
        frame, lasti, line = entries[k].tb_frame, entries[k].tb_lasti, entries[k].tb_lineno
        whole = TracebackType(whole, frame, lasti, line)
        cut = TracebackType(cut, frame, lasti, line) if k <= last else None
    return [trace for trace in (whole, cut) if trace]
