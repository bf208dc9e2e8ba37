"""The arms that the crosswalks of a map lie over, and the lines from kerb to kerb on which pedestrians walk.

A crosswalk lies over the arm to whose vertices the crosswalk is nearest, measured along movements that lead over its painted
area. Painted areas over one arm are one crosswalk if they are aligned, for example one area per carriageway beside an island.

The kerbs of a crosswalk are the outer edges of the lanes that lead over it, or of the shoulders beside these lanes.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Collection, Sequence, Set
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.arms import MOST
from pytest_rvads.geometry.conflicts import Line
from pytest_rvads.geometry.control import ObjectKind, Sign
from pytest_rvads.geometry.crosswalks import Crosswalk, covered, hull
from pytest_rvads.geometry.graph import MetricGraph, Route, walk
from pytest_rvads.geometry.network import Doubt, MapWarning, Network, PaintedCrosswalk
from pytest_rvads.geometry.segment import Pose, Segment, join
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import CONFLICT_WIDTH, Key
from pytest_rvads.support.errors import MapError

Array = NDArray[np.float64]

REACH = 15.0
"""Largest distance of the middle of a crosswalk from the entrance and exit vertices of its arm [m]."""
_MARGIN = 10.0
"""Length of the lanes beyond `REACH` that is looked at [m]."""
_MOST_CORNERS, _MOST_AREAS = 1000, 50
"""Most corners of a painted area, and most painted areas over one arm."""
_REFUGE = 1.8
"""Least width of an island [m]: on less, pedestrians can't wait (PROWAG 2011, R208.2: 6 ft in the direction of travel)."""
_SHORT = 0.1
"""Length of a line below which the line has no clear direction [m], and least width of a lane that vehicles drive on [m]."""
_LEAST_SLANT = 0.5
"""Least sine of the angle between a crosswalk and the lanes over it, 30 degrees; else pedestrians walk straight across."""
_ALIGNED = math.radians(20.0)
"""Largest angle between the lines on which pedestrians walk over two painted areas of one crosswalk [rad]."""


class _Pass(NamedTuple):
    """A movement that leads over a painted area, on its lane into the junction or out of the junction."""

    route: Route
    lane: tuple[bool, int]
    """Whether the lane leads into the junction, and the number of the entrance or exit."""
    place: Pose
    """The middle of the stretch of the movement inside the area."""
    distance: float
    """Distance of this place from the entrance vertex or the exit vertex, along the movement [m]."""
    edge: str


class _Path(NamedTuple):
    """The straight line on which pedestrians walk over a painted area."""

    origin: Array
    """A point of the line, shape ``(2,)`` [m]."""
    across: Array
    """Unit vector along the line, from the near side to the far side, shape ``(2,)``."""


def lay(
    graph: MetricGraph, reports: Sequence[JunctionReport], joints: Collection[str]
) -> tuple[dict[str, tuple[Crosswalk, ...]], tuple[MapWarning, ...]]:
    """Return the crosswalks over the arms of the junctions of a map."""
    sites: dict[int, _Site] = {}
    laid: dict[tuple[int, int], list[PaintedCrosswalk]] = {}
    warnings = []
    arms = np.array([(arm.x, arm.y) for report in reports for arm in report.arms]).reshape(-1, 2)
    owners = np.repeat(np.arange(len(reports)), [report.ways for report in reports])
    for painted in graph.network.crosswalks:
        if len(painted.area) > _MOST_CORNERS:
            message = (
                f"the crosswalk {painted.id!r} has {len(painted.area):,} corners, more than {_MOST_CORNERS:,}; it was left out"
            )
            warnings.append(MapWarning(Doubt.CROSSWALK, message, painted.road or None))
            continue
        gaps = np.full(len(reports), math.inf)
        np.minimum.at(gaps, owners, np.hypot(*(arms[:, None] - painted.area).T).min(axis=0))
        ranked = []
        for number in np.flatnonzero(gaps <= REACH + _MARGIN).tolist():
            if reports[number].ways <= MOST:
                if number not in sites:
                    sites[number] = _Site(graph, reports[number], joints)
                over = sites[number].over(painted.area)
                ranked += [(min(p.distance for p in passes), -len(passes), number, arm) for arm, passes in over.items()]
        if ranked:
            number, arm = min(ranked)[2:]
            laid.setdefault((number, arm), []).append(painted)
            if len(laid[number, arm]) > _MOST_AREAS:
                raise MapError(f"more than {_MOST_AREAS} crosswalks lie over arm {arm} of junction {reports[number].id!r}")
            continue
        reason, gap = f"no movement leads over it within {REACH:g} m of an entrance or exit", gaps.min(initial=math.inf)
        if REACH < gap < math.inf:
            reason = f"the nearest arm begins {gap:.0f} m away, expected at most {REACH:g} m"
        place = f" of road {painted.road!r}" if painted.road else ""
        message = f"the crosswalk {painted.id!r}{place} is at no junction: {reason}"
        warnings.append(MapWarning(Doubt.CROSSWALK, message, painted.road or None))
    table: dict[str, tuple[Crosswalk, ...]] = {}
    for number, arm in sorted(laid):
        site, areas = sites[number], laid[number, arm]
        crosswalks = [site.crosswalk(arm, group) for group in site.aligned(arm, areas)]
        table[site.report.id] = (*table.get(site.report.id, ()), *crosswalks)
    return table, tuple(warnings)


class _Site:
    """A junction with the centre lines of its movements, from the lanes before the junction to the lanes behind it."""

    def __init__(self, graph: MetricGraph, report: JunctionReport, joints: Collection[str]) -> None:
        self.graph, self.report = graph, report
        self.courses: list[tuple[Route, Segment, list[str], list[float], list[float]]] = []
        """Per movement the line, its edges, the station of the end of every edge [m], and the stations of both vertices [m]."""
        for route in report.movements:
            before = self._beyond(route.path.entrance, joints, upstream=True)[::-1]
            ids = [*before, *route.path.edges, *self._beyond(route.path.exit, joints, upstream=False)]
            line = join([graph.segment(id) for id in ids])
            if line:
                ends = np.cumsum([graph.edges[id].length for id in ids]).tolist()
                vertices = [ends[len(before) - 1], ends[len(before) + len(route.path.edges) - 1]]
                self.courses.append((route, line, ids, ends, vertices))

    def _beyond(self, start: str, joints: Collection[str], *, upstream: bool) -> list[str]:
        """Return the edges away from the junction, from an entrance or exit edge on, that are near enough for a crosswalk."""
        length, near = 0.0, []
        for id in walk(self.graph, start, upstream=upstream, joints=joints):
            near.append(id)
            length += self.graph.edges[id].length
            if length >= REACH + _MARGIN:
                break
        return near

    def over(self, area: Array) -> dict[int, list[_Pass]]:
        """Return, per arm, the movements that lead over an area within `REACH` of the vertices of this arm."""
        over: dict[int, list[_Pass]] = {}
        for route, line, ids, ends, vertices in self.courses:
            stretch = covered(area, Line(line, CONFLICT_WIDTH))
            if stretch is None:
                continue
            middle = (stretch.start + stretch.end) / 2
            edge = ids[min(bisect_left(ends, middle), len(ids) - 1)]
            entrance, exit = self.report.entrances[route.entrance], self.report.exits[route.exit]
            lanes = (entrance.arm, (True, route.entrance)), (exit.arm, (False, route.exit))
            for vertex, (arm, lane) in zip(vertices, lanes, strict=True):
                if abs(middle - vertex) <= REACH:
                    over.setdefault(arm, []).append(_Pass(route, lane, line.pose(middle), abs(middle - vertex), edge))
        return over

    def path(self, area: Array, passes: Sequence[_Pass]) -> _Path:
        """Return the line through the middle of an area, between the two sides over which the lanes lead."""
        straightest = _straightest(passes)
        straight_across = _left(_unit(straightest[-1].place)) * (
            1.0 if straightest[-1].lane[0] != self.report.left_hand else -1.0
        )
        middles = []
        for p in straightest:
            ahead = _unit(p.place)
            aside = self.graph.edges[p.edge].width / 4 * _left(ahead)
            for point in (np.array(p.place[:2]) - aside, np.array(p.place[:2]) + aside):
                # The middle of the part of the line ahead that lies inside the area; the point itself if no part does.
                left, along = (area - point) @ _left(ahead), (area - point) @ ahead
                cuts = [
                    x + (u - x) * y / (y - v)
                    for x, y, u, v in zip(along, left, np.roll(along, -1), np.roll(left, -1), strict=True)
                    if (y > 0.0) != (v > 0.0)
                ]
                middles.append(point + (min(cuts) + max(cuts)) / 2 * ahead if cuts else point)
        middles.sort(key=lambda point: float(point @ straight_across))
        across = middles[-1] - middles[0]
        length = float(np.hypot(*across))
        skewed = length < _SHORT or across @ straight_across < _LEAST_SLANT * length
        return _Path(middles[0], straight_across if skewed else across / length)

    def aligned(self, arm: int, areas: Sequence[PaintedCrosswalk]) -> list[list[PaintedCrosswalk]]:
        """Return the areas over an arm in groups: pedestrians walk straight on from area to area of a group."""
        groups: list[tuple[_Path, float, list[PaintedCrosswalk]]] = []
        for painted in areas:
            path = self.path(painted.area, self.over(painted.area)[arm])
            aside = _left(path.across)
            half = float(np.ptp(painted.area @ aside)) / 2
            for other, other_half, group in groups:
                parallel = float(path.across @ other.across) >= math.cos(_ALIGNED)
                if parallel and abs(float((other.origin - path.origin) @ aside)) <= min(half, other_half):
                    group.append(painted)
                    break
            else:
                groups.append((path, half, [painted]))
        return [group for _, _, group in groups]

    def crosswalk(self, arm: int, areas: Sequence[PaintedCrosswalk]) -> Crosswalk:
        """Return the crosswalk over an arm that areas make up."""
        area = areas[0].area if len(areas) == 1 else hull(np.vstack([painted.area for painted in areas]))
        passes = [p for painted in areas for p in self.over(painted.area)[arm]]
        origin, across = self.path(area, passes)
        beside = {edge: width for painted in areas for edge, width in painted.beside.items()}
        # Per pass, where its lane begins and ends along the path, without the shoulder.
        edges = {}
        for p in passes:
            half = max(self.graph.edges[p.edge].width, _SHORT) / 2 / max(abs(float(_left(_unit(p.place)) @ across)), _LEAST_SLANT)
            at = float((np.array(p.place[:2]) - origin) @ across)
            edges[p] = at - half, at + half
        near = min(edges[p][0] - (beside.get(p.edge, 0.0) if p.lane[0] else 0.0) for p in passes)
        far = max(edges[p][1] + (0.0 if p.lane[0] else beside.get(p.edge, 0.0)) for p in passes)
        straightest = _straightest(passes)
        # Without lanes in, the whole crosswalk is the half of the lanes out, and the other way round.
        inner = max((edges[p][1] for p in straightest if p.lane[0]), default=None)
        outer = min((edges[p][0] for p in straightest if not p.lane[0]), default=None)
        middle, gap = near if inner is None else far, 0.0
        if inner is not None and outer is not None:
            middle, gap = (inner + outer) / 2, outer - inner
        name = "+".join(dict.fromkeys(painted.id for painted in areas))
        line = Segment(name, np.array([origin + near * across, origin + far * across]))
        lights = {light for painted in areas for light in painted.lights}
        phase = _phase(self.graph.network, self.report, arm, lights, {(p.route.entrance, p.route.exit) for p in passes})
        return Crosswalk(name, arm, area, line, middle - near, gap if gap >= _REFUGE else 0.0, phase)


def _unit(place: Pose) -> Array:
    return np.array([math.cos(place.heading), math.sin(place.heading)])


def _left(vector: Array) -> Array:
    return np.array([-vector[1], vector[0]])


def _straightest(passes: Sequence[_Pass]) -> list[_Pass]:
    """Return, per lane of an arm, the pass of the movement that turns least."""
    return list({p.lane: p for p in sorted(passes, key=lambda p: -abs(p.route.turning))}.values())


def _phase(network: Network, report: JunctionReport, arm: int, lights: Set[str], over: Collection[Key]) -> int | None:
    """Return the number of the phase group that has green while pedestrians may walk; None if no light stops the arm.

    The group of the vehicle lights that share a controller with a light of the crosswalk counts first. Else the group has neither
    an entrance of the arm nor a straight movement over the crosswalk. Among several such groups, a group with a straight movement
    to another arm goes before other groups, because the law lets pedestrians walk beside it (Uniform Vehicle Code 11-202(a)3).
    Then the group with the fewest movements over the crosswalk goes first, then the group with the lowest number.
    """
    own = {k for k, end in enumerate(report.entrances) if end.arm == arm}
    if any(report.signs[k] is not Sign.LIGHTS for k in own):
        return None
    groups = {number: group for number, group in enumerate(report.phase_groups) if not group & own}
    numbers = {end.edge: k for k, end in enumerate(report.entrances)}
    heads = [(item.id, numbers.get(item.edge)) for item in report.objects if item.kind is ObjectKind.LIGHT]
    for signals in network.controllers:
        if not lights.isdisjoint(signals):
            named = {
                number for number, group in enumerate(report.phase_groups) for id, k in heads if id in signals and k in group
            }
            if len(named) == 1 and named <= groups.keys():
                return named.pop()
    straight = {(way.entrance, way.exit) for way in report.movements if way.turn is Turn.STRAIGHT}
    crossing = {number: {key for key in over if key[0] in group} for number, group in groups.items()}
    parallel = {number: any(entrance in group for entrance, _ in straight) for number, group in groups.items()}
    ranked = [(not parallel[n], len(crossing[n]), n) for n in groups if straight.isdisjoint(crossing[n])]
    return min(ranked)[2] if ranked else None
