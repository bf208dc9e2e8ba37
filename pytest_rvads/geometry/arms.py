"""The arms of a junction, and the reasons why the model can't use a junction, checked in order of importance.

An arm is a road end where the junction is entered or left, or a pair of one-way road ends that lie side by side (the paper's
``entex``). Arms are numbered counter-clockwise. Arm 0 is the first arm counter-clockwise from direction -112.5 degrees as seen
from the centre, so an arm that lies about south is arm 0. Junctions that the model can't use have arms, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from pytest_rvads.geometry.graph import MetricGraph, Path, Route, walk
from pytest_rvads.geometry.network import Edge, facing
from pytest_rvads.geometry.segment import GAP_LIMIT

FIRST = math.radians(-112.5)
"""Direction from which arms are counted [rad]."""
_FACING = math.radians(70.0)
_BESIDE = 30.0
_ALONGSIDE = math.radians(30.0)
_FURTHER_OUT = 40.0
"""Distance from the junction up to which two one-way roads are compared to decide whether they run side by side [m].

Lanes that part around an island have come together again at this distance.
"""
_PER_DEGREE = 0.05
_MOST_PAIRS = 10_000

RoadEnd = tuple[str, str]

FEWEST, MOST = 3, 8
"""Least and largest number of arms of a junction of the model."""
LONGEST, MOST_WAYS = 1000.0, 400
"""Longest movement [m] and most movements of a junction; no road has more, and the work of conflicts grows with them."""


@dataclass(frozen=True, slots=True)
class RoadArm:
    """An arm in the map: a road end, or a pair of one-way road ends."""

    ends: tuple[RoadEnd, ...]
    entrances: tuple[str, ...]
    """Edges that lead into the junction, counted from the kerb."""
    exits: tuple[str, ...]
    """Edges that lead out of the junction, counted from the kerb."""
    x: float
    """Mean east coordinate of the lane ends [m]."""
    y: float
    """Mean north coordinate of the lane ends [m]."""
    outward: float
    """Direction away from the junction [rad]."""


def arms_of(graph: MetricGraph, pairs: Sequence[tuple[str, str]]) -> tuple[RoadArm, ...]:
    """Return the arms of a junction, numbered counter-clockwise."""
    entering: dict[RoadEnd, list[Edge]] = {}
    leaving: dict[RoadEnd, list[Edge]] = {}
    for id in dict.fromkeys(entrance for entrance, _ in pairs):
        entering.setdefault(graph.edges[id].head, []).append(graph.edges[id])
    for id in dict.fromkeys(exit for _, exit in pairs):
        leaving.setdefault(graph.edges[id].tail, []).append(graph.edges[id])
    left_hand = graph.network.left_hand
    arms = [_arm((end,), entering[end], leaving[end], left_hand) for end in entering if end in leaving]
    only_in = [end for end in entering if end not in leaving]
    only_out = [end for end in leaving if end not in entering]
    # Some one-way streets begin next to each other and lead apart; the two sides of a dual carriageway run side by side.
    costs = []
    for end_in, end_out in product(only_in, only_out) if len(only_in) * len(only_out) <= _MOST_PAIRS else ():
        entrance, exit = entering[end_in][0], leaving[end_out][0]
        distance, angle, on_left = facing(entrance, exit)
        if angle > _FACING or distance > _BESIDE or on_left is (entrance.road in left_hand):
            continue
        apart = math.remainder(_away(graph, entrance, upstream=True) - _away(graph, exit, upstream=False), math.tau)
        if abs(apart) <= _ALONGSIDE:
            costs.append((distance + _PER_DEGREE * math.degrees(angle), end_in, end_out))
    for _, end_in, end_out in sorted(costs):
        if end_in in only_in and end_out in only_out:
            only_in.remove(end_in)
            only_out.remove(end_out)
            arms.append(_arm((end_in, end_out), entering[end_in], leaving[end_out], left_hand))
    arms += [_arm((end,), entering[end], [], left_hand) for end in only_in]
    arms += [_arm((end,), [], leaving[end], left_hand) for end in only_out]
    return tuple(arms)


def sort_arms(arms: Sequence[RoadArm], in_order: Callable[[Sequence[RoadArm]], bool]) -> tuple[RoadArm, ...]:
    """Return the arms counter-clockwise."""
    if not arms:
        return ()
    x, y = math.fsum(arm.x for arm in arms) / len(arms), math.fsum(arm.y for arm in arms) / len(arms)

    def turned(angle: float) -> float:
        # Rounding must not make an arm in direction `FIRST` the last arm.
        return (angle - FIRST + 1e-9) % math.tau

    around = tuple(sorted(arms, key=lambda arm: (turned(math.atan2(arm.y - y, arm.x - x)), arm.ends)))
    if in_order(around):
        return around
    outward = tuple(sorted(arms, key=lambda arm: (turned(arm.outward), arm.ends)))
    return outward if in_order(outward) else around


def turns_in_order(turning: Iterable[tuple[int, int, float]], ways: int) -> bool:
    """Return whether movements (entrance arm, exit arm, change of heading [rad]), by turn, follow the cyclic order of exits."""
    table: dict[int, list[tuple[float, int]]] = {}
    for entrance, exit, change in turning:
        if entrance != exit:
            table.setdefault(entrance, []).append((change, (exit - entrance) % ways))
    return all([d for _, d in sorted(rows)] == sorted(d for _, d in rows) for rows in table.values())


def _arm(ends: tuple[RoadEnd, ...], entering: Sequence[Edge], leaving: Sequence[Edge], left_hand: Container[str]) -> RoadArm:
    points = [edge.points[-1] for edge in entering] + [edge.points[0] for edge in leaving]
    headings = [edge.end_heading + math.pi for edge in entering] + [edge.start_heading for edge in leaving]
    outward = math.atan2(math.fsum(map(math.sin, headings)), math.fsum(map(math.cos, headings)))
    # The unit vector across the arm, from the kerb beside the entrances to the kerb beside the exits.
    across = (-math.sin(outward), math.cos(outward)) if ends[0][0] in left_hand else (math.sin(outward), -math.cos(outward))
    return RoadArm(
        ends,
        tuple(edge.id for edge in sorted(entering, key=lambda edge: float(edge.points[-1] @ across))),
        tuple(edge.id for edge in sorted(leaving, key=lambda edge: float(-(edge.points[0] @ across)))),
        math.fsum(p[0] for p in points) / len(points),
        math.fsum(p[1] for p in points) / len(points),
        outward,
    )


def _away(graph: MetricGraph, edge: Edge, *, upstream: bool) -> float:
    """Return the direction from the junction to a point `_FURTHER_OUT` along a road, or to the end of a shorter road [rad]."""
    points = np.vstack([graph.edges[id].points[:: -1 if upstream else 1] for id in walk(graph, edge.id, upstream=upstream)])
    far_enough = np.hypot(*(points - points[0]).T) >= _FURTHER_OUT
    x, y = points[int(far_enough.argmax()) if far_enough.any() else -1] - points[0]
    return math.atan2(y, x)


def unusable(
    graph: MetricGraph, id: str, arms: Sequence[RoadArm], ways: Sequence[Route], pairs: Sequence[tuple[str, str]]
) -> str | None:
    """Return the first reason why scenarios cannot use junction `id`; None for a usable junction."""
    declared = graph.network.junctions[id]
    if declared.type not in ("default", ""):
        return f'it is of type "{declared.type}", and only junctions made of connecting roads (type "default") can be used'
    if declared.lost is not None:
        return f"road {declared.lost!r}, which belongs to it or leads to it, has no geometry or no length"
    if not ways:
        return "no drivable lane leads through it"
    for edge in (graph.edges[id] for pair in pairs for id in pair):
        if edge.junction is not None:
            return f"road {edge.road!r}, which leads into or out of it, is itself part of junction {edge.junction!r}"
    if not FEWEST <= len(arms) <= MOST:
        return f"it has {len(arms)} arms, and only junctions of {FEWEST} to {MOST} arms can be used"
    if len({road in graph.network.left_hand for arm in arms for road, _ in arm.ends}) > 1:
        return "traffic keeps right on some of its roads and left on others"
    longest = max(ways, key=lambda way: way.length)
    if longest.length > LONGEST:
        return (
            f"its movement from lane {longest.path.entrance} to lane {longest.path.exit} is {longest.length:,.0f} m long, "
            f"expected at most {LONGEST:,.0f} m; check the unit of length and the coordinates there"
        )
    if len(ways) > MOST_WAYS:
        return f"it has {len(ways):,} movements, and only junctions of at most {MOST_WAYS} movements can be used"
    entering = sum(bool(arm.entrances) for arm in arms)
    if entering < 2:
        return f"traffic enters it from {entering} of its {len(arms)} arms, and a usable junction has traffic from at least two"
    gap, (lane, next_lane) = max(widest_gap(graph, way.path) for way in ways)
    if gap <= GAP_LIMIT:
        return None
    return f"lanes {lane} and {next_lane} are linked but {gap:.2f} m apart, expected at most {GAP_LIMIT:.1f} m"


def widest_gap(graph: MetricGraph, path: Path) -> tuple[float, tuple[str, str]]:
    """Return the widest gap between consecutive lanes of a path [m], and the two lanes."""
    gaps = []
    for lane, next_lane in pairwise((path.entrance, *path.edges, path.exit)):
        (x, y), (u, v) = graph.edges[lane].points[-1], graph.edges[next_lane].points[0]
        gaps.append((math.hypot(u - x, v - y), (lane, next_lane)))
    return max(gaps)
