"""``rvads rules`` and ``rvads monitor``, with ``rvads check``: the oracle without simulation."""

from __future__ import annotations

import argparse
import json

from pytest_rvads.cli import check_command, rules_command
from pytest_rvads.cli.common import Subparsers, lines, say

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    rules = commands.add_parser("rules", help="list the rules: meaning, formula, source, who is responsible")
    rules.add_argument("--rules", action="append", metavar="FILE", help="also those of a file of rules, may be repeated")
    rules.set_defaults(command=_rules)
    rules_command.declare(rules)

    check_command.declare(commands)

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
