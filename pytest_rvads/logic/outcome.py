"""Outcomes: every status that a record can have, with all that reports have to know of it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Literal, NamedTuple

from pytest_rvads.support.wording import plural

__all__ = ["BAD", "Outcome", "Tallied", "counted", "told_in"]

Meaning = Literal["violated", "error", "flaky", "passed", "idle"]
Mark = Literal["good", "bad", "doubt", "none"]
BAD: tuple[Meaning, ...] = ("violated", "error", "flaky")
"""What means that something is wrong with the system under test or with its test."""


class _Traits(NamedTuple):
    """What reports have to know of an outcome."""

    value: str
    """The spelling in reports."""
    severity: int
    """0 is the worst result; the numbers have gaps for further outcomes."""
    meaning: Meaning
    """What the outcome says when a session is compared with an earlier session; ``idle``: nothing."""
    cell: str
    """The text of a table cell."""
    style: str
    """The style in a terminal, as rich spells it."""
    mark: Mark
    """The mark on a page."""
    judges: bool = False
    """Whether the outcome says something of the system under test; a session without any such outcome is not green."""
    word: str = ""
    """The words in sentences that count ("3 provoked by traffic"); by default the spelling inside a sentence."""
    letter: str = ""
    """The letter in pytest's line of progress, where pytest's own letter would mislead."""


class Outcome(StrEnum):
    """Result of an item, in the order in which summaries count the results; the value is the spelling in reports."""

    severity: int
    meaning: Meaning
    cell: str
    style: str
    mark: Mark
    judges: bool
    word: str
    letter: str

    def __new__(cls, *traits: Any) -> Outcome:
        """Make a member from its traits."""
        value, *further = _Traits(*traits)
        member = str.__new__(cls, value)
        member._value_ = value
        for name, trait in zip(_Traits._fields[1:], further, strict=True):
            setattr(member, name, trait)
        member.word = member.word or member.small
        return member

    PASS = _Traits("PASS", severity=70, meaning="passed", cell="pass", style="green", mark="good", judges=True)
    FAIL = _Traits("FAIL", severity=20, meaning="violated", cell="FAIL", style="bold red", mark="bad", judges=True)
    OPEN = _Traits("OPEN", severity=40, meaning="violated", cell="OPEN", style="yellow", mark="doubt", judges=True)
    UNAVOIDABLE = _Traits("UNAVOIDABLE", severity=50, meaning="passed", cell="unavoidable", style="cyan", mark="doubt")
    """Violated, and no vehicle could have kept the rule."""
    PROVOKED = _Traits(
        "PROVOKED", severity=60, meaning="passed", cell="provoked", style="cyan", mark="doubt", word="provoked by traffic"
    )
    """Violated or open by the doing of the traffic, not of the subject."""
    UNSURE = _Traits("UNSURE", severity=65, meaning="idle", cell="unsure", style="blue", mark="doubt", letter="?")
    """Another reading of what was recorded, within its accuracy, would change the verdict."""
    NA = _Traits("NA", severity=80, meaning="idle", cell="NA", style="dim", mark="none", letter="n")
    ERROR = _Traits("ERROR", severity=0, meaning="error", cell="ERROR", style="bold magenta", mark="bad")
    FLAKY = _Traits("FLAKY", severity=10, meaning="flaky", cell="FLAKY", style="bold magenta", mark="bad")
    NOT_JUDGED = _Traits("NOT JUDGED", severity=30, meaning="error", cell="NOT JUDGED", style="bold magenta", mark="bad")
    """The test has a rule or a monitor and judged nothing."""
    NOT_RUN = _Traits("NOT RUN", severity=90, meaning="idle", cell="NOT RUN", style="", mark="none", letter="-")

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
"""What verdicts are counted as; None stands for known failures."""


def told_in(counts: Mapping[Tallied, int]) -> list[Tallied]:
    """Return the outcomes that were counted, in the order of sentences: verdicts, known failures, then all other outcomes."""
    verdicts = [outcome for outcome in Outcome if outcome.judges or outcome.meaning == "passed"]
    order = (*verdicts, None, *(outcome for outcome in Outcome if outcome not in verdicts))
    return [outcome for outcome in order if counts.get(outcome)]


def counted(counts: Mapping[Tallied, int]) -> str:
    """Return verdicts by status: ``3 pass, 1 known failure, 2 NA``."""
    return ", ".join(
        plural(counts[None], "known failure") if outcome is None else f"{counts[outcome]:,} {outcome.word}"
        for outcome in told_in(counts)
    )
