"""Causes of failures: which of many failing items have one thing behind them.

One fault breaks several rules of a run: who enters too early also breaks the rules about those he meets. What broke first
explains the rest, so the failures of a run belong together, and runs belong together in which the same was violated first,
whoever it was. Grouping every failure by its own rule, violation and roles instead gave three times as many groups as faults,
measured with mutants of the reference autopilot (tests/report/test_triage.py).

What no autopilot could have avoided explains nothing else and is a cause of its own.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record, VerdictRecord

__all__ = ["Cause", "causes", "idle", "known", "provoked", "unavoidable", "unsure"]

_RULES = 3
"""Rules named per cause; the rest is counted."""
_INSTANCES = 3
"""Unsure instances of an item that are told; likewise."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Failures that look alike: in their runs the same was violated first."""

    rules: tuple[str, ...]
    """The rule that was violated first in the first of the runs, then the others."""
    text: str
    """What was violated first, without who did it."""
    nodeids: tuple[str, ...]
    """Its items."""
    runs: int
    example: str
    """Node id of the first item that tells it."""
    roles: str = ""
    """Who did it most often, up to rotation, where it was not always the same."""

    @property
    def count(self) -> int:
        """How many items it broke."""
        return len(self.nodeids)

    @property
    def rule(self) -> str:
        """The rules in a few words."""
        more = len(self.rules) - _RULES
        return ", ".join(self.rules[:_RULES]) + (f" and {more} more" if more > 0 else "")

    @property
    def line(self) -> str:
        """The cause in one line."""
        where = f", in {self.runs} runs" if self.runs > 1 else ""
        return f"{self.text}{where}{f', mostly {self.roles}' if self.roles else ''}"


def causes(records: Sequence[Record]) -> list[Cause]:
    """Group unexpected failures by their cause, the most frequent first."""
    return _grouped([record for record in records if record.failed])


def provoked(records: Sequence[Record]) -> list[Cause]:
    """Group what traffic did to a subject that is not to blame, likewise."""
    return _grouped([record for record in records if record.status is Outcome.PROVOKED])


def unavoidable(records: Sequence[Record]) -> list[Cause]:
    """Group what nobody could have avoided and no test failed for, likewise."""
    return _grouped([record for record in records if record.status is Outcome.UNAVOIDABLE and not record.failed])


def unsure(records: Sequence[Record]) -> list[Cause]:
    """Group what is UNSURE, and failed no test, by what it hangs on, likewise."""
    return _worded([(_hanging(record), record) for record in records if record.status is Outcome.UNSURE and not record.failed])


def known(records: Sequence[Record]) -> list[Cause]:
    """Group known failures by what they are known as, likewise."""
    return _worded([(record.known, record) for record in records if record.known])


def idle(records: Sequence[Record]) -> list[Cause]:
    """Group what neither passed nor failed, is no known failure and not UNSURE, by the reason given, likewise."""
    rest = [record for record in records if not (record.failed or record.known or record.outcome == "passed")]
    told = [record for record in rest if record.message and record.status is not Outcome.UNSURE]
    return _worded([(_first_line(record), record) for record in told])


def _worded(told: Sequence[tuple[str, Record]]) -> list[Cause]:
    """Group records of which the same is told."""
    groups: dict[str, list[Record]] = {}
    for text, record in told:
        groups.setdefault(text, []).append(record)
    found = [
        Cause(
            rules=tuple(dict.fromkeys(record.asks for record in group)),
            text=text,
            nodeids=tuple(record.nodeid for record in group),
            runs=len({record.hash or record.nodeid for record in group}),
            example=group[0].nodeid,
        )
        for text, group in groups.items()
    ]
    return sorted(found, key=lambda cause: -cause.count)


def _grouped(records: Sequence[Record]) -> list[Cause]:
    first: dict[Hashable, Record] = {}
    for record in records:
        if _explains(record):
            best = first.setdefault(record.hash, record)
            if _time(record) < _time(best):
                first[record.hash] = record
    groups: dict[Hashable, list[tuple[Record, Record]]] = {}
    for record in records:
        teller = first[record.hash] if _explains(record) else record
        groups.setdefault(_signature(teller), []).append((teller, record))
    return sorted(map(_cause, groups.values()), key=lambda cause: -cause.count)


def _cause(group: Sequence[tuple[Record, Record]]) -> Cause:
    teller = group[0][0]
    verdict = _verdict(teller)
    rules = dict.fromkeys((teller.asks, *(record.asks for _, record in group)))
    runs = {teller.hash or teller.nodeid: teller for teller, _ in group}
    roles = Counter(v.roles for t in runs.values() if (v := _verdict(t)))
    most = roles.most_common(1)[0][0] if len(roles) > 1 else ""
    text = _violated(teller)
    if verdict and len(roles) == 1 and verdict.roles:
        text = f"{text} ({verdict.roles})"
    nodeids = tuple(record.nodeid for _, record in group)
    return Cause(tuple(rules), text, nodeids, len(runs), teller.nodeid, most)


def _explains(record: Record) -> bool:
    """Tell whether what a record says was violated can be behind other failures of its run."""
    verdict = _verdict(record)
    return bool(verdict and record.hash and not verdict.unavoidable)


def _verdict(record: Record) -> VerdictRecord | None:
    """Return the verdict that gave a record its status, or None where something else did."""
    wanted = record.status
    if wanted is Outcome.ERROR:
        return None
    return next((verdict for verdict in record.verdicts if wanted in (verdict.outcome, verdict.status)), None)


def _time(record: Record) -> tuple[float, str]:
    """Return when it was violated [s]; of several at the same time, the first by name tells."""
    verdict = _verdict(record)
    return (math.inf if verdict is None or verdict.time is None else verdict.time), record.asks


def _signature(record: Record) -> Hashable:
    """Return what records with the same cause share; numbers in messages are not part of it."""
    verdict = _verdict(record)
    if verdict:
        # What can't be kept is one cause, however it ended.
        return "" if verdict.unavoidable else record.status, _violated(record)
    # One fault of a stack is one cause, whatever rules would have judged its runs.
    rule = "" if record.status is Outcome.ERROR else record.asks
    return record.status, rule, re.sub(r"\d+(\.\d+)?", "#", _violated(record))


def _violated(record: Record) -> str:
    if record.status is Outcome.FLAKY:
        return "not deterministic: the same start gave another run"
    if record.status is Outcome.UNSURE:
        return _hanging(record)
    verdict = _verdict(record)
    return (verdict.violated or verdict.cause) if verdict else _first_line(record)


def _hanging(record: Record) -> str:
    """Return what an unsure record hangs on."""
    verdict = _verdict(record)
    told = verdict.hangs if verdict else ()
    more = len(told) - _INSTANCES
    return "; ".join(told[:_INSTANCES]) + (f" and {more} more" if more > 0 else "") or _first_line(record)


def _first_line(record: Record) -> str:
    return record.message.strip().partition("\n")[0]
