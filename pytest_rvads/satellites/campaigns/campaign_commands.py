"""The commands ``rvads town``, which judges a driver at the junctions of maps, and ``rvads league``, which compares drivers."""

from __future__ import annotations

import argparse
import shlex
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import (
    MAP_FORMATS,
    Subparsers,
    declare_driver,
    declare_rules,
    listed_rules,
    make_folder,
    opened_driver,
    opened_executor,
    program,
    progress,
    say,
    share,
    show,
    terminable,
    warn,
)
from pytest_rvads.report.session_report import NOTHING_JUDGED
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.wording import first, plural, quoted

if TYPE_CHECKING:
    from pytest_rvads.satellites.campaigns.town import Town
    from pytest_rvads.simulators.simulator import Simulator

_TOWN = """\
Judge a controller at every junction of maps. The folder of -o gets town.html, the map with the verdicts at all
junctions; town.json, the report; results-*.jsonl, the results so far, so that the same command continues after an interruption;
and replays, a page of the first example of every cause. Exit status: 0 if every verdict passed, 1 if something failed, 2 if an
argument is wrong or the command did not come to its end, 5 if nothing was judged."""
_LEAGUE = """\
Judge several drivers on the same drawn cells. CONFIG is a TOML file with the drivers, junctions, maps, seats, traffic and rules,
the number of cells, the number of lines of critical starts, and a seed. The folder of -o gets league.html, the table of drivers
by rules with the causes of all failures; league.json, the same for programs; replays of the first run of every cause; and the
results so far, so that the same command continues after an interruption. Exit status: 0 if every verdict passed, 1 if something
failed, 2 if an argument or the configuration is wrong or a driver lacks results, 5 if nothing was judged."""


def declare(commands: Subparsers) -> None:
    """Add the commands ``rvads town`` and ``rvads league`` to the parser."""
    from pytest_rvads.scenarios.selection import COVERS  # imported only if a command is declared

    town = commands.add_parser("town", help="judge a controller at all junctions of maps", description=_TOWN)
    town.add_argument("maps", nargs="+", metavar="MAP", help=f"map file ({MAP_FORMATS})")
    declare_driver(town)
    share(town, "simulator")
    declare_rules(town)
    town.add_argument("--cover", choices=COVERS, default="conflicts", help="choice of scenarios (default: conflicts)")
    share(town, "occupancy", "traffic", "workers")
    town.add_argument(
        "--grid", nargs="+", metavar="NAME", help="configurations, such as CD, arrivals, staggered, S21 (default: alternating)"
    )
    town.add_argument(
        "--subject",
        default="all",
        metavar="N",
        help="entrance of the vehicle under test among traffic; all: each entrance in turn; none: the driver drives all vehicles "
        "(default: all)",
    )
    town.add_argument("--followers", type=int, default=0, metavar="N", help="number of vehicles that queue behind each vehicle")
    town.add_argument(
        "--junctions",
        nargs="+",
        default=["*"],
        metavar="WHICH",
        help="ids, types such as '4-way stop', 'nearest to X, Y' (default: all)",
    )
    town.add_argument("--limit", type=int, metavar="N", help="draw at most N junctions, evenly over kinds of junctions")
    town.add_argument("--sample", type=int, metavar="N", help="draw N runs, evenly over junctions, classes and configurations")
    town.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the draws (default: 0)")
    town.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="GLOB",
        help="run only the ids that match, even if they were judged before; without -o the output goes to rvads-town/only",
    )
    share(town, "output", metavar="DIR", help="folder to write to (default: rvads-town)")
    town.add_argument("--list", action="store_true", help="print the ids of the runs, and simulate nothing")
    town.set_defaults(command=_town)
    league = commands.add_parser("league", help="judge several drivers on the same runs", description=_LEAGUE)
    league.add_argument("config", metavar="CONFIG", help="TOML file")
    share(league, "workers")
    share(league, "output", metavar="DIR", default="rvads-league", help="folder to write to (default: rvads-league)")
    league.set_defaults(command=_league)


def _town(options: argparse.Namespace) -> int:
    from pytest_rvads.drivers.naming import stand_in

    named = not options.list or options.autopilot is not None or options.sut is not None
    with opened_driver(options) if named else nullcontext(stand_in()) as driver:
        town, simulator = _asked(options, driver)
        if options.list and town.runs:
            for planned in town.plan:
                say(planned.name)
            return 0
        folder = Path(options.output or ("rvads-town/only" if options.only else "rvads-town"))
        refused = [(name, reason) for reason, names in town.refused().items() for name in names]
        warn(f"{plural(len(town.plan.places), 'junction')}, {plural(town.runs, 'run')}")
        if refused:
            warn(f"{plural(len(refused), 'junction')} refused, the first: {refused[0][0]}: {refused[0][1]}")
        left_out = [scenarios.scenarios for place in town.plan.places if (scenarios := town.plan.left_out(place))]
        if left_out:
            number, places = plural(sum(left_out), "scenario"), plural(len(left_out), "junction")
            warn(f"{number} at {places} left out: a vehicle has no room at its start")
        for note in (*map(str, town.drawn()), *town.notes()):
            warn(note)
        if not town.runs:
            if town.plan.only:
                patterns, ids = ", ".join(map(repr, town.plan.only)), [run.name for run in replace(town.plan, only=())]
                raise ScenarioError(
                    f"no run has an id like {patterns}, there are {first(ids, 3)}: `rvads town MAP --list` prints them"
                )
            warn("rvads: nothing to judge: every junction is refused")
            return NOTHING_JUDGED
        make_folder("-o", folder)
        with terminable(), opened_executor(options) as executor:
            return _judge_town(town, simulator, options, folder, executor)


def _asked(options: argparse.Namespace, driver: Any) -> tuple[Town, Simulator]:
    """Return the town and the simulator that the options ask for; a wrong option raises an error before a run is simulated."""
    from pytest_rvads.drivers.traffic import DEFAULT, Policy
    from pytest_rvads.geometry.control import JunctionControl
    from pytest_rvads.satellites.campaigns.town import Request, Town
    from pytest_rvads.scenarios.configurations import grid
    from pytest_rvads.scenarios.scenario import check_followers
    from pytest_rvads.simulators.simulator import named

    subject = _subject(options.subject)
    if options.traffic is not None and subject is None:
        raise ScenarioError("--traffic drives the vehicles beside a subject: give --subject N or all, or leave --traffic out")
    for name in ("limit", "sample"):
        if (count := getattr(options, name)) is not None and count < 1:
            raise ScenarioError(f"--{name} must be at least 1, got {count}")
    check_followers(options.followers)
    grid(options.grid or "paper", 4, JunctionControl.STOP)
    rules = listed_rules(options.rules or ["road"])
    request = Request(
        driver,
        rules,
        options.cover,
        options.occupancy,
        tuple(options.grid) if options.grid else None,
        subject,
        None if subject is None else Policy.of(options.traffic or DEFAULT),
        (options.followers,),
    )
    town = Town.of(
        [Path(map) for map in options.maps],
        options.junctions,
        request,
        limit=options.limit,
        only=options.only,
        sample=options.sample,
        seed=options.seed,
    )
    return town, named(options.simulator, Path.cwd())


def _subject(text: str) -> int | str | None:
    if text in ("all", "none"):
        return None if text == "none" else text
    if not (text.isdecimal() and len(text) < 4):
        raise ScenarioError(f"--subject must be an entrance, counted from 0, all, or none, got {text!r}")
    return int(text)


def _rerun_command(options: argparse.Namespace) -> str:
    """Return the beginning of a command that runs cases of this town again, without the options that select some of its runs."""
    words = [*program(options), "town", *options.maps]
    for name in ("autopilot", "sut", "simulator", "cover", "occupancy", "subject", "traffic"):
        value, usual = getattr(options, name), {"cover": "conflicts", "occupancy": "arms", "subject": "all"}.get(name)
        words += [f"--{name}", value] if value not in (None, usual) else []
    words += ["--followers", str(options.followers)] if options.followers else []
    words += ["--rules", *options.rules] if options.rules else []
    words += ["--grid", *options.grid] if options.grid else []
    return f"{shlex.join(words)} --only"


def _judge_town(
    town: Town, simulator: Simulator, options: argparse.Namespace, folder: Path, executor: Executor | int | None
) -> int:
    """Simulate and judge the runs, write page and reports, also after an interruption, and return the exit status."""
    from pytest_rvads.report.files import save, write
    from pytest_rvads.satellites.campaigns.campaign import continued, digest
    from pytest_rvads.satellites.campaigns.replays import Replays, draw_replays
    from pytest_rvads.satellites.pages.page import page

    again = _rerun_command(options)
    path = None if options.only else folder / f"results-{digest(town.cases(), town.plan.request.rules, simulator)}.jsonl"
    if path is not None and path.exists():
        warn(f"{path} has results of this town: cases with a result are not simulated again")
    rules, cut, replays = town.plan.request.rules, "", Replays()
    results, stopped = continued(town.cases(), rules, path, simulator, executor, progress, town.runs)
    if stopped:
        if results is None:
            raise stopped
        cut = "interrupted" if isinstance(stopped, KeyboardInterrupt) else str(stopped)
        warn(f"rvads: {cut}")
    assert results is not None
    with results:
        if not cut:
            replays = draw_replays(
                results.records(),
                town.case_of,
                rules,
                lambda name: f"{again} {quoted(name)}",
                folder,
                executor,
                simulator,
            )
        report = town.report(results, replays, again, cut)
        title = f"rvads town: {', '.join(map.stem for map in town.maps)}"
        write(folder / "town.html", page(report, folder, title, town.pictures(results, report.records)))
        save(folder / "town.json", report)
        show(report)
        for note in report.notes:
            say(note)
        say(f"look: {folder / 'town.html'}")
        return report.exitstatus


def _league(options: argparse.Namespace) -> int:
    from pytest_rvads.satellites.campaigns.league import judge_league

    with terminable(), opened_executor(options) as executor:
        return judge_league(Path(options.config), Path(options.output), executor)
