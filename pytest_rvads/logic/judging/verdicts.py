"""Verdicts of rules on runs. Reports and files of results hold these values unchanged."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.support.displayed import shown
from pytest_rvads.support.errors import RunError

__all__ = ["InstanceVerdict", "NearMiss", "Status", "Verdict"]


class Status(StrEnum):
    """The outcome of judging a run by a rule."""

    PASS = "PASS"
    """The rule was triggered, and every obligation was discharged."""
    FAIL = "FAIL"
    """The rule was violated, whatever would have followed."""
    OPEN = "OPEN"
    """An obligation was still open when the run ended."""
    UNSURE = "UNSURE"
    """Another reading of the recording, within its accuracy, would change the verdict."""
    NA = "NA"
    """The rule does not apply to the run, or was never triggered."""
    ERROR = "ERROR"
    """The run can't be judged: it is empty, damaged, or ended by a fault."""


class InstanceVerdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """The verdict of an instance of a rule; symmetric instances share a verdict."""

    binding: tuple[tuple[str, str], ...]
    """Variables of the rule, and the names of the elements that the variables stand for."""
    status: Status
    responsible: tuple[str, ...] = ()
    """The vehicles bound to act, if the instance is violated or open."""
    trigger: int | None = None
    """First tick of the obligation that was violated, is open, or was discharged first."""
    failed: int | None = None
    """First tick from which on no continuation satisfies the instance."""
    broken: tuple[str, ...] = ()
    """The atoms that had the wrong value in that tick."""
    margin: float | None = None
    """How long before its permission the bound vehicle acted, negative if the vehicle waited [s].

    For vehicles that must never be together: the duration of their overlap [s]. None if the action or the permission is missing.
    """
    hangs: str = ""
    """The doubt on which an UNSURE instance depends, and its size."""


class NearMiss(msgspec.Struct, frozen=True):
    """The step in which a rule that never applied came closest to applying."""

    binding: tuple[tuple[str, str], ...]
    tick: int
    missing: tuple[str, ...]
    """Conjuncts of the premise that were false in the step."""
    steps: int
    """Number of equally close steps."""


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """The verdict of a rule on a run.

    The truth value of a verdict is the truth of "the run satisfies the rule". An NA, UNSURE or ERROR verdict has no truth value:
    ``bool()`` raises an error.
    """

    rule: str
    status: Status
    message: str
    """One line: the rule, the time, and the event."""
    reason: str = ""
    """Reason of the status; of NA and ERROR, in the same words for the same cause."""
    final: bool = False
    """True when no continuation of the run could change the status."""
    time: float | None = None
    """Time of the earliest violation, or of the beginning of the open obligation [s]."""
    counts: dict[str, int] = {}
    """Number of instances by outcome: fail, open, pass, "not triggered"."""
    collapsed: int = 0
    """Number of instances that the static model makes true; `counts` leaves them out."""
    instances: tuple[InstanceVerdict, ...] = ()
    """Verdicts of the instances, sorted by severity, then by time."""
    near: NearMiss | None = None
    violated: str = ""
    """The violated obligation, in the same words for all vehicles; groups failures."""
    roles: str = ""
    """The vehicles of the violation, in words that are the same for all rotations of a scenario."""
    asked: bool = True
    """Whether an instance bound the subject to act; without a subject, whether an instance was triggered."""
    unavoidable: bool = False
    """Whether no vehicle could have kept the violated rule; sessions count it apart, and it fails no test by default."""
    notes: tuple[str, ...] = ()
    """Further remarks, such as that no run could pass, or that a tie window decides."""
    explanation: str = ""
    """A block of text: the rule, the instance, its states, the vehicles bound to act, the beginning of the obligation."""
    requirement: str | None = None
    dt: float = 0.01
    """Time between two states [s]."""
    start: float = 0.0
    """Time of the first state on the clock of the recording [s]; `time` is on this clock, ticks count from the first state."""
    subject: str | None = None
    """The vehicle under test among traffic. The status then comes from the instances that the subject is to blame for, if any."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation; such a verdict fails no test of the subject."""
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
        """The outcome in reports: UNAVOIDABLE or PROVOKED if the verdict is unavoidable or provoked, else the status."""
        return Outcome.UNAVOIDABLE if self.unavoidable else Outcome.PROVOKED if self.provoked else Outcome(self.status.value)

    @property
    def cause(self) -> str:
        """The violated obligation and its vehicles, in the same words for the same violation in a rotated scenario."""
        return f"{self.violated} ({self.roles})" if self.roles else self.violated

    def record(self) -> dict[str, Any]:
        """Return the verdict as builtins for JSON, without the fields that have their default, as reports hold it."""
        content: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return content
