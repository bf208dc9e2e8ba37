"""Verdicts of rules on runs, in the form in which reports and files of results hold them."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import show_lists, shown


class Status(StrEnum):
    """The outcome of judging a run by a rule."""

    PASS = "PASS"
    """The rule was triggered, and every obligation was met."""
    FAIL = "FAIL"
    """The rule was violated, and no continuation of the run could change this."""
    OPEN = "OPEN"
    """An obligation was still open when the run ended."""
    UNSURE = "UNSURE"
    """Other values of the recorded measurements, within their accuracy, or another possible way of a vehicle would change the
    verdict."""
    NA = "NA"
    """The rule does not apply to the run, or was never triggered."""
    ERROR = "ERROR"
    """The run can't be judged: it is empty, damaged, or ended by a fault."""


class InstanceVerdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """The verdict of an instance (a rule for certain vehicles and entrances).

    Instances with the same meaning, such as the rule p1 for (a1, a2) and for (a2, a1), share a verdict.
    """

    binding: tuple[tuple[str, str], ...]
    """Variables of the rule, with the names of the vehicles and entrances that the variables stand for."""
    status: Status
    responsible: tuple[str, ...] = ()
    """The vehicles responsible for the violation or the open obligation; empty for an instance that is neither."""
    trigger: int | None = None
    """First tick of the obligation: of the violated or open obligation, or of the first obligation of a kept instance."""
    failed: int | None = None
    """First tick from which on no continuation satisfies the instance."""
    broken: tuple[str, ...] = ()
    """The atoms (predicates of certain vehicles) that had the wrong value in the tick `failed`."""
    margin: float | None = None
    """Time from the action of the bound vehicle to the event that permits the action [s]; negative if the vehicle waited.

    For a rule about states, such as two vehicles that must never touch: the total time in the forbidden state [s]. None if the
    action or the event is missing.
    """
    hangs: str = ""
    """The uncertain event or measurement on which an UNSURE instance depends, and its accuracy."""


class NearMiss(msgspec.Struct, frozen=True):
    """The tick in which a rule that was never triggered came closest to being triggered."""

    binding: tuple[tuple[str, str], ...]
    tick: int
    missing: tuple[str, ...]
    """The parts of the premise (the condition that triggers the rule) that were false in the tick."""
    steps: int
    """Number of ticks in which equally few parts of the premise were false."""


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """The verdict of a rule on a run.

    The truth value of a verdict is the truth of "the run satisfies the rule". An NA, UNSURE or ERROR verdict has no truth value:
    ``bool()`` raises an error.
    """

    rule: str
    """Name of the rule."""
    status: Status
    """The status; `outcome` distinguishes further cases."""
    message: str
    """One line: the rule, the time, and the event."""
    reason: str = ""
    """Reason of the status. Verdicts that are NA or ERROR for the same cause have the same words."""
    final: bool = False
    """Whether no continuation of the run could change the status."""
    time: float | None = None
    """Time of the earliest violation, or of the beginning of the open obligation [s]."""
    counts: dict[str, int] = {}
    """Number of instances by outcome: fail, open, pass, "not triggered"."""
    collapsed: int = 0
    """Number of instances that are true because of the junction and the ways alone; `counts` leaves these instances out."""
    instances: tuple[InstanceVerdict, ...] = ()
    """Verdicts of the instances, sorted by severity, then by time."""
    near: NearMiss | None = None
    """Where a rule that was never triggered came closest to being triggered; None for other verdicts."""
    violated: str = ""
    """The violated obligation, in words that do not name vehicles, so that reports can group failures by these words."""
    roles: str = ""
    """The movements of the vehicles of the violation, in words that are the same for all rotations of a scenario."""
    asked: bool = True
    """Whether a triggered instance required an action of the subject. In a run without a subject, whether an instance was
    triggered and a vehicle moved."""
    unavoidable: bool = False
    """Whether no vehicle could have kept the violated rule; such verdicts are counted separately, and fail no test by default."""
    notes: tuple[str, ...] = ()
    """Further remarks, such as that no vehicle may go first, or that a tie window (arrivals that count as equal) decides."""
    explanation: str = ""
    """Several lines of text: the rule, the instance, its states, the vehicles bound to act, the beginning of the obligation."""
    requirement: str | None = None
    """Identifier of the requirement that the rule traces to."""
    dt: float = 0.01
    """Time between two states [s]."""
    start: float = 0.0
    """Time of the first state on the clock of the recording [s]; `time` is on this clock, ticks count from the first state."""
    subject: str | None = None
    """The vehicle under test among traffic. The status comes from the instances that the subject is to blame for, if there are
    any."""
    provoked: bool = False
    """Whether traffic or pedestrians alone caused the violation or the open obligation; such a verdict fails no test."""
    title: str = ""
    """The title of the rule, in words."""
    responsible: tuple[str, ...] = ()
    """The vehicles responsible for violated or open instances, each once, sorted by time."""

    def __repr__(self) -> str:
        return f"<Verdict {self.rule} {self.status}: {self.message}>"

    def _repr_html_(self) -> str:
        return shown(self)

    def __bool__(self) -> bool:
        if self.status is Status.NA:
            raise RunError(
                f"the verdict of {self.rule} is NA ({self.reason}), neither true nor false: "
                "ask for verdict.status, or choose a scenario to which the rule applies"
            )
        if self.status is Status.UNSURE:
            raise RunError(
                f"the verdict of {self.rule} is UNSURE ({self.reason}), neither true nor false: ask for verdict.status"
            )
        if self.status is Status.ERROR:
            raise RunError(
                f"the run could not be judged by {self.rule} ({self.reason}), so the verdict is neither true nor false"
            )
        return self.status is Status.PASS

    @property
    def outcome(self) -> Outcome:
        """The outcome in reports: UNAVOIDABLE if `unavoidable`, PROVOKED if `provoked`, and the status in all other cases."""
        return outcome_of(self.status, self.unavoidable, self.provoked)

    @property
    def cause(self) -> str:
        """The violated obligation and the vehicles' movements, in words that are the same for all rotations of a scenario."""
        return f"{self.violated} ({self.roles})" if self.roles else self.violated

    def record(self) -> dict[str, Any]:
        """Return the verdict as a dictionary for JSON, as in reports: fields with their default values are left out."""
        content: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return content


show_lists(Verdict)


def outcome_of(status: str, unavoidable: bool, provoked: bool) -> Outcome:
    """Return the outcome of a verdict in reports."""
    return Outcome.UNAVOIDABLE if unavoidable else Outcome.PROVOKED if provoked else Outcome(status)
