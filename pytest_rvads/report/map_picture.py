"""Draws the junctions of a map: lanes with arrows and marks, signs, lights, stopping lines, right of way."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.graph import walk
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.network import Edge, gathered
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.geometry.turns import UTURN, turn_word
from pytest_rvads.geometry.ways import Key
from pytest_rvads.report.scene import TURNS
from pytest_rvads.report.svg import Points, arrow, document, marks, polyline, sign, text, wrap

_PANEL, _COLUMNS, _HEAD, _LEGEND = 360.0, 3, 78.0, 900.0
_LINE, _LETTERS, _LINES = 12.0, 66, 12
"""Text above a panel: height of a line [px], letters per line, most lines."""
_GAP = 6.0
"""Distance between a panel and the edge of its tile, so that neighbours do not look linked [px]."""
_MARGIN = 18.0
"""Drawn length of the roads around a junction [m]."""
_STRIPE = 0.5
"""Width of the stripes of a crosswalk and of the gaps between them [m] (StVO, sign 293)."""
_ARROWS = 12.0
_NO_TURN = "#777"
_DASHES = "5 3"
_REASONS = {
    Reason.STATED: "as the map says",
    Reason.SIGN: "by signs",
    Reason.TURN: "turning {1}",
    Reason.RIGHT: "{0} before {1}",
    Reason.MERGE: "joining",
    Reason.UNDECIDED: "undecided at a flat angle",
}


class _View(NamedTuple):
    """The part of a map that a panel shows: a square, given by its middle and half its side [m]."""

    x: float
    y: float
    reach: float

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return _PANEL / 2 / self.reach

    def place(self, points: ArrayLike) -> Points:
        """Return points of the map in the panel, shape ``(..., 2)`` [px]."""
        return _PANEL / 2 + (np.asarray(points) - (self.x, self.y)) * (self.scale, -self.scale)

    def near(self, points: Points) -> Points:
        """Return the points of a line near the panel; the frame of the panel clips the line."""
        close = np.abs(points - (self.x, self.y)).max(axis=1) <= 1.5 * self.reach
        keep = close.copy()
        keep[1:] |= close[:-1]
        keep[:-1] |= close[1:]
        return points[keep] if keep.sum() >= 2 else points


def draw_map(road_map: RoadMap) -> str:
    """Return an SVG document with a panel for each junction of a map, usable or not."""
    reports = road_map.junctions
    columns = min(_COLUMNS, len(reports))
    usable = sum(report.usable for report in reports)
    count = "1 junction" if len(reports) == 1 else f"{len(reports)} junctions"
    drawn = {turn_word(report, way) for report in reports for way in report.movements}
    words = [word for word in TURNS if word != UTURN or word in drawn]
    body = [
        text(12, 24, f"{road_map.path}: {count}, {usable} usable", font_size=15, font_weight="bold"),
        _legend(words),
    ]
    y = _HEAD
    for begin in range(0, len(reports), columns):
        row = reports[begin : begin + columns]
        junctions = [road_map.junction(report.id) if report.usable else None for report in row]
        captions = [_caption(road_map, *pair) for pair in zip(row, junctions, strict=True)]
        above = 12 + _LINE * max(map(len, captions))
        for column, (report, junction, (head, *lines)) in enumerate(zip(row, junctions, captions, strict=True)):
            x = column * _PANEL
            body.append(
                f'<svg x="{x + _GAP:g}" y="{y + above:g}" width="{_PANEL - 2 * _GAP:g}" height="{_PANEL - 2 * _GAP:g}" '
                f'viewBox="0 0 {_PANEL:g} {_PANEL:g}">{_panel(road_map, report, junction)}</svg>'
            )
            body.append(text(x + 12, y + 12, head, font_weight="bold", fill="#000" if report.usable else "#a00"))
            body += [text(x + 12, y + 12 + _LINE * k, line, font_size=10) for k, line in enumerate(lines, start=1)]
        y += above + _PANEL
    defs = "".join(
        f'<marker id="{name}" viewBox="0 0 6 6" refX="5" refY="3" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L6 3L0 6z" fill="{colour}"/></marker>'
        for name, colour in [*((word, TURNS[word]) for word in words), ("way", _NO_TURN)]
    )
    return document(max(columns * _PANEL, _LEGEND), y, body, defs)


def _legend(words: Iterable[str]) -> str:
    x, y, parts = 12, 44, []
    for word in words:
        parts.append(f'<path d="M{x:g} {y - 4:g}h24" stroke="{TURNS[word]}" stroke-width="2" marker-end="url(#{word})"/>')
        parts.append(text(x + 30, y, word))
        x += 95
    parts.append(f'<path d="M{x:g} {y - 4:g}h24" stroke="#333" stroke-width="2" stroke-dasharray="{_DASHES}"/>')
    parts.append(text(x + 30, y, "gives way to somebody"))
    x, y = 12, y + 20
    for mark, label, width in (
        (_number(x + 8, y - 4, "0"), "entrance", 95),
        (sign(Sign.STOP, x + 103, y - 4, 7), "stop", 65),
        (sign(Sign.YIELD, x + 168, y - 4, 7), "yield", 65),
        (sign(Sign.PRIORITY, x + 233, y - 4, 7), "priority", 85),
        (_light(x + 318, y - 4), "light", 70),
    ):
        parts.append(mark)
        parts.append(text(x + 22, y, label))
        x += width
    parts.append(f'<path d="M{x + 4:g} {y - 4:g}h14" stroke="#c00" stroke-width="3"/>' + text(x + 24, y, "stopping line"))
    return "".join(parts)


def _caption(road_map: RoadMap, report: JunctionReport, junction: Junction | None) -> list[str]:
    """Return the lines of text above the panel of a junction; the first line is the heading."""
    state = "usable" if report.usable else "not usable"
    lines = [f"junction {report.id}: {report.ways}-way, {report.control.value}, {state}"]
    lines += ["traffic keeps left"] if report.left_hand else []
    if report.reason is not None:
        lines += wrap(report.reason, _LETTERS)
    elif junction is not None:
        approaches = [f"{length:.0f} m" for length in report.approach]
        lengths = ", ".join(f"{length} to {k}" for k, length in enumerate(approaches))
        lines += wrap(f"approach: {lengths if len(set(approaches)) > 1 else approaches[0]}", _LETTERS)
        sides = ("left", "right") if report.left_hand else ("right", "left")
        table: dict[Reason, dict[int, set[int]]] = {}
        for (way, prior), reason in _yields(junction).items():
            table.setdefault(reason, {}).setdefault(way[0], set()).add(prior[0])
        when = {JunctionControl.STOP: " in a tie", JunctionControl.LIGHTS: " on the same green"}.get(report.control, "")
        for reason in (reason for reason in Reason if reason in table):
            pairs = (f"{k} to {' '.join(map(str, sorted(priors)))}" for k, priors in sorted(table[reason].items()))
            lines += wrap(f"gives way{when}, {_REASONS[reason].format(*sides)}: {', '.join(pairs)}", _LETTERS)
        doubts = gathered(warning for warning in (*road_map.warnings, *road_map.bends) if warning.junction == report.id)
        lines += [line for doubt in doubts for line in wrap(doubt["message"], _LETTERS)]
    return lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "..."]


def _yields(junction: Junction) -> dict[tuple[Key, Key], Reason]:
    """Return pairs of movements with the reason why the first gives way; pairs that never have green together are left out."""
    phases = [start.phase for start in junction.starts]
    pairs = (junction.yields or {}).items()
    return {(a, b): reason for (a, b), reason in pairs if len({phases[a[0]], phases[b[0]]} - {None}) < 2}


def _panel(road_map: RoadMap, report: JunctionReport, junction: Junction | None) -> str:
    if not report.arms:
        return text(_PANEL / 2, _PANEL / 2, "nothing to draw", text_anchor="middle", fill="#777")
    edges = road_map.graph.edges
    inside = [edges[id] for id in dict.fromkeys(id for way in report.movements for id in way.path.edges)]
    corners = np.vstack([[(arm.x, arm.y) for arm in report.arms], *(edge.points for edge in inside)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = ((low + high) / 2).tolist()
    view = _View(x, y, max(float((high - low).max()) / 2, 10.0) + _MARGIN)  # a view shows 20 m at least
    place, scale = view.place, view.scale
    roads = _roads(road_map, report, view.reach)
    parts = ['<rect width="100%" height="100%" fill="#f4f4ee"/>']
    for extra, colour in ((0.5, "#999"), (0.0, "#cfcfcf")):
        for edge in (*inside, *roads):
            line = place(view.near(edge.points))
            width = max((max(edge.width, 1.0) + extra) * scale, 1.0)
            parts.append(polyline(line, stroke=colour, stroke_width=f"{width:.1f}"))
    for arm in report.arms:
        for upstream, ids in ((True, arm.entrances), (False, arm.exits)):
            lanes = [edges[id] for id in ids]
            width = math.fsum(lane.width for lane in lanes) / max(len(lanes), 1)
            centre = upstream or not arm.entrances
            for mark, broken in marks([lane.points for lane in lanes], width, left_hand=report.left_hand, centre=centre):
                near = place(_View(arm.x, arm.y, 2 * view.reach).near(mark))
                parts.append(polyline(near, stroke="#fff", stroke_width=1.2, stroke_dasharray="8 8" if broken else None))
    for crosswalk in road_map.crossings.get(report.id, ()):  # the border of its painted area, and stripes along the lanes
        path = crosswalk.path
        across = np.array([-1.0, 1.0]) * (path.points[1] - path.points[0])[::-1] / path.length
        width = float(np.ptp(crosswalk.area @ across)) * scale
        stripes = {"class": "crosswalk", "stroke": "#fff", "stroke_width": f"{width:.1f}"}
        parts.append(polyline(place(np.vstack([crosswalk.area, crosswalk.area[:1]])), stroke="#fff", stroke_width=1))
        parts.append(polyline(place(path.points), **stripes, stroke_dasharray=f"{_STRIPE * scale:.1f}"))
    for edge in roads:
        parts += _directions(edge, view)
    yields = _yields(junction).items() if junction else ()
    yielding = {way for (way, _), reason in yields if reason is not Reason.UNDECIDED}
    for way in report.movements:
        course = [point for id in way.path.edges for point in place(edges[id].points)]
        word = turn_word(report, way)
        dashes = _DASHES if (way.entrance, way.exit) in yielding else None
        end = f"url(#{word})"
        parts.append(polyline(course, stroke=TURNS[word], stroke_width=1.5, marker_end=end, stroke_dasharray=dashes))
    for entrance in range(len(report.entrances)):
        parts += _posted(road_map, report, entrance, view)
    parts.append(f'<path d="M10 {_PANEL - 10:g}h{10 * scale:.1f}m0 -3v6m-{10 * scale:.1f} 0v-6" stroke="#333" fill="none"/>')
    parts.append(text(10, _PANEL - 16, "10 m", font_size=10))
    return "".join(parts)


def _roads(road_map: RoadMap, report: JunctionReport, reach: float) -> list[Edge]:
    """Return the lanes outside the junction that can be visible in its panel."""
    lanes: dict[str, Edge] = {}
    starts = [(start, True) for arm in report.arms for start in arm.entrances]
    starts += [(start, False) for arm in report.arms for start in arm.exits]
    for start, upstream in starts:
        total = 0.0
        for id in walk(road_map.graph, start, upstream=upstream):
            if total > 2 * reach:
                break
            lanes[id] = road_map.graph.edges[id]
            total += lanes[id].length
    return list(lanes.values())


def _directions(edge: Edge, view: _View) -> list[str]:
    """Return SVG arrows along a lane of a road, within the panel."""
    parts, (x, y, reach) = [], view
    apart, size = max(_ARROWS, reach / 4), max(1.0, reach / 40)
    covered = 0.0
    for (ax, ay), (bx, by) in pairwise(edge.points.tolist()):
        step = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / step, (by - ay) / step
        nearest = (x - ax) * ux + (y - ay) * uy
        low, high = max(0.0, nearest - 1.5 * reach), min(step, nearest + 1.5 * reach)
        for k in range(math.ceil((covered + low) / apart), math.floor((covered + high) / apart) + 1):
            along = apart * k - covered
            px, py = ax + along * ux, ay + along * uy
            if along < step and max(abs(px - x), abs(py - y)) <= reach:
                line = view.place([(px, py), (px + size * ux, py + size * uy)])
                parts.append(polyline(line, stroke=_NO_TURN, stroke_width=1.2, marker_end="url(#way)"))
        covered += step
    return parts


def _posted(road_map: RoadMap, report: JunctionReport, entrance: int, view: _View) -> list[str]:
    """Return SVG elements of an entrance: stopping line, number, arrow and light; at the kerb also the sign of the arm."""
    end = report.entrances[entrance]
    edge, many = road_map.graph.edges[end.edge], len(report.arms[end.arm].entrances) > 1
    (ex, ey), heading = edge.points[-1].tolist(), edge.end_heading
    ux, uy = math.cos(heading), math.sin(heading)
    half, back = max(edge.width, 2.0) / 2, report.setbacks[entrance]

    def place(behind: float, aside: float = 0.0) -> tuple[float, float]:
        """Return a point behind the end of the lane and to its right in the panel [px]."""
        px, py = view.place((ex - behind * ux + aside * uy, ey - behind * uy - aside * ux)).tolist()
        return px, py

    parts = [polyline([place(back, -half), place(back, half)], stroke="#c00", stroke_width=3)]
    parts.append(_number(*place(back + 16 / view.scale), str(entrance)))
    ways = [way for way in report.movements if way.entrance == entrance]
    if many or len({way.exit for way in ways}) < report.ways - 1:
        px, py = place(back + 44 / view.scale)
        turned = f"translate({px:.1f} {py:.1f}) rotate({-math.degrees(heading):.1f}) scale(4.5)"
        sides = arrow({way.turn for way in ways})
        parts.append(f'<path class="arrow" transform="{turned}" d="{sides}" fill="none" stroke="#222" stroke-width=".35"/>')
    kerb = half + 9 / view.scale
    kind = report.signs[entrance]
    if kind is Sign.LIGHTS and many:
        parts.append(_light(*place(-11 / view.scale)))
    elif kind is Sign.LIGHTS or end.lane == 0:
        post = place(back, -kerb if report.left_hand else kerb)
        parts.append(_light(*post) if kind is Sign.LIGHTS else sign(kind, *post, 7))
    return parts


def _number(x: float, y: float, label: str) -> str:
    name = text(x, y + 4, label, fill="#fff", text_anchor="middle", font_size=11 if len(label) < 3 else 9)
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8" fill="#000"/>{name}'


def _light(x: float, y: float) -> str:
    lamps = zip((-5, 0, 5), ("#e33", "#fc0", "#3b3"), strict=True)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y + dy:.1f}" r="2" fill="{colour}"/>' for dy, colour in lamps)
    return f'<rect x="{x - 4:.1f}" y="{y - 9:.1f}" width="8" height="18" rx="2" fill="#222"/>{dots}'
