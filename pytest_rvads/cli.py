"""The command ``rvads``: what can be asked without pytest.

Standard output holds only the answer; warnings and errors go to standard error, an error in one line with
exit status 2.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

from pytest_rvads import __version__
from pytest_rvads.errors import RvadsError

__all__ = ["main"]

_SHOWN = 100
_DISTANCES = (0.01, 0.3, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0)
"""Distances of the braking table: those of the configurations, and some between [m]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        return command(options)
    except BrokenPipeError:  # the reader, such as `head`, had enough; nothing more can be written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (RvadsError, OSError) as error:
        # A formula's error shows its place in lines of their own; programs that read ours get one line.
        text = str(error) if sys.stderr.isatty() else " ".join(str(error).split())
        print(f"rvads: {text}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("rvads: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="rvads", description="Validate autonomous-driving controllers against traffic rules.")
    parser.add_argument("--version", action="version", version=f"rvads {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    classes = commands.add_parser("classes", help="list the structural equivalence classes of an n-way junction")
    classes.add_argument("ways", type=int, metavar="N", help="number of ways, 3 to 8")
    classes.add_argument("--all", action="store_true", help=f"list all classes, not only the first {_SHOWN}")
    classes.add_argument("--svg", metavar="OUT", help="also draw them into this file")
    classes.set_defaults(command=_classes)

    map_ = commands.add_parser("map", help="show the junctions of an OpenDRIVE file and what is doubtful in it")
    map_.add_argument("file", metavar="FILE")
    map_.add_argument("--json", action="store_true", help="print one JSON object")
    map_.add_argument("--svg", metavar="OUT", help="also draw the junctions into this file")
    map_.set_defaults(command=_map)

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

    braking = commands.add_parser("braking", help="show v(d)max: how fast a vehicle may be that far before the stopping line")
    braking.add_argument("--json", action="store_true", help="print one JSON object: aggression, distance, speed")
    braking.set_defaults(command=_braking)

    paper = commands.add_parser("paper", help="simulate the two tables of the paper and mark where they disagree with it")
    paper.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    paper.add_argument("--svg", metavar="OUT", help="also draw the tables into this file")
    paper.add_argument("--strict", action="store_true", help="exit 1 when a cell is not as published")
    paper.add_argument("--sweep", action="store_true", help="give the shares of every verdict over the range of the random draw")
    paper.set_defaults(command=_paper)

    simulate = commands.add_parser("simulate", help="simulate scenarios at junctions that are given by the lengths of their ways")
    simulate.add_argument("--jsonl", action="store_true", required=True, help="read a JSON object per line, write one for each")
    simulate.set_defaults(command=_simulate)
    return parser


def _classes(options: argparse.Namespace) -> int:
    from pytest_rvads.draw.classes import draw_classes
    from pytest_rvads.scenarios.classes import class_label, classes, count_classes, count_scenarios, label, members

    ways, total = options.ways, count_classes(options.ways)
    title = f"{count_scenarios(ways)} scenarios in {total} classes"
    shown = total if options.all else min(total, _SHOWN)

    def listed() -> list[tuple[str, tuple[tuple[int, ...], ...]]]:
        return [(class_label(ways, n), members(code)) for n, code in enumerate(islice(classes(ways), shown), start=1)]

    if options.svg:
        Path(options.svg).write_text(draw_classes(ways, title, listed()), encoding="utf-8")
    print(title)
    for number, code in enumerate(islice(classes(ways), shown), start=1):
        print(f"{class_label(ways, number)}  {label(code)}  {' '.join(label(m) for m in members(code)[1:])}".rstrip())
    if shown < total:
        print(f"... and {total - shown} more: --all lists them", file=sys.stderr)
    return 0


def _map(options: argparse.Namespace) -> int:
    from pytest_rvads.draw.junction import draw_map
    from pytest_rvads.maps.road_map import describe, read_map

    road_map = read_map(options.file)
    found = describe(road_map)
    if options.svg:
        Path(options.svg).write_text(draw_map(road_map), encoding="utf-8")
    if options.json:
        print(json.dumps(found, indent=1))
        return 0
    count = len(found["junctions"])
    print(f"{os.path.basename(options.file)}: {count} junction{'s' if count > 1 else ''}")
    for junction in found["junctions"]:
        approach = f"approach {min(junction['approach'], default=0.0):4.0f} m"
        state = "usable" if junction["usable"] else f"not usable: {junction['reason']}"
        print(f"  {junction['id']:>6}  {junction['ways']}-way {junction['control']:<7} {approach}  {state}")
    for warning in found["warnings"]:
        print(f"warning: {warning['message']}", file=sys.stderr)
    return 0


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


def _braking(options: argparse.Namespace) -> int:
    from pytest_rvads.physics.braking import envelope

    curves = envelope(_DISTANCES)
    if options.json:
        print(json.dumps({str(a): dict(zip(map(str, _DISTANCES), speeds, strict=True)) for a, speeds in curves.items()}))
        return 0
    print("v(d)max [m/s], full service brake\n d [m]" + "".join(f"  aggression {a}" for a in curves))
    for row, distance in enumerate(_DISTANCES):
        cells = (speeds[row] for speeds in curves.values())
        print(f"{distance:6.2f}" + "".join(f"{'unsafe' if v is None else f'{v:.2f}':>14}" for v in cells))
    return 0


def _paper(options: argparse.Namespace) -> int:
    from pytest_rvads.experiment import paper, report

    if options.sweep:
        shares = paper.sweep(progress=_progress)
        print(json.dumps(paper.nested(shares)) if options.json else report.text_sweep(shares))
        return 0
    verdicts = paper.compute(progress=_progress)
    if options.svg:
        Path(options.svg).write_text(report.svg_tables(verdicts), encoding="utf-8")
    print(json.dumps(paper.nested(verdicts)) if options.json else report.text_tables(verdicts))
    return 1 if options.strict and report.disagreements(verdicts) else 0


def _simulate(_: argparse.Namespace) -> int:
    from pytest_rvads.experiment.prediction import answer

    for line in sys.stdin:
        if line.strip():
            print(answer(line), flush=True)
    return 0


def _progress(done: int, total: int) -> None:
    """Draw a bar on standard error; where that is no terminal, a line per quarter."""
    if sys.stderr.isatty():
        full = 40 * done // total
        end = "\n" if done == total else ""
        print(f"\r[{'#' * full}{' ' * (40 - full)}] {done}/{total} runs", end=end, file=sys.stderr, flush=True)
    elif 4 * done // total > 4 * (done - 1) // total:
        print(f"{done}/{total} runs", file=sys.stderr)
