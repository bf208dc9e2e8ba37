"""Arms of a junction and the ways through it, whether or not the model can use it.

An arm is a road end where the junction is entered or left, or a pair of one-way road ends that lie side by side
(the paper's ``entex``). Arms are numbered counter-clockwise, the first one being the first counter-clockwise from
direction -112.5 degrees as seen from the centre, so a southern arm with some slack is arm 0.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pytest_rvads.errors import MapError
from pytest_rvads.maps.network import Edge, Network
from pytest_rvads.maps.segment import Turn

__all__ = ["FIRST", "STRAIGHT", "Arm", "Path", "arms_of", "paths_of", "sort_arms", "turn_type", "turns_in_order", "walk"]

FIRST = math.radians(-112.5)
"""Direction from which arms are counted [rad]."""
STRAIGHT = math.radians(44.0)
"""Change of heading from which on a movement is a turn [rad]; as in SUMO's netconvert, one degree below the arms of a regular
8-way junction, so that rounding never makes one of two neighbours straight and the other a turn."""
_FACING = math.radians(70.0)
_BESIDE = 30.0
_PER_DEGREE = 0.05
_MOST_STEPS = 300_000
_MOST_PAIRS = 10_000

RoadEnd = tuple[str, str]


class Path(NamedTuple):
    """One way through a junction, as the file has it."""

    entrance: str
    """Edge it comes from."""
    exit: str
    """Edge it goes to."""
    edges: tuple[str, ...]
    """Edges inside the junction."""
    length: float
    """Along the lane centre line [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""


@dataclass(frozen=True, slots=True)
class Arm:
    """A road end, or a pair of one-way road ends."""

    ends: tuple[RoadEnd, ...]
    entrances: tuple[str, ...]
    """Edges that lead into the junction."""
    exits: tuple[str, ...]
    """Edges that lead out of it."""
    x: float
    """Mean of the lane ends, east [m]."""
    y: float
    """North [m]."""
    outward: float
    """Direction away from the junction [rad]."""


def turn_type(turning: float) -> Turn:
    """Return the turn type of a total change of heading [rad]."""
    return Turn.STRAIGHT if abs(turning) < STRAIGHT else Turn.LEFT if turning > 0 else Turn.RIGHT


def paths_of(network: Network, junction: str) -> list[Path]:
    """Return the shortest path from every entrance edge to every exit edge of `junction`.

    Raises:
        MapError: so many branches in a junction that no intersection can be meant.
    """
    inside = {id: network.edges[id] for id in network.inside.get(junction, ())}
    starts = dict.fromkeys(before for edge in inside.values() for before in edge.before if before not in inside)
    found: list[Path] = []
    steps = 0
    for start in starts:
        done: set[str] = set()
        queue: list[tuple[float, float, tuple[str, ...]]] = [
            (0.0, 0.0, (id,)) for id in network.edges[start].after if id in inside
        ]
        exits: dict[str, Path] = {}
        while queue:
            length, turning, way = heapq.heappop(queue)
            edge = inside[way[-1]]
            if edge.id in done:
                continue
            done.add(edge.id)
            steps += 1
            if steps > _MOST_STEPS:
                raise MapError(
                    f"the lanes of junction {junction!r} branch too often, {len(starts)} entrances lead to {len(inside)} lanes"
                )
            length, turning = length + edge.length, turning + edge.turning
            for id in edge.after:
                if id in inside:
                    heapq.heappush(queue, (length, turning, (*way, id)))
                elif id not in exits or length < exits[id].length:
                    exits[id] = Path(start, id, way, length, turning)
        found += exits.values()
    return found


def arms_of(network: Network, pairs: Sequence[tuple[str, str]]) -> tuple[Arm, ...]:
    """Return the arms of a junction, numbered counter-clockwise.

    Args:
        network: the lanes of the map.
        pairs: (entrance edge, exit edge) of every way through the junction.
    """
    entering: dict[RoadEnd, list[Edge]] = {}
    leaving: dict[RoadEnd, list[Edge]] = {}
    for id in dict.fromkeys(one for one, _ in pairs):
        edge = network.edges[id]
        entering.setdefault((edge.road, "end" if edge.forward else "start"), []).append(edge)
    for id in dict.fromkeys(two for _, two in pairs):
        edge = network.edges[id]
        leaving.setdefault((edge.road, "start" if edge.forward else "end"), []).append(edge)
    arms = [_arm((end,), entering[end], leaving[end]) for end in entering if end in leaving]
    only_in = [end for end in entering if end not in leaving]
    only_out = [end for end in leaving if end not in entering]
    costs = sorted(
        (cost, one, two)
        for one in (only_in if len(only_in) * len(only_out) <= _MOST_PAIRS else ())
        for two in only_out
        if (cost := _beside(entering[one][0], leaving[two][0], network.left_hand[one[0]])) is not None
    )
    for _, one, two in costs:
        if one in only_in and two in only_out:
            only_in.remove(one)
            only_out.remove(two)
            arms.append(_arm((one, two), entering[one], leaving[two]))
    arms += [_arm((end,), entering[end], []) for end in only_in]
    arms += [_arm((end,), [], leaving[end]) for end in only_out]
    return tuple(arms)


def sort_arms(arms: Sequence[Arm], in_order: Callable[[Sequence[Arm]], bool]) -> tuple[Arm, ...]:
    """Number the arms counter-clockwise.

    Args:
        arms: in any order.
        in_order: tells whether the turns of all movements agree with an order. Positions around the centre are
            tried first, then the directions of the arms; positions stand where neither agrees.
    """
    if not arms:
        return ()
    x, y = sum(arm.x for arm in arms) / len(arms), sum(arm.y for arm in arms) / len(arms)

    def turned(angle: float) -> float:
        # An arm just at the starting direction must not jump to the end by rounding.
        return (angle - FIRST + 1e-9) % math.tau

    around = tuple(sorted(arms, key=lambda arm: (turned(math.atan2(arm.y - y, arm.x - x)), arm.ends)))
    if in_order(around):
        return around
    outward = tuple(sorted(arms, key=lambda arm: (turned(arm.outward), arm.ends)))
    return outward if in_order(outward) else around


def turns_in_order(turning: Iterable[tuple[int, int, float]], ways: int) -> bool:
    """Tell whether the movements of every entrance, sorted by turn, follow the cyclic order of the exits.

    Args:
        turning: (entrance arm, exit arm, total change of heading [rad]) of the movements.
        ways: number of arms.
    """
    table: dict[int, list[tuple[float, int]]] = {}
    for entrance, exit, change in turning:
        if entrance != exit:
            table.setdefault(entrance, []).append((change, (exit - entrance) % ways))
    return all([d for _, d in sorted(rows)] == sorted(d for _, d in rows) for rows in table.values())


def walk(network: Network, start: str, *, upstream: bool) -> tuple[list[str], bool]:
    """Walk from an edge over road links to the next junction or the end of the road.

    Where lanes merge or fork, the walk keeps to the one that goes on straightest.

    Returns:
        The edges in the order of the walk, and whether a junction was reached.
    """
    way, edge = [start], network.edges[start]
    seen = {start}
    while True:
        here = edge
        choices = [network.edges[id] for id in (here.before if upstream else here.after)]
        if any(choice.junction is not None for choice in choices):
            return way, True
        choices = [choice for choice in choices if choice.id not in seen]
        if not choices:
            return way, False
        edge = min(choices, key=lambda c: _bend(c, here) if upstream else _bend(here, c))
        seen.add(edge.id)
        way.append(edge.id)


def _bend(one: Edge, two: Edge) -> tuple[float, float, str, str]:
    turn = abs(math.remainder(two.start_heading - one.end_heading, math.tau))
    return round(turn, 3), math.dist(one.points[-1], two.points[0]), one.id, two.id


def _arm(ends: tuple[RoadEnd, ...], entering: Sequence[Edge], leaving: Sequence[Edge]) -> Arm:
    points = [edge.points[-1] for edge in entering] + [edge.points[0] for edge in leaving]
    headings = [edge.end_heading + math.pi for edge in entering] + [edge.start_heading for edge in leaving]
    return Arm(
        ends,
        tuple(edge.id for edge in entering),
        tuple(edge.id for edge in leaving),
        float(sum(p[0] for p in points) / len(points)),
        float(sum(p[1] for p in points) / len(points)),
        math.atan2(sum(map(math.sin, headings)), sum(map(math.cos, headings))),
    )


def _beside(entrance: Edge, exit: Edge, left_hand: bool) -> float | None:
    """Return the cost of pairing a one-way entrance with a one-way exit, or None where they are no pair."""
    angle = abs(math.remainder(exit.start_heading - entrance.end_heading - math.pi, math.tau))
    (x, y), (u, v) = entrance.points[-1], exit.points[0]
    distance = math.hypot(u - x, v - y)
    heading = entrance.end_heading
    side = math.cos(heading) * (v - y) - math.sin(heading) * (u - x)
    if angle > _FACING or distance > _BESIDE or (side < 0) != left_hand:
        return None
    return float(distance + _PER_DEGREE * math.degrees(angle))
