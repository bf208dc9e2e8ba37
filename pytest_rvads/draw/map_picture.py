"""Pictures of the junctions of a map: lanes, directions, entrances with numbers, signs, lights, stopping lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np

from pytest_rvads.draw.svg import document, polyline, text, wrap
from pytest_rvads.junctions.analysis import JunctionReport
from pytest_rvads.junctions.road_map import RoadMap
from pytest_rvads.junctions.ways import walk
from pytest_rvads.maps.control import ObjectKind
from pytest_rvads.maps.network import Edge
from pytest_rvads.maps.segment import Turn

__all__ = ["draw_map"]

_PANEL, _CAPTION, _COLUMNS, _HEAD = 360.0, 64.0, 3, 62.0
_GAP = 6.0
"""Between a panel and the edge of its tile; neighbours must not look linked [px]."""
_MARGIN = 18.0
"""How much of the roads around a junction is drawn [m]."""
_SMALLEST = 20.0
_ARROWS = 12.0
_TURNS = {Turn.LEFT: "#d55e00", Turn.STRAIGHT: "#0072b2", Turn.RIGHT: "#009e73"}
"""Okabe and Ito's palette, distinguishable by colour-blind people."""
_NO_TURN = "#777"

Project = Callable[[float, float], tuple[float, float]]


def draw_map(road_map: RoadMap) -> str:
    """Return an SVG document with a panel for each junction of a map, usable or not."""
    reports = road_map.junctions
    columns = min(_COLUMNS, len(reports))
    rows = math.ceil(len(reports) / columns)
    usable = sum(report.usable for report in reports)
    count = "1 junction" if len(reports) == 1 else f"{len(reports)} junctions"
    body = [
        text(12, 24, f"{road_map.path}: {count}, {usable} usable", font_size=15, font_weight="bold"),
        _legend(12, 44),
    ]
    for i, report in enumerate(reports):
        x, y = i % columns * _PANEL, _HEAD + i // columns * (_PANEL + _CAPTION)
        body.append(
            f'<svg x="{x + _GAP:g}" y="{y + _CAPTION:g}" width="{_PANEL - 2 * _GAP:g}" height="{_PANEL - 2 * _GAP:g}" '
            f'viewBox="0 0 {_PANEL:g} {_PANEL:g}">{_panel(road_map, report)}</svg>'
        )
        body.append(_caption(report, x, y))
    defs = "".join(
        f'<marker id="{name}" viewBox="0 0 6 6" refX="5" refY="3" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L6 3L0 6z" fill="{colour}"/></marker>'
        for name, colour in [*((turn.value, colour) for turn, colour in _TURNS.items()), ("way", _NO_TURN)]
    )
    return document(max(columns * _PANEL, 720), _HEAD + rows * (_PANEL + _CAPTION), body, defs)


def _legend(x: float, y: float) -> str:
    parts = []
    for turn, colour in _TURNS.items():
        parts.append(f'<path d="M{x:g} {y - 4:g}h24" stroke="{colour}" stroke-width="2" marker-end="url(#{turn.value})"/>')
        parts.append(text(x + 30, y, turn.value))
        x += 95
    for mark, label, width in (
        (_number(x + 8, y - 4, "0"), "entrance", 95),
        (_sign(x + 105, y - 4), "stop sign", 95),
        (_light(x + 200, y - 4), "light", 75),
    ):
        parts.append(mark)
        parts.append(text(x + 22, y, label))
        x += width
    parts.append(f'<path d="M{x + 4:g} {y - 4:g}h14" stroke="#c00" stroke-width="3"/>' + text(x + 24, y, "stopping line"))
    return "".join(parts)


def _caption(report: JunctionReport, x: float, y: float) -> str:
    state = "usable" if report.usable else "not usable"
    side = ", traffic keeps left" if report.left_hand else ""
    head = f"junction {report.id}: {report.ways}-way, {report.control.value}, {state}{side}"
    lines = [text(x + 12, y + 20, head, font_weight="bold", fill="#000" if report.usable else "#a00")]
    if report.reason is not None:
        lines += [text(x + 12, y + 35 + 12 * i, line, font_size=10) for i, line in enumerate(wrap(report.reason, 66)[:3])]
    elif report.arms:
        lengths = ", ".join(f"e{i} {length:.0f} m" for i, length in enumerate(report.approach))
        lines.append(text(x + 12, y + 35, f"approach: {lengths}", font_size=10))
    return "".join(lines)


def _panel(road_map: RoadMap, report: JunctionReport) -> str:
    if not report.arms:
        return text(_PANEL / 2, _PANEL / 2, "nothing to draw", text_anchor="middle", fill="#777")
    edges = road_map.graph.edges
    inside = [edges[id] for id in dict.fromkeys(id for way in report.movements for id in way.path.edges)]
    corners = np.vstack([[(arm.x, arm.y) for arm in report.arms], *(edge.points for edge in inside)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (low + high) / 2
    reach = max(float((high - low).max()) / 2, _SMALLEST / 2) + _MARGIN
    scale = _PANEL / 2 / reach

    def place(east: float, north: float) -> tuple[float, float]:
        return _PANEL / 2 + (east - x) * scale, _PANEL / 2 - (north - y) * scale

    roads = _roads(road_map, report, reach)
    parts = ['<rect width="100%" height="100%" fill="#f4f4ee"/>']
    for extra, colour in ((0.5, "#999"), (0.0, "#d8d8d8")):
        for edge in (*inside, *roads):
            width = max((max(edge.width, 1.0) + extra) * scale, 1.0)
            parts.append(polyline((place(*p) for p in _near(edge, x, y, reach)), stroke=colour, stroke_width=f"{width:.1f}"))
    for edge in roads:
        parts += _directions(edge, place, x, y, reach)
    for way in report.movements:
        line = [place(*p) for id in way.path.edges for p in edges[id].points]
        parts.append(polyline(line, stroke=_TURNS[way.turn], stroke_width=1.5, marker_end=f"url(#{way.turn.value})"))
    parts += _marks(road_map, report, place, scale)
    parts.append(f'<path d="M10 {_PANEL - 10:g}h{10 * scale:.1f}m0 -3v6m-{10 * scale:.1f} 0v-6" stroke="#333" fill="none"/>')
    parts.append(text(10, _PANEL - 16, "10 m", font_size=10))
    return "".join(parts)


def _roads(road_map: RoadMap, report: JunctionReport, reach: float) -> list[Edge]:
    """Return the lanes outside the junction as far as they may show."""
    found: dict[str, Edge] = {}
    for upstream, starts in (
        (True, [e for arm in report.arms for e in arm.entrances]),
        (False, [e for arm in report.arms for e in arm.exits]),
    ):
        for start in starts:
            total = 0.0
            for id in walk(road_map.graph, start, upstream=upstream):
                if total > 2 * reach:
                    break
                found[id] = road_map.graph.edges[id]
                total += found[id].length
    return list(found.values())


def _near(edge: Edge, x: float, y: float, reach: float) -> Iterable[tuple[float, float]]:
    """Return the points of a lane near the picture, whose frame clips the rest."""
    distance = np.maximum(np.abs(edge.points[:, 0] - x), np.abs(edge.points[:, 1] - y))
    close = distance <= 1.5 * reach
    keep = close.copy()
    keep[1:] |= close[:-1]
    keep[:-1] |= close[1:]
    points = edge.points[keep] if keep.sum() >= 2 else edge.points
    return [(float(a), float(b)) for a, b in points]


def _directions(edge: Edge, place: Project, x: float, y: float, reach: float) -> list[str]:
    """Return arrows along a road lane, within the picture."""
    parts = []
    apart, size = max(_ARROWS, reach / 4), max(1.0, reach / 40)
    done = 0.0
    for (ax, ay), (bx, by) in pairwise(edge.points.tolist()):
        step = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / step, (by - ay) / step
        nearest = (x - ax) * ux + (y - ay) * uy
        low, high = max(0.0, nearest - 1.5 * reach), min(step, nearest + 1.5 * reach)
        for k in range(math.ceil((done + low) / apart), math.floor((done + high) / apart) + 1):
            along = apart * k - done
            px, py = ax + along * ux, ay + along * uy
            if along < step and max(abs(px - x), abs(py - y)) <= reach:
                line = [place(px, py), place(px + size * ux, py + size * uy)]
                parts.append(polyline(line, stroke=_NO_TURN, stroke_width=1.2, marker_end="url(#way)"))
        done += step
    return parts


def _marks(road_map: RoadMap, report: JunctionReport, place: Project, scale: float) -> list[str]:
    """Return stopping lines, entrance numbers, signs and lights."""
    parts = []
    kinds: dict[str, set[ObjectKind]] = {}
    for item in report.objects:
        kinds.setdefault(item.edge, set()).add(item.kind)
    for number, arm in enumerate(report.arms):
        for id in arm.entrances:
            edge = road_map.graph.edges[id]
            (ex, ey), heading = edge.points[-1].tolist(), edge.end_heading
            ux, uy = math.cos(heading), math.sin(heading)
            half, back = max(edge.width, 2.0) / 2, report.setbacks[number]
            bar = [place(ex - back * ux + side * half * uy, ey - back * uy - side * half * ux) for side in (-1, 1)]
            parts.append(polyline(bar, stroke="#c00", stroke_width=3))
            parts.append(_number(*place(ex - (back + 16 / scale) * ux, ey - (back + 16 / scale) * uy), str(number)))
            kerb = half + 9 / scale if not report.left_hand else -half - 9 / scale
            here = place(ex - back * ux + kerb * uy, ey - back * uy - kerb * ux)
            if ObjectKind.LIGHT in kinds.get(id, ()):
                parts.append(_light(*here))
            elif ObjectKind.STOP in kinds.get(id, ()):
                parts.append(_sign(*here))
    return parts


def _number(x: float, y: float, label: str) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8" fill="#000"/>' + text(
        x, y + 4, label, fill="#fff", text_anchor="middle", font_size=11
    )


def _sign(x: float, y: float) -> str:
    corners = " ".join(
        f"{x + 7 * math.cos(math.pi / 8 + k * math.pi / 4):.1f},{y + 7 * math.sin(math.pi / 8 + k * math.pi / 4):.1f}"
        for k in range(8)
    )
    return f'<polygon points="{corners}" fill="#c00" stroke="#fff"/>'


def _light(x: float, y: float) -> str:
    lamps = zip((-5, 0, 5), ("#e33", "#fc0", "#3b3"), strict=True)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y + dy:.1f}" r="2" fill="{colour}"/>' for dy, colour in lamps)
    return f'<rect x="{x - 4:.1f}" y="{y - 9:.1f}" width="8" height="18" rx="2" fill="#222"/>{dots}'
