"""Why the model has no room for a junction of a file, the gravest reason first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from pytest_rvads.junctions.arms import RoadArm
from pytest_rvads.junctions.graph import MetricGraph
from pytest_rvads.junctions.ways import Way
from pytest_rvads.maps.segment import GAP_LIMIT

__all__ = ["FEWEST", "MOST", "unusable"]

FEWEST, MOST = 3, 8
"""Ways a junction of the model can have."""


def unusable(
    graph: MetricGraph, id: str, arms: Sequence[RoadArm], ways: Sequence[Way], pairs: Sequence[tuple[str, str]]
) -> str | None:
    """Return the first reason why junction `id` cannot be used, None where it can.

    Args:
        graph: of the map.
        id: of the junction.
        arms: counter-clockwise.
        ways: between the arms.
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
    return _of_arms(arms) or _of_movements(ways, len(arms)) or _of_gaps(graph, ways)


def _of_arms(arms: Sequence[RoadArm]) -> str | None:
    for i, arm in enumerate(arms):
        if not (arm.entrances and arm.exits):
            roads = " and ".join(f"road {road!r}" for road, _ in arm.ends)
            what = "exit" if arm.entrances else "entrance"
            return f"arm {i} ({roads}) is one-way and has no {what} lane, expected one entrance and one exit lane per arm"
    for i, arm in enumerate(arms):
        if len(arm.entrances) > 1 or len(arm.exits) > 1:
            lanes = f"{len(arm.entrances)} entrance and {len(arm.exits)} exit lanes"
            return f"arm {i} (road {arm.ends[0][0]!r}) has {lanes}, expected one of each"
    return None


def _of_movements(ways: Sequence[Way], arms: int) -> str | None:
    present = {(way.entrance, way.exit) for way in ways}
    back = min((entrance for entrance, exit in present if entrance == exit), default=None)
    if back is not None:
        return f"it has a U-turn at entrance {back}, which the model has no room for; leave U-turns out with drop_uturns"
    missing = [(i, k) for i in range(arms) for k in range(arms) if i != k and (i, k) not in present]
    if not missing:
        return None
    listed = ", ".join(f"{i} to {k}" for i, k in missing[:6])
    return f"it lacks {len(missing)} movements: from entrance to exit {listed}; every entrance needs one to each other arm"


def _of_gaps(graph: MetricGraph, ways: Sequence[Way]) -> str | None:
    widest, where = 0.0, ("", "")
    for way in ways:
        for one, two in pairwise((way.path.entrance, *way.path.edges, way.path.exit)):
            gap = math.dist(graph.edges[one].points[-1], graph.edges[two].points[0])
            if gap > widest:
                widest, where = gap, (one, two)
    if widest <= GAP_LIMIT:
        return None
    return f"lanes {where[0]} and {where[1]} are linked but {widest:.2f} m apart, expected at most {GAP_LIMIT:.1f} m"
