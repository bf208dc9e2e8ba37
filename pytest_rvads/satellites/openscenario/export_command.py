"""The command ``rvads export``: writes runs and scenarios as OpenSCENARIO XML for other tools."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, say, share
from pytest_rvads.support.errors import RunError, ScenarioError


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads export`` to the parser."""
    parser = commands.add_parser(
        "export",
        help="write a run, or a scenario for another tool's controller, as OpenSCENARIO XML",
        description="The map of the junction is written into the same folder.",
    )
    parser.add_argument(
        "source", metavar="RUN|CASE", help="file of a run (.npz), or id of a scenario, such as stop4-class07-as1133-cfgD"
    )
    share(parser, "output", required=True, help="file to write (.xosc)")
    parser.add_argument("--scenario", action="store_true", help="write the initial scenario of a run, without its trajectories")
    share(parser, "rules", action="store", help="judge the run by this rule and quote the verdict in the file")
    share(parser, "map", help="map file of the junction, unless it is built in or named by the run")
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.check import check
    from pytest_rvads.runs.readers import READERS, read_runs
    from pytest_rvads.runs.states import crowd
    from pytest_rvads.satellites.openscenario.document import mapped
    from pytest_rvads.satellites.openscenario.run_export import export_run, recorded_map, vehicles
    from pytest_rvads.satellites.openscenario.scenario_xosc import save_scenario
    from pytest_rvads.scenarios.case import Fleet
    from pytest_rvads.scenarios.ids import from_id, recalled

    source, out, fleet = Path(options.source), Path(options.output), None
    is_file = source.exists() or source.suffix.lower() in READERS
    if options.rules and (options.scenario or not is_file):
        raise ScenarioError(
            "--rules judges a run, and a scenario has no run: leave --rules out, or export a file of a run without --scenario"
        )
    if is_file:
        runs = read_runs(source)
        if len(runs) != 1:
            raise RunError(
                f"{source}: the file has {len(runs)} runs, expected a single run: cut the file into files of a single run"
            )
        run = runs[0]
        if not options.scenario:
            verdict = check(run, options.rules) if options.rules else None
            export_run(run, out, map=options.map, verdict=verdict)
            say(f"{out}: {crowd(run.agents)} at {run.junction.name}, {run.duration:.2f} s")
            if verdict is not None:
                say(f"  {verdict.message}")
            return 0
        record = run.provenance.get("scenario")
        if not isinstance(record, Mapping):
            raise RunError(f"{source}: the run names no scenario, expected a run that rvads simulated")
        place = mapped(run.junction, options.map, recorded_map(run.provenance))
        scenario, fleet = recalled(record, place, f"{source}: scenario"), Fleet(others=vehicles(run))
    else:
        scenario = from_id(options.source, options.map)
    save_scenario(scenario, out, map=options.map, fleet=fleet)
    say(f"{out}: {scenario.describe()}")
    return 0
