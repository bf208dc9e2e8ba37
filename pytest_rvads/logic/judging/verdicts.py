"""Verdicts: what a rule says about a run. Reports and files of results hold these values as they are."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec

from pytest_rvads.displayed import shown
from pytest_rvads.errors import RunError
from pytest_rvads.outcome import Outcome

__all__ = ["InstanceVerdict", "NearMiss", "Status", "Verdict"]


class Status(StrEnum):
    """The outcome of judging a run by a rule."""

    PASS = "PASS"
    """Triggered, and every obligation discharged."""
    FAIL = "FAIL"
    """Violated, whatever would have followed."""
    OPEN = "OPEN"
    """An obligation was still open when the run ended."""
    UNSURE = "UNSURE"
    """Another reading of what was recorded, within its accuracy, would change the verdict."""
    NA = "NA"
    """The rule is about something else, or was never triggered."""
    ERROR = "ERROR"
    """The run can't be judged: it is empty, damaged, or ended by a fault."""


class InstanceVerdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """What one instance of a rule says; symmetric instances are one."""

    binding: tuple[tuple[str, str], ...]
    """Variables of the rule and the names they stand for."""
    status: Status
    responsible: tuple[str, ...] = ()
    """The vehicles bound to act, when violated or open."""
    trigger: int | None = None
    """Tick since which the obligation exists that was violated, is open, or was discharged first."""
    failed: int | None = None
    """Tick at which no continuation could repair it any more."""
    broken: tuple[str, ...] = ()
    """What was not as it had to be, in that tick."""
    margin: float | None = None
    """How long before it was allowed the bound vehicle acted, negative when it waited; seconds of overlap where two
    must never be together [s]. None where one of the two events is missing."""
    hangs: str = ""
    """Of what is UNSURE, what it hangs on, and by how much."""


class NearMiss(msgspec.Struct, frozen=True):
    """The step in which a rule that never applied came closest to applying."""

    binding: tuple[tuple[str, str], ...]
    tick: int
    missing: tuple[str, ...]
    """Conjuncts of the premise that were false then."""
    steps: int
    """How many steps were as close as this one."""


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """The verdict of one rule on one run.

    Its truth value is that of "the run satisfies the rule"; an NA verdict has none and refuses.
    """

    rule: str
    status: Status
    message: str
    """One line: rule, time, what happened."""
    reason: str = ""
    """Of NA and ERROR, the same words for the same cause."""
    final: bool = False
    """True when no continuation of the run could change the status."""
    time: float | None = None
    """Of the earliest violation, or since when the obligation is open [s]."""
    counts: dict[str, int] = {}
    """Instances by outcome: fail, open, pass, "not triggered"."""
    collapsed: int = 0
    """Instances that what is static makes true; they are in no count."""
    instances: tuple[InstanceVerdict, ...] = ()
    """The worst first, the earliest of them first."""
    near: NearMiss | None = None
    violated: str = ""
    """What was violated, in the same words whoever did it: groups failures."""
    roles: str = ""
    """Which vehicles it was, in words that are the same for all rotations of a scenario."""
    asked: bool = True
    """Whether an instance bound the subject to act; without a subject, whether any was triggered."""
    unavoidable: bool = False
    """Violated, but nobody could have kept it: a session counts it apart, and it fails no test by default."""
    notes: tuple[str, ...] = ()
    """What else should be known: that no run could pass, that a tie window decides."""
    explanation: str = ""
    """A block of text: the rule, the instance, the states before and after, who had to act and since when."""
    requirement: str | None = None
    dt: float = 0.01
    """Time between two states [s]."""
    start: float = 0.0
    """Time of the first state on the clock of the recording, which `time` is on [s]; ticks count from it."""
    subject: str | None = None
    """The vehicle under test, where the others are traffic; the status is then that of what it is to blame for, if anything."""
    provoked: bool = False
    """Violated or open, but by the doing of the traffic alone: nothing for a test of the subject to fail by."""
    title: str = ""
    """Of the rule, in words."""
    responsible: tuple[str, ...] = ()
    """The vehicles responsible for violated or open instances, the earliest first, each once."""

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
        """What reports say of it: the status, or UNAVOIDABLE or PROVOKED where it is."""
        return Outcome.UNAVOIDABLE if self.unavoidable else Outcome.PROVOKED if self.provoked else Outcome(self.status.value)

    @property
    def cause(self) -> str:
        """What was violated and by whom: the same words for the same violation in a rotated scenario."""
        return f"{self.violated} ({self.roles})" if self.roles else self.violated

    def record(self) -> dict[str, Any]:
        """Return the verdict as builtins that JSON has too, without what has its default, as reports hold it."""
        content: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return content
