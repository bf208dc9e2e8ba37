"""The reasons why the model can't use a junction of a file, checked in order of importance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from pytest_rvads.geometry.arms import RoadArm
from pytest_rvads.geometry.graph import MetricGraph
from pytest_rvads.geometry.paths import Path, Route
from pytest_rvads.geometry.segment import GAP_LIMIT

__all__ = ["FEWEST", "MOST", "unusable", "widest_gap"]

FEWEST, MOST = 3, 8
"""Least and largest number of arms of a junction of the model."""


def unusable(
    graph: MetricGraph, id: str, arms: Sequence[RoadArm], ways: Sequence[Route], pairs: Sequence[tuple[str, str]]
) -> str | None:
    """Return the first reason why junction `id` cannot be used; None for a usable junction.

    Args:
        graph: the metric graph of the map.
        id: the id of the junction.
        arms: the arms, counter-clockwise.
        ways: the ways through the junction, without the ways that are left out.
        pairs: (entrance edge, exit edge) of every way through the junction.
    """
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
        return f"it has {len(arms)} arms, and only junctions of {FEWEST} to {MOST} can be used"
    if len({road in graph.network.left_hand for arm in arms for road, _ in arm.ends}) > 1:
        return "traffic keeps right on some of its roads and left on others"
    entering = sum(bool(arm.entrances) for arm in arms)
    if entering < 2:
        return f"traffic enters it from {entering} of its {len(arms)} arms, and only junctions that two or more enter are usable"
    return _reason_of_gaps(graph, ways)


def widest_gap(graph: MetricGraph, path: Path) -> tuple[float, tuple[str, str]]:
    """Return the widest gap between consecutive lanes of a path [m], and the two lanes."""
    gaps = []
    for lane, next_lane in pairwise((path.entrance, *path.edges, path.exit)):
        (x, y), (u, v) = graph.edges[lane].points[-1], graph.edges[next_lane].points[0]
        gaps.append((math.hypot(u - x, v - y), (lane, next_lane)))
    return max(gaps)


def _reason_of_gaps(graph: MetricGraph, ways: Sequence[Route]) -> str | None:
    gap, (lane, next_lane) = max(widest_gap(graph, way.path) for way in ways)
    if gap <= GAP_LIMIT:
        return None
    return f"lanes {lane} and {next_lane} are linked but {gap:.2f} m apart, expected at most {GAP_LIMIT:.1f} m"
