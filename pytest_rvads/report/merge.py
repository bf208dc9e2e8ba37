"""Merging the reports of several sessions, such as the shards of a CI job, into one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import NOTHING_JUDGED, Cell, Extent, Report, exit_status, in_order, steady
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import first

__all__ = ["merge"]

_SHOWN = 10
"""Contradictions listed; the rest is counted."""
_COMMANDS = 3
"""Commands of sessions named; likewise."""


def merge(reports: Sequence[tuple[str, Report]]) -> Report:
    """Return one report over what several sessions ran.

    Of an item that several of them ran, the worst verdict counts, and a difference is noted: verdicts or runs that
    differ come from other code or from an autopilot that is not deterministic. What did not run in one and did in
    another has run.

    Args:
        reports: with the name to call each by.

    Raises:
        RvadsError: a report has no records, or two are no parts of one session: their projects differ, or one name stands for
            different maps, formulas or code.
    """
    _refuse_strangers(reports)
    records: dict[str, tuple[str, Record]] = {}
    clashes: list[str] = []
    for name, report in reports:
        for record in report.records:
            known = records.setdefault(record.nodeid, (name, record))
            if known[1] is not record:
                clash = _clash(known, (name, record))
                clashes += [clash] if clash else []
                records[record.nodeid] = min(known, (name, record), key=lambda found: found[1].status.severity)
    notes = [f"{name}: {note}" for name, report in reports for note in report.notes]
    notes += clashes[:_SHOWN]
    if len(clashes) > _SHOWN:
        notes.append(f"... and {len(clashes) - _SHOWN} more contradictions between the merged reports")
    versions, differences = _versions(reports)
    planned: dict[Cell, None] = dict.fromkeys(cell for _, report in reports for cell in report.planned)
    merged = in_order(list(steady(record for _, record in records.values())))
    return Report(
        merged,
        {ways: total for _, report in reports for ways, total in report.totals.items()},
        tuple(sorted(planned, key=str)),
        versions,
        _exitstatus([report for _, report in reports], merged, bool(clashes)),
        tuple(differences + notes),
        {test: count for _, report in reports for test, count in report.left_out.items()},
        seconds=_seconds([report for _, report in reports]),
        unfit={test: count for _, report in reports for test, count in report.unfit.items()},
        extents=_extents([report for _, report in reports]),
        complete=all(report.complete for _, report in reports),
        project=next((report.project for _, report in reports if report.project), ""),
        refused=_refused([report for _, report in reports]),
        drawn=tuple(dict.fromkeys(drawn for _, report in reports for drawn in report.drawn)),
        began=min((report.began for _, report in reports if report.began), default=""),
        command=first(list(dict.fromkeys(report.command for _, report in reports if report.command)), _COMMANDS),
    )


def _refuse_strangers(reports: Sequence[tuple[str, Report]]) -> None:
    earlier_values: dict[str, tuple[str, set[str]]] = {}
    for name, report in reports:
        if not report.records:
            raise RvadsError(f"{name} has no items, so it is no part of a session: leave it out, or look why it has none")
        origins: dict[str, set[str]] = {"project": {report.project}}
        for record in report.records:
            test = record.nodeid.partition("[")[0]
            origins.setdefault(f"map of {record.junction} in {test}", set()).add(record.place or "")
            if isinstance(record, SimulatedItem):
                origins.setdefault(f"code of {record.driver} in {test}", set()).add(record.source)
            origins.setdefault(f"formula of {record.rule}", set()).add(record.formula)
        for subject, values in origins.items():
            if present := values - {""}:
                earlier_name, before = earlier_values.setdefault(subject, (name, present))
                if not before & present:
                    raise RvadsError(f"{earlier_name} and {name} are no parts of one session: they differ in the {subject}")


def _clash(named_record: tuple[str, Record], other_named_record: tuple[str, Record]) -> str:
    """Return how two records of the same item contradict each other, or nothing."""
    (name, a), (other_name, b) = named_record, other_named_record
    if Outcome.NOT_RUN in (a.status, b.status):
        return ""
    if a.status != b.status:
        return f"{a.nodeid} is {a.status} in {name} and {b.status} in {other_name}"
    if a.hash != b.hash:
        return f"{a.nodeid} is {a.status} in both {name} and {other_name}, but of different runs"
    return ""


def _versions(reports: Sequence[tuple[str, Report]]) -> tuple[dict[str, str], list[str]]:
    """Return the versions of all reports, and a sentence for each that differs between them."""
    versions: dict[str, dict[str, str]] = {}
    for name, report in reports:
        for package, version in report.versions.items():
            versions.setdefault(package, {}).setdefault(version, name)
    differences = [
        f"versions differ: {package} " + ", ".join(f"{version} in {name}" for version, name in names.items())
        for package, names in versions.items()
        if len(names) > 1
    ]
    return {package: ", ".join(names) for package, names in versions.items()}, differences


def _extents(reports: Sequence[Report]) -> dict[str, Extent]:
    """Return how much there is to cover, by what any of the sessions asked for."""
    extents: dict[str, Extent] = {}
    for name, extent in (entry for report in reports for entry in report.extents.items()):
        earlier = extents.get(name, extent)
        extents[name] = Extent(
            turns=extent.turns,
            classes=earlier.classes | extent.classes,
            partial=earlier.partial | extent.partial,
            pairs=earlier.pairs or extent.pairs,
            conflicts=earlier.conflicts or extent.conflicts,
        )
    return extents


def _refused(reports: Sequence[Report]) -> dict[str, tuple[str, ...]]:
    """Return why junctions are left out, by any of the sessions."""
    found: dict[str, dict[str, None]] = {}
    for reason, names in (entry for report in reports for entry in report.refused.items()):
        found.setdefault(reason, {}).update(dict.fromkeys(names))
    return {reason: tuple(names) for reason, names in found.items()}


def _seconds(reports: Sequence[Report]) -> dict[str, float]:
    """Return how long the runs took, those whose items were split in all."""
    seconds: Counter[str] = Counter()
    for report in reports:
        seconds.update(report.seconds)
    return dict(seconds)


def _exitstatus(reports: Sequence[Report], records: Sequence[Record], clashed: bool) -> int:
    """Return the exit status of a session that had run all this.

    A shard in which nothing was applicable (5) is no trouble as long as another one judged something.
    """
    # A failure that was expected, or that an option lets pass, does not fail the whole either.
    outcomes = {Outcome.FAIL if r.failed else Outcome.PASS if r.status.judges else Outcome.NA for r in records}
    worst = max((report.ended for report in reports if report.ended != NOTHING_JUDGED), default=0)
    return worst or exit_status(outcomes | ({Outcome.ERROR} if clashed else set()))
