"""The network of a map of lanelets: roads, junctions, and signs, lights and stop lines at entrances."""

from __future__ import annotations

import math
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import MapObject, ObjectKind
from pytest_rvads.geometry.network import HAND, DeclaredJunction, Doubt, Edge, MapWarning, Network, PaintedCrosswalk, facing
from pytest_rvads.geometry.opendrive.signals import INSIDE
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.satellites.lanelet2.lanelet_areas import Ground, areas_of, cut_off, listed
from pytest_rvads.satellites.lanelet2.lanelets import Lanelet, hand_votes, intersections, stations_of, turn_odd
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.wording import plural

_ACROSS, _ALONG, _PARALLEL = 5.5, 15.0, math.radians(30.0)
"""Lanes of one direction that end within these distances [m] and this angle [rad] of each other are of one arm."""
_OPPOSITE_GAP = 20.0
"""Widest gap between a lane into a junction and the lane out of it that belongs to the same road [m]."""
_LINE_RANGE = 25.0
"""Greatest distance of a stop line before the junction [m]."""
_BEYOND = 1.0
"""Greatest distance of a stop line behind the end of the entrance lane [m]."""
_REFERENCE_RANGE = 50.0
"""Greatest length of lanelets between a lanelet with a sign or light and the junction [m]."""
_MOST_TESTS = 8_000_000
"""Most pairs of points of approaches and stop lines that are compared; a town has 30,000."""
_MOST_PLACES = 100_000
"""Most pairs of lanelets of which one has priority, and most entrances of lights, signs and lines; a town has 1,000."""

Array = NDArray[np.float64]
Members = Mapping[str, Sequence[str]]
"""Per junction, the ids of its lanelets."""
LaneEnd = tuple[str, int]
"""Id of a lanelet, and -1 for its end or 0 for its start."""


@dataclass(frozen=True, slots=True)
class Regulation:
    """A light, a sign, or a statement on who gives way to whom."""

    id: str
    kind: ObjectKind
    lanelets: tuple[str, ...]
    """Sources of the lanelets that the light or sign is for, in the junction or before the junction."""
    lines: tuple[str, ...] = ()
    """Ids of the stop lines of the light or sign."""
    arrows: frozenset[Turn] = frozenset()
    """The turns of the arrows of a light; empty for a light without arrows."""
    prior: tuple[str, ...] = ()
    """Sources of the lanelets that have priority over `lanelets`."""


@dataclass(slots=True, eq=False)
class Rules:
    """The lights, signs and lines of a map."""

    regulations: list[Regulation] = field(default_factory=list)
    lines: dict[str, Array] = field(default_factory=dict)
    """Points of the stop lines, shape ``(k, 2)`` [m]."""
    controllers: tuple[tuple[str, ...], ...] = ()
    """Groups of lights that change together."""
    crosswalks: list[PaintedCrosswalk] = field(default_factory=list)


def network_of(ground: Ground, rules: Rules, warnings: Iterable[MapWarning], count: int) -> Network:
    """Return the network of the lanelets of a map; `count` is the number of lanelets in the file."""
    doubts = list(warnings)
    left_out = "".join(f"; {warning.message}" for warning in doubts if warning.kind is Doubt.LANE)
    if not ground.lanes:
        raise MapError(f"it has {plural(count, 'lanelet')}, and none that a car can drive on; use another map{left_out}")
    if odd := turn_odd(ground.lanes, ground.links):
        message = f"lanelets that run against the lanelets before and behind them were turned, left for right: {listed(odd)}"
        doubts.append(MapWarning(Doubt.SIDE, message))
    members, doubts_of_areas = areas_of(ground, {id for row in rules.regulations for id in row.lanelets})
    doubts += doubts_of_areas
    if not members:
        raise MapError(
            f"it has {plural(len(ground.lanes), 'lane')} but no place where lanelets of three roads cross, merge or part, so it "
            f"offers nothing to test; use a map with a junction{left_out}"
        )
    left_hand = _keeps_left(ground, members, doubts)
    junctions = {id: name for name, ids in members.items() for id in ids}
    roads = _roads(ground, members, left_hand=left_hand)
    edges = {}
    for id, lane in ground.lanes.items():
        edge, (road, forward), kinks = _edge(lane), roads[id], 0.0
        if id in junctions:
            # The bounds are polylines, so a part of a bend lies between a lanelet and its neighbours.
            starts = [lane.heading(0) - ground.lanes[before].heading(-1) for before in ground.links.pred[id]]
            outside = [ground.lanes[after] for after in ground.links.succ[id] if after not in junctions]
            ends = [after.heading(0) - lane.heading(-1) for after in outside]
            turns = [[math.remainder(turn, math.tau) for turn in side] for side in (starts, ends)]
            kinks = math.fsum(min(side, key=abs, default=0.0) for side in turns)
        edges[id] = replace(edge, road=road, forward=forward, junction=junctions.get(id), turning=edge.turning + kinks)
    attacher = _Attacher(ground, junctions)
    objects = attacher.attach(rules)
    doubts += [MapWarning(Doubt.SIGNAL, f"{message}: {listed(ids)}") for message, ids in attacher.doubts.items() if ids]
    return Network(
        edges,
        ground.links,
        {name: DeclaredJunction(priorities=tuple(attacher.priorities.get(name, ()))) for name in members},
        frozenset(edge.road for edge in edges.values()) if left_hand else frozenset(),
        tuple(objects),
        rules.controllers,
        tuple(doubts),
        crosswalks=tuple(rules.crosswalks),
    )


def _keeps_left(ground: Ground, members: Members, doubts: list[MapWarning]) -> bool:
    """Return whether traffic keeps left.

    The environment decides, else the majority of the bounds that opposite lanelets share, of the lanes out of junctions, and of
    the region. Lanes out lie on the left of the nearest lanes in where traffic keeps right. They count only if three quarters of
    them agree. A doubt is added to `doubts`.
    """
    stated = os.environ.get(HAND, "")
    if stated not in ("", "left", "right"):
        raise MapError(f"the variable {HAND} must be left or right, got {stated[:40]!r}")
    bounds = hand_votes([lane for lane in ground.lanes.values() if ":back" not in lane.id])
    places = list(_sides_of_exits(ground, members))
    exits = {"right": sum(places), "left": len(places) - sum(places)}
    agreed = len(places) > 1 and 4 * max(exits.values()) >= 3 * len(places)
    tally = {
        hand: len(bounds[hand]) + agreed * exits[hand] + (ground.region == hand) * max(len(places), 2)
        for hand in ("right", "left")
    }
    most, least = ("left", "right") if tally["left"] > max(tally["right"], 1) else ("right", "left")
    if stated and len(bounds[stated]) < len(bounds[most]):
        counts = f"{len(bounds[most])} bounds between opposite lanelets say {most}"
        doubts.append(MapWarning(Doubt.SIDE, f"traffic keeps {stated}, as --hand or {HAND} says, though {counts}"))
    elif not stated and not any(bounds.values()) and ground.region is None:
        message = (
            f"no bounds of opposite lanelets say on which side traffic keeps, and {sum(places)} of {len(places)} lanes out of "
            f"junctions lie on the left of a lane in; {most} was taken, --hand or the variable {HAND} states the side"
        )
        doubts.append(MapWarning(Doubt.SIDE, message))
    elif not stated and tally[least]:
        ways = f" (bounds of opposite lanelets: {listed(bounds[least])})" if bounds[least] else ""
        message = (
            f"{tally[most]} of {sum(tally.values())} votes of bounds, of lanes out of junctions and of the region say that "
            f"traffic keeps {most}, the others{ways} {least}; {most} was taken, --hand or the variable {HAND} states the side"
        )
        doubts.append(MapWarning(Doubt.SIDE, message))
    return (stated or most) == "left"


def _sides_of_exits(ground: Ground, members: Members) -> Iterator[bool]:
    """Yield, per lane into a junction, whether the nearest opposite lane out of the junction lies on the left.

    A lanelet that leads over the junction counts at one of its ends alone, because its bounds may be exchanged.
    """
    for ids in members.values():
        inside, ends = set(ids), dict[str, int]()
        before, after = ({lane for id in ids for lane in links[id]} - inside for links in (ground.links.pred, ground.links.succ))
        exits = [_edge(ground.lanes[id]) for id in sorted(after - before)]
        for entrance in (_edge(ground.lanes[id]) for id in sorted(before - after)):
            rows = [(*facing(entrance, exit), exit.id) for exit in exits]
            opposite = [(gap, left, id) for gap, angle, left, id in rows if gap <= _OPPOSITE_GAP and angle <= _PARALLEL]
            if opposite:
                _, left, id = min(opposite)
                if all(ends.setdefault(ground.lanes[one].source, end) == end for one, end in ((entrance.id, -1), (id, 0))):
                    yield left


def _edge(lane: Lanelet) -> Edge:
    steps = np.diff(lane.points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    limits = () if lane.limit is None else ((0.0, lane.limit),)
    turning = float(headings[-1] - headings[0])
    return Edge(lane.id, "", None, True, lane.points, turning, lane.width, lane.length, limits=limits)


def _roads(ground: Ground, members: Members, *, left_hand: bool) -> dict[str, tuple[str, bool]]:
    """Return, per lanelet, its road and whether the lanelet runs from the start to the end of the road.

    Lanelets side by side at a junction are of one road. A lanelet in a junction is a road of its own. Where a road would have
    lanelets at one end that are not side by side there, the lanelets from a junction to a junction are cut in the middle.
    """
    while True:
        beside, groups = _sides(ground, members, left_hand=left_hand)
        roads: dict[str, tuple[str, bool]] = {}
        for id in ground.lanes:
            if id not in roads:
                roads[id] = (id, True)
                for one, two in nx.bfs_edges(beside, id):
                    roads[two] = (id, roads[one][1] == beside.edges[one, two]["same"])
        # The roads of which one end has lanes from several groups of lanes side by side at a junction.
        mixed = set()
        for group in groups:
            numbers: dict[tuple[str, bool], int] = {}
            for (id, at), number in group.items():
                road, forward = roads[id]
                if numbers.setdefault((road, forward == (at == 0)), number) != number:
                    mixed.add(road)
        ends = Counter(id for group in groups for id, _ in group)
        between = [id for id, lane in ground.lanes.items() if ends[id] > 1 and roads[id][0] in mixed and len(lane.points) > 4]
        if not between:
            return roads
        for id in between:
            cut_off(ground, id, "next", ground.lanes[id].length / 2, back=True)


def _sides(ground: Ground, members: Members, *, left_hand: bool) -> tuple[nx.Graph, list[dict[LaneEnd, int]]]:
    """Return the graph of lanelets side by side at junctions, and per junction its lane ends, numbered by road end."""
    beside = nx.Graph()
    beside.add_nodes_from(ground.lanes)
    groups = []
    for ids in members.values():
        inside, ends = set(ids), nx.Graph()
        ends.add_nodes_from((lane, -1) for id in ids for lane in ground.links.pred[id] if lane not in inside)
        ends.add_nodes_from((lane, 0) for id in ids for lane in ground.links.succ[id] if lane not in inside)
        for (id, at), (other_id, other_at) in combinations(ends, 2):
            lane, other = ground.lanes[id], ground.lanes[other_id]
            heading = lane.heading(at)
            turn = math.remainder(other.heading(other_at) - heading - (0.0 if at == other_at else math.pi), math.tau)
            if at != other_at:
                # The end of a lanelet and the start of another meet at the bound between opposite lanes of a road.
                joined = lane.end[left_hand] == other.start[left_hand]
                joined = joined or (lane.source == other.source and lane.end == other.start[::-1])
            else:
                # The starts or the ends of two lanelets share a bound, or lie beside each other.
                places, other_places = (lane.start, other.start) if at == 0 else (lane.end, other.end)
                x, y = other.points[at] - lane.points[at]
                along, across = math.cos(heading) * x + math.sin(heading) * y, math.cos(heading) * y - math.sin(heading) * x
                joined = abs(along) < _ALONG and abs(across) < _ACROSS
                joined = joined or places[0] == other_places[1] or places[1] == other_places[0]
            joined = joined and abs(turn) <= _PARALLEL
            if joined and id != other_id:
                ends.add_edge((id, at), (other_id, other_at))
                beside.add_edge(id, other_id, same=at == other_at)
        groups.append({end: number for number, part in enumerate(nx.connected_components(ends)) for end in part})
    return beside, groups


class _Attacher:
    """Assigns lights, signs, lines and priorities to the entrances of junctions."""

    def __init__(self, ground: Ground, junctions: Mapping[str, str]) -> None:
        self.lanes, self.links, self.junctions = ground.lanes, ground.links, junctions
        self.doubts: defaultdict[str, dict[str, None]] = defaultdict(dict)
        """Per kind of doubt, the ids of elements."""
        self.priorities: defaultdict[str, dict[tuple[str, str], None]] = defaultdict(dict)
        """Per junction, pairs of roads of which the first has priority over the second."""
        self.pieces: defaultdict[str, list[str]] = defaultdict(list)
        """Per source, the ids of its pieces in the direction of its bounds."""
        for id, lane in self.lanes.items():
            if ":back" not in id:
                self.pieces[lane.source].append(id)
        self.entrances = [
            (junction, before)
            for junction, before in dict.fromkeys((junctions[id], before) for id in junctions for before in self.links.pred[id])
            if junctions.get(before) != junction
        ]
        self.places = 0
        """Number of entrances and priorities of the lights and signs so far."""
        self.tests = 0
        """Number of pairs of points of approaches and stop lines that were compared."""
        self.setbacks: dict[tuple[str, str, str], float] = {}
        """Per line, junction and entrance, the distance of the line before the junction [m]."""

    def attach(self, rules: Rules) -> list[MapObject]:
        """Return the lights, signs and lines, an object per light, sign or line and entrance."""
        boxes = _boxes(rules.lines)
        for junction, entrance in self.entrances:
            for line, distance in self._lines_across(entrance, rules.lines, boxes):
                self.setbacks[line, junction, entrance] = distance
        signs = [sign for regulation in rules.regulations for sign in self._signs_of(regulation)]
        # Lines of signs and lights that cross no lane into a junction can cross a lanelet in the junction.
        crossing = {line for line, *_ in self.setbacks}
        for sign in signs:
            inside = {line: rules.lines[line] for line in sign.lines if line in rules.lines and line not in crossing}
            for junction, entrance in self._places(sign) if inside else ():
                for after in self.links.succ[entrance]:
                    for line, distance in self._lines_across(entrance, inside, _boxes(inside), after):
                        key = line, junction, entrance
                        self.setbacks[key] = max(self.setbacks.get(key, distance), distance)
        placed: dict[tuple[str, str, ObjectKind, str], tuple[Regulation, float | None]] = {}
        for (line, junction, entrance), distance in self.setbacks.items():
            placed[junction, entrance, ObjectKind.LINE, line] = Regulation(line, ObjectKind.LINE, ()), distance
        crossing = {line for line, *_ in self.setbacks}
        for sign in signs:
            places = self._places(sign)
            if not places:
                noun = "lights" if sign.kind is ObjectKind.LIGHT else f"{sign.kind} signs"
                self.doubts[f"{noun} for no entrance of a junction were ignored"][sign.id] = None
                continue
            if not sign.lanelets:
                self.doubts["lights and signs that no lanelet refers to were assigned by their stop lines"][sign.id] = None
            astray = [line for line in sign.lines if line in rules.lines and line not in crossing]
            self.doubts["stop lines of lights or signs cross no lane into a junction"] |= dict.fromkeys(astray)
            self._count_places(len(places))
            for junction, entrance in places:
                setbacks = [self.setbacks.get((line, junction, entrance)) for line in sign.lines]
                setback = None if sign.kind is ObjectKind.LIGHT else min((s for s in setbacks if s is not None), default=None)
                placed[junction, entrance, sign.kind, sign.id] = sign, setback
        objects = []
        for (junction, entrance, *_), (sign, setback) in placed.items():
            station = max(self.lanes[entrance].length - max(setback or 0.0, 0.0), 0.0)
            objects.append(MapObject(sign.id, sign.kind, junction, entrance, station, setback, sign.arrows))
        return objects

    def _count_places(self, more: int) -> None:
        self.places += more
        if self.places > _MOST_PLACES:
            raise MapError(
                f"its lights, signs and priorities are for more than {_MOST_PLACES:,} places; check which lanelets they refer to"
            )

    def _signs_of(self, regulation: Regulation) -> Iterator[Regulation]:
        """Yield the signs of a regulation; a statement about lanelets in a junction is a priority of roads, and no sign."""
        groups = [[id for source in sources for id in self.pieces[source]] for sources in (regulation.prior, regulation.lanelets)]
        inside = [[(self.junctions[id], id) for id in ids if id in self.junctions] for ids in groups]
        self._count_places(len(inside[0]) * len(inside[1]))
        pairs = [(junction, a, b) for junction, a in inside[0] for other, b in inside[1] if junction == other and a != b]
        for junction, prior, yielding in pairs:
            self.priorities[junction][prior, yielding] = None
        if not pairs:
            yield regulation
            if regulation.prior:
                yield replace(regulation, kind=ObjectKind.PRIORITY, lanelets=regulation.prior)

    def _places(self, regulation: Regulation) -> list[tuple[str, str]]:
        """Return the junctions and entrances that a light or sign is for, by its lanelets, or else by its lines."""
        places = dict.fromkeys(place for source in regulation.lanelets for id in self.pieces[source] for place in self._ahead(id))
        if not places:
            lines = set(regulation.lines)
            places = dict.fromkeys((junction, entrance) for line, junction, entrance in self.setbacks if line in lines)
        return list(places)

    def _ahead(self, id: str) -> Iterator[tuple[str, str]]:
        """Yield the junctions and entrances by which traffic comes to a lanelet inside, or from a lanelet before the junction."""
        junction = self.junctions.get(id)
        if junction is not None:
            reached = nx.generic_bfs_edges(self.links, id, lambda lane: self.links.pred[lane] if lane in self.junctions else ())
            yield from ((junction, before) for _, before in reached if self.junctions.get(before) != junction)
            return
        ahead, seen = [(id, 0.0)], {id}
        while ahead:
            lane, distance = ahead.pop()
            for after in self.links.succ[lane]:
                if after in self.junctions:
                    yield self.junctions[after], lane
                elif after not in seen and distance + self.lanes[after].length <= _REFERENCE_RANGE:
                    seen.add(after)
                    ahead.append((after, distance + self.lanes[after].length))

    def _lines_across(
        self, entrance: str, lines: Mapping[str, Array], boxes: Array, after: str = ""
    ) -> Iterator[tuple[str, float]]:
        """Yield the stop lines across an entrance lane or its approach, each with its distance before the junction [m].

        The distance is negative for a line in the junction: a little behind the lane, or across the lanelet `after` it.
        """
        # The centre line of the entrance lane with the lanes before it, up to about `_LINE_RANGE`.
        parts, length, lane = [self.lanes[entrance].points], self.lanes[entrance].length, entrance
        while length < _LINE_RANGE:
            before = [id for id in self.links.pred[lane] if id not in self.junctions]
            if len(before) != 1 or len(parts) > 20:
                break
            lane = before[0]
            parts.insert(0, self.lanes[lane].points)
            length += self.lanes[lane].length
        path = np.vstack(parts)
        end, step, last = path[-1], path[-1] - path[-2], len(path) - 1
        path = np.vstack((path, self.lanes[after].points if after else end + _BEYOND * step / np.hypot(*step)))
        stations = stations_of(path)
        first = max(int(np.searchsorted(stations, stations[last] - _LINE_RANGE)) - 1, 0)
        path, stations, last = path[first:], stations[first:], last - first
        low, high = boxes
        near = ((low <= end + 2 * _LINE_RANGE) & (high >= end - 2 * _LINE_RANGE)).all(axis=1)
        for id, line in ((id, lines[id]) for id, beside in zip(lines, near, strict=True) if beside):
            self.tests += len(path) * len(line)
            if self.tests > _MOST_TESTS:
                raise MapError(
                    f"the stop lines around lanelet {entrance!r} have too many nodes to compare them all; simplify them"
                )
            if np.hypot(*(line - end).T).min() > 2 * _LINE_RANGE:
                continue
            places, _ = intersections(path, line)
            setbacks = stations[last] - np.interp(places[np.isfinite(places)], np.arange(len(path)), stations)
            setbacks = setbacks[(setbacks <= _LINE_RANGE) & (setbacks >= -INSIDE)]
            if len(setbacks):
                yield id, round(float(setbacks.max() if after else setbacks.min()), 6)


def _boxes(lines: Mapping[str, Array]) -> Array:
    """Return the least and the greatest coordinates of each line, shape ``(2, lines, 2)`` [m]."""
    return np.array([(line.min(axis=0), line.max(axis=0)) for line in lines.values()]).reshape(-1, 2, 2).swapaxes(0, 1)
