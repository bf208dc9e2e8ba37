"""``python -m studies.power``: how soon deficiencies and mutants are found, and what kills mutants of the reference autopilot."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from pytest_rvads.cli import answer
from pytest_rvads.cli.common import opened_executor, progress, share
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.simulators.simulator import named
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.storage import write_file
from studies.crosswalk_power import find_all, table
from studies.detection import DEFICIENCIES, measure
from studies.killing import kill_all
from studies.power_tables import plot, table_of_mutants, table_of_power
from studies.same_runs import HEADING, SameRuns, compare_all, row, summary


def main(words: Sequence[str] | None = None) -> int:
    """Run the command with these words, by default those of the command line, and return the exit status."""
    power = argparse.ArgumentParser(
        prog="python -m studies.power",
        description="Measure the number of simulations until each deficiency of the LGSVL-like autopilot is found, by several "
        "ways to choose scenarios; or which rules and relations kill each mutant of the reference autopilot; or how soon "
        "the default cover finds the mutants that meet pedestrians wrongly; or how soon critical starts find every deficiency "
        "and every mutant, beside other methods.",
    )
    instead = power.add_mutually_exclusive_group()
    instead.add_argument("--mutants", action="store_true", help="the mutants instead")
    instead.add_argument(
        "--critical",
        action="store_true",
        help="critical starts instead, beside other methods: a row per driver, as soon as measured",
    )
    instead.add_argument("--crosswalks", action="store_true", help="the mutants that meet pedestrians wrongly instead")
    power.add_argument(
        "--deficiency", action="append", choices=("I1", "I2", "I3", "I4", "I5"), help="only this one, may be repeated"
    )
    power.add_argument("--among", metavar="TRAFFIC", help="one vehicle has the deficiency, among traffic of this policy")
    power.add_argument(
        "--simulator", metavar="NAME", help="what makes the runs, a name or module:name; starts stay those of the usual one"
    )
    power.add_argument("--seeds", type=int, default=100, help="repetitions (default: 100)")
    power.add_argument("--budget", type=int, default=40, help="simulations after which a search gives up (default: 40)")
    share(power, "workers")
    power.add_argument("--svg", metavar="FILE", help="draw the plot")
    power.set_defaults(command=_power)
    return answer(power, words)


def _power(options: argparse.Namespace) -> int:
    for name in ("seeds", "budget"):
        value = getattr(options, name)
        if value < 1:
            raise ScenarioError(f"--{name} must be at least 1, got {value}")
    named(options.simulator, Path.cwd())  # an unknown one is refused before anything runs
    if options.mutants:
        with opened_executor(options) as executor:
            print(table_of_mutants(kill_all(executor, partial(progress, what="mutants"), options.simulator)))
        return 0
    if options.crosswalks:
        with opened_executor(options) as executor:
            print(table(find_all(executor, partial(progress, what="mutants"))))
        return 0
    if options.critical:
        measured: list[SameRuns] = []
        print(HEADING)
        with opened_executor(options) as executor:
            for driver in compare_all(options.deficiency or (), executor):
                measured.append(driver)
                print(row(driver), flush=True)
        print(f"\n{summary(measured)}")
        return 0
    wanted = options.deficiency or tuple(DEFICIENCIES)
    if options.among is not None:
        traffic(options.among)  # so is an unknown policy
    with opened_executor(options) as executor:
        powers = measure(
            options.seeds,
            options.budget,
            deficiencies=wanted,
            among=options.among,
            simulator=options.simulator,
            executor=executor,
        )
    print(table_of_power(powers))
    if options.svg:
        write_file(Path(options.svg), plot(powers).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
