"""Records: one plain dict per item, the only thing that reports are made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["SEVERITY", "Record", "cell_record", "conclude", "flake", "not_run", "properties"]

Record = dict[str, Any]

SEVERITY = ("ERROR", "FLAKY", "FAIL", "OPEN", "PROVOKED", "PASS", "NA", "NOT JUDGED", "NOT RUN")
"""Every status of a record, the worst first. PROVOKED: violated or open by the doing of the traffic, not of the subject."""

_WORST = ("ERROR", "FAIL", "OPEN", "PROVOKED", "PASS", "NA")


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
        **keys,
        "requirements": list(requirements),
    }


def conclude(
    record: Record,
    verdicts: Sequence[Record],
    when: str,
    outcome: str,
    *,
    known: str | None = None,
    text: str = "",
    asserted: bool = True,
    monitored: bool = True,
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
        monitored: whether the test has a rule or a monitor to judge with.

    The status is that of the verdicts, worst first. A test of a run without rule and monitor is PASS or FAIL by its
    assertions. A test that has one and never judged is NOT JUDGED, one that was skipped by somebody NOT RUN; neither
    ever counts as a pass, and no failed test as anything but a failure.
    """
    given = ["PROVOKED" if v.get("provoked") else v["status"] for v in verdicts]
    worst = min(given, key=_WORST.index, default=None)
    if outcome == "failed":
        status = worst if worst in ("ERROR", "FAIL", "OPEN") else "FAIL" if when == "call" and asserted else "ERROR"
    elif worst:
        status = worst
    elif when != "call" or outcome == "skipped":
        status = "NOT RUN"
    else:
        status = "NOT JUDGED" if monitored else "PASS"
    record |= {"status": status, "verdicts": list(verdicts), "known": known, "outcome": outcome, "message": text}


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
    }
    return list(named.items())
