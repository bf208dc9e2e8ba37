"""The commands ``rvads check`` and ``rvads rules``, which judge runs without simulation."""

from __future__ import annotations

import argparse
import textwrap
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, make_folder, named_rules, processes, say, share
from pytest_rvads.support.errors import FormulaError
from pytest_rvads.support.installed import entries, load

if TYPE_CHECKING:
    from pytest_rvads.logic.ltl.ltl3 import Machine
    from pytest_rvads.logic.rules.rule import Rule


def declare(commands: Subparsers) -> None:
    """Add the commands ``check`` and ``rules`` to the parser."""
    rules = commands.add_parser(
        "rules",
        help="list the rules, or show the rule NAME: meaning, formula, source, responsible vehicle, monitor",
    )
    rules.add_argument(
        "names", nargs="*", metavar="NAME|FILE", help="rule to show (default: list all rules), or file of rules to read first"
    )
    rules.add_argument("--dot", action="store_true", help="print only the monitors of the named rules, for Graphviz")
    rules.set_defaults(command=_print_rules)
    check = commands.add_parser(
        "check",
        help="judge runs that were recorded (.json), kept by --rvads-keep (.npz), or driven elsewhere (.xosc)",
        description="Exit status: 0 if no rule is violated or open, 1 if a rule is violated or open, 2 if a file or run can't be "
        "read or judged, 5 if nothing was judged: no rule applies, or every verdict is UNSURE. An UNSURE verdict is counted and "
        "listed, and neither passes nor fails.",
    )
    check.add_argument(
        "files", nargs="+", metavar="FILE", help="file, folder (searched at any depth) or quoted pattern such as 'drives/*.npz'"
    )
    share(check, "rules")
    form = check.add_mutually_exclusive_group()
    share(form, "json", help="print one JSON object: run, rule, status and instances; exit 0 whatever the verdicts")
    form.add_argument("--jsonl", action="store_true", help="as --json, but print a line per run as soon as the run is judged")
    help = "write a report, in the format of its ending, or into a folder the page and a replay page per failure; repeatable"
    share(check, "output", action="append", default=[], help=help)
    share(check, "workers", metavar="N", help="number of processes (default: 1)")
    check.add_argument(
        "-v", "--verbose", action="store_true", help="print all verdicts, warnings and key performance indicators of every run"
    )
    if "follow" in entries("streams"):
        load("streams", "follow").declare(check)
    check.set_defaults(command=_check_runs)


def _print_rules(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.ltl.export import describe, to_dot
    from pytest_rvads.logic.rules.book import get_rule, load_rules

    for file in (name for name in options.names if name.endswith(".rules")):
        load_rules(file)
    names = [name for name in options.names if not name.endswith(".rules")]
    if options.dot and not names:
        raise FormulaError("--dot draws the monitors of named rules, got no name: write such as rvads rules p2 --dot")
    if options.dot:
        say("".join(to_dot(_automaton(get_rule(name))) for name in names).rstrip())
    elif names:
        entries = []
        for rule in map(get_rule, names):
            try:
                monitor = describe(_automaton(rule))
            except FormulaError as error:
                monitor = f"monitor: none is shown: {error}"
            entries.append(f"{_rule_entry(rule)}\n{textwrap.indent(monitor, ' ' * 6)}")
        say("\n".join(entries))
    else:
        say(list_rules())
    return 0


def _automaton(rule: Rule) -> Machine:
    """Return the monitor of an instance of a rule, the rule for certain vehicles and entrances."""
    from pytest_rvads.logic.ltl import formula as f
    from pytest_rvads.logic.ltl.ltl3 import synthesize

    body = rule.formula
    while isinstance(body, f.Forall):
        body = body.body
    if any(isinstance(part, f.Forall | f.Exists) for part, _ in f.walk(body)):
        raise FormulaError(f"rule {rule.name!r} has a quantifier inside, so its monitor depends on the vehicles of the run")
    return synthesize(body)


def list_rules() -> str:
    """Return a text that lists all rules by rulebook, with meaning, formula, source and responsible role."""
    from pytest_rvads.logic.rules.book import current_book, rulebook

    blocks = []
    for book in ("paper", "variants", "road"):
        blocks.append(f"rulebook {book}")
        blocks += [_rule_entry(r) for r in rulebook(book)]
    if own_rules := current_book().own:
        blocks += ["your own", *map(_rule_entry, own_rules)]
    return "\n".join(blocks)


def _rule_entry(rule: Rule) -> str:
    kind = f" [{', '.join(rule.kinds)}]" if rule.about else ""
    lines = [f"  {rule.name}  {rule.title}{kind}", f"      {rule.meaning}" if rule.meaning else ""]
    lines += [f"      {line}" for line in textwrap.wrap(rule.text, 110, break_on_hyphens=False)]
    facts = [
        f"responsible: {rule.responsible}" if rule.responsible else "",
        f"tie window: {rule.tie:g} s" if rule.tie else "",
        f"source: {rule.source}" if rule.source else "",
        f"requirement: {rule.requirement}" if rule.requirement else "",
    ]
    return "\n".join(filter(None, [*lines, *(f"      {fact}" for fact in facts if fact)]))


def _check_runs(options: argparse.Namespace) -> int:
    if "follow" in entries("streams"):
        following = load("streams", "follow")
        if options.follow:
            status: int = following.follow(options)
            return status
        following.refuse_without(options)
    from pytest_rvads.cli.check_output import Teller
    from pytest_rvads.cli.run_answers import Judge, judged

    folder: str | None = None
    reports: list[Path] = []
    if options.output:
        from pytest_rvads.report.files import fitting

        folder = next((name for name in options.output if not Path(name).suffix or Path(name).is_dir()), None)
        reports += [fitting(name) for name in options.output if name != folder]
    names = tuple(options.rules or ["road"])
    named_rules(names)  # mistakes in rules are reported before any file is read
    if folder is not None:
        make_folder("-o", Path(folder))
        reports.append(Path(folder) / "index.html")
    with Teller(options, reports) as teller:
        judge = Judge(names, options.verbose, teller.alone and not teller.for_program, folder)
        with closing(judged(teller.files, judge, processes(options, 1))) as batches:
            for batch in batches:
                teller.tell(batch)
    return teller.exit_status()
