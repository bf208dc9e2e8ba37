"""What is known of a case that was simulated and judged: a line of a file of results."""

from __future__ import annotations

from typing import Annotated

import msgspec

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Count, SimulatedItem

__all__ = ["Glance", "Judged"]


class Judged(SimulatedItem, frozen=True, kw_only=True, omit_defaults=True, tag="judged"):
    """The record of a run with the verdict of every rule, in the order of the rules, and which case of a campaign it is.

    The id is that of the run. Of a case without a run every verdict is an ERROR. `by_rule` makes a record per rule of it.
    """

    case: str
    """Hash of the case; a case with a result is not run again."""
    number: Count = 0
    """Position of the case in the campaign."""
    shape: str = ""
    """Junction of the same shape at which the run was simulated; empty if it was simulated at the junction of the case."""
    line: Count = 0
    test: str = ""
    rotation: Count = 0
    seat: Count | None = None
    traffic: str | None = None
    rule: str | None = None
    requirements: tuple[str, ...] = ()
    status: Outcome = Outcome.NOT_RUN
    known: str | None = None
    outcome: str = ""
    message: str = ""

    @property
    def name(self) -> str:
        """Id of the run as in ids of items, without a rule."""
        return self.nodeid


class _Judgement(msgspec.Struct):
    status: Outcome
    unavoidable: bool = False
    provoked: bool = False

    @property
    def outcome(self) -> Outcome:
        return Outcome.UNAVOIDABLE if self.unavoidable else Outcome.PROVOKED if self.provoked else self.status


class Glance(msgspec.Struct):
    """What of a `Judged` is needed to know which ones a file has."""

    case: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    number: Count = 0
    verdicts: tuple[_Judgement, ...] = ()
