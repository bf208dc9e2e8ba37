"""The errors of the library: one tree, each class with its cause and its remedy.

A message is one sentence with the value that was got, the expected value, the place, and the remedy. The plugin turns
every error of this module into a ``pytest.UsageError`` or an error of the item, never into a traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from types import UnionType

__all__ = [
    "AutopilotError",
    "FormulaError",
    "MapError",
    "OpenObligation",
    "RuleViolation",
    "RunError",
    "RvadsError",
    "ScenarioError",
    "require",
    "suggest",
]


class RvadsError(Exception):
    """Base of every error raised on purpose by this library."""


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

    Cause: a syntax error, an unknown predicate, an unbound variable, a sort mismatch, a size limit.
    Remedy: the message shows the place and the nearest valid word.
    """


class AutopilotError(RvadsError):
    """The autopilot under test raised, or answered with something that is not a control.

    Cause: an exception in ``control``, NaN, a wrong type, a value out of range.
    Remedy: fix the autopilot; the message names vehicle, class and simulated time.
    """


class RunError(RvadsError):
    """A run can't be judged.

    Cause: it is empty, breaks the semantic model, or ended by a fault of plant or autopilot.
    Remedy: the message names the fault; the verdict of such a run is ERROR, never PASS or FAIL.
    """


class RuleViolation(AssertionError):
    """The run violates the rule, whatever would have followed (status FAIL)."""


class OpenObligation(RuleViolation):
    """An obligation of the rule was still open when the run ended (status OPEN)."""


class MetamorphicViolation(RuleViolation):
    """Runs that have to be judged alike are not; the note of the exception shows them side by side."""


for _public in (RuleViolation, OpenObligation, MetamorphicViolation):
    _public.__module__ = "pytest_rvads"  # where users find them, and what pytest shows


def require(value: object, kind: type | UnionType, wanted: str, error: type[RvadsError]) -> None:
    """Raise an `error` where `value` is not of `kind`; `wanted` begins its sentence and says what to write."""
    if not isinstance(value, kind):
        raise error(f"{wanted}, got {value!r:.60}")


def suggest(word: str, choices: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the choice nearest to `word`, or an empty string."""
    near = difflib.get_close_matches(word, list(choices), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def needs(what: str, library: str, extra: str) -> str:
    """Return the sentence for `what` when the package `library`, which an extra installs, is missing."""
    return f"{what} needs the package {library}, which is not installed: pip install 'pytest-rvads[{extra}]'"
