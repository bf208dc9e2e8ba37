"""The command ``rvads report``: merges reports of sessions or results of campaigns into a report, checks and compares reports.

Several sessions, such as the shards of a CI job, are merged into one report.
"""

from __future__ import annotations

import argparse
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, number, say, share, show, warn
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import (
    NOTHING_JUDGED,
    UNFINISHED,
    Cell,
    Drawn,
    Extent,
    Report,
    cell_of,
    exit_status,
    in_order,
    steady,
)
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

_SHOWN = 10
"""Largest number of contradictions between merged reports that are listed; further contradictions are counted."""
_PERCENT, _SECONDS = number("percentage", 0, 100), number("number of seconds", 0, 3600)


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads report`` to the parser."""
    report = commands.add_parser("report", help="merge, compare or check the reports of sessions and campaigns")
    actions = report.add_subparsers(required=True, metavar="ACTION")
    merge = actions.add_parser(
        "merge",
        help="merge reports, such as the shards of a CI job, or results of a campaign into one report, and print its summary",
        description="Exit status: the status of a session with all items; 1 if reports contradict each other or coverage is too "
        "low; 2 if a report is missing, damaged or incomplete, or the campaign did not come to its end. A case that is in "
        "several files of results counts once.",
    )
    merge.add_argument(
        "files", nargs="+", metavar="FILE", help="written by --rvads-report (.json), or by rvads.campaign or rvads town (.jsonl)"
    )
    share(merge, "output", action="append", default=[], help="write a report, in the format of its ending; repeatable")
    merge.add_argument(
        "--cov-fail-under",
        type=_PERCENT,
        metavar="N",
        help="as --rvads-cov-fail-under, for the merged report [%%]",
    )
    merge.add_argument("--cov-arrivals", type=_SECONDS, metavar="SECONDS", help="as --rvads-cov-arrivals, for the merged report")
    share(merge, "baseline")
    merge.set_defaults(command=_print_merged)
    check = actions.add_parser(
        "check",
        help="show whether sessions came to their end, and with which exit status",
        description="Exit status: 2 if a report is missing, damaged, or incomplete because its session has not ended or died; "
        "else the status of the first session that did not end with 0.",
    )
    check.add_argument("files", nargs="+", metavar="FILE.json", help="written by --rvads-report")
    check.set_defaults(command=_check_reports)
    compare = actions.add_parser(
        "compare",
        help="show sessions side by side; of two, the verdicts that differ",
        description="Items are matched by their ids: run the same tests twice, with the code before and after a change, or with "
        "several controllers. Exit status: 0 if the sessions were compared, whatever the differences; 1 if there is a difference "
        "that --fail-on names; 2 if a report is missing or damaged, or has no item in common with the first.",
    )
    compare.add_argument(
        "files",
        nargs="+",
        metavar="FILE.json",
        help="reports of the earlier and of the later session, or of two or more controllers (--rvads-report)",
    )
    share(
        compare,
        "output",
        action="append",
        default=[],
        help="also write the comparison, as FILE.html, FILE.md or FILE.json; other formats of reports hold the later session "
        "with the changes; repeatable",
    )
    compare.add_argument(
        "--fail-on",
        metavar="KIND",
        action="append",
        default=[],
        choices=("new", "eroded", "lost"),
        help="exit with 1 if an item is new (fails in B and did not in A), eroded (passes with a smaller margin) or lost (was "
        "judged in A and is not in B); repeatable",
    )
    compare.set_defaults(command=_compare)


def _print_merged(options: argparse.Namespace) -> int:
    from pytest_rvads.report.figures import shortfall, untested
    from pytest_rvads.report.files import fitting, load, recovered, save
    from pytest_rvads.report.session_report import compare, with_baseline
    from pytest_rvads.support.installed import load as installed

    paths = list(map(fitting, options.output))
    with ExitStack() as stack:
        if any(name.endswith(".jsonl") for name in options.files):
            report: Report = stack.enter_context(installed("results", "campaign")(options.files)).report()
        else:
            report = merge([(name, recovered(Path(name))) for name in options.files])
        if options.baseline:
            planned = set(report.planned)
            earlier = load(Path(options.baseline))
            lost = {record.nodeid for record in earlier.records if cell_of(record) not in planned}
            report = with_baseline(report, compare(report, earlier, options.baseline, lost.__contains__))
        for path in paths:
            save(path, report)
        show(report)
        gates = (
            "" if options.cov_fail_under is None else shortfall(report, options.cov_fail_under),
            "" if options.cov_arrivals is None else untested(report, options.cov_arrivals),
        )
        for note in filter(None, (*report.notes, *gates)):
            warn(f"rvads: {note}")
        return report.ended or int(any(gates))


def _compare(options: argparse.Namespace) -> int:
    from pytest_rvads.report.files import fitting, recovered
    from pytest_rvads.report.side_by_side import save, side_by_side, text

    outputs = list(map(fitting, options.output))
    if len(options.files) < 2 or (options.fail_on and len(options.files) > 2):
        wanted = "two reports" if options.fail_on else "two or more reports"
        raise RvadsError(f"rvads report compare takes {wanted}, got {len(options.files)}: name such files")
    sessions = side_by_side([(name, recovered(Path(name))) for name in options.files])
    print(text(sessions, shutil.get_terminal_size().columns))
    for path in outputs:
        save(path, sessions)
    return int(sessions.comparison.count(*map(str.upper, options.fail_on)) > 0)


def _check_reports(options: argparse.Namespace) -> int:
    from pytest_rvads.report.files import recovered

    statuses = []
    for file in map(Path, options.files):
        try:
            report = recovered(file)
        except RvadsError as error:
            warn(f"rvads: {error}")
            statuses.append(UNFINISHED)
            continue
        for note in report.notes:
            warn(f"rvads: {file}: {one_line(note)}")
        if report.complete:
            say(f"{file}: complete, {len(report.records)} items, exit status {report.exitstatus}")
        statuses.append(report.ended)
    return UNFINISHED if UNFINISHED in statuses else next(filter(None, statuses), 0)


def merge(reports: Sequence[tuple[str, Report]]) -> Report:
    """Return one report on the test items of several sessions.

    If several sessions ran a test item, the worst verdict counts. A note lists the items whose verdicts or runs differ between
    sessions: the code changed, or the autopilot is not deterministic. An item has run if any session ran the item.
    """
    _refuse_strangers(reports)
    records: dict[str, tuple[str, Record]] = {}
    clashes: list[str] = []
    notes: list[str] = []
    planned: dict[Cell, None] = {}
    totals: dict[int, tuple[int, int]] = {}
    versions: dict[str, dict[str, str]] = {}  # by package and version, the first report with it
    left_out: dict[str, int] = {}
    unfit: dict[str, int] = {}
    seconds: Counter[str] = Counter()
    extents: dict[str, Extent] = {}
    refused: dict[str, dict[str, None]] = {}
    drawn: dict[Drawn, None] = {}
    for name, report in reports:
        for record in report.records:
            earlier_name, earlier = records.setdefault(record.nodeid, (name, record))
            if earlier is record:
                continue
            if Outcome.NOT_RUN not in (earlier.status, record.status):
                if earlier.status != record.status:
                    clashes.append(f"{record.nodeid} is {earlier.status} in {earlier_name} and {record.status} in {name}")
                elif earlier.hash != record.hash:
                    both = f"{record.nodeid} is {record.status} in both {earlier_name} and {name}"
                    clashes.append(f"{both}, but of different runs")
            if record.status.severity < earlier.status.severity:
                records[record.nodeid] = name, record
        for package, version in report.versions.items():
            versions.setdefault(package, {}).setdefault(version, name)
        for site, extent in report.extents.items():
            before = extents.get(site, extent)
            extents[site] = Extent(
                turns=extent.turns,
                classes=before.classes | extent.classes,
                partial=before.partial | extent.partial,
                pairs=before.pairs or extent.pairs,
                conflicts=before.conflicts or extent.conflicts,
            )
        for reason, names in report.refused.items():
            refused.setdefault(reason, {}).update(dict.fromkeys(names))
        notes += [f"{name}: {note}" for note in report.notes]
        planned |= dict.fromkeys(report.planned)
        drawn |= dict.fromkeys(report.drawn)
        totals |= report.totals
        left_out |= report.left_out
        unfit |= report.unfit
        seconds.update(report.seconds)
    notes += clashes[:_SHOWN]
    if len(clashes) > _SHOWN:
        notes.append(f"... and {len(clashes) - _SHOWN} more contradictions between the merged reports")
    differences = [
        f"versions differ: {package} " + ", ".join(f"{version} in {name}" for version, name in names.items())
        for package, names in versions.items()
        if len(names) > 1
    ]
    merged = in_order(list(steady(record for _, record in records.values())))
    # A failure that was expected, or that an option lets pass, does not fail the merged session either.
    outcomes = {Outcome.FAIL if r.failed else Outcome.PASS if r.status.judges else Outcome.NA for r in merged}
    outcomes |= {Outcome.ERROR} if clashes else set()
    # A shard that judged nothing does no harm if another judged.
    worst = max((report.ended for _, report in reports if report.ended != NOTHING_JUDGED), default=0)
    return Report(
        merged,
        totals,
        tuple(sorted(planned, key=str)),
        {package: ", ".join(names) for package, names in versions.items()},
        worst or exit_status(outcomes),
        tuple(differences + notes),
        left_out,
        seconds=dict(seconds),
        unfit=unfit,
        extents=extents,
        complete=all(report.complete for _, report in reports),
        project=next((report.project for _, report in reports if report.project), ""),
        refused={reason: tuple(names) for reason, names in refused.items()},
        drawn=tuple(drawn),
        began=min((report.began for _, report in reports if report.began), default=""),
        command=", ".join(dict.fromkeys(report.command for _, report in reports if report.command)),
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
