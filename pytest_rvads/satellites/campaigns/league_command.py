"""The command ``rvads league``: judges several drivers on the same cells, and writes a page and JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from pytest_rvads.cli.common import Subparsers, terminable
from pytest_rvads.cli.shared_options import opened_executor, share

_DESCRIPTION = """\
Judge several drivers on the same drawn cells. CONFIG is a TOML file with the drivers, junctions, maps, seats, traffic and rules,
the number of cells, the number of lines of critical starts, and a seed. The folder of -o gets league.html, the table of drivers
by rules with the causes of all failures; league.json, the same for programs; replays of the first run of every cause; and the
results so far, so that the same command continues after an interruption. Exit status: 0 if every verdict passed, 1 if something
failed, 2 if an argument or the configuration is wrong or a driver lacks results, 5 if nothing was judged."""


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads league`` to the parser."""
    league = commands.add_parser("league", help="judge several drivers on the same runs", description=_DESCRIPTION)
    league.add_argument("config", metavar="CONFIG", help="TOML file")
    share(league, "workers")
    share(league, "output", metavar="DIR", default="rvads-league", help="folder to write to (default: rvads-league)")
    league.set_defaults(command=_league)


def _league(options: argparse.Namespace) -> int:
    from pytest_rvads.satellites.campaigns.league_output import judge_league

    with terminable(), opened_executor(options) as executor:
        return judge_league(Path(options.config), Path(options.output), executor)
