"""``rvads export``: runs and scenarios for other tools, as OpenSCENARIO XML."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, say
from pytest_rvads.errors import RunError, ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.runs.run import Run
    from pytest_rvads.scenarios.case import Fleet
    from pytest_rvads.scenarios.scenario import Scenario

__all__ = ["declare"]


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    parser = commands.add_parser(
        "export",
        help="write a run, or a scenario for somebody else's controller, as OpenSCENARIO XML",
        description="The OpenDRIVE map of the junction is written beside.",
    )
    parser.add_argument(
        "source", metavar="RUN|CASE", help="file of a run (.npz), or the id of a scenario: stop4-class07-as1133-cfgD"
    )
    parser.add_argument("--xosc", metavar="OUT", required=True, help="file to write (.xosc)")
    parser.add_argument("--scenario", action="store_true", help="of a run the scenario that it began with, not what happened")
    parser.add_argument("--rules", metavar="RULE", help="judge the run by it and tell the verdict in the file")
    parser.add_argument("--map", metavar="FILE", help="OpenDRIVE file of the junction, where it is neither built in nor told")
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> int:
    from pytest_rvads.runs.readers import READERS

    source, out = Path(options.source), Path(options.xosc)
    is_file = source.exists() or source.suffix.lower() in READERS
    if options.rules and (options.scenario or not is_file):
        raise ScenarioError(
            "--rules judges a run, and a scenario is none: leave --rules out, or write the run of a file, without --scenario"
        )
    return _run(options, source, out) if is_file else _scenario(options, out)


def _scenario(options: argparse.Namespace, out: Path) -> int:
    from pytest_rvads.satellites.openscenario.scenario_export import save_scenario
    from pytest_rvads.scenarios.ids import from_id

    scenario = from_id(options.source, options.map)
    save_scenario(scenario, out, map=options.map)
    say(f"{out}: {scenario.describe()}")
    return 0


def _run(options: argparse.Namespace, source: Path, out: Path) -> int:
    from pytest_rvads.logic.check import check
    from pytest_rvads.runs.readers import read_runs
    from pytest_rvads.satellites.openscenario.run_export import export_run
    from pytest_rvads.satellites.openscenario.scenario_export import save_scenario

    runs = read_runs(source)
    if len(runs) != 1:
        raise RunError(f"{source}: it holds {len(runs)} runs, one is exported at a time: cut it into files of one run")
    run = runs[0]
    if options.scenario:
        scenario, fleet = _began(run, source, options.map)
        save_scenario(scenario, out, map=options.map, fleet=fleet)
        say(f"{out}: {scenario.describe()}")
        return 0
    verdict = check(run, options.rules) if options.rules else None
    export_run(run, out, map=options.map, verdict=verdict)
    say(f"{out}: {len(run.agents)} vehicles at {run.junction.name}, {run.duration:.2f} s")
    if verdict is not None:
        say(f"  {verdict.message}")
    return 0


def _began(run: Run, source: Path, map: str | None) -> tuple[Scenario, Fleet]:
    """Return the scenario that a run was simulated from, and its bodies, as its provenance tells."""
    from pytest_rvads.satellites.openscenario.mapfile import mapped
    from pytest_rvads.satellites.openscenario.run_export import recorded_map, vehicles
    from pytest_rvads.scenarios.case import Fleet
    from pytest_rvads.scenarios.ids import recalled

    record = run.provenance.get("scenario")
    if not isinstance(record, Mapping):
        raise RunError(f"{source}: it does not say which scenario it was simulated from, as runs that rvads simulated do")
    place = mapped(run.junction, map, recorded_map(run.provenance))
    found = vehicles(run)
    return recalled(record, place, f"{source}: scenario"), Fleet(others={name: v for name, v in found.items() if v is not None})
