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

from pytest_rvads.report.record import Record

__all__ = ["Cause", "causes", "provoked", "unavoidable"]

_RULES = 3
"""Rules named per cause; the rest is counted."""


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
    return _grouped([record for record in records if record["outcome"] == "failed"])


def provoked(records: Sequence[Record]) -> list[Cause]:
    """Group what traffic did to a subject that is not to blame, likewise."""
    return _grouped([record for record in records if record["status"] == "PROVOKED"])


def unavoidable(records: Sequence[Record]) -> list[Cause]:
    """Group what nobody could have avoided and no test failed for, likewise."""
    return _grouped([record for record in records if record["status"] == "UNAVOIDABLE" and record["outcome"] != "failed"])


def _grouped(records: Sequence[Record]) -> list[Cause]:
    first: dict[Hashable, Record] = {}
    for record in records:
        if _explains(record):
            best = first.setdefault(record["hash"], record)
            if _time(record) < _time(best):
                first[record["hash"]] = record
    groups: dict[Hashable, list[tuple[Record, Record]]] = {}
    for record in records:
        teller = first[record["hash"]] if _explains(record) else record
        groups.setdefault(_signature(teller), []).append((teller, record))
    return sorted(map(_cause, groups.values()), key=lambda cause: -cause.count)


def _cause(group: Sequence[tuple[Record, Record]]) -> Cause:
    teller = group[0][0]
    verdict = _verdict(teller)
    rules = dict.fromkeys((_rule(teller), *(_rule(record) for _, record in group)))
    runs = {teller.get("hash") or teller["nodeid"]: teller for teller, _ in group}
    roles = Counter(v.get("roles", "") for t in runs.values() if (v := _verdict(t)))
    most = roles.most_common(1)[0][0] if len(roles) > 1 else ""
    text = _violated(teller)
    if verdict and len(roles) == 1 and verdict.get("roles"):
        text = f"{text} ({verdict['roles']})"
    nodeids = tuple(record["nodeid"] for _, record in group)
    return Cause(tuple(rules), text, nodeids, len(runs), teller["nodeid"], most)


def _explains(record: Record) -> bool:
    """Tell whether what a record says was violated can be behind other failures of its run."""
    verdict = _verdict(record)
    return bool(verdict and record.get("hash") and not verdict.get("unavoidable"))


def _verdict(record: Record) -> Record | None:
    """Return the verdict that gave a record its status, or None where something else did."""
    wanted = record["status"]
    if wanted not in ("FAIL", "OPEN", "PROVOKED", "UNAVOIDABLE"):
        return None
    flag = wanted.lower()
    return next((v for v in record["verdicts"] if v.get(flag) or v["status"] == wanted), None)


def _time(record: Record) -> tuple[float, str]:
    """Return when it was violated [s]; of several at the same time, the first by name tells."""
    verdict = _verdict(record)
    time = verdict.get("time") if verdict else None
    return (math.inf if time is None else time), _rule(record)


def _signature(record: Record) -> Hashable:
    """Return what records with the same cause share; numbers in messages are not part of it."""
    verdict = _verdict(record)
    if verdict:
        # What can't be kept is one cause, however it ended.
        return "" if verdict.get("unavoidable") else record["status"], _violated(record)
    # One fault of a stack is one cause, whatever rules would have judged its runs.
    rule = "" if record["status"] == "ERROR" else _rule(record)
    return record["status"], rule, re.sub(r"\d+(\.\d+)?", "#", _violated(record))


def _violated(record: Record) -> str:
    if record["status"] == "FLAKY":
        return "not deterministic: the same start gave another run"
    verdict = _verdict(record)
    text: str = (verdict.get("violated") or verdict["cause"]) if verdict else record["message"].strip().partition("\n")[0]
    return text


def _rule(record: Record) -> str:
    return record["rule"] or "run"
