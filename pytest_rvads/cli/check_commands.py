"""``rvads check``, ``rvads rules`` and ``rvads monitor``: the oracle without simulation."""

from __future__ import annotations

import argparse
import json
from contextlib import closing
from functools import partial
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, lines, progress, say
from pytest_rvads.support.entrypoints import load
from pytest_rvads.support.errors import RunError, ScenarioError

__all__ = ["declare"]

_JUNCTIONS = {("stop", 3): "stop3", ("stop", 4): "stop4", ("lights", 3): "light3", ("lights", 4): "light4"}


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    rules = commands.add_parser("rules", help="list the rules: meaning, formula, source, who is responsible")
    rules.add_argument("--rules", action="append", metavar="FILE", help="also those of a file of rules, may be repeated")
    rules.set_defaults(command=_rules)
    _declare_rules_check(rules)
    _declare_check(commands)

    monitor = commands.add_parser("monitor", help="show the LTL3 monitor of a formula, or monitor words")
    what = monitor.add_mutually_exclusive_group(required=True)
    what.add_argument("formula", nargs="?", metavar="FORMULA")
    what.add_argument(
        "--jsonl", action="store_true", help="read objects with id, formula, words line by line, answer each in a line"
    )
    monitor.set_defaults(command=_monitor)


def _rules(options: argparse.Namespace) -> int:
    from pytest_rvads.cli.answers import list_rules
    from pytest_rvads.logic.rules.rulefile import load_rules

    for file in options.rules or ():
        load_rules(file)
    say(list_rules())
    return 0


def _declare_rules_check(rules: argparse.ArgumentParser) -> None:
    commands = rules.add_subparsers(metavar="COMMAND")
    check = commands.add_parser(
        "check",
        help="find scenarios and orders of arrival in which nobody can obey the rules",
        description="Find scenarios and orders of arrival in which no behaviour satisfies all rules and lets everyone through; "
        "exit status 1 if there are any.",
    )
    check.add_argument(
        "--rules",
        action="append",
        default=argparse.SUPPRESS,
        metavar="RULE",
        help="a rule, rulebook or file of rules, may be repeated (default: paper)",
    )
    check.add_argument("--ways", type=int, choices=(3, 4), default=4, help="entrances of the junction (default: 4)")
    check.add_argument("--control", choices=("stop", "lights"), help="of the junction (default: both)")
    check.add_argument("--scenario", metavar="DIRECTIONS", help="one scenario, such as 1133; 0 where nobody stands")
    check.add_argument("--arrivals", metavar="SECONDS", help="one order of arrival: a time per entrance, such as 0,0,0.4,2")
    check.set_defaults(command=_rules_check)


def _rules_check(options: argparse.Namespace) -> int:
    from pytest_rvads.cli.answers import named_rules
    from pytest_rvads.geometry.control import JunctionControl
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.scenarios.classes import parse
    from pytest_rvads.search.survey import show, survey

    rules = named_rules(options.rules or ["paper"])
    code = parse(options.scenario) if options.scenario else None
    if code and len(code) != options.ways:
        raise ScenarioError(f"scenario {options.scenario!r} names {len(code)} entrances, expected {options.ways}: see --ways")
    arrivals = _times(options.arrivals) if options.arrivals else None
    contradicted = False
    for control in (options.control,) if options.control else ("stop", "lights"):
        about = [rule for rule in rules if rule.concerns(JunctionControl(control))]
        if about:
            result = survey(
                find(_JUNCTIONS[control, options.ways]),
                about,
                scenarios=[code] if code else None,
                arrivals=arrivals,
                progress=partial(progress, what="pairs"),
            )
            say(show(result))
            contradicted = contradicted or bool(result.contradictions)
    return 1 if contradicted else 0


def _times(text: str) -> list[float]:
    try:
        times = [float(part) for part in text.split(",")]
    except ValueError:
        times = [-1.0]
    if not all(0 <= time < 3600 for time in times):
        raise ScenarioError(f"--arrivals takes times in seconds, one per entrance, such as 0,0,0.4,2, got {text!r}")
    return times


def _declare_check(commands: Subparsers) -> None:
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
    from pytest_rvads.cli.check_output import Teller, Totals
    from pytest_rvads.cli.run_answers import Question, judged, run_files

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


def _monitor(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.ltl.export import describe
    from pytest_rvads.logic.ltl.ltl3 import synthesize
    from pytest_rvads.logic.ltl.parser import parse_ltl
    from pytest_rvads.logic.ltl.words import answer

    if not options.jsonl:
        say(describe(synthesize(parse_ltl(options.formula))))
        return 0
    for line in lines():
        print(json.dumps(answer(line), allow_nan=False), flush=True)
    return 0
