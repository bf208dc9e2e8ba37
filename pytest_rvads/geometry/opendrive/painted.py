"""Crosswalks of an OpenDRIVE file: their painted areas, their lights for pedestrians, and the shoulders that they lead over.

A crosswalk is an object of type ``crosswalk``, or the road that a ``<crossPath>`` of a junction names. The painted area is the
convex hull of the corners of the object, or of the lanes of the road. A light for pedestrians belongs to the nearest crosswalk.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import hull
from pytest_rvads.geometry.network import Doubt, PaintedCrosswalk
from pytest_rvads.geometry.opendrive.centre_lines import borders_at
from pytest_rvads.geometry.opendrive.draft import Chain, Draft
from pytest_rvads.geometry.opendrive.records import Road, pose_at
from pytest_rvads.geometry.opendrive.signals import point_of
from pytest_rvads.support.errors import MapError

_PEDESTRIAN = "1000002"
"""Type of a light for pedestrians (OpenDRIVE, list of signals)."""
_LIGHT_RANGE = 5.0
"""Largest distance of a light for pedestrians from the painted area of its crosswalk [m]."""
_MOST_TESTS = 20_000
"""Most pairs of a light for pedestrians and a crosswalk near it; a town has 1,000."""
_NEAR = 5.0
"""Distance from the painted area to which the shoulders of roads are looked up [m]."""
_BESIDE = frozenset({"shoulder", "parking", "biking", "border", "stop", "restricted", "bus", "taxi", "hov"})
"""Types, in lower case, of lanes between a lane that vehicles drive on and its kerb."""
_LEAST_AREA, _WIDEST = 0.5, 100.0
"""Least size of a painted area [m^2], and its largest extent to the north or the east [m]."""
_PARTS = 8
"""Number of parts of a crossing road between whose ends its lanes count as straight."""

Array = NDArray[np.float64]


def painted(draft: Draft) -> tuple[PaintedCrosswalk, ...]:
    """Return the crosswalks of a draft with edges; a crosswalk without a usable area is left out, with a warning in the draft."""
    areas = [(id, road, area) for id, road, corners in _corners(draft) if (area := _area(draft, id, road, corners)) is not None]
    if not areas:
        return ()
    lights: list[list[str]] = [[] for _ in areas]
    low, high = (np.array([side(area, axis=0) for _, _, area in areas]) for side in (np.min, np.max))
    tests = 0
    signals = [(road, signal) for road in draft.document.roads.values() if road.shapes for signal in road.signals]
    for at, signal in signals:
        if signal.type.replace(".", "") != _PEDESTRIAN:
            continue
        point = np.array(point_of(at, signal))
        near = np.flatnonzero(((low <= point + _LIGHT_RANGE) & (high >= point - _LIGHT_RANGE)).all(axis=1)).tolist()
        tests += len(near)
        if tests > _MOST_TESTS:
            raise MapError(f"too many crosswalks and lights for pedestrians stand around the light {signal.id!r}; leave some out")
        distances = [(_nearest(np.vstack((areas[k][2], areas[k][2][:1])), point)[0], k) for k in near]
        distance, k = min(distances, default=(math.inf, 0))
        if distance <= _LIGHT_RANGE:
            lights[k].append(signal.id)
    edges = list(draft.edges.values())
    boxes = np.array([(*edge.points.min(axis=0), *edge.points.max(axis=0)) for edge in edges]).reshape(-1, 4)
    crosswalks = []
    for (id, road, area), names in zip(areas, lights, strict=True):
        low, high = area.min(axis=0) - _NEAR, area.max(axis=0) + _NEAR
        near = ((boxes[:, :2] <= high) & (boxes[:, 2:] >= low)).all(axis=1).nonzero()[0]
        widths = {edges[k].id: _beside(draft.document.roads[edges[k].road], edges[k], area.mean(axis=0)) for k in near}
        beside = {edge: width for edge, width in widths.items() if width > 0.0}
        crosswalks.append(PaintedCrosswalk(id, road, area, tuple(dict.fromkeys(names)), beside))
    return tuple(crosswalks)


def _corners(draft: Draft) -> Iterator[tuple[str, str, Array]]:
    """Yield the id, the road and the corners of every crosswalk, shape ``(k, 2)`` [m]."""
    roads = draft.document.roads
    for road in roads.values():
        for record in road.crosswalks if road.shapes else ():
            corners = [_point(road, s, t) for s, t in record.corners]
            if record.local:
                x, y = _point(road, record.s, record.t)
                heading = pose_at(road, record.s)[2] + record.heading
                cos, sin = math.cos(heading), math.sin(heading)
                corners = [(x + u * cos - v * sin, y + u * sin + v * cos) for u, v in record.corners]
            yield record.id, road.id, np.array(corners)
    for junction in draft.document.junctions.values():
        for id, name in junction.cross_paths:
            if name not in roads or not roads[name].shapes:
                message = (
                    f"the crossPath {id!r} of junction {junction.id!r} names road {name!r}, which does not exist; it was left out"
                )
                draft.warn(Doubt.CROSSWALK, message, None, junction.id)
                continue
            # Points on the outermost borders of the lanes of the road.
            road = roads[name]
            stations = [road.length * k / _PARTS for k in range(_PARTS + 1)]
            borders = [(s, [t for pair in borders_at(road, s).values() for t in pair] or [0.0]) for s in stations]
            yield id, name, np.array([_point(road, s, t) for s, offsets in borders for t in (min(offsets), max(offsets))])


def _point(road: Road, s: float, t: float) -> tuple[float, float]:
    x, y, heading = pose_at(road, s)
    return x - t * math.sin(heading), y + t * math.cos(heading)


def _area(draft: Draft, id: str, road: str, corners: Array) -> Array | None:
    """Return the convex hull of the corners of a crosswalk; None, with a warning in the draft, if the hull is no crosswalk."""
    area = hull(corners) if np.isfinite(corners).all() else np.zeros((0, 2))
    x, y = area.T
    size = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    fault = f"has {size:.2f} m^2, expected {_LEAST_AREA:g} m^2 or more"
    if size >= _LEAST_AREA:
        extent = float(np.ptp(area, axis=0).max())
        if extent <= _WIDEST:
            return area
        fault = f"is {extent:.0f} m wide, expected at most {_WIDEST:g} m"
    message = f"the crosswalk {id!r} of road {road!r} was left out: its painted area {fault}"
    draft.warn(Doubt.CROSSWALK, message, road)
    return None


def _nearest(line: Array, point: Array) -> tuple[float, int, float]:
    """Return the distance from a point to a line [m], the nearest piece of the line, and the share of it before the point."""
    starts, pieces = line[:-1], np.diff(line, axis=0)
    along = np.clip(((point - starts) * pieces).sum(axis=1) / (pieces**2).sum(axis=1), 0.0, 1.0)
    distances = np.hypot(*(starts + along[:, None] * pieces - point).T)
    k = int(distances.argmin())
    return float(distances[k]), k, float(along[k])


def _beside(road: Road, edge: Chain, point: Array) -> float:
    """Return the width of the lanes between an edge and its kerb, at the place of the edge nearest to a point [m]."""
    _, k, along = _nearest(edge.points, point)
    s = float(edge.s[k] + along * (edge.s[k + 1] - edge.s[k]))
    section = max((i for i, part in enumerate(road.sections) if part.s <= s), default=0)
    lane = dict(edge.lanes).get(section)
    if lane is None:
        return 0.0
    borders, lanes = borders_at(road, s), road.sections[section].lanes
    step, width = 1 if lane > 0 else -1, 0.0
    while (lane := lane + step) in borders and lanes[lane].type in _BESIDE:
        width += abs(borders[lane][1] - borders[lane][0])
    return width
