"""``rvads rules``, ``rvads check`` and ``rvads monitor``: the oracle without simulation."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli import follow_command, rules_command
from pytest_rvads.cli.common import Subparsers, lines, say, warn
from pytest_rvads.errors import RunError

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    rules = commands.add_parser("rules", help="list the rules: meaning, formula, source, who is responsible")
    rules.add_argument("--file", metavar="FILE", help="also those of a file of rules")
    rules.set_defaults(command=_rules)
    rules_command.declare(rules)

    check = commands.add_parser(
        "check",
        help="judge runs that were recorded (.json) or kept by --rvads-keep (.npz)",
        description="Exit status: 0 when no rule is violated or open, 1 when one is, 2 when a run can't be judged, 5 when no "
        "rule applies.",
    )
    check.add_argument("file", metavar="FILE")
    check.add_argument(
        "--rule", action="append", metavar="RULE", help="a rule, rulebook or file of rules, may be repeated (default: paper)"
    )
    check.add_argument(
        "--json", action="store_true", help="print one JSON object: run, rule, status; exit 0 whatever the verdicts"
    )
    check.add_argument("--kpis", action="store_true", help="with --json, also the key performance indicators of every run")
    follow_command.declare(check)
    check.set_defaults(command=_check)

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

    if options.file:
        load_rules(options.file)
    say(list_rules())
    return 0


def _check(options: argparse.Namespace) -> int:
    if options.follow:
        return follow_command.follow(options)
    from pytest_rvads.cli.answers import check_runs, doubts, named_rules
    from pytest_rvads.conduct.kpis import describe, kpis
    from pytest_rvads.conduct.validate import damage
    from pytest_rvads.runs.readers import read_runs

    rules = named_rules(options.rule or ["paper"])
    runs = read_runs(options.file)
    for doubt in doubts(runs):
        warn(f"warning: {doubt}")
    verdicts = check_runs(runs, rules)
    wanted = options.kpis or not options.json
    measured = {run.label: kpis(run) for run in runs if wanted and not damage(run)}
    if options.json:
        answer: dict[str, dict[str, Any]] = {
            run: {rule: v.status.value for rule, v in by_rule.items()} for run, by_rule in verdicts.items()
        }
        for run, found in measured.items():
            answer[run]["kpis"] = found.record()
        print(json.dumps(answer))
    else:
        for run, by_rule in verdicts.items():
            say("\n  ".join((run, *map(_line, by_rule.values()), *(describe(measured[run]) if run in measured else ()))))
    return _exit_status([(run, v) for run, by_rule in verdicts.items() for v in by_rule.values()], told=options.json)


def _line(verdict: Verdict) -> str:
    told = verdict.message.removeprefix(f"{verdict.rule} {verdict.status}: ")
    return f"{verdict.status.value:5} {told if told.startswith(verdict.rule) else f'{verdict.rule}: {told}'}"


def _exit_status(given: Sequence[tuple[str, Verdict]], *, told: bool) -> int:
    """Return the exit status for verdicts on runs, given by their labels; 0 where all that is `told` in JSON."""
    unfit = {run: v.reason for run, v in given if v.status == "ERROR"}
    if unfit:
        raise RunError("; ".join(f"{run} can't be judged: {reason}" for run, reason in unfit.items()))
    if told:
        return 0
    if all(v.status == "NA" for _, v in given):
        print("rvads: nothing was judged: no rule applies to any of these runs", file=sys.stderr)
        return 5
    return 1 if any(v.status in ("FAIL", "OPEN") for _, v in given) else 0


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
