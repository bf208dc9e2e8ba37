"""The command ``rvads dynamics``, which measures how vehicles and their drivers brake and accelerate.

``braking`` shows the braking envelope v(d)max of a simulator, and the part of the envelope that an autopilot reaches.
``pedals`` shows what throttle and brake of a driver do, for shims of drivers of others. ``driving`` measures a driver, and shows
the settings at junctions that follow: the starts that are only just safe, after Li and others (arXiv 2405.16914).
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import Subparsers, declare_driver, opened_driver, progress_for, say, share
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.executors import apart
from pytest_rvads.support.storage import write_file

if TYPE_CHECKING:
    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.simulators.simulator import Simulator

_DESCRIPTION = """\
driving measures three functions of arXiv 2405.16914: B(v), the distance to stop from speed v; AV(v, x), the speed x metres
after a start with speed v; AT(v, x), the time for these x metres. A lone vehicle drives toward a red light for B, and toward a
green light for AV and AT. braking shows v(d)max, the greatest speed from which a vehicle stops before its line at distance d,
for each aggression (braking level 1, 2 or 3 of the vehicle): of the simulated vehicle, or with --autopilot the v(d)max that a
traffic policy reaches. pedals measures the acceleration of a lone vehicle by the position of its pedals, and at full pedal. A
shim, which seats a driver of another simulator, multiplies the driver's pedal by a ratio: the acceleration at full pedal in the
other simulator, divided by the acceleration at full pedal here."""
_DISTANCES = (0.01, 0.3, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0)
"""Distances of the braking table: the distances of the configurations, and further distances between them [m]."""
_CURVE = (0.01, 0.1, 0.2, 0.3, *(0.5 * k for k in range(1, 41)))
"""Distances of the curves in the picture of v(d)max [m]."""
_SPEEDS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
"""Speeds at the start of the dynamics of a driver [m/s], below the speed limit of 11.18 m/s."""
_WAYS = (5.0, 10.0, 24.0, 40.0, 60.0)
"""Distances for the speed AV and the time AT after acceleration [m]; 24 m is the length of the junction of Li et al."""


def declare(commands: Subparsers) -> None:
    """Add the command ``dynamics`` to the parser."""
    dynamics = commands.add_parser("dynamics", help="measure how a driver brakes and accelerates", description=_DESCRIPTION)
    dynamics.add_argument(
        "what", nargs="?", choices=("driving", "braking", "pedals"), default="driving", help="what is measured (default: driving)"
    )
    declare_driver(dynamics)
    share(dynamics, "simulator")
    dynamics.add_argument(
        "--aggression", type=int, choices=(1, 2, 3), default=1, help="with pedals: braking level of the vehicle (default: 1)"
    )
    share(dynamics, "json", "svg")
    measures = {"driving": _driving, "braking": _braking, "pedals": _pedals}
    dynamics.set_defaults(command=lambda options: measures[options.what](options))


def _braking(options: argparse.Namespace) -> int:
    from pytest_rvads.physics.braking import envelope
    from pytest_rvads.report.svg import draw_braking
    from pytest_rvads.simulators.simulator import named, vmax

    if options.sut:
        raise ScenarioError("`rvads dynamics braking` takes a traffic policy by --autopilot: leave --sut out")
    limit = partial(vmax, simulator=named(options.simulator, Path.cwd()))
    curves = envelope(_DISTANCES, limit=limit)
    title = "v(d)max of the plant, full service brake"
    if options.autopilot is not None:
        from pytest_rvads.simulators.driver_dynamics import closed_envelope

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
        curve_points = {level: list(zip(_CURVE, speeds, strict=True)) for level, speeds in fine.items()}
        table_points = {level: list(zip(_DISTANCES, speeds, strict=True)) for level, speeds in curves.items()}
        picture = draw_braking(table_points, title, curve_points) if options.autopilot else draw_braking(curve_points, title)
        write_file(Path(options.svg), picture.encode())
    return 0


def _driving(options: argparse.Namespace) -> int:
    from pytest_rvads.report.svg import draw_dynamics
    from pytest_rvads.simulators.simulator import named

    simulator = named(options.simulator, Path.cwd())
    with opened_driver(options) as driver:
        bundled = options.autopilot if options.autopilot and ":" not in options.autopilot else ""
        braking, driving, settings = apart(partial(_measured, driver, simulator, bundled))
    result = {
        "version": 1,
        "speeds": _SPEEDS,
        "distances": _WAYS,
        "B": [_finite(b) for b in braking],
        "AV": [[_finite(av) for av, _ in row] for row in driving],
        "AT": [[_finite(at) for _, at in row] for row in driving],
        "settings": settings,
    }
    if options.json:
        print(json.dumps(result))
    else:
        for line in _table(result):
            say(line)
    if options.svg:
        times = {
            speed: [(way, time) for way, (_, time) in zip(_WAYS, row, strict=True)]
            for speed, row in zip(_SPEEDS, driving, strict=True)
        }
        title = f"dynamics of {options.autopilot or options.sut}"
        write_file(Path(options.svg), draw_dynamics(list(zip(_SPEEDS, braking, strict=True)), times, title).encode())
    return 0


def _measured(
    driver: Factory, simulator: Simulator, bundled: str
) -> tuple[list[float], list[list[tuple[float, float]]], dict[str, Any]]:
    """Return B by speed, AV and AT by speed and distance, and a driver's settings (only just safe starts) as a JSON object."""
    from pytest_rvads.geometry.segment import SPEED_LIMIT
    from pytest_rvads.simulators.driver_dynamics import LENGTH, LIMIT, PUBLISHED, Measured, settings

    measured = Measured(driver, simulator, bundled)
    braking = [measured.braking(speed) for speed in _SPEEDS]
    driving = [[measured.driving(speed, way) for way in _WAYS] for speed in _SPEEDS]
    rows = []
    for speed in _SPEEDS:
        for vista, *metres in settings(measured, speed, SPEED_LIMIT, LENGTH):
            numbers = {name: None if m is None else _finite(m) for name, m in zip(("xe", "xf", "xa"), metres, strict=True)}
            rows.append({"speed": speed, "vista": vista, **numbers})
    published = {"limit": LIMIT, "xa": PUBLISHED}
    return braking, driving, {"limit": SPEED_LIMIT, "length": LENGTH, "rows": rows, "published": published}


def _finite(value: float) -> float | None:
    return None if math.isinf(value) else round(value, 3)


def _table(result: dict[str, Any]) -> Sequence[str]:
    def cell(value: float | None) -> str:
        return f"{'never' if value is None else f'{value:.2f}':>8}"

    heads = "".join(f"{f'{way:g} m':>8}" for way in result["distances"])
    lines = [f"{'v [m/s]':>8}{'B [m]':>9}   AV [m/s] after{heads}   AT [s] for{heads}"]
    for row, speed in enumerate(result["speeds"]):
        after, time = ("".join(map(cell, result[name][row])) for name in ("AV", "AT"))
        lines.append(f"{speed:8g} {cell(result['B'][row])}{'':17}{after}{'':13}{time}")
    told = result["settings"]
    lines += ["", f"settings with a speed limit of {told['limit']:.2f} m/s and a junction of {told['length']:g} m"]
    lines.append(f"{'ve [m/s]':>9}  {'vista':27}{'xe [m]':>8}{'xf [m]':>8}{'xa [m]':>8}")
    for entry in told["rows"]:
        cells = [cell(entry["xe"]), cell(entry["xf"]), f"{'–':>8}" if "lights" in entry["vista"] else cell(entry["xa"])]
        lines.append(f"{entry['speed']:9g}  {entry['vista']:27}{''.join(cells)}")
    limit, published = told["published"]["limit"], told["published"]["xa"]
    distances = ", ".join(f"{name} {distance:g} m" for name, distance in published.items())
    lines.append(f"published xa at a crossing with yield signs from ve = 0, with a limit of {limit:.2f} m/s: {distances}")
    return lines


def _pedals(options: argparse.Namespace) -> int:
    from pytest_rvads.report.svg import draw_pedals
    from pytest_rvads.simulators.driver_dynamics import calibrated
    from pytest_rvads.simulators.simulator import named

    simulator = named(options.simulator, Path.cwd())
    with opened_driver(options) as driver:
        measured = apart(partial(calibrated, driver, simulator, options.aggression))
    pedals = dict(zip(("throttle", "brake"), measured, strict=True))
    if options.json:
        result: dict[str, object] = {"version": 1, "aggression": options.aggression}
        for name, pedal in pedals.items():
            result[name] = {
                "full": None if pedal.full is None else round(pedal.full, 3),
                "largest": round(pedal.largest, 3),
                "used": [[round(number, 3) for number in row] for row in pedal.used],
            }
        print(json.dumps(result))
    else:
        say(f"{'pedal':10}{'position':>10}{'acceleration [m/s^2]':>22}{'time [s]':>10}")
        for name, pedal in pedals.items():
            for used in pedal.used:
                say(f"{name:10}{used.position:10.2f}{used.acceleration:22.2f}{used.seconds:10.2f}")
        for name, pedal in pedals.items():
            if pedal.full is None:
                say(f"{name}: never pressed")
            else:
                say(f"{name}: {pedal.full:.2f} m/s^2 at full pedal, pressed up to {pedal.largest:.2f}")
    if options.svg:
        points = {name: [(used.position, abs(used.acceleration)) for used in pedal.used] for name, pedal in pedals.items()}
        write_file(Path(options.svg), draw_pedals(points, f"pedals of {options.autopilot or options.sut}").encode())
    return 0
