"""``rvads report``: what can be done with the reports that ``--rvads-report=FILE.json`` wrote."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, say, show, warn
from pytest_rvads.report.session_report import UNFINISHED
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    report = commands.add_parser(
        "report", help="merge or compare the reports of sessions, or tell whether they are whole; make those of a campaign"
    )
    actions = report.add_subparsers(required=True, metavar="ACTION")
    merge = actions.add_parser(
        "merge",
        help="make one report of several, such as the shards of a CI job, and print its summary",
        description="Exit status: that of a session which had run everything; 1 when reports contradict each other or coverage "
        "is too low; 2 when one is missing, damaged or incomplete.",
    )
    merge.add_argument("files", nargs="+", metavar="FILE.json", help="written by --rvads-report")
    merge.add_argument("-o", "--output", metavar="OUT", help="write the merged report, in the format of its ending")
    merge.add_argument("--cov-fail-under", type=_percent, metavar="N", help="as --rvads-cov-fail-under, for the whole [%%]")
    merge.add_argument("--baseline", metavar="FILE.json", help="tell what changed since an earlier report")
    merge.add_argument("--baseline-of", choices=("same", "any"), default="same", help="as --rvads-baseline-of (default same)")
    merge.add_argument("--erosion", type=_seconds, default=0.5, metavar="SECONDS", help="as --rvads-erosion (default 0.5)")
    merge.set_defaults(command=_merge)
    check = actions.add_parser(
        "check",
        help="tell whether sessions came to their end, and how",
        description="Exit status: 2 when a report is missing, damaged, or incomplete because its session has not ended or died; "
        "else that of the first session that did not end with 0.",
    )
    check.add_argument("files", nargs="+", metavar="FILE.json", help="written by --rvads-report")
    check.set_defaults(command=_check)
    compare = actions.add_parser(
        "compare",
        help="show two sessions side by side: what each was, and in what their verdicts differ",
        description="Items are matched by their ids: run the same tests twice, with the code before and after a change, or with "
        "one controller and another. Exit status: 0 when the difference was told, whatever it is; 1 when there is one that "
        "--fail-on names; 2 when a report is missing or damaged, or the two have no item in common.",
    )
    compare.add_argument("a", metavar="A.json", help="written by --rvads-report; the earlier one, or that of one controller")
    compare.add_argument("b", metavar="B.json", help="the later one, or that of another controller")
    compare.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        action="append",
        default=[],
        help="write the comparison too, as FILE.html, FILE.md or FILE.json, or in another format of reports B with what changed "
        "since A; repeatable",
    )
    compare.add_argument("--erosion", type=_seconds, default=0.5, metavar="SECONDS", help="as --rvads-erosion (default 0.5)")
    compare.add_argument(
        "--fail-on",
        metavar="KIND",
        action="append",
        default=[],
        choices=("new", "eroded", "lost"),
        help="exit with 1 when an item is new (fails in B and did not in A), eroded (passes with less of a margin) or lost (was "
        "judged in A and is not in B); repeatable",
    )
    compare.set_defaults(command=_compare)
    make = actions.add_parser(
        "make",
        help="make the reports of a campaign from its results, and print its summary",
        description="Takes the results of one campaign, or of parts of it that ran apart; a case that is in several counts once. "
        "Exit status: 0 if all is well, 1 if something is wrong, 2 if the campaign did not come to its end, 5 if nothing was "
        "judged.",
    )
    make.add_argument("files", nargs="+", metavar="RESULTS.jsonl", help="written by rvads.campaign or rvads town")
    make.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        action="append",
        default=[],
        help="write a report, in the format of its ending; repeatable",
    )
    make.set_defaults(command=_make)


def _percent(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 100:
        raise ValueError
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 3600:
        raise ValueError
    return value


_percent.__name__, _seconds.__name__ = "percentage", "number of seconds"  # argparse names them in its messages


def _merge(options: argparse.Namespace) -> int:
    from pytest_rvads.report.baseline import compare, with_baseline
    from pytest_rvads.report.coverage import shortfall
    from pytest_rvads.report.files import load, save
    from pytest_rvads.report.journal import recovered
    from pytest_rvads.report.merge import merge
    from pytest_rvads.report.session_report import cell_of

    report = merge([(name, recovered(Path(name))) for name in options.files])
    if options.baseline:
        planned = set(report.planned)
        earlier = load(Path(options.baseline))
        lost = {record.nodeid for record in earlier.records if cell_of(record) not in planned}
        same = options.baseline_of == "same"
        report = with_baseline(report, compare(report, earlier, options.baseline, options.erosion, lost.__contains__, same=same))
    if options.output:
        save(Path(options.output), report)
    show(report)
    short = "" if options.cov_fail_under is None else shortfall(report, options.cov_fail_under)
    for note in (*report.notes, *([short] if short else [])):
        warn(f"rvads: {note}")
    return report.ended or (1 if short else 0)


def _compare(options: argparse.Namespace) -> int:
    from pytest_rvads.report.files import fitting
    from pytest_rvads.report.journal import recovered
    from pytest_rvads.report.side_by_side import side_by_side
    from pytest_rvads.report.side_by_side_forms import save, text

    outputs = list(map(fitting, options.output))
    a, b = ((name, recovered(Path(name))) for name in (options.a, options.b))
    found = side_by_side(a, b, options.erosion)
    print(text(found, shutil.get_terminal_size().columns))
    for path in outputs:
        save(path, found)
    return int(found.comparison.count(*map(str.upper, options.fail_on)) > 0)


def _make(options: argparse.Namespace) -> int:
    from pytest_rvads.report.files import fitting, save
    from pytest_rvads.support.entrypoints import load

    paths = list(map(fitting, options.output))
    with load("results", "campaign")(options.files) as results:
        report = results.report()
        for path in paths:
            save(path, report)
        show(report)
        for note in report.notes:
            warn(f"rvads: {note}")
        ended: int = report.ended
    return ended


def _check(options: argparse.Namespace) -> int:
    statuses = [_told(Path(name)) for name in options.files]
    return UNFINISHED if UNFINISHED in statuses else next(filter(None, statuses), 0)


def _told(file: Path) -> int:
    """Say of one report whether it is whole, and return the exit status of its session."""
    from pytest_rvads.report.journal import recovered

    try:
        report = recovered(file)
    except RvadsError as error:
        warn(f"rvads: {error}")
        return UNFINISHED
    for note in report.notes:
        warn(f"rvads: {file}: {one_line(note)}")
    if report.complete:
        say(f"{file}: complete, {len(report.records)} items, exit status {report.exitstatus}")
    return report.ended
