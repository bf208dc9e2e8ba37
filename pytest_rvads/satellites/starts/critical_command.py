"""The command ``rvads critical``: finds the starts at which a driver turns from waiting to going, and judges their runs."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import (
    MAP_FORMATS,
    Subparsers,
    conflicting,
    declare_driver,
    declare_rules,
    named_rules,
    opened_driver,
    opened_executor,
    program,
    progress,
    say,
    share,
    terminable,
    warn,
)
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.folders import ROOT, STARTS
from pytest_rvads.report.session_report import NOTHING_JUDGED, exit_status
from pytest_rvads.support.errors import MapError, RvadsError, ScenarioError
from pytest_rvads.support.executors import apart
from pytest_rvads.support.storage import write_file
from pytest_rvads.support.wording import plural

if TYPE_CHECKING:
    from pytest_rvads.geometry.junction import Junction
    from pytest_rvads.satellites.starts.critical import CriticalStart
    from pytest_rvads.satellites.starts.lines import Setting

_CRITICAL = """\
For every two conflicting ways of a junction, find the start at which the vehicle under test changes from waiting to going, and
judge the runs from this start and from less critical starts. A start is found to 0.01 s of the lead: the time by which the
vehicle arrives before the other vehicle or the pedestrian. Exit status: 0 when all runs passed, 1 when a run failed, 2 when an
argument is wrong, 5 when no start could be simulated. With --all-lines, find all changes of a verdict over leads of -6 to 6 s,
and write a page with a strip per pair of ways. --json prints a certificate, which names the simulated starts, the verdicts
inferred between these starts, and the random starts that were compared with the inferred verdicts. Exit status: 0, also for a
driver that fails; 1 when a random start differs from the certificate, or a run has no verdict."""


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads critical`` to the parser."""
    critical = commands.add_parser(
        "critical", help="find the starts at which a driver changes from waiting to going", description=_CRITICAL
    )
    critical.add_argument("place", metavar="JUNCTION|MAP", help=f"built-in junction, or map file ({MAP_FORMATS})")
    share(critical, "junction", help="id of a junction of the map (default: all with conflicting ways)")
    declare_driver(critical)
    share(critical, "traffic", default="reference")
    critical.add_argument(
        "--pedestrians",
        nargs="+",
        default=[],
        metavar="BEHAVIOUR",
        help="instead of another vehicle, meet a pedestrian on a crosswalk; a behaviour such as steady or darts",
    )
    share(critical, "simulator", "workers")
    declare_rules(critical)
    alone = critical.add_mutually_exclusive_group()
    alone.add_argument("--start", metavar="ID", help="simulate this start alone, and say why the run fails")
    alone.add_argument("--all-lines", action="store_true", help="find all changes of a verdict on all lines, and write a page")
    critical.add_argument(
        "--probes", type=int, default=250, metavar="N", help="with --all-lines: random starts to compare (default: 250)"
    )
    page = f"{ROOT}/{STARTS}"
    share(critical, "output", help=f"with --start: replay page to write; with --all-lines: page to write (default: {page})")
    share(critical, "json", help="print one JSON object: two entries per line of starts, with --all-lines the certificate")
    critical.set_defaults(command=_critical)


def _critical(options: argparse.Namespace) -> int:
    from pytest_rvads.satellites.starts.critical import critical_starts
    from pytest_rvads.satellites.starts.lines import Setting, lines_at
    from pytest_rvads.simulators.simulator import named

    if options.output and not (options.start or options.all_lines):
        raise ScenarioError("-o writes the replay of one start, or the page of all lines: give --start ID or --all-lines")
    if options.probes < 0:
        raise ScenarioError(f"--probes must be a number of random starts, 0 or more, got {options.probes}")
    if options.json and options.start:
        raise ScenarioError("--json prints lines of starts, and --start simulates one start: leave one of the two out")
    with opened_driver(options) as driver, terminable(), opened_executor(options) as executor:
        simulator = named(options.simulator, Path.cwd())
        setting = Setting.of(driver, named_rules(options.rules or ["road"]), options.traffic, simulator=simulator)
        if options.start:
            return _one_start(options, setting)
        if options.all_lines:
            from pytest_rvads.satellites.starts.all_lines import search_all

            return search_all(options, _places(options), setting, executor, partial(again, options))
        entries: list[dict[str, Any]] = []
        stopped: BaseException | None = None
        for place in _places(options):
            groups = lines_at(place, behaviours=options.pedestrians)
            sides: list[CriticalStart] = []
            try:
                sides.extend(
                    critical_starts(groups, setting, executor, None if options.json else partial(progress, what="groups"))
                )
            except (KeyboardInterrupt, RvadsError) as error:
                stopped = error
            entries += [_entry(side, setting, options) for side in sides]
            if sides and not options.json:
                for line in _table(place, sides, setting, options):
                    say(line)
            if stopped:
                count = plural(sum(map(len, groups)), "line")
                warn(f"rvads: INCOMPLETE: {len(sides) // 2} of {count} of starts at {place.name} were searched")
                break
    if options.json:
        names = [rule.name for rule in setting.rules]
        print(json.dumps({"version": 1, "rules": names, "complete": not stopped, "lines": entries}))
    if stopped:
        raise stopped
    if not any(entry["critical_start"] or entry["error"] for entry in entries):
        warn("rvads: no start could be simulated: " + next((e["unfit"] for e in entries if e["unfit"]), "no vehicle has room"))
        return NOTHING_JUDGED
    return exit_status({entry["status"] for entry in entries})


def _map_of(options: argparse.Namespace) -> str | None:
    """Return the map file that the options name; None if the options name a built-in junction."""
    from pytest_rvads.geometry.finder import names

    place: str = options.place
    if place in names():
        if options.junction:
            raise MapError(f"--junction names a junction of a map, and {place!r} is a built-in junction: leave it out")
        return None
    if not Path(place).exists():
        raise MapError(f"{place!r} is no built-in junction ({', '.join(names())}) and no file: name one of these")
    return place


def _places(options: argparse.Namespace) -> Iterator[Junction]:
    """Yield the junctions that the options name; of a whole map, those without a line of starts are left out with a warning."""
    from pytest_rvads.drivers.walking import behaviour
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.satellites.starts.lines import lines_at

    for name in options.pedestrians:
        behaviour(name)
    map = _map_of(options)
    if map is None or options.junction:
        yield find(options.junction or options.place, map)
        return
    ids = conflicting(map)
    if not ids:
        raise MapError(f"{map} has no junction in which ways conflict: `rvads map {shlex.quote(map)}` says why")
    left_out: list[ScenarioError] = []
    for place in (find(id, map) for id in ids):
        try:
            lines_at(place, behaviours=options.pedestrians)
        except ScenarioError as error:
            left_out.append(error)
            warn(f"rvads: {error}")
        else:
            yield place
    if len(left_out) == len(ids):
        raise ScenarioError(f"{map} has no junction with a line of starts, for the reasons above: use another map")


def again(options: argparse.Namespace, place: Junction, id: str) -> str:
    """Return the command that simulates the start with the id `id` once more."""
    words = [*program(options), "critical", options.place, *(["--junction", place.id] if place.map else [])]
    words += [word for name in ("autopilot", "sut") if (value := getattr(options, name)) for word in (f"--{name}", value)]
    words += ["--traffic", options.traffic] if options.traffic != "reference" else []
    words += ["--simulator", options.simulator] if options.simulator else []
    words += ["--rules", *options.rules] if options.rules else []
    return shlex.join([*words, "--start", id])


def _entry(side: CriticalStart, setting: Setting, options: argparse.Namespace) -> dict[str, Any]:
    """Return a JSON object: the critical start for two conflicting ways and an order of the vehicles (subject goes or waits)."""
    from pytest_rvads.satellites.starts.lines import Begin, start_of

    line = side.line
    shown = side.failed or side.start
    id = setting.id(line.scenario(shown.lead)) if shown else ""
    return {
        "junction": line.place.name,
        "ways": list(line.named()),
        "from_rest": line.begin is Begin.REST,
        "seat": line.seat,
        "decided_by": line.vista,
        "order": side.order,
        "critical_start": start_of(line, side.start.lead, setting) if side.start else None,
        "status": side.status,
        "fault": side.fault,
        "rule": side.rule,
        "failed_start": start_of(line, side.failed.lead, setting) if side.failed else None,
        "starts": len(side.tried),
        "rerun": again(options, line.place, id) if side.failed else "",
        "unfit": side.unfit,
        "error": side.error,
    }


def _table(place: Junction, sides: Sequence[CriticalStart], setting: Setting, options: argparse.Namespace) -> Iterator[str]:
    """Yield a table line per way of the subject, way of the other vehicle and order of the two, then lines on each failure."""
    from pytest_rvads.satellites.starts.lines import STEP

    yield f"{place.name}: {plural(len(sides) // 2, 'line')} of starts, {sum(len(side.tried) for side in sides)} runs"
    wide = 9 + 8 * any(side.line.walker is not None for side in sides)
    yield f"{'subject':18}{'other':{wide}}{'decided by':26}{'order':7}{'critical start':>16}  status"
    rows: dict[tuple[object, ...], list[CriticalStart]] = {}  # sides that are equal up to a rotation of the junction
    for side in sides:
        line = side.line
        turns = tuple(line.place.every_way[way].turn for way in line.ways)
        apart: object = (line.ways[1][0] - line.seat) % len(place.entrances)
        if line.walker:
            arms = place.crossings[line.walker.crossing].arm - place.entrances[line.seat].arm
            apart = arms % place.ways, line.walker.side, line.walker.behaviour
        tenths = None if side.start is None else round(side.start.lead * STEP, 1)
        key = (
            turns,
            apart,
            line.begin,
            line.vista,
            side.order,
            tenths,
            side.status,
            side.rule,
            side.fault,
            bool(side.unfit),
            bool(side.error),
        )
        rows.setdefault(key, []).append(side)
    for row in rows.values():
        first = row[0]
        subject, other = first.line.labels
        lead = "-" if first.unfit or first.error else "never"
        lead = lead if first.start is None else f"{first.start.lead * STEP:+.2f} s"
        told = f"{first.status} {first.rule}, {first.fault}" if first.fault else str(first.status)
        told = "no room where a vehicle starts" if first.unfit else told
        more = f", as on {plural(len(row) - 1, 'similar line')}" if len(row) > 1 else ""
        yield f"{subject:18}{other:{wide}}{first.line.vista:26}{first.order:7}{lead:>16}  {told}{more}"
    for side in (row[0] for row in rows.values()):
        if side.error and side.order == "goes":  # the entries of both orders of a line have the same error
            yield from ("", f"{side.line}: ERROR: {side.error}")
        elif side.failed is not None:
            id = setting.id(side.line.scenario(side.failed.lead))
            yield from ("", f"{side.line}, {side.fault}: {side.rule} {side.status}, lead {side.failed.lead * STEP:+.2f} s")
            yield from side.explanation.splitlines()
            yield f"rerun     {again(options, side.line.place, id)}"


def _one_start(options: argparse.Namespace, setting: Setting) -> int:
    """Simulate the start that an option names, print the verdicts on its run, and write its replay page."""
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.logic.check import verdict_by
    from pytest_rvads.satellites.pages.replay import replay
    from pytest_rvads.scenarios.ids import from_id

    map = _map_of(options)
    scenario = from_id(options.start, map)
    if map is None or options.junction:
        named = find(options.junction or options.place, map)
        if scenario.place.name != named.name:
            raise ScenarioError(
                f"--start is at junction {scenario.place.name!r}, and the command names {named.name!r}: name one of the two"
            )
    say(scenario.describe())
    run = apart(partial(setting.simulated, scenario))
    verdicts = [verdict_by(run, rule) for rule in setting.rules if rule.concerns(scenario.place)]
    if not verdicts:
        warn(f"rvads: none of the rules is about junction {scenario.place.name!r}: choose others by --rules")
        return NOTHING_JUDGED
    verdicts.sort(key=lambda verdict: verdict.outcome.severity)
    if run.fault is not None:
        say(f"ERROR: {run.fault.reason}")
    for verdict in verdicts:
        if verdict.outcome is Outcome.ERROR:
            if run.fault is None:
                say(verdict.message)
        else:
            say(verdict.explanation if verdict.outcome.bad else verdict.message)
    if options.output:
        worst = verdicts[0]
        opened = worst.time if worst.outcome.bad else None
        marked = [] if opened is None else [(opened, worst.message)]
        page = replay(run, worst.message, worst.explanation, marked, responsible=worst.responsible, opened=opened)
        write_file(Path(options.output), page.encode())
        say(f"wrote {options.output}")
    return exit_status({verdict.outcome for verdict in verdicts})
