"""The commands ``rvads classes`` and ``rvads map``, which show classes of scenarios and the junctions of a map.

Classes are drawn as in the paper: a row per class, a diagram per scenario.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, islice
from math import cos, pi, sin
from operator import itemgetter
from pathlib import Path
from typing import Any

from pytest_rvads.cli.common import MAP_FORMATS, Subparsers, say, share, warn
from pytest_rvads.geometry.segment import NO_LIMIT
from pytest_rvads.report.svg import document, text
from pytest_rvads.support.storage import write_file
from pytest_rvads.support.wording import natural, plural

_SHOWN = 100
_START = "vehicles start up to {:.0f} m before the line"
_CELL, _LABEL, _RADIUS, _LANE, _HEAD = 124, 90, 42.0, 5.0, 66
"""Sizes of the picture of classes [px]: a scenario, the room for the name of a class, an arm, half a lane, title and legend."""
_COLOURS = ("#009e73", "#0072b2", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f00")
"""Okabe and Ito's palette, distinguishable by colour-blind people; a colour per direction (arms from entrance to exit).

At four arms, right, straight and left have the colours that they have in the picture of a map.
"""


def declare(commands: Subparsers) -> None:
    """Add the commands ``classes`` and ``map`` to the parser."""
    classes = commands.add_parser(
        "classes", help="list the structural equivalence classes of an n-way junction, or of a named junction"
    )
    classes.add_argument(
        "place", metavar="N|JUNCTION", help="number of ways, 3 to 8; built-in name, or id of a junction in --map"
    )
    share(classes, "map", "occupancy", "svg")
    classes.add_argument("--all", action="store_true", help=f"list all classes, not only the first {_SHOWN}")
    classes.set_defaults(command=_classes)

    map_ = commands.add_parser("map", help="show the junctions of a map file, and warnings on doubtful parts of the file")
    map_.add_argument("file", metavar="FILE", help=f"map file ({MAP_FORMATS}), or the name or type of a built-in junction")
    share(map_, "json", "svg")
    map_.add_argument("--uturns", action="store_true", help="include U-turns, which are left out otherwise")
    map_.set_defaults(command=_map)


def _classes(options: argparse.Namespace) -> int:
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.scenarios.classes import Orbits, label
    from pytest_rvads.support.errors import ScenarioError

    place = None if options.place.isdecimal() and not options.map else find(options.place, options.map)
    orbits = Orbits.at(place, options.occupancy) if place else Orbits.plain(int(options.place))
    lanes, total = place.lanes if place else (), orbits.count
    if options.svg and place and not place.one_lane_each:
        raise ScenarioError(f"--svg draws junctions of one lane per arm, {place.name!r} has more: leave it out")
    title = f"{orbits.scenarios} scenarios in {total} classes"
    shown = total if options.all else min(total, _SHOWN)

    def rows() -> Iterator[tuple[str, tuple[tuple[int, ...], ...]]]:
        return ((orbits.label(n), orbits.members(code)) for n, code in enumerate(islice(orbits, shown), start=1))

    if options.svg:
        write_file(Path(options.svg), draw_classes(place.ways if place else int(options.place), title, rows()).encode())
    print(title)
    for name, members in rows():
        print(f"{name}  {label(members[0], lanes)}  {' '.join(label(m, lanes) for m in members[1:])}".rstrip())
    if shown < total:
        print(f"... and {total - shown} more: --all lists them", file=sys.stderr)
    return 0


def draw_classes(ways: int, title: str, rows: Iterable[tuple[str, Sequence[tuple[int, ...]]]]) -> str:
    """Return an SVG document with a diagram of every scenario of some classes."""
    rows = list(rows)
    body = [text(10, 24, title, font_size=15, font_weight="bold")]
    body.append(text(10, 42, "direction: number of arms from entrance to exit, counter-clockwise", font_size=10))
    for d in range(1, ways):
        left = 10 + (d - 1) * _LABEL
        line = f'<path d="M{left} 56h24" stroke="{_COLOURS[d - 1]}" stroke-width="2" marker-end="url(#d{d})"/>'
        body.append(line + text(left + 34, 60, str(d)))
    for number, (label, members) in enumerate(rows):
        top = _HEAD + number * _CELL
        body.append(text(10, top + _CELL / 2 + 4, label))
        for column, member in enumerate(members):
            x, y = _LABEL + (column + 0.5) * _CELL, top + _CELL / 2
            body.append(f'<g transform="translate({x:g} {y:g})">{_diagram(ways, member)}</g>')
    markers = "".join(
        f'<marker id="d{d}" viewBox="0 0 6 6" refX="4" refY="3" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L6 3L0 6z" fill="{_COLOURS[d - 1]}"/></marker>'
        for d in range(1, ways)
    )
    return document(_LABEL + ways * _CELL + 10, _HEAD + 10 + len(rows) * _CELL, body, markers)


def _diagram(ways: int, directions: Sequence[int]) -> str:
    parts = []
    for arm in range(ways):
        ux, uy = _outward(arm, ways)
        parts.append(f'<line x2="{_RADIUS * ux:.1f}" y2="{_RADIUS * uy:.1f}" stroke="#ddd" stroke-width="{4 * _LANE:g}"/>')
    for arm, direction in enumerate(directions):
        ux, uy = _outward(arm, ways)
        number = _RADIUS + 8
        parts.append(text(number * ux, number * uy + 3, str(arm), font_size=9, fill="#666", text_anchor="middle"))
        if not direction:
            continue
        # The movement leads from the lane into the junction to the lane out. Screen y points down: the lane to the right of a
        # driver heading inwards (-u) lies along (uy, -ux).
        vx, vy = _outward((arm + direction) % ways, ways)
        start = (_RADIUS * ux + _LANE * uy, _RADIUS * uy - _LANE * ux)
        end = (_RADIUS * vx - _LANE * vy, _RADIUS * vy + _LANE * vx)
        bend = 2 * _LANE
        controls = (bend * ux + _LANE * uy, bend * uy - _LANE * ux), (bend * vx - _LANE * vy, bend * vy + _LANE * vx)
        path = " ".join(f"{x:.1f} {y:.1f}" for x, y in (*controls, end))
        colour = _COLOURS[direction - 1]
        parts.append(
            f'<path d="M{start[0]:.1f} {start[1]:.1f}C{path}" fill="none" stroke="{colour}" stroke-width="2" '
            f'marker-end="url(#d{direction})"/>'
        )
    return "".join(parts)


def _outward(arm: int, ways: int) -> tuple[float, float]:
    """Return the direction of an arm on the screen: arm 0 points down, the other arms follow counter-clockwise."""
    angle = -pi / 2 + 2 * pi * arm / ways
    return cos(angle), -sin(angle)


def _map(options: argparse.Namespace) -> int:
    from pytest_rvads.geometry.conflicts import JunctionKind
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.geometry.network import Doubt, gathered
    from pytest_rvads.geometry.road_map import READERS, describe, read_map
    from pytest_rvads.logic.conduct.room import narrow_lines
    from pytest_rvads.report.map_picture import draw_map

    is_file = Path(options.file).suffix.lower() in READERS or Path(options.file).exists()
    file = options.file if is_file else str(find(options.file).map_file)
    road_map = read_map(file, uturns=options.uturns)
    description = describe(road_map)
    description["warnings"] += gathered(narrow_lines(road_map))
    if options.svg:
        write_file(Path(options.svg), draw_map(road_map).encode())
    if options.json:
        print(json.dumps(description, indent=1))
        return 0
    junctions = description["junctions"]
    usable = [junction for junction in junctions if junction["usable"]]
    summary = f"  {len(usable)} of {len(junctions)} usable"
    if usable:
        counts = Counter(junction["kind"] for junction in usable)
        kinds = ", ".join(f"{counts[kind]} {kind}" for kind in JunctionKind if counts[kind])
        summary += f": {kinds}; {_START.format(max(junction['usable_from'] for junction in usable))}"
    say(f"{os.path.basename(file)}: {plural(len(junctions), 'junction')}")
    say(summary)
    sides = {report.left_hand for report in road_map.junctions}
    doubtful = any(warning.kind is Doubt.SIDE for warning in road_map.warnings)
    if True in sides or doubtful:
        side = "left" if sides == {True} else "left at some junctions" if True in sides else "right"
        say(f"  traffic keeps {side}{', see the warning about the side' if doubtful else ''}")
    crossed = [len(junction["crossings"]) for junction in junctions if junction["crossings"]]
    if crossed:
        say(f"  {plural(sum(crossed), 'crosswalk')} at {plural(len(crossed), 'junction')}")
    for junction in sorted(junctions, key=lambda junction: natural(junction["id"])):
        state = f"not usable: {junction['reason']}"
        if junction["usable"]:
            state = f"{junction['kind']}; {_START.format(junction['usable_from'])}"
        say(f"  {junction['id']:>6}  {junction['ways']}-way {junction['control']:<7} {state}")
        for line in _details(junction) if junction["usable"] else ():
            say(f"  {'':>6}  {line}")
    for warning in description["warnings"]:
        warn(f"warning: {warning['message']}")
    return 0


def _details(junction: dict[str, Any]) -> Iterator[str]:
    """Yield lines on a usable junction: the lanes and control of its arms, and which arms give way to which."""
    lanes = [[lane for lane in junction["entrances"] if lane["arm"] == number] for number in range(junction["ways"])]
    named = [len(own) for own in lanes] != [1] * len(lanes)  # else the entrance of an arm has the number of the arm
    arms = []
    for arm, own in zip(junction["arms"], lanes, strict=True):
        names = f" ({_named([lane['entrance'] for lane in own], 'entrance')})" if named and own else ""
        limits = ["no limit" if limit == NO_LIMIT else f"limit {limit:.1f} m/s" for limit in arm["speed_limits"]]
        numbers_by_sign: dict[str, list[int]] = {}
        for lane in own:
            sign = "no sign" if lane["sign"] == "none" else lane["sign"]
            sign = f"{sign}, no turn on red" if lane["no_turn_on_red"] else sign
            numbers_by_sign.setdefault(sign, []).append(lane["entrance"])
        signs = list(numbers_by_sign)
        if len(signs) > 1:
            signs = [f"{k} at {len(some)} of {len(own)} ({_named(some, 'entrance')})" for k, some in numbers_by_sign.items()]
        arms.append(", ".join((f"{plural(len(own), 'lane')} in{names}", f"{arm['exits']} out", *signs, *limits)))
    alike = groupby(range(len(arms)), key=arms.__getitem__)
    yield "; ".join(f"{_named([*numbers])}: {arm}" for arm, numbers in alike)
    ways = [movement["arm"] for movement in junction["movements"]]
    yielding = sorted({(ways[arm_number], ways[other_arm]) for arm_number, other_arm in junction["yields"]})
    parts = [
        f"arm {arm_number} to {', '.join(str(other_arm) for _, other_arm in pairs)}"
        for arm_number, pairs in groupby(yielding, key=itemgetter(0))
    ]
    undecided = sorted({tuple(sorted((ways[arm_number], ways[other_arm]))) for arm_number, other_arm in junction["undecided"]})
    parts += [f"arms {arm_number} and {other_arm} undecided" for arm_number, other_arm in undecided]
    yield f"gives way: {'; '.join(parts) or 'nobody'}"
    crosswalks: dict[str, list[int]] = {}
    for crosswalk in junction["crossings"]:
        words = [f"{crosswalk['length']:.1f} m long"]
        behind = crosswalk["behind_line"]
        if behind is not None:
            # Nearer than 0.05 m, the crosswalk is at the line.
            where = "at" if abs(behind) < 0.05 else f"{abs(behind):.1f} m {'behind' if behind > 0 else 'before'}"
            words.append(f"{where} the stopping line")
        if crosswalk["island"]:
            words.append(f"island of {crosswalk['island']:.1f} m")
        if crosswalk["green"]:
            words.append(f"walk with the green of {_named(crosswalk['green'])}")
        crosswalks.setdefault(", ".join(words), []).append(crosswalk["arm"])
    if crosswalks:
        yield f"crosswalks: {'; '.join(f'{_named(arms)}: {words}' for words, arms in crosswalks.items())}"


def _named(numbers: list[int], noun: str = "arm") -> str:
    *most, last = numbers
    if len(most) > 1 and last - most[0] == len(most):
        return f"{noun}s {most[0]} to {last}"
    return f"{noun}s {', '.join(map(str, most))} and {last}" if most else f"{noun} {last}"
