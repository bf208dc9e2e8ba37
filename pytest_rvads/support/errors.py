"""The errors of the library: a tree of classes, each with cause and remedy; and the places of errors in code of users.

A message is one sentence with the value that was got, the expected value, the place, and the remedy. The plugin turns every error
of this module into a ``pytest.UsageError`` or an error of the test, never into a traceback. In tracebacks, code of users that
this package calls, such as drivers, words and hooks, is found by leaving out this package and other installed ones.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from traceback import extract_tb
from types import TracebackType, UnionType

from pytest_rvads.support.wording import named_error


class RvadsError(Exception):
    """Base class of the errors of this library, except violations of rules."""


class MapError(RvadsError):
    """A map file or junction can't be used.

    Cause: a missing, damaged or unsuitable file, an unknown junction, a junction outside the model.
    Remedy: the message names the file and the place; ``rvads map FILE`` lists what the file offers.
    """


class ScenarioError(RvadsError):
    """A scenario, class or grid is not well-formed.

    Cause: a wrong direction string, a negative distance, an unknown configuration or mark keyword.
    Remedy: the message lists the valid choices.
    """


class FormulaError(RvadsError):
    """A formula or rule can't be understood, or is too large to build a monitor for.

    Cause: a syntax error, an unknown predicate, an unbound variable, an argument of the wrong sort, a size limit.
    Remedy: correct the text; the message shows the place and the nearest valid word.
    """


class AutopilotError(RvadsError):
    """The autopilot under test raised an exception, or its answer is no command.

    Cause: an exception in ``control``, NaN, a wrong type, a value out of range.
    Remedy: fix the autopilot; the message names vehicle, class and simulated time.
    """


class RunError(RvadsError):
    """A run can't be judged.

    Cause: the run is empty, breaks the semantic model, or ended by a fault of simulator or autopilot. Remedy: remove the fault
    that the message names; the verdict on such a run is ERROR, or FAIL for a violation before the fault.
    """


class RuleViolation(AssertionError):
    """The run violates the rule, whatever the continuation of the run (status FAIL)."""


class OpenObligation(RuleViolation):
    """An obligation of the rule was still open when the run ended (status OPEN)."""


class MetamorphicViolation(RuleViolation):
    """Two runs with a metamorphic relation got different verdicts; the note of the exception shows the runs side by side."""


RuleViolation.__module__ = "pytest_rvads"  # the module from which users import the class, which pytest prints
OpenObligation.__module__ = MetamorphicViolation.__module__ = "pytest_rvads.errors"


def require(value: object, kind: type | UnionType, expectation: str, error: type[RvadsError]) -> None:
    """Raise an `error` if `value` is not of `kind`; `expectation`, which says what to write, begins the message."""
    if not isinstance(value, kind):
        raise error(f"{expectation}, got {value!r:.60}")


def suggest(word: str, choices: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the choice nearest to `word`, or an empty string."""
    nearest = difflib.get_close_matches(word, list(choices), n=1, cutoff=0.5)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def needs(what: str, library: str, extra: str) -> str:
    """Return the message that `what` needs the missing package `library`, which an extra installs."""
    return f"{what} needs the package {library}, which is not installed: pip install 'pytest-rvads[{extra}]'"


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
