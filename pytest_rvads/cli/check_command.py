"""``rvads check``: judging runs that were recorded, of files, folders and patterns."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

from pytest_rvads.cli.common import Subparsers
from pytest_rvads.entrypoints import load
from pytest_rvads.errors import RunError

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    check = commands.add_parser(
        "check",
        help="judge runs that were recorded (.json), kept by --rvads-keep (.npz), or exported (.xosc)",
        description="Exit status: 0 when no rule is violated or open, 1 when one is, 2 when a file or run can't be read or "
        "judged, 5 when nothing was judged: no rule applies, or every verdict is unsure. What is UNSURE is counted and listed, "
        "and neither passes nor fails.",
    )
    check.add_argument(
        "files", nargs="+", metavar="FILE", help="file, folder (searched at any depth) or quoted pattern such as 'drives/*.npz'"
    )
    check.add_argument(
        "--rules", action="append", metavar="RULE", help="a rule, rulebook or file of rules, may be repeated (default: road)"
    )
    form = check.add_mutually_exclusive_group()
    form.add_argument(
        "--json",
        action="store_true",
        help="print one JSON object: run, rule, status and instances; exit 0 whatever the verdicts",
    )
    form.add_argument("--jsonl", action="store_true", help="likewise, a line per run as soon as it is judged")
    check.add_argument("--html", metavar="DIR", help="write the page of the verdicts and a replay page of every failure there")
    check.add_argument(
        "--report", action="append", default=[], metavar="FILE", help="write a report, in the format of its ending; repeatable"
    )
    check.add_argument("--kpis", action="store_true", help="also the key performance indicators of every run")
    check.add_argument("-j", "--jobs", type=_count, default=1, metavar="N", help="judge on so many processes (default: 1)")
    check.add_argument("-v", "--verbose", action="store_true", help="of many runs, print all verdicts and warnings")
    load("streams", "follow").declare(check)
    check.set_defaults(command=_check)


def _count(text: str) -> int:
    value = int(text)
    if not 1 <= value <= 1000:
        raise ValueError
    return value


_count.__name__ = "number of processes"  # argparse names it in its messages


def _check(options: argparse.Namespace) -> int:
    following = load("streams", "follow")
    if options.follow:
        status: int = following.follow(options)
        return status
    following.refuse_without(options)
    from pytest_rvads.cli.answers import named_rules
    from pytest_rvads.cli.check_teller import Teller
    from pytest_rvads.cli.check_totals import Totals
    from pytest_rvads.cli.run_answers import Question, judged
    from pytest_rvads.cli.run_files import run_files

    reports: list[Path] = []
    if options.report:
        from pytest_rvads.report.files import fitting

        reports += map(fitting, options.report)
    names = tuple(options.rules or ["road"])
    named_rules(names)  # what is wrong with them is told before anything is read
    if options.html is not None:
        _make_folder(options.html)
        reports.append(Path(options.html) / "index.html")
    totals, told = Totals(), options.json or options.jsonl
    files = run_files(options.files, totals.trouble)
    alone = len(options.files) == len(files) == 1
    question = Question(names, options.kpis, alone and not told, options.html)
    with (
        Teller(options, totals, len(files), reports, alone=alone) as teller,
        closing(judged(files, question, options.jobs)) as batches,
    ):
        for batch in batches:
            teller.tell(batch)
    return totals.exit_status(told=told)


def _make_folder(name: str) -> None:
    try:
        Path(name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{name}: no folder for pages can be made there: {error.strerror}") from error
