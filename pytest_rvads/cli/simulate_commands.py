"""``rvads braking`` and ``rvads paper``: the commands that simulate."""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli import executor_options
from pytest_rvads.cli.common import Subparsers, progress, say
from pytest_rvads.errors import ScenarioError
from pytest_rvads.storage import write_file

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.executors import Progress
    from pytest_rvads.paper.experiment import Setup

__all__ = ["declare"]

_DISTANCES = (0.01, 0.3, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0)
"""Distances of the braking table: the distances of the configurations, and some between [m]."""
_CURVE = (0.01, 0.1, 0.2, 0.3, *(0.5 * k for k in range(1, 41)))
"""Distances of the curves in the picture [m]."""


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    braking = commands.add_parser("braking", help="show v(d)max: how fast a vehicle may be that far before the stopping line")
    braking.add_argument("--json", action="store_true", help="print one JSON object: aggression, distance, speed")
    braking.add_argument("--autopilot", metavar="NAME", help="what this autopilot reaches of it, such as reference or lgsvl")
    braking.add_argument(
        "--junction", metavar="NAME", help="what it reaches per movement and lane of this junction, at aggression 1"
    )
    braking.add_argument("--map", metavar="FILE", help="OpenDRIVE file of a junction given by id")
    braking.add_argument("--simulator", metavar="NAME", help="whose v(d)max, a name or module:name")
    braking.add_argument("--svg", metavar="OUT", help="also draw the curves into this file")
    braking.set_defaults(command=_braking)

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


def _braking(options: argparse.Namespace) -> int:
    from pytest_rvads.draw.curves import draw_braking
    from pytest_rvads.physics.braking import envelope
    from pytest_rvads.simulators.simulator import named, vmax

    if options.junction or options.map:
        return _by_movement(options)
    limit = partial(vmax, simulator=named(options.simulator, Path.cwd()))
    curves = envelope(_DISTANCES, limit=limit)
    title = "v(d)max of the plant, full service brake"
    if options.autopilot is not None:
        from pytest_rvads.simulators.closed_loop import closed_envelope

        curves = closed_envelope(options.autopilot, _DISTANCES, simulator=options.simulator, progress=_bar(options))
        title = f"v(d)max that the autopilot {options.autopilot} reaches, red light ahead"
    if options.json:
        print(json.dumps({str(a): dict(zip(map(str, _DISTANCES), speeds, strict=True)) for a, speeds in curves.items()}))
    else:
        print(f"{title} [m/s]\n d [m]" + "".join(f"  aggression {a}" for a in curves))
        for row, distance in enumerate(_DISTANCES):
            cells = (speeds[row] for speeds in curves.values())
            print(f"{distance:6.2f}" + "".join(f"{'none' if v is None else f'{v:.2f}':>14}" for v in cells))
    if options.svg:
        fine = envelope(_CURVE, limit=limit)
        whole = {level: list(zip(_CURVE, speeds, strict=True)) for level, speeds in fine.items()}
        found = {level: list(zip(_DISTANCES, speeds, strict=True)) for level, speeds in curves.items()}
        picture = draw_braking(found, title, whole) if options.autopilot else draw_braking(whole, title)
        write_file(Path(options.svg), picture.encode())
    return 0


def _by_movement(options: argparse.Namespace) -> int:
    """Print the v(d)max that an autopilot reaches, a row per movement."""
    from pytest_rvads.junctions.finder import find
    from pytest_rvads.simulators.closed_loop import closed_by_movement

    if not (options.junction and options.autopilot) or options.svg:
        raise ScenarioError(
            "--junction goes with --autopilot and without --svg: v(d)max of the plant is the same on every lane, and a junction "
            "of --map has to be named"
        )
    place = find(options.junction, options.map)
    found = closed_by_movement(options.autopilot, _DISTANCES, place, simulator=options.simulator, progress=_bar(options))
    rows = []
    for key, speeds in found.items():
        entrance, exit, turn = place.entrances[key[0]], place.exits[key[1]], str(place.movements[key].turn)
        lanes = {"entrance": entrance.arm, "lane": entrance.lane, "exit": exit.arm, "exit_lane": exit.lane}
        rows.append({**lanes, "turn": turn, "vmax": {str(d): v for d, v in speeds.items()}})
    if options.json:
        print(json.dumps(rows))
        return 0
    say(f"v(d)max that the autopilot {options.autopilot} reaches at {place.name}, to stop before the line, aggression 1 [m/s]")
    say(f"{'from':>5}{'to':>6}  {'turn':9} d [m]" + "".join(f"{d:>7.2f}" for d in _DISTANCES))
    for row, speeds in zip(rows, found.values(), strict=True):
        ends = f"{row['entrance']}.{row['lane']:<3}{row['exit']:>4}.{row['exit_lane']}"
        cells = ("-" if d not in speeds else "none" if (v := speeds[d]) is None else f"{v:.2f}" for d in _DISTANCES)
        say(f"{ends:>11}  {row['turn']:9}      " + "".join(f"{cell:>7}" for cell in cells))
    return 0


def _paper(options: argparse.Namespace) -> int:
    with executor_options.opened(options) as executor:
        return _tables(options, executor)


def _tables(options: argparse.Namespace, executor: Executor | int | None) -> int:
    from pytest_rvads.paper import table_output, tables

    if options.sweep:
        shares = tables.sweep(_setup(options), executor=executor, progress=_bar(options))
        print(json.dumps(tables.nested(shares)) if options.json else table_output.text_sweep(shares))
        return 0
    if options.margins or options.ablation or options.null_models or options.snapshots:
        return _evidence(options, executor)
    verdicts = tables.compute(_setup(options), executor=executor, progress=_bar(options))
    # The answer is printed first, because a picture that can't be written must not prevent it.
    print(json.dumps(tables.nested(verdicts)) if options.json else table_output.text_tables(verdicts), flush=True)
    if options.svg:
        write_file(Path(options.svg), table_output.svg_tables(verdicts).encode())
    return 1 if options.strict and table_output.disagreements(verdicts) else 0


def _setup(options: argparse.Namespace) -> Setup:
    """Return the settings that all runs of the tables share."""
    from pytest_rvads.paper.experiment import Setup
    from pytest_rvads.simulators.simulator import named

    named(options.simulator, Path.cwd())  # an unknown simulator is refused before anything runs
    return Setup(simulator=options.simulator)


def _bar(options: argparse.Namespace) -> Progress | None:
    """Return the progress display; None for a program that wants JSON, which may read standard error together with it."""
    return None if options.json and not sys.stderr.isatty() else progress


def _evidence(options: argparse.Namespace, executor: Executor | int | None) -> int:
    """Print or draw the evidence beside the tables; text only."""
    from pytest_rvads.paper import evidence, snapshots, tables

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
