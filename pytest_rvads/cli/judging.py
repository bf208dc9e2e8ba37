"""``rvads rules``, ``rvads check`` and ``rvads monitor``: the oracle without simulation."""

from __future__ import annotations

import argparse
import json
import sys

from pytest_rvads.cli.common import Subparsers

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    rules = commands.add_parser("rules", help="list the rules: meaning, formula, source, who is responsible")
    rules.add_argument("--file", metavar="FILE", help="also those of a file of rules")
    rules.set_defaults(command=_rules)

    check = commands.add_parser("check", help="judge runs that were recorded (.json) or kept by --rvads-keep (.npz)")
    check.add_argument("file", metavar="FILE")
    check.add_argument("--rule", action="append", metavar="RULE", help="a rule or rulebook, may be repeated (default: paper)")
    check.add_argument(
        "--json", action="store_true", help="print one JSON object: run, rule, status; exit 0 whatever the verdicts"
    )
    check.set_defaults(command=_check)

    monitor = commands.add_parser("monitor", help="show the LTL3 monitor of a formula, or monitor words")
    what = monitor.add_mutually_exclusive_group(required=True)
    what.add_argument("formula", nargs="?", metavar="FORMULA")
    what.add_argument(
        "--jsonl", action="store_true", help="read objects with id, formula, words line by line, answer each in a line"
    )
    monitor.set_defaults(command=_monitor)


def _rules(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.commands import list_rules
    from pytest_rvads.logic.rulefile import load_rules

    if options.file:
        load_rules(options.file)
    print(list_rules())
    return 0


def _check(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.commands import check_runs, doubts, read_runs

    runs = read_runs(options.file)
    for doubt in doubts(runs):
        print(f"warning: {doubt}", file=sys.stderr)
    verdicts = check_runs(runs, options.rule or "paper")
    if options.json:
        print(json.dumps({run: {rule: v.status.value for rule, v in by_rule.items()} for run, by_rule in verdicts.items()}))
        return 0
    for run, by_rule in verdicts.items():
        print(run)
        for verdict in by_rule.values():
            print(f"  {verdict.status.value:5} {verdict.message}")
    return 1 if any(v.status in ("FAIL", "OPEN") for by_rule in verdicts.values() for v in by_rule.values()) else 0


def _monitor(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.commands import show_monitor
    from pytest_rvads.logic.words import answer

    if not options.jsonl:
        print(show_monitor(options.formula))
        return 0
    for line in sys.stdin:
        if line.strip():
            print(json.dumps(answer(line)), flush=True)
    return 0
