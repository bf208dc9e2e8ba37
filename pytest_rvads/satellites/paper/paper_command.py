"""The command ``rvads paper``: computes the two tables of the paper, and the evidence for their reproduction."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, opened_executor, progress, progress_for, share
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.storage import write_file

if TYPE_CHECKING:
    from concurrent.futures import Executor


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads paper`` to the parser."""
    paper = commands.add_parser(
        "paper", help="simulate the two tables of the paper, and mark cells that differ from the paper (exit status 1 if any)"
    )
    share(paper, "json", "svg", "simulator", "workers")
    paper.add_argument(
        "what",
        nargs="?",
        choices=("tables", "sweep", "margins", "ablation", "null-models", "snapshots"),
        default="tables",
        help="instead of the tables, show the shares of every verdict over the range of the random draw (sweep), the margins of "
        "p1 and how far each free constant can move (margins), the cells that flip if a deficiency is switched off (ablation), "
        "or how many cells a model without a simulation gets right (null-models); or draw a violation of each of p1 to p6 "
        "into the folder of --svg (snapshots)",
    )
    paper.set_defaults(command=_paper)


def _paper(options: argparse.Namespace) -> int:
    from pytest_rvads.satellites.paper import tables
    from pytest_rvads.satellites.paper.tables import Setup
    from pytest_rvads.simulators.simulator import named

    with opened_executor(options) as executor:
        if options.what not in ("tables", "sweep"):
            return _evidence(options, executor)
        named(options.simulator, Path.cwd())  # an unknown simulator is an error before a run is simulated
        setup = Setup(simulator=options.simulator)
        if options.what == "sweep":
            shares = tables.sweep(setup, executor=executor, progress=progress_for(options))
            print(json.dumps(tables.nested(shares)) if options.json else tables.text_sweep(shares))
            return 0
        verdicts = tables.compute(setup, executor=executor, progress=progress_for(options))
    # The tables are printed before the picture is written, so that an error of writing does not suppress the tables.
    print(json.dumps(tables.nested(verdicts)) if options.json else tables.text_tables(verdicts), flush=True)
    if options.svg:
        write_file(Path(options.svg), tables.svg_tables(verdicts).encode())
    return int(bool(tables.disagreements(verdicts)))


def _evidence(options: argparse.Namespace, executor: Executor | int | None) -> int:
    from pytest_rvads.satellites.paper import evidence, tables

    if options.json or options.simulator or (options.svg is None) == (options.what == "snapshots"):
        raise ScenarioError(
            "--json and --simulator are options of the tables, and --svg is the picture of the tables or the folder of "
            "snapshots: give only options that belong together"
        )
    if options.what == "null-models":
        print(evidence.text_null_models())
    elif options.what == "snapshots":
        for path in evidence.write_snapshots(options.svg):
            print(path)
    elif options.what == "ablation":
        base = tables.compute(executor=executor, progress=progress)
        print(evidence.text_ablation(evidence.ablation(base, executor=executor, progress=progress)))
    else:
        print(evidence.text_margins(evidence.p1_margins(executor=executor, progress=progress)), flush=True)
        base = tables.compute(executor=executor, progress=progress)
        print(f"\n{evidence.text_rooms(evidence.rooms(base, executor=executor, progress=progress))}")
    return 0
