"""Outcomes: every status that the record of a test can have, with its severity, its spelling and its style in reports.

A verdict has a `Status`, which says how the run keeps the rule. Its outcome is the status, or PROVOKED or UNAVOIDABLE if the
vehicle under test is not to blame. A test can have outcomes that no verdict has, such as NOT JUDGED.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Literal, NamedTuple

from pytest_rvads.support.wording import plural

Meaning = Literal["violated", "error", "flaky", "passed", "idle"]
Mark = Literal["good", "bad", "error", "doubt", "none"]
MARKS: dict[Mark, tuple[str, str, str]] = {
    "bad": ("✗", "#b34700", "#ff8a47"),
    "error": ("E", "#9c2f72", "#d98ab8"),
    "doubt": ("!", "#8a5a00", "#e9b03a"),
    "good": ("✓", "#00694d", "#1fbf92"),
    "none": ("–", "#5f6368", "#99a0a8"),
}
"""By mark of an outcome, the worst first: its sign, and its colours on light ground (contrast with white above 5) and on dark."""
BAD: tuple[Meaning, ...] = ("violated", "error", "flaky")
"""The meanings of outcomes that show a fault of the system under test or of its test."""


class _Traits(NamedTuple):
    """The spelling, severity and style of an outcome in reports."""

    value: str
    """The spelling in reports."""
    severity: int
    """The rank of the outcome by badness: 0 is the worst; the numbers have gaps for further outcomes."""
    meaning: Meaning
    """What the outcome counts as when a session is compared with an earlier session; ``idle`` outcomes are not compared."""
    cell: str
    """The text of the outcome in a cell of a table."""
    style: str
    """The colour and font in a terminal, as the library rich spells them."""
    mark: Mark
    """The kind of mark that an HTML page shows for the outcome."""
    judges: bool = False
    """Whether the outcome says something about the system under test; a session without any such outcome is not green."""
    word: str = ""
    """The words after a number ("3 provoked by traffic"); by default the spelling of the outcome inside a sentence."""
    letter: str = ""
    """The letter in pytest's line of progress; empty if pytest's own letter is right."""


class Outcome(StrEnum):
    """The result of a test or of a verdict; the value of an outcome is its spelling in reports.

    The outcomes have the order in which summaries count results.
    """

    severity: int
    meaning: Meaning
    cell: str
    style: str
    mark: Mark
    judges: bool
    word: str
    letter: str

    def __new__(cls, *traits: Any) -> Outcome:
        """Make an outcome from its spelling, severity and style."""
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
    """The rule was violated, and no vehicle could have kept the rule."""
    PROVOKED = _Traits(
        "PROVOKED", severity=60, meaning="passed", cell="provoked", style="cyan", mark="doubt", word="provoked by traffic"
    )
    """The traffic, not the vehicle under test, violated the rule or left an obligation open."""
    UNSURE = _Traits("UNSURE", severity=65, meaning="idle", cell="unsure", style="blue", mark="doubt", letter="?")
    """Other values of the recorded measurements, within their accuracy, or another possible way of a vehicle would change the
    verdict."""
    NA = _Traits("NA", severity=80, meaning="idle", cell="NA", style="dim", mark="none", letter="n")
    ERROR = _Traits("ERROR", severity=0, meaning="error", cell="ERROR", style="bold magenta", mark="error")
    FLAKY = _Traits("FLAKY", severity=10, meaning="flaky", cell="FLAKY", style="bold magenta", mark="error")
    NOT_JUDGED = _Traits("NOT JUDGED", severity=30, meaning="error", cell="NOT JUDGED", style="bold magenta", mark="error")
    """The test has a rule or a monitor, but judged no run."""
    NOT_RUN = _Traits("NOT RUN", severity=90, meaning="idle", cell="NOT RUN", style="", mark="none", letter="-")

    @property
    def bad(self) -> bool:
        """Whether something is wrong with the system under test or with its test."""
        return self.meaning in BAD

    @property
    def small(self) -> str:
        """The spelling of the outcome inside a sentence."""
        return self.value if len(self.value) == 2 else self.value.lower()  # NA is an abbreviation

    @classmethod
    def worst_first(cls) -> list[Outcome]:
        """Return all outcomes, the worst outcome first."""
        return sorted(cls, key=lambda outcome: outcome.severity)


EXPLANATIONS = {
    Outcome.NA: "the rule did not apply",
    Outcome.UNAVOIDABLE: "nobody could have kept the rule",
    Outcome.PROVOKED: "broken by the doing of the traffic, not of the vehicle under test",
    Outcome.OPEN: "still owed at the end of the run",
    Outcome.UNSURE: "the recording is not exact enough to tell",
    Outcome.FLAKY: "the same start gave another run, or the same run another verdict",
    Outcome.NOT_JUDGED: "the test judged nothing",
}
"""What tables say of outcomes to readers who do not know them."""
Tallied = Outcome | None
"""A kind of result that reports count: an outcome, or None for known failures (failures of tests that are marked as such)."""


def told_in(counts: Mapping[Tallied, int]) -> list[Tallied]:
    """Return the outcomes with a count above 0, in the order in which sentences name the outcomes.

    Outcomes that judge the system under test or count as passed come first, known failures (None) second, all others last.
    """
    verdicts = [outcome for outcome in Outcome if outcome.judges or outcome.meaning == "passed"]
    order = (*verdicts, None, *(outcome for outcome in Outcome if outcome not in verdicts))
    return [outcome for outcome in order if counts.get(outcome)]


def counted(counts: Mapping[Tallied, int]) -> str:
    """Return the counts of outcomes in words: ``3 pass, 1 known failure, 2 NA``."""
    return ", ".join(
        plural(counts[None], "known failure") if outcome is None else f"{counts[outcome]:,} {outcome.word}"
        for outcome in told_in(counts)
    )
