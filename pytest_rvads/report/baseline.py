"""What changed since a baseline: an earlier report of the same tests.

Items are compared by node id. A safety margin is time, so that one threshold serves them all: how long the bound vehicle
waited beyond what its rule asks for, and of the item's run the shortest time to collision and post-encroachment time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from msgspec import structs

from pytest_rvads.report.outcome import BAD, Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Change, Comparison, Report

__all__ = ["compare", "with_baseline"]


def compare(report: Report, baseline: Report, name: str, erosion: float, gone: Callable[[str], bool]) -> Comparison:
    """Return what changed between a baseline and a session.

    Args:
        report: of the session.
        baseline: the earlier report.
        name: what to call it.
        erosion: a margin that falls by more than this is told [s].
        gone: whether an item of the baseline that the session has no record of does not exist any more; otherwise it was
            not selected.
    """
    before = {record.nodeid: record for record in baseline.records}
    simulators = dict.fromkeys((before[r.nodeid].simulator, r.simulator) for r in report.records if r.nodeid in before)
    changes = [_change(record, before.pop(record.nodeid, None), erosion) for record in report.records]
    for nodeid, record in before.items():
        if gone(nodeid):
            changes += [Change("LOST", nodeid, f"was {record.status}, does not exist any more")] if _judged(record) else []
        else:
            changes.append(Change("OUTSIDE", nodeid))
    differences = [
        f"{package} was {baseline.versions[package]} and is {version}"
        for package, version in report.versions.items()
        if package in baseline.versions and baseline.versions[package] != version
    ]
    differences += [f"the simulator was {was} and is {now}" for was, now in simulators if was and now and was != now]
    return Comparison(name, tuple(changes), tuple(differences))


def with_baseline(report: Report, comparison: Comparison) -> Report:
    """Return the report with its comparison, and the kind of change in every record, under ``change``."""
    kinds = {change.nodeid: change.kind for change in comparison.changes}
    records = tuple(structs.replace(record, change=kinds[record.nodeid]) for record in report.records)
    return replace(report, records=records, comparison=comparison)


def _state(record: Record | None) -> str:
    """Return the meaning of an outcome, or ``absent`` or ``known``; whatever the verdicts, a failed item is no passed one."""
    if record is None:
        return "absent"
    if record.failed:
        # An error says nothing of what the verdict would be, so it is never the same as a violation.
        return record.status.meaning if record.status.bad else "violated"
    if record.known:
        return "known"
    return "passed" if record.status.meaning == "passed" else "idle"


def _judged(record: Record | None) -> bool:
    return record is not None and _state(record) != "idle"


def _change(record: Record, before: Record | None, erosion: float) -> Change:
    """Return what became of an item that the session has a record of."""
    if record.status is Outcome.NOT_RUN:
        # A skip that somebody wrote into a test is a choice; being too late, or interrupted, is none.
        chosen = record.outcome == "skipped" and not record.message.startswith("NOT RUN: ")
        if before and chosen and _judged(before):
            return Change("LOST", record.nodeid, f"was {before.status}, is skipped")
        return Change("NOT RUN", record.nodeid)
    # Another map under the same name is no basis.
    moved = before is not None and None not in (record.place, before.place) and record.place != before.place
    then, now = "absent" if moved else _state(before), _state(record)
    was = before.status.value if before else ""
    if now in BAD and then != now:
        changed = f"was {was}, is {record.status}: " if then in BAD else ""
        return Change("NEW", record.nodeid, changed + record.message.strip().partition("\n")[0])
    if moved and now not in BAD and _judged(before):
        return Change("LOST", record.nodeid, f"was {was}, at a junction that is not the same any more")
    kind, text = _kept(then, now)
    if kind == "UNCHANGED" and now == "passed" and before and (eroded := _erosion(record, before, erosion)):
        return Change("ERODED", record.nodeid, eroded)
    return Change(kind, record.nodeid, text.format(was=was, now=record.status, known=record.known))


def _kept(then: str, now: str) -> tuple[str, str]:
    """Return the kind of a change that is no new failure, and what to say of it."""
    match then, now:
        case (("violated" | "error" | "flaky" | "known"), "passed"):
            return "FIXED", ""
        case "passed", "known":
            return "KNOWN", "{known}"
        case (("passed" | "violated" | "error" | "flaky" | "known"), "idle"):
            return "LOST", "was {was}, is {now}"
        case ("absent", _) | ("idle", ("passed" | "known")):
            return "ADDED", ""
    return "UNCHANGED", ""


def _erosion(record: Record, before: Record, least: float) -> str:
    """Return which margins fell by more than `least` [s], or nothing."""
    now, then = _margins(record), _margins(before)
    return ", ".join(
        f"{name} {then[name]:.2f} -> {value:.2f} s" for name, value in now.items() if name in then and then[name] - value > least
    )


def _margins(record: Record) -> dict[str, float]:
    """Return the safety margins of an item [s], the larger the safer."""
    waits = [-i.margin for verdict in record.verdicts for i in verdict.instances if i.margin is not None]
    kpis = record.kpis
    found = {
        "margin": min(waits, default=None),
        "ttc": kpis.ttc if kpis else None,
        "pet": kpis.pet if kpis else None,
    }
    return {name: value for name, value in found.items() if value is not None}
