"""The command ``rvads calibrate``: what throttle and brake of a driver do in the simulation, for shims of drivers of others."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, say
from pytest_rvads.cli.shared_options import declare_driver, opened_driver
from pytest_rvads.support.executors import apart
from pytest_rvads.support.storage import write_file

if TYPE_CHECKING:
    from pytest_rvads.simulators.driver_dynamics import Pedal


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads calibrate`` to the parser."""
    calibrate = commands.add_parser(
        "calibrate",
        help="measure what throttle and brake of a driver do",
        description="Measures the acceleration of a lone vehicle by the position of its pedals, and at full pedal. A shim, "
        "which seats a driver of another simulator, multiplies the driver's pedal by a ratio: the acceleration at full pedal in "
        "the other simulator, divided by the acceleration at full pedal here.",
    )
    declare_driver(calibrate)
    calibrate.add_argument("--simulator", metavar="NAME", help="simulator of the runs, a name or module:name")
    calibrate.add_argument(
        "--aggression", type=int, choices=(1, 2, 3), default=1, help="braking level of the vehicle (default: 1)"
    )
    calibrate.add_argument("--json", action="store_true", help="print one JSON object")
    calibrate.add_argument("--svg", metavar="OUT", help="also draw acceleration over position into this file")
    calibrate.set_defaults(command=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    from pytest_rvads.report.draw.curves import draw_pedals
    from pytest_rvads.simulators.driver_dynamics import calibrated
    from pytest_rvads.simulators.simulator import meant, named

    simulator = named(options.simulator, Path.cwd()) if options.simulator else meant()
    with opened_driver(options) as driver:
        measured = apart(partial(calibrated, driver, simulator, options.aggression))
    pedals = dict(zip(("throttle", "brake"), measured, strict=True))
    if options.json:
        print(json.dumps({"version": 1, "aggression": options.aggression} | {name: _plain(p) for name, p in pedals.items()}))
    else:
        for line in _table(pedals):
            say(line)
    if options.svg:
        points = {name: [(used.position, abs(used.acceleration)) for used in pedal.used] for name, pedal in pedals.items()}
        write_file(Path(options.svg), draw_pedals(points, f"pedals of {options.autopilot or options.sut}").encode())
    return 0


def _plain(pedal: Pedal) -> dict[str, object]:
    full = None if pedal.full is None else round(pedal.full, 3)
    return {
        "full": full,
        "largest": round(pedal.largest, 3),
        "used": [[round(number, 3) for number in row] for row in pedal.used],
    }


def _table(pedals: dict[str, Pedal]) -> Iterator[str]:
    yield f"{'pedal':10}{'position':>10}{'acceleration [m/s^2]':>22}{'time [s]':>10}"
    for name, pedal in pedals.items():
        for used in pedal.used:
            yield f"{name:10}{used.position:10.2f}{used.acceleration:22.2f}{used.seconds:10.2f}"
    for name, pedal in pedals.items():
        if pedal.full is None:
            yield f"{name}: never pressed"
        else:
            yield f"{name}: {pedal.full:.2f} m/s^2 at full pedal, pressed up to {pedal.largest:.2f}"
