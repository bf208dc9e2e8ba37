"""The command ``rvads paper``: computes the two tables of the paper, and the evidence for their reproduction."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, progress, progress_for
from pytest_rvads.cli.shared_options import declare_executor, opened_executor
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.storage import write_file

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.satellites.paper.experiment import Setup


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads paper`` to the parser."""
    paper = commands.add_parser("paper", help="simulate the two tables of the paper, and mark cells that differ from the paper")
    paper.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    paper.add_argument("--svg", metavar="OUT", help="also draw the tables into this file")
    paper.add_argument("--simulator", metavar="NAME", help="simulator of the runs, a name or module:name")
    paper.add_argument("--strict", action="store_true", help="exit with 1 if a cell is not as published")
    instead = paper.add_mutually_exclusive_group()
    instead.add_argument(
        "--sweep", action="store_true", help="show the shares of every verdict over the range of the random draw"
    )
    instead.add_argument("--margins", action="store_true", help="show the margins of p1, and how far each free constant can move")
    instead.add_argument("--ablation", action="store_true", help="show the cells that flip if a deficiency is switched off")
    instead.add_argument("--null-models", action="store_true", help="show how many cells a model without a simulation gets right")
    instead.add_argument("--snapshots", metavar="DIR", help="draw a violation of each of p1 to p6 into this folder")
    declare_executor(paper)
    paper.set_defaults(command=_paper)


def _paper(options: argparse.Namespace) -> int:
    with opened_executor(options) as executor:
        return _tables(options, executor)


def _tables(options: argparse.Namespace, executor: Executor | int | None) -> int:
    from pytest_rvads.satellites.paper import tables

    if options.sweep:
        shares = tables.sweep(_setup(options), executor=executor, progress=progress_for(options))
        print(json.dumps(tables.nested(shares)) if options.json else tables.text_sweep(shares))
        return 0
    if options.margins or options.ablation or options.null_models or options.snapshots:
        return _evidence(options, executor)
    verdicts = tables.compute(_setup(options), executor=executor, progress=progress_for(options))
    # The tables are printed before the picture is written, so that an error of writing does not suppress the tables.
    print(json.dumps(tables.nested(verdicts)) if options.json else tables.text_tables(verdicts), flush=True)
    if options.svg:
        write_file(Path(options.svg), tables.svg_tables(verdicts).encode())
    return 1 if options.strict and tables.disagreements(verdicts) else 0


def _setup(options: argparse.Namespace) -> Setup:
    """Return the settings that all runs of the tables share."""
    from pytest_rvads.satellites.paper.experiment import Setup
    from pytest_rvads.simulators.simulator import named

    named(options.simulator, Path.cwd())  # an unknown simulator is an error before a run is simulated
    return Setup(simulator=options.simulator)


def _evidence(options: argparse.Namespace, executor: Executor | int | None) -> int:
    """Print the evidence for the reproduction of the tables as text, or draw violations of the rules."""
    from pytest_rvads.satellites.paper import evidence, tables

    if options.json or options.svg or options.strict or options.simulator:
        raise ScenarioError(
            "--json, --svg, --strict and --simulator are options of the tables: leave these options out, or print the tables"
        )
    if options.null_models:
        print(evidence.text_null_models())
    elif options.snapshots:
        for path in evidence.write_snapshots(options.snapshots):
            print(path)
    elif options.ablation:
        base = tables.compute(executor=executor, progress=progress)
        print(evidence.text_ablation(evidence.ablation(base, executor=executor, progress=progress)))
    else:
        print(evidence.text_margins(evidence.p1_margins(executor=executor, progress=progress)), flush=True)
        base = tables.compute(executor=executor, progress=progress)
        print(f"\n{evidence.text_rooms(evidence.rooms(base, executor=executor, progress=progress))}")
    return 0
