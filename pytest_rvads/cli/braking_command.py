"""``rvads braking``: the braking envelope v(d)max of the plant, and the share of it that an autopilot reaches."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, progress_for, say
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.storage import write_file

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


def _braking(options: argparse.Namespace) -> int:
    from pytest_rvads.physics.braking import envelope
    from pytest_rvads.report.draw.curves import draw_braking
    from pytest_rvads.simulators.simulator import named, vmax

    if options.junction or options.map:
        return _by_movement(options)
    limit = partial(vmax, simulator=named(options.simulator, Path.cwd()))
    curves = envelope(_DISTANCES, limit=limit)
    title = "v(d)max of the plant, full service brake"
    if options.autopilot is not None:
        from pytest_rvads.simulators.closed_loop import closed_envelope

        curves = closed_envelope(options.autopilot, _DISTANCES, simulator=options.simulator, progress=progress_for(options))
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
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.simulators.closed_loop import closed_by_movement

    if not (options.junction and options.autopilot) or options.svg:
        raise ScenarioError(
            "--junction goes with --autopilot and without --svg: v(d)max of the plant is the same on every lane, and a junction "
            "of --map has to be named"
        )
    place = find(options.junction, options.map)
    speeds_of = closed_by_movement(
        options.autopilot, _DISTANCES, place, simulator=options.simulator, progress=progress_for(options)
    )
    rows = []
    for key, speeds in speeds_of.items():
        entrance, exit, turn = place.entrances[key[0]], place.exits[key[1]], str(place.movements[key].turn)
        lanes = {"entrance": entrance.arm, "lane": entrance.lane, "exit": exit.arm, "exit_lane": exit.lane}
        rows.append({**lanes, "turn": turn, "vmax": {str(d): v for d, v in speeds.items()}})
    if options.json:
        print(json.dumps(rows))
        return 0
    say(f"v(d)max that the autopilot {options.autopilot} reaches at {place.name}, to stop before the line, aggression 1 [m/s]")
    say(f"{'from':>5}{'to':>6}  {'turn':9} d [m]" + "".join(f"{d:>7.2f}" for d in _DISTANCES))
    for row, speeds in zip(rows, speeds_of.values(), strict=True):
        ends = f"{row['entrance']}.{row['lane']:<3}{row['exit']:>4}.{row['exit_lane']}"
        cells = ("-" if d not in speeds else "none" if (v := speeds[d]) is None else f"{v:.2f}" for d in _DISTANCES)
        say(f"{ends:>11}  {row['turn']:9}      " + "".join(f"{cell:>7}" for cell in cells))
    return 0
