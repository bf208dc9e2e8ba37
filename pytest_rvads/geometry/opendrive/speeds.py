"""Speed limits of OpenDRIVE files: those of road types (``<type><speed>``) and those of lanes (``<lane><speed>``)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import pairwise
from operator import itemgetter
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.opendrive.records import Road
from pytest_rvads.geometry.segment import NO_LIMIT, Limits
from pytest_rvads.support.errors import MapError

__all__ = ["limit_of", "limits_along", "speed_of"]

_UNITS = {"": 1.0, "m/s": 1.0, "mph": 0.44704, "km/h": 1 / 3.6}
"""Per unit its size [m/s]: OpenDRIVE 1.8, section 8.2; an international mile has 1,609.344 m."""
_WITH_UNIT = re.compile(r"\s*(\d{1,9}\.?\d{0,30}(?:e[-+]?\d{1,2})?)\s*(m/s|mph|km/h)?\s*", re.IGNORECASE)


def speed_of(text: str, what: str) -> float:
    """Return a speed [m/s] from text with or without a unit, such as ``30mph``.

    Args:
        text: the speed; without a unit in m/s.
        what: the name of the speed in the message of the error.

    Raises:
        MapError: the text is no speed above 0 and below `NO_LIMIT`.
    """
    match = _WITH_UNIT.fullmatch(text)
    speed = float(match[1]) * _UNITS[(match[2] or "").lower()] if match else 0.0
    if not 0.0 < speed < NO_LIMIT:
        raise MapError(f"{what} must be a speed above 0 such as 30mph, 50km/h or, in m/s, 13.9, got {text[:40]!r}")
    return speed


def limit_of(element: Element) -> float | None:
    """Return the speed limit of an element [m/s], None if the element leaves the limit undefined.

    Raises:
        MapError: the limit is no speed, see `speed_of`.
    """
    most = element.get("max", "").strip()
    if most.lower() in ("undefined", ""):
        return None
    return NO_LIMIT if most.lower() == "no limit" else speed_of(f"{most} {element.get('unit', '')}".strip(), "it")


def limits_along(road: Road, chain: Iterable[tuple[int, int]], stations: NDArray[np.float64], s: NDArray[np.float64]) -> Limits:
    """Return the speed limits along an edge.

    Args:
        road: the road that the edge belongs to.
        chain: section index and lane id of its lanes, in the direction of travel.
        stations: arc length along the edge at points of it, shape ``(k,)`` [m].
        s: road station at these points, shape ``(k,)`` [m]; the stations rise or fall along the edge.
    """
    parts = [part for i, lane in chain for part in _in_section(road, i, lane)]
    sign = 1.0 if s[-1] >= s[0] else -1.0
    rows = sorted(((min(sign * start, sign * end), limit) for start, end, limit in parts), key=itemgetter(0))
    borders = np.interp([start for start, _ in rows], sign * s, stations).tolist()
    limits = [limit for _, limit in rows]
    changes = ((at, limit) for at, limit, before in zip(borders, limits, [0.0, *limits], strict=False) if limit != before)
    return tuple(changes) if any(limits) else ()


def _in_section(road: Road, i: int, lane: int) -> Iterator[tuple[float, float, float | None]]:
    """Yield the start and end of every speed limit of a lane within a section [m], and the limit [m/s].

    A limit of the lane counts before a limit of the road.
    """
    start, end = [*(section.s for section in road.sections), road.length][i : i + 2]
    lane_limits = tuple((start + at, limit) for at, limit in road.sections[i].lanes[lane].limits)
    cuts = sorted({start, *(at for at, _ in (*road.limits, *lane_limits) if start < at < end)})
    for a, b in pairwise((*cuts, end)):
        yield a, b, _limit_at(lane_limits, a) or _limit_at(road.limits, a)


def _limit_at(limits: Limits, s: float) -> float | None:
    return next((limit for at, limit in reversed(limits) if at <= s), None)
