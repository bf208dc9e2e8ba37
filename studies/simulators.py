"""``python -m studies.simulators``: run the same cases on two simulators and compare the outcomes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from pytest_rvads.cli import answer
from pytest_rvads.cli.common import opened_executor, progress, say, share
from pytest_rvads.simulators.simulator import named
from pytest_rvads.support.errors import ScenarioError, suggest
from studies.agreement import agree, text_agreements
from studies.case_sets import SETS, recorded_trials


def main(words: Sequence[str] | None = None) -> int:
    """Run the command with these words, by default those of the command line, and return the exit status."""
    compare = argparse.ArgumentParser(
        prog="python -m studies.simulators",
        description="Run the same cases on two simulators and compare verdicts, order of entry and collisions; entry times may "
        "differ, and by how much is told.",
    )
    compare.add_argument("simulators", metavar="NAME", nargs=2, help="bullet, mujoco, sumo, or module:name")
    compare.add_argument(
        "--set",
        metavar="NAME",
        action="append",
        help="paper, classes, signs, mutants or contacts, may be repeated (default: paper and contacts)",
    )
    compare.add_argument("--recorded", metavar="FILE", nargs="+", default=[], help="also the runs of recorded files, predicted")
    compare.add_argument("--strict", action="store_true", help="exit 1 when an outcome differs")
    share(compare, "workers")
    compare.set_defaults(command=_compare)
    return answer(compare, words)


def _compare(options: argparse.Namespace) -> int:
    wanted = options.set or ([] if options.recorded else ["paper", "contacts"])
    for name in wanted:
        if name not in SETS:
            raise ScenarioError(f"--set must be one of {', '.join(SETS)}, got {name!r}{suggest(name, SETS)}")
    one, two = options.simulators
    for name in (one, two):
        named(name, Path.cwd())  # an unknown one is refused before anything runs
    trials = {name: list(SETS[name]()) for name in wanted} | {file: list(recorded_trials(file)) for file in options.recorded}
    with opened_executor(options) as executor:
        found = {
            name: list(agree((one, two), cases, executor=executor, progress=partial(progress, what=f"cases of {name}")))
            for name, cases in trials.items()
        }
    say(text_agreements(found, (one, two)))
    return int(options.strict and not all(case.same for cases in found.values() for case in cases))


if __name__ == "__main__":
    sys.exit(main())
