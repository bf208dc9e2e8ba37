"""Outcomes: every status that a record can have, with all that reports have to know of it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Literal

from pytest_rvads.wording import plural

__all__ = ["BAD", "Outcome", "Tallied", "counted", "told_in"]

Meaning = Literal["violated", "error", "flaky", "passed", "idle"]
Mark = Literal["good", "bad", "doubt", "none"]
BAD: tuple[Meaning, ...] = ("violated", "error", "flaky")
"""What means that something is wrong with the system under test or with its test."""


class Outcome(StrEnum):
    """Result of an item, in the order in which summaries count the results.

    The value of a member is the spelling in reports. The attributes are severity, meaning, the text of a table cell, the style in
    a terminal, the mark on a page, and pytest's word and letter if these differ from the default.
    """

    severity: int
    """0 is the worst result; the numbers have gaps for further members."""
    meaning: Meaning
    """What it says when a session is compared with an earlier one; ``idle``: nothing."""
    cell: str
    style: str
    mark: Mark
    judges: bool
    """Whether something was found out about the system under test; a session without any such outcome is not green."""
    word: str
    """In sentences that count: "3 provoked by traffic"."""
    letter: str
    """In pytest's line of progress, where pytest's own would mislead."""

    def __new__(  # noqa: PLR0913 - what distinguishes outcomes, written out per member
        cls,
        value: str,
        severity: int = 0,
        meaning: Meaning = "idle",
        cell: str = "",
        style: str = "",
        mark: Mark = "none",
        judges: bool = False,
        word: str = "",
        letter: str = "",
    ) -> Outcome:
        """Make a member; from outside, find the one with a spelling."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.severity, member.meaning, member.cell, member.style, member.mark = severity, meaning, cell, style, mark
        member.judges, member.letter = judges, letter
        member.word = word or member.small
        return member

    PASS = "PASS", 70, "passed", "pass", "green", "good", True
    FAIL = "FAIL", 20, "violated", "FAIL", "bold red", "bad", True
    OPEN = "OPEN", 40, "violated", "OPEN", "yellow", "doubt", True
    UNAVOIDABLE = "UNAVOIDABLE", 50, "passed", "unavoidable", "cyan", "doubt"
    """Violated, and nobody could have kept the rule."""
    PROVOKED = "PROVOKED", 60, "passed", "provoked", "cyan", "doubt", False, "provoked by traffic"
    """Violated or open by the doing of the traffic, not of the subject."""
    UNSURE = "UNSURE", 65, "idle", "unsure", "blue", "doubt", False, "", "?"
    """Another reading of what was recorded, within its accuracy, would change the verdict."""
    NA = "NA", 80, "idle", "NA", "dim", "none", False, "", "n"
    ERROR = "ERROR", 0, "error", "ERROR", "bold magenta", "bad"
    FLAKY = "FLAKY", 10, "flaky", "FLAKY", "bold magenta", "bad"
    NOT_JUDGED = "NOT JUDGED", 30, "error", "NOT JUDGED", "bold magenta", "bad"
    """The test has a rule or a monitor and judged nothing."""
    NOT_RUN = "NOT RUN", 90, "idle", "NOT RUN", "", "none", False, "", "-"

    @property
    def bad(self) -> bool:
        """Whether something is wrong with the system under test or with its test."""
        return self.meaning in BAD

    @property
    def small(self) -> str:
        """The spelling inside a sentence."""
        return self.value if len(self.value) == 2 else self.value.lower()  # NA is an abbreviation

    @classmethod
    def worst_first(cls) -> list[Outcome]:
        """Return all of them, the worst first."""
        return sorted(cls, key=lambda outcome: outcome.severity)


Tallied = Outcome | None
"""What verdicts are counted as; None: known failures."""


def told_in(counts: Mapping[Tallied, int]) -> list[Tallied]:
    """Return what there is any of, in the order of sentences: known failures after what was found out, before what was not."""
    found = [outcome for outcome in Outcome if outcome.judges or outcome.meaning == "passed"]
    order = (*found, None, *(outcome for outcome in Outcome if outcome not in found))
    return [one for one in order if counts.get(one)]


def counted(counts: Mapping[Tallied, int]) -> str:
    """Return verdicts by status: ``3 pass, 1 known failure, 2 NA``."""
    told = told_in(counts)
    return ", ".join(plural(counts[one], "known failure") if one is None else f"{counts[one]:,} {one.word}" for one in told)
