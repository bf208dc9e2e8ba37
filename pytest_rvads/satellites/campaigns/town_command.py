"""``rvads town``: the junctions of whole maps, judged without pytest."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli import executor_options
from pytest_rvads.cli.common import Subparsers, say, terminable, warn
from pytest_rvads.report.session_report import NOTHING_JUDGED
from pytest_rvads.support.errors import AutopilotError, RvadsError, ScenarioError
from pytest_rvads.support.wording import plural

if TYPE_CHECKING:
    from pytest_rvads.satellites.campaigns.town import Town
    from pytest_rvads.satellites.campaigns.town_output import Order

__all__ = ["declare"]

_DESCRIPTION = """\
Judge a controller at every junction of OpenDRIVE maps. In the folder of -o stand town.html, the map with all junctions by their
verdicts; town.json, the report as of a session; results-*.jsonl, what was judged so far: the same command goes on where an
earlier one was cut off; replays, a page of the first example of every cause. Exit status: 0 when all that was judged passed, 1
when something failed, 2 when an argument is wrong or it did not come to its end, 5 when nothing was judged."""


_LARGEST = 2**31
"""Largest map file that is read [bytes]; larger files were refused before as no maps."""
_CHOICES = (
    *("maps", "cover", "occupancy", "grid", "subject", "traffic", "followers", "junctions"),
    *("limit", "sample", "seed", "once_per_shape"),
)
"""Options that choose runs."""


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    from pytest_rvads.scenarios.selection import COVERS  # no work before it is asked for

    town = commands.add_parser("town", help="judge a controller at all junctions of maps", description=_DESCRIPTION)
    town.add_argument("maps", nargs="+", metavar="MAP", help="OpenDRIVE file")
    drives = town.add_mutually_exclusive_group()
    drives.add_argument("--autopilot", metavar="NAME", help="what drives: module:name, reference, or a traffic policy")
    drives.add_argument("--sut", metavar="COMMAND", help="what drives: a program that speaks the protocol of stacks")
    town.add_argument("--simulator", metavar="NAME", help="what makes the runs, a name or module:name")
    town.add_argument(
        "--rules", nargs="+", default=["road"], metavar="RULE", help="rules, rulebooks or files of rules (default: road)"
    )
    town.add_argument("--cover", choices=COVERS, default="conflicts", help="which scenarios (default: conflicts)")
    town.add_argument("--occupancy", choices=("arms", "lanes"), default="arms", help="who is there in a full scenario")
    town.add_argument(
        "--grid", nargs="+", metavar="NAME", help="configurations, such as CD, arrivals, staggered, S21 (default: alternating)"
    )
    town.add_argument(
        "--subject",
        default="all",
        metavar="N",
        help="entrance of the vehicle under test among traffic, all of them in turn, or none: all vehicles are (default: all)",
    )
    town.add_argument("--traffic", metavar="POLICY", help="what drives the others (default: reference)")
    town.add_argument("--followers", type=int, default=0, metavar="N", help="how many queue behind each")
    town.add_argument(
        "--junctions",
        nargs="+",
        default=["*"],
        metavar="WHICH",
        help="ids, types such as '4-way stop', 'nearest to X, Y' (default: all)",
    )
    town.add_argument("--limit", type=int, metavar="N", help="at most so many junctions, evenly of every kind")
    town.add_argument("--sample", type=int, metavar="N", help="draw so many runs, evenly over junctions, classes, configurations")
    town.add_argument("--seed", type=int, default=0, metavar="S", help="of what is drawn (default: 0)")
    town.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="GLOB",
        help="run these alone, now, whatever was judged before; without -o they go into a folder of their own",
    )
    executor_options.declare(town)
    town.add_argument(
        "--once-per-shape", action="store_true", help="of junctions that are the same up to a motion simulate the first alone"
    )
    town.add_argument(
        "--report", action="append", default=[], metavar="FILE", help="write a report, in the format of its ending; repeatable"
    )
    town.add_argument("-o", "--out", metavar="DIR", help="folder to write to (default: rvads-town)")
    town.add_argument("--list", action="store_true", help="print the ids of the runs, and simulate nothing")
    town.set_defaults(command=_town)


def _town(options: argparse.Namespace) -> int:
    with _driver(options) as driver:
        order = _understood(options, driver)
        if options.list:
            for planned in order.town.plan:
                say(planned.name)
            return 0
        folder = Path(options.out or ("rvads-town/only" if options.only else "rvads-town"))
        _told_before(order.town)
        if not order.town.simulated:
            return _nothing(order.town)
        _made(folder)
        with terminable(), executor_options.opened(options) as executor:
            return _judged(order, options, folder, executor)


@contextmanager
def _driver(options: argparse.Namespace) -> Iterator[Any]:
    """Yield the driver under test.

    Raises:
        AutopilotError: the options name no driver, or the named object is no driver.
    """
    from pytest_rvads.drivers.chosen import chosen
    from pytest_rvads.drivers.naming import stand_in

    if options.sut is not None:
        from pytest_rvads.drivers.stacks.process import Process

        with Process(options.sut) as stack:
            yield stack
    elif options.autopilot is not None:
        yield chosen(options.autopilot, Path.cwd(), "--autopilot")
    elif options.list:
        yield stand_in()
    else:
        raise AutopilotError(
            "nothing says what drives: name it by --autopilot module:name or --sut COMMAND (--autopilot reference if you mean "
            "the reference)"
        )


def _understood(options: argparse.Namespace, driver: Any) -> Order:
    """Return the order that the options describe; errors in the options are raised before anything runs."""
    from pytest_rvads.drivers.traffic import DEFAULT, Policy
    from pytest_rvads.geometry.control import JunctionControl
    from pytest_rvads.logic.rules.book import rules_for
    from pytest_rvads.logic.rules.rulefile import load_rules
    from pytest_rvads.report.files import fitting
    from pytest_rvads.satellites.campaigns.town import Town
    from pytest_rvads.satellites.campaigns.town_output import Order
    from pytest_rvads.satellites.campaigns.town_plan import Asked
    from pytest_rvads.scenarios.configurations import grid
    from pytest_rvads.scenarios.scenario import check_followers
    from pytest_rvads.simulators.simulator import meant, named

    reports = tuple(map(fitting, options.report))
    subject = _subject(options.subject)
    if options.traffic is not None and subject is None:
        raise ScenarioError("--traffic drives the vehicles beside a subject: say --subject N or all, or leave --traffic out")
    for name in ("limit", "sample"):
        if (count := getattr(options, name)) is not None and count < 1:
            raise ScenarioError(f"--{name} must be at least 1, got {count}")
    check_followers(options.followers)
    grid(options.grid or "paper", 4, JunctionControl.STOP)
    rules = tuple(rule for name in options.rules for rule in (load_rules(name) if name.endswith(".rules") else [name]))
    rules_for(rules)
    asked = Asked(
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
        asked,
        limit=options.limit,
        only=options.only,
        sample=options.sample,
        seed=options.seed,
        once_per_shape=options.once_per_shape,
    )
    simulator = named(options.simulator, Path.cwd()) if options.simulator else meant()
    return Order(town, simulator, _again(options), reports)


def _subject(text: str) -> int | str | None:
    if text in ("all", "none"):
        return None if text == "none" else text
    if not (text.isdecimal() and len(text) < 4):
        raise ScenarioError(f"--subject must be an entrance, counted from 0, all, or none, got {text!r}")
    return int(text)


def _again(options: argparse.Namespace) -> str:
    """Return the command that runs given ids again under the same options; options that select other runs are left out."""
    words = ["rvads", "town", *options.maps]
    for name in ("autopilot", "sut", "simulator", "cover", "occupancy", "subject", "traffic"):
        value, usual = getattr(options, name), {"cover": "conflicts", "occupancy": "arms", "subject": "all"}.get(name)
        words += [f"--{name}", value] if value not in (None, usual) else []
    words += ["--followers", str(options.followers)] if options.followers else []
    words += ["--rules", *options.rules] if options.rules != ["road"] else []
    words += ["--grid", *options.grid] if options.grid else []
    return f"{shlex.join(words)} --only"


def _told_before(town: Town) -> None:
    """Print to standard error the number of planned runs, and the refused junctions."""
    refused = [(name, reason) for reason, names in town.refused().items() for name in names]
    total, simulated = sum(town.counts.values()), town.simulated
    fewer = f", {simulated} to simulate" if simulated < total else ""
    warn(f"{plural(len(town.plan.places), 'junction')}, {plural(total, 'run')}{fewer}")
    if refused:
        warn(f"{plural(len(refused), 'junction')} refused, the first: {refused[0][0]}: {refused[0][1]}")
    left_out = [found.scenarios for place in town.plan.places if (found := town.plan.left_out(place))]
    if left_out:
        scenarios, places = plural(sum(left_out), "scenario"), plural(len(left_out), "junction")
        warn(f"{scenarios} at {places} left out: a vehicle has no room where it starts")
    for one in town.drawn():
        warn(f"{one.taken:,} of {one.total:,} {one.what} are drawn, seed {one.seed}")
    for note in town.notes():
        warn(note)


def _made(folder: Path) -> None:
    """Make the folder to write to.

    Raises:
        RvadsError: the folder can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RvadsError(
            f"-o must name a folder to write to, got {str(folder)!r}, which can't be made ({error.strerror}): name another one"
        ) from error


def _nothing(town: Town) -> int:
    if town.plan.only:
        raise ScenarioError(f"no run has an id like {', '.join(map(repr, town.plan.only))}: `rvads town MAP --list` prints them")
    warn("rvads: nothing to judge: every junction is refused")
    return NOTHING_JUDGED


def _judged(order: Order, options: argparse.Namespace, folder: Path, executor: Executor | int | None) -> int:
    """Simulate and judge the runs, write all results even of an interrupted campaign, and return the exit status."""
    from pytest_rvads.satellites.campaigns.campaign import campaign
    from pytest_rvads.satellites.campaigns.progress_bar import progressing
    from pytest_rvads.satellites.campaigns.resultsfile import Results
    from pytest_rvads.satellites.campaigns.town_output import written

    town = order.town
    path = None if options.only else folder / f"results-{_digest(order, options)}.jsonl"
    if path is not None and path.exists():
        warn(f"{path} has results of this town: what is judged there is not simulated again")
    try:
        with progressing("runs") as progress:
            results = campaign(
                town.cases(),
                order.town.plan.asked.rules,
                executor=executor,
                results=path,
                simulator=order.simulator,
                progress=progress,
                total=town.simulated,
            )
    except (KeyboardInterrupt, RvadsError) as stopped:
        if path is None or not path.exists():
            raise
        try:
            results = Results(path)
        except (RvadsError, OSError):
            raise stopped from None
        cut = "interrupted" if isinstance(stopped, KeyboardInterrupt) else str(stopped)
        with results:
            if not len(results):
                raise stopped
            warn(f"rvads: {cut}")
            return written(order, results, folder, executor, cut)
    with results:
        return written(order, results, folder, executor)


def _digest(order: Order, options: argparse.Namespace) -> str:
    """Return a digest that differs for other maps, drivers, simulators, rules and choices, and for other code of these."""
    from pytest_rvads.drivers.identity import identity
    from pytest_rvads.support.storage import read_file
    from pytest_rvads.support.versions import code

    told: list[Any] = [sha256(read_file(map, _LARGEST)).hexdigest() for map in order.town.maps]
    told += [code(), identity(order.town.plan.asked.driver), identity(order.simulator)]
    told += [rule if isinstance(rule, str) else f"{rule.name} {identity(rule)}" for rule in order.town.plan.asked.rules]
    told += [identity(order.town.plan.asked.traffic.factory)] if order.town.plan.asked.traffic else []
    told.append([getattr(options, name) for name in _CHOICES])
    return sha256(json.dumps(told).encode("utf-8", "surrogatepass")).hexdigest()[:12]
