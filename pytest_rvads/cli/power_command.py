"""``rvads power``: how good are the checks themselves?"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from pytest_rvads.cli import executor_options
from pytest_rvads.cli.common import Subparsers, progress
from pytest_rvads.errors import ScenarioError
from pytest_rvads.storage import write_file

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    power = commands.add_parser(
        "power",
        help="measure how soon deficiencies are found, or what kills mutants",
        description="Measure the number of simulations until each deficiency of the LGSVL-like autopilot is found, by several "
        "ways to choose scenarios; or which rules and relations kill each mutant of the reference autopilot.",
    )
    power.add_argument("--mutants", action="store_true", help="the mutants instead")
    power.add_argument(
        "--deficiency", action="append", choices=("I1", "I2", "I3", "I4", "I5"), help="only this one, may be repeated"
    )
    power.add_argument("--among", metavar="TRAFFIC", help="one vehicle has the deficiency, among traffic of this policy")
    power.add_argument(
        "--simulator", metavar="NAME", help="what makes the runs, a name or module:name; starts stay those of the usual one"
    )
    power.add_argument("--seeds", type=int, default=100, help="repetitions (default: 100)")
    power.add_argument("--budget", type=int, default=40, help="simulations after which a search gives up (default: 40)")
    executor_options.declare(power)
    power.add_argument("--svg", metavar="FILE", help="draw the plot")
    power.set_defaults(command=_power)


def _power(options: argparse.Namespace) -> int:
    from pytest_rvads.drivers.traffic import traffic
    from pytest_rvads.simulators.simulator import named
    from pytest_rvads.studies.killing import kill_all
    from pytest_rvads.studies.power import DEFICIENCIES, measure
    from pytest_rvads.studies.power_tables import plot, table_of_mutants, table_of_power

    for name in ("seeds", "budget"):
        value = getattr(options, name)
        if value < 1:
            raise ScenarioError(f"--{name} must be at least 1, got {value}")
    named(options.simulator, Path.cwd())  # an unknown one is refused before anything runs
    if options.mutants:
        with executor_options.opened(options) as executor:
            print(table_of_mutants(kill_all(executor, partial(progress, what="mutants"), options.simulator)))
        return 0
    wanted = options.deficiency or tuple(DEFICIENCIES)
    if options.among is not None:
        traffic(options.among)  # likewise
    with executor_options.opened(options) as executor:
        measured = measure(
            options.seeds,
            options.budget,
            deficiencies=wanted,
            among=options.among,
            simulator=options.simulator,
            executor=executor,
        )
    print(table_of_power(measured))
    if options.svg:
        write_file(Path(options.svg), plot(measured).encode())
    return 0
