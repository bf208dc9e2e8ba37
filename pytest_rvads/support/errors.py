"""The errors of the library: a tree of classes, each with cause and remedy.

A message is one sentence with the value that was got, the expected value, the place, and the remedy. The plugin turns every error
of this module into a ``pytest.UsageError`` or an error of the test, never into a traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from types import UnionType


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
