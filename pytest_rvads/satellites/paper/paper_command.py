"""``rvads paper``: the two tables of the paper, and the evidence beside them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli import executor_options
from pytest_rvads.cli.common import Subparsers, progress, progress_for
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.storage import write_file

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.satellites.paper.experiment import Setup

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    paper = commands.add_parser("paper", help="simulate the two tables of the paper, and mark where they disagree with it")
    paper.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    paper.add_argument("--svg", metavar="OUT", help="also draw the tables into this file")
    paper.add_argument("--simulator", metavar="NAME", help="what makes the runs of the tables, a name or module:name")
    paper.add_argument("--strict", action="store_true", help="exit 1 when a cell is not as published")
    instead = paper.add_mutually_exclusive_group()
    instead.add_argument(
        "--sweep", action="store_true", help="give the shares of every verdict over the range of the random draw"
    )
    instead.add_argument("--margins", action="store_true", help="tell what p1 hangs on, and how far each free constant can move")
    instead.add_argument("--ablation", action="store_true", help="tell which cells flip when a deficiency is switched off")
    instead.add_argument("--null-models", action="store_true", help="tell how many cells a table without vehicles would get")
    instead.add_argument("--snapshots", metavar="DIR", help="draw a violation of each of p1 to p6 into this folder")
    executor_options.declare(paper)
    paper.set_defaults(command=_paper)


def _paper(options: argparse.Namespace) -> int:
    with executor_options.opened(options) as executor:
        return _tables(options, executor)


def _tables(options: argparse.Namespace, executor: Executor | int | None) -> int:
    from pytest_rvads.satellites.paper import table_output, tables

    if options.sweep:
        shares = tables.sweep(_setup(options), executor=executor, progress=progress_for(options))
        print(json.dumps(tables.nested(shares)) if options.json else table_output.text_sweep(shares))
        return 0
    if options.margins or options.ablation or options.null_models or options.snapshots:
        return _evidence(options, executor)
    verdicts = tables.compute(_setup(options), executor=executor, progress=progress_for(options))
    # The answer is printed first, because a picture that can't be written must not prevent it.
    print(json.dumps(tables.nested(verdicts)) if options.json else table_output.text_tables(verdicts), flush=True)
    if options.svg:
        write_file(Path(options.svg), table_output.svg_tables(verdicts).encode())
    return 1 if options.strict and table_output.disagreements(verdicts) else 0


def _setup(options: argparse.Namespace) -> Setup:
    """Return the settings that all runs of the tables share."""
    from pytest_rvads.satellites.paper.experiment import Setup
    from pytest_rvads.simulators.simulator import named

    named(options.simulator, Path.cwd())  # an unknown simulator is refused before anything runs
    return Setup(simulator=options.simulator)


def _evidence(options: argparse.Namespace, executor: Executor | int | None) -> int:
    """Print or draw the evidence beside the tables; text only."""
    from pytest_rvads.satellites.paper import evidence, snapshots, tables

    if options.json or options.svg or options.strict or options.simulator:
        raise ScenarioError(
            "--json, --svg, --strict and --simulator go with the tables: leave them out here, or ask for the tables alone"
        )
    if options.null_models:
        print(evidence.text_null_models())
    elif options.snapshots:
        for path in snapshots.write(options.snapshots):
            print(path)
    elif options.ablation:
        base = tables.compute(executor=executor, progress=progress)
        print(evidence.text_ablation(evidence.ablation(base, executor=executor, progress=progress)))
    else:
        print(evidence.text_margins(evidence.p1_margins(executor=executor, progress=progress)), flush=True)
        base = tables.compute(executor=executor, progress=progress)
        print(f"\n{evidence.text_rooms(evidence.rooms(base, executor=executor, progress=progress))}")
    return 0
