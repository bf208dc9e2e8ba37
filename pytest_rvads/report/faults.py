"""Describes the failure of a test item from its record: the violated obligation, the time, and a key of its cause."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record

_INSTANCES = 3
"""Largest number of unsure instances that are described per test item; further instances are counted."""
_VARIES = re.compile(r"0x[0-9a-fA-F]+|\d+([.,]\d+)*(e[+-]?\d+)?")
"""Matches the parts in which messages of one fault differ: vehicle numbers, times, line numbers, memory addresses."""


def verdict_of(record: Record) -> Verdict | None:
    """Return the verdict from which a record has its status; None if the status comes from an error or an exception."""
    status = record.status
    if status is Outcome.ERROR:
        return None
    return next((verdict for verdict in record.verdicts if status in (verdict.outcome, verdict.status)), None)


def time_of(record: Record) -> tuple[bool, float, str]:
    """Return the key by which failures of a run are sorted: violations by their times [s], then open obligations.

    An obligation becomes overdue at the end of the run, whenever it began. Records with the same time are ordered by the names of
    their rules.
    """
    verdict = verdict_of(record)
    time = math.inf if verdict is None or verdict.time is None else verdict.time
    return record.status is Outcome.OPEN, time, record.asks


def signature(record: Record) -> Hashable:
    """Return a key that is equal for records with the same cause, without the parts of messages that differ."""
    verdict = verdict_of(record)
    if verdict is not None:
        # Violations of a rule that no vehicle could have kept are one cause, whatever their status.
        return "" if verdict.unavoidable else record.status, violated(record)
    # A fault of a stack is one cause, whatever rules would have judged its runs. So is a stack that is not deterministic.
    rule = "" if record.status in (Outcome.ERROR, Outcome.FLAKY) else record.asks
    return record.status, rule, _VARIES.sub("#", violated(record))


def violated(record: Record) -> str:
    """Return the violated obligation or the error of a record in words."""
    if record.status is Outcome.FLAKY:
        repeated = record.flaky and record.flaky.what == "status"
        return f"not deterministic: the same start gave another {'verdict' if repeated else 'run'}"
    if record.status is Outcome.UNSURE:
        return hanging(record)
    verdict = verdict_of(record)
    if verdict is None:
        return first_line(record).removeprefix(f"{record.asks} {Outcome.ERROR}: ")
    obligation = verdict.violated
    return (
        obligation.replace("open: ", "still owed at the end of the run: ", 1) if obligation.startswith("open: ") else obligation
    )


def hanging(record: Record) -> str:
    """Return the doubts (events within the accuracy of a recording) that make the verdict of a record UNSURE, in words."""
    verdict = verdict_of(record)
    if verdict is None:
        return first_line(record)
    unsure = [instance for instance in verdict.instances if instance.status is Status.UNSURE and instance.hangs]
    doubts = [f"{', '.join(f'{name}={value}' for name, value in i.binding)}: {i.hangs}" for i in unsure]
    doubts = doubts or [verdict.reason]
    more = len(doubts) - _INSTANCES
    return "; ".join(doubts[:_INSTANCES]) + (f" and {more} more" if more > 0 else "") or first_line(record)


def first_line(record: Record) -> str:
    """Return the first line of a record's message."""
    return record.message.strip().partition("\n")[0]
