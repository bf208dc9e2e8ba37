"""``rvads classes`` and ``rvads map``: junctions and their scenarios."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Iterator
from itertools import groupby, islice
from operator import itemgetter
from pathlib import Path
from typing import Any

from pytest_rvads.cli.common import Subparsers, say, warn
from pytest_rvads.geometry.segment import NO_LIMIT
from pytest_rvads.support.storage import write_file
from pytest_rvads.support.wording import plural

__all__ = ["declare"]

_SHOWN = 100
_START = "vehicles start up to {:.0f} m before the line"


def declare(commands: Subparsers) -> None:
    """Add the commands of this module."""
    classes = commands.add_parser(
        "classes", help="list the structural equivalence classes of an n-way junction, or of one by name"
    )
    what = classes.add_mutually_exclusive_group(required=True)
    what.add_argument("ways", type=int, nargs="?", metavar="N", help="number of ways, 3 to 8")
    what.add_argument("--junction", metavar="NAME", help="built-in name, or id of a junction in --map")
    classes.add_argument("--map", metavar="FILE", help="OpenDRIVE file of a junction given by id")
    classes.add_argument("--occupancy", choices=("arms", "lanes"), default="arms", help="a vehicle on each arm, or on each lane")
    classes.add_argument("--all", action="store_true", help=f"list all classes, not only the first {_SHOWN}")
    classes.add_argument("--svg", metavar="OUT", help="also draw them into this file")
    classes.set_defaults(command=_classes)

    map_ = commands.add_parser("map", help="show the junctions of an OpenDRIVE file and what is doubtful in it")
    map_.add_argument("file", metavar="FILE")
    map_.add_argument("--json", action="store_true", help="print one JSON object")
    map_.add_argument("--svg", metavar="OUT", help="also draw the junctions into this file")
    map_.add_argument("--uturns", action="store_true", help="keep U-turns, which are left out otherwise")
    map_.add_argument("--no-clusters", dest="clusters", action="store_false", help="keep junctions of a cluster apart")
    map_.set_defaults(command=_map)


def _classes(options: argparse.Namespace) -> int:
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.report.draw.class_table import draw_classes
    from pytest_rvads.scenarios.classes import label
    from pytest_rvads.scenarios.orbits import Orbits
    from pytest_rvads.support.errors import ScenarioError

    place = find(options.junction, options.map) if options.junction else None
    if place is None and options.map:
        raise ScenarioError("--map is where --junction is looked for: name the junction, or leave --map out")
    orbits = Orbits.at(place, options.occupancy) if place else Orbits.plain(options.ways)
    lanes, total = place.lanes if place else (), orbits.count
    if options.svg and place and not place.one_lane_each:
        raise ScenarioError(f"--svg draws junctions of one lane per arm, {place.name!r} has more: leave it out")
    title = f"{orbits.scenarios} scenarios in {total} classes"
    shown = total if options.all else min(total, _SHOWN)

    def listed() -> Iterator[tuple[str, tuple[tuple[int, ...], ...]]]:
        return ((orbits.label(n), orbits.members(code)) for n, code in enumerate(islice(orbits, shown), start=1))

    if options.svg:
        write_file(Path(options.svg), draw_classes(place.ways if place else options.ways, title, list(listed())).encode())
    print(title)
    for name, members in listed():
        print(f"{name}  {label(members[0], lanes)}  {' '.join(label(m, lanes) for m in members[1:])}".rstrip())
    if shown < total:
        print(f"... and {total - shown} more: --all lists them", file=sys.stderr)
    return 0


def _map(options: argparse.Namespace) -> int:
    from pytest_rvads.geometry.road_map import describe, read_map
    from pytest_rvads.logic.conduct.room import narrow_lines
    from pytest_rvads.report.draw.map_picture import draw_map

    road_map = read_map(options.file, uturns=options.uturns, clusters=options.clusters)
    description = describe(road_map)
    description["warnings"] += [warning.record() for warning in narrow_lines(road_map)]
    if options.svg:
        write_file(Path(options.svg), draw_map(road_map).encode())
    if options.json:
        print(json.dumps(description, indent=1))
        return 0
    say(f"{os.path.basename(options.file)}: {plural(len(description['junctions']), 'junction')}")
    say(f"  {_summed(description['junctions'])}")
    for junction in description["junctions"]:
        state = f"not usable: {junction['reason']}"
        if junction["usable"]:
            state = f"{junction['kind']}; {_START.format(junction['usable_from'])}"
        say(f"  {junction['id']:>6}  {junction['ways']}-way {junction['control']:<7} {state}")
        for line in _details(junction) if junction["usable"] else ():
            say(f"  {'':>6}  {line}")
    for warning in description["warnings"]:
        warn(f"warning: {warning['message']}")
    return 0


def _summed(junctions: list[dict[str, Any]]) -> str:
    """Return a line on the usable junctions: their number, their kinds, and the length of the longest approaches."""
    from pytest_rvads.geometry.conflicts import JunctionKind

    usable = [junction for junction in junctions if junction["usable"]]
    share = f"{len(usable)} of {len(junctions)} usable"
    if not usable:
        return share
    counts = Counter(junction["kind"] for junction in usable)
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in JunctionKind if counts[kind])
    return f"{share}: {kinds}; {_START.format(max(junction['usable_from'] for junction in usable))}"


def _details(junction: dict[str, Any]) -> Iterator[str]:
    """Yield lines on a usable junction: the lanes and control of its arms, and which arms give way to which."""
    arms = [
        ", ".join((f"{plural(arm['entrances'], 'lane')} in, {arm['exits']} out", *_control(arm), *_limits(arm)))
        for arm in junction["arms"]
    ]
    alike = groupby(range(len(arms)), key=arms.__getitem__)
    yield "; ".join(f"{_named([*numbers])}: {arm}" for arm, numbers in alike)
    ways = [movement["entrance"] for movement in junction["movements"]]
    yielding = sorted({(ways[arm_number], ways[other_arm]) for arm_number, other_arm in junction["yields"]})
    parts = [
        f"arm {arm_number} to {_listed([other_arm for _, other_arm in pairs])}"
        for arm_number, pairs in groupby(yielding, key=itemgetter(0))
    ]
    undecided = sorted({tuple(sorted((ways[arm_number], ways[other_arm]))) for arm_number, other_arm in junction["undecided"]})
    parts += [f"arms {arm_number} and {other_arm} undecided" for arm_number, other_arm in undecided]
    yield f"gives way: {'; '.join(parts) or 'nobody'}"


def _control(arm: dict[str, Any]) -> Iterator[str]:
    """Yield the control of an arm with entrances, in words."""
    if arm["entrances"]:
        yield "no sign" if arm["control"] == "none" else arm["control"]


def _limits(arm: dict[str, Any]) -> Iterator[str]:
    """Yield the speed limits of an arm, in words."""
    for limit in arm["speed_limits"]:
        yield "no limit" if limit == NO_LIMIT else f"limit {limit:.1f} m/s"


def _named(arms: list[int]) -> str:
    return f"arm {arms[0]}" if len(arms) == 1 else f"arms {arms[0]} {'and' if len(arms) == 2 else 'to'} {arms[-1]}"


def _listed(arms: list[int]) -> str:
    return ", ".join(map(str, arms))
