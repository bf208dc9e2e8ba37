"""Records: one plain dict per item, the only thing that reports are made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["JUDGED", "SEVERITY", "Record", "asked", "cell_record", "conclude", "flake", "not_run", "properties"]

Record = dict[str, Any]

SEVERITY = ("ERROR", "FLAKY", "FAIL", "NOT JUDGED", "OPEN", "UNAVOIDABLE", "PROVOKED", "PASS", "NA", "NOT RUN")
"""Every status of a record, the worst first.

UNAVOIDABLE: violated, and nobody could have kept the rule. PROVOKED: violated or open by the doing of the traffic, not of the
subject. NOT JUDGED: the test has a rule or a monitor and judged nothing.
"""
JUDGED = ("PASS", "FAIL", "OPEN")
"""Statuses in which something was found out about the system under test; a session without any of them is not green."""


def cell_record(
    nodeid: str, line: int, test: str, keys: Mapping[str, str | int], ways: int, requirements: Sequence[str] = ()
) -> Record:
    """Start the record of an item.

    Args:
        nodeid: of the item.
        line: of the test function in its file.
        test: name of the test function.
        keys: what selects the cell: junction, cls, scenario, cfg, rotation, and seat, traffic, rule where there is one.
        ways: number of entrances of the junction.
        requirements: identifiers of what scenario and rule trace to.
    """
    return {
        "nodeid": nodeid,
        "line": line,
        "test": test,
        "ways": ways,
        "seat": None,
        "traffic": None,
        "rule": None,
        "driver": "",
        **keys,
        "requirements": list(requirements),
    }


def asked(record: Record) -> bool:
    """Return whether a rule asked something of the system under test, of the subject where there is one, and got an answer."""
    given = any(v.get("asked", True) for v in record["verdicts"] if v["status"] in JUDGED)
    return record["status"] in JUDGED or (given and record["status"] != "ERROR")


def conclude(
    record: Record,
    verdicts: Sequence[Record],
    when: str,
    outcome: str,
    *,
    known: str | None = None,
    text: str = "",
    asserted: bool = True,
    judged: bool = True,
) -> None:
    """Complete a record when its item is over.

    Args:
        record: of the item, changed in place.
        verdicts: records of the verdicts given, in order.
        when: phase of the report.
        outcome: pytest's outcome.
        known: reason of the xfail that matched, or None.
        text: of the exception, or empty.
        asserted: whether the exception, if any, is a failed assertion; any other one is an error of the test.
        judged: False where the test has a rule or a monitor and did not judge, for which it failed.

    The status is that of the verdicts, worst first. A test of a run without rule and monitor is PASS or FAIL by its
    assertions. One that was skipped by somebody is NOT RUN; it never counts as a pass, and no failed test as anything but a
    failure.
    """
    worst = min(map(_status, verdicts), key=SEVERITY.index, default=None)
    if outcome == "failed":
        violated = worst if worst in ("FAIL", "OPEN", "UNAVOIDABLE") else "FAIL"
        status = "ERROR" if worst == "ERROR" or not (when == "call" and asserted) else violated
        status = status if judged else "NOT JUDGED"
    else:
        status = worst or ("NOT RUN" if when != "call" or outcome == "skipped" else "PASS")
    record |= {"status": status, "verdicts": list(verdicts), "known": known, "outcome": outcome, "message": text}


def _status(verdict: Record) -> str:
    for special in ("unavoidable", "provoked"):
        if verdict.get(special):
            return special.upper()
    return str(verdict["status"])


def flake(record: Record, what: str, time: float | None, text: str) -> None:
    """Turn the record of a failed item into FLAKY: the same start gave another run.

    Args:
        record: of the item, changed in place.
        what: the first field that differs.
        time: of the first state that does [s], None where it is not the states.
        text: the difference in one sentence.
    """
    record |= {"status": "FLAKY", "flaky": {"what": what, "time": time, "text": text}}


def not_run(record: Record, reason: str) -> Record:
    """Return the record of an item that was to run and did not, for a reason."""
    return record | {"status": "NOT RUN", "verdicts": [], "known": None, "outcome": "", "message": reason}


def properties(record: Record) -> list[tuple[str, Any]]:
    """Return the properties of an item for JUnit."""
    named = {
        "junction": record["junction"],
        "class": record["cls"],
        "scenario": record["scenario"],
        "configuration": record["cfg"],
        "rotation": record["rotation"],
        **({} if record["seat"] is None else {"seat": record["seat"], "traffic": record["traffic"]}),
        "rule": record["rule"] or record["test"],
        "verdict": record["status"],
        "driver": record["driver"],
    }
    return list(named.items())
