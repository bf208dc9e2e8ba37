"""Centre lines of lanes, and their repair before the graph is made, so that lengths, stations, pictures and exports agree.

A centre line is computed along the reference line from laneOffset, widths of inner lanes and half the lane's width. A record of
geometry, laneOffset or width holds from its station to the station of the next record. A record that starts at the end of a lane
section does not count for this section; if it did, lanes would jump at the end of a section.

Folds and overlaps are cut, steps to the side become tapers, and no repaired line runs backwards. Repairs work on arrays of rows
``(x, y, s)``, shape ``(k, 3)`` [m]: the points of a centre line in the direction of travel with their stations on the road.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.network import Doubt, MapWarning
from pytest_rvads.geometry.opendrive.records import MOST_CELLS, STEP, Cubic, Line, Road, Section, evaluate
from pytest_rvads.geometry.segment import GAP_LIMIT
from pytest_rvads.support.errors import MapError

Array = NDArray[np.float64]

SPACING = 0.5
"""Distance between samples [m]; with these samples and all breakpoints, the lengths of lanes of whole towns err by 0.01 m."""
JOINT = 0.1
"""Gap between two pieces of a reference line from which on a warning is given [m]."""
_STRAIGHT_SPACING = 50.0
_LOOKS_PER_SAMPLE = 20
_BEND = 0.06
"""Change of heading between two samples above which a curve is sampled finer, so that chords stay within 5 mm of it [rad]."""
_FINEST = 8
_MERGE = 1e-3
_KINK = 0.02
_EPS = 1e-6


class LaneLine(NamedTuple):
    """Centre line of a drivable lane in a lane section, in the direction of the reference line."""

    points: Array
    """Points of the line, shape ``(k, 2)`` [m]."""
    s: Array
    """Station of each point on the road, shape ``(k,)`` [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    width: float
    """Width of the lane at mid-length [m]."""
    ends: tuple[float, float]
    """Width of the lane at the first and at the last station [m]."""
    cut: float
    """Length of the folds that were cut at kinks and at the ends [m]."""


class _Samples(NamedTuple):
    """Samples of the reference line of a road along a lane section."""

    s: Array
    """Stations, shape ``(k,)`` [m]."""
    line: Line
    heading: Array
    """Headings, unwrapped, shape ``(k,)`` [rad]."""
    joints: list[int]
    """Indices of the first samples of the pieces of the line after the first piece."""


def sample_count(road: Road) -> int:
    """Return an estimate of the number of samples that the lanes of `road` take, which is known before the sampling."""
    tables = [
        road.offsets,
        *(cubics for section in road.sections for lane in section.lanes.values() for cubics in (lane.widths, lane.borders)),
    ]
    curved = any(row.c or row.d for rows in tables for row in rows)
    # A curve is integrated from its start anew for every lane section.
    again = len(road.sections) if any(shape.kind in ("spiral", "poly3", "paramPoly3") for shape in road.shapes) else 0
    lanes = max((sum(lane.drivable for lane in section.lanes.values()) for section in road.sections), default=0)
    straight = not curved and all(shape.kind == "line" for shape in road.shapes)
    spacing = _STRAIGHT_SPACING if straight else SPACING
    records = len(road.shapes) + sum(map(len, tables))
    # Every lane section looks at all pieces, offsets and speed limits of its road, and integrates polynomials along its length.
    cells = sum(min(shape.length / STEP, MOST_CELLS) for shape in road.shapes if shape.kind in ("poly3", "paramPoly3"))
    looks = len(road.sections) * int(len(road.shapes) + len(road.offsets) + len(road.limits) + cells) // _LOOKS_PER_SAMPLE
    return int(road.length / spacing * max(1, lanes, again)) + records * max(1, lanes) + looks


def lane_lines(road: Road) -> list[dict[int, LaneLine]]:
    """Return the centre lines of the drivable lanes of `road`, per lane section by lane id."""
    tables = []
    with np.errstate(all="ignore"):
        for section, start, end in _spans(road):
            table: dict[int, LaneLine] = {}
            if any(lane.drivable for lane in section.lanes.values()):
                samples = _reference(road, section, start, end)
                if not np.isfinite(samples.line).all():
                    raise MapError(
                        f"road {road.id!r} has coordinates that are not finite between stations {start:.2f} and {end:.2f} m"
                    )
                shift = _cubic(road.offsets, samples.s, 0.0, end)
                for id, inner, outer in _borders(section, samples.s, start, end):
                    if section.lanes[id].drivable:
                        offset = shift + math.copysign(0.5, id) * (inner + outer)
                        table[id] = _line(road, id, samples, offset, outer - inner)
            tables.append(table)
    return tables


def borders_at(road: Road, s: float) -> dict[int, tuple[float, float]]:
    """Return the offsets of the inner and the outer border of every lane from the reference line, to the left, at a station [m].

    The borders at an end of the road also hold beyond this end.
    """
    at = np.array([min(max(s, 0.0), road.length)])
    for section, start, end in reversed([*_spans(road)]):
        if start <= at[0]:
            shift = float(_cubic(road.offsets, at, 0.0, end)[0])
            sides = ((math.copysign(1.0, id), id, inner, outer) for id, inner, outer in _borders(section, at, start, end))
            return {id: (shift + side * float(inner[0]), shift + side * float(outer[0])) for side, id, inner, outer in sides}
    return {}


def line_warnings(road: Road, lines: Iterable[Mapping[int, LaneLine]]) -> Iterator[MapWarning]:
    """Yield the warnings about a road with lanes: gaps and length of the reference line, folds of the centre lines."""
    if road.drivable:
        with np.errstate(all="ignore"):
            ends = [*(shape.s for shape in road.shapes[1:]), road.length]
            total = math.fsum(shape.length for shape in road.shapes)
            for shape, after, at in zip(road.shapes, road.shapes[1:], ends, strict=False):
                piece = evaluate(shape, np.array([0.0, max(at - shape.s, 0.0)]))
                gap = math.hypot(after.x - piece.x[-1], after.y - piece.y[-1])
                if not gap <= JOINT:
                    message = f"the reference line of road {road.id!r} has a gap of {gap:.2f} m at station {at:.2f} m"
                    yield MapWarning(Doubt.GAP, message, road.id)
            if abs(total - road.length) > max(0.05, 0.002 * road.length):
                message = f"road {road.id!r} says it is {road.length:.2f} m long, its geometry adds up to {total:.2f} m"
                yield MapWarning(Doubt.LENGTH, message, road.id)
    for table in lines:
        for id, line in table.items():
            if line.cut:
                message = f"lane {id} of road {road.id!r} folds where the reference line bends; {line.cut:.2f} m of it were cut"
                yield MapWarning(Doubt.KINK, message, road.id)


def _spans(road: Road) -> Iterator[tuple[Section, float, float]]:
    bounds = [min(max(section.s, 0.0), road.length) for section in road.sections[1:]]
    yield from zip(road.sections, [0.0, *bounds], [*bounds, road.length], strict=True)


def _borders(section: Section, s: Array, start: float, end: float) -> Iterator[tuple[int, Array, Array]]:
    """Yield the id of every lane of a section, and the distances of its two borders from the centre at stations `s` [m]."""
    for ids in (sorted(i for i in section.lanes if i > 0), sorted((i for i in section.lanes if i < 0), reverse=True)):
        inner = np.zeros_like(s)
        for id in ids:
            lane = section.lanes[id]
            if lane.widths or not lane.borders:
                outer = inner + _cubic(lane.widths, s, start, end)
            else:
                outer = math.copysign(1.0, id) * _cubic(lane.borders, s, start, end)
            yield id, inner, outer
            inner = outer


def _cubic(rows: Sequence[Cubic], s: Array, base: float, end: float) -> Array:
    """Return the values of piecewise cubics at stations `s`; at `end` the value just before `end`."""
    if not rows:
        return np.zeros_like(s)
    if len(rows) == 1 and rows[0].s + base <= s[0] + _EPS:
        (_, a, b, c, d), ds = rows[0], s - rows[0].s - base
        single: Array = a + ds * (b + ds * (c + ds * d))
        return single
    table = np.array(rows)
    starts = table[:, 0] + base
    row = np.searchsorted(starts, np.minimum(s + _EPS, end - _EPS), side="right") - 1
    picked = table[np.maximum(row, 0)]
    ds = s - picked[:, 0] - base
    value: Array = picked[:, 1] + ds * (picked[:, 2] + ds * (picked[:, 3] + ds * picked[:, 4]))
    value[row < 0] = 0.0
    return value


def _reference(road: Road, section: Section, start: float, end: float) -> _Samples:
    """Sample the reference line of a section; a joint of two pieces is sampled twice, once from each side."""
    rows = [(row.s + start, row) for lane in section.lanes.values() for row in (*lane.widths, *lane.borders)]
    rows += [(row.s, row) for row in road.offsets]
    curved = any(row.c or row.d for _, row in rows)
    cuts = np.unique([at for at, _ in rows if start < at < end])
    stations: list[Array] = []
    lines: list[Line] = []
    # Each piece of the reference line with the stations that it covers between `start` and `end`. The first piece also covers the
    # stations before the piece, the last piece the stations after the piece.
    lows = [start, *(max(shape.s, start) for shape in road.shapes[1:])]
    highs = [*(min(shape.s, end) for shape in road.shapes[1:]), end]
    pieces = [row for row in zip(road.shapes, lows, highs, strict=True) if row[2] - row[1] > _EPS]
    if not pieces:
        pieces = [(max((shape for shape in road.shapes if shape.s <= start + _EPS), default=road.shapes[0]), start, end)]
    for shape, low, high in pieces:
        # The samples are closer together where the piece bends.
        count = 1 if shape.kind == "line" and not curved else max(1, math.ceil((high - low) / SPACING))
        s = np.linspace(low, high, count + 1)
        if shape.kind != "line":
            turn = np.diff(evaluate(shape, np.maximum(s - shape.s, 0.0)).heading)
            bend = float(np.max(np.abs(np.remainder(turn + np.pi, 2 * np.pi) - np.pi)))
            if bend > _BEND:
                s = np.linspace(low, high, count * min(math.ceil(bend / _BEND), _FINEST) + 1)
        inside = cuts[(cuts > low) & (cuts < high)]
        if len(inside):
            s = np.unique(np.concatenate((s, inside)))
        stations.append(s)
        lines.append(evaluate(shape, np.maximum(s - shape.s, 0.0)))
    joints = np.cumsum([len(s) for s in stations[:-1]]).tolist()
    line = Line(*(np.concatenate(parts) for parts in zip(*lines, strict=True)))
    return _Samples(np.concatenate(stations), line, np.unwrap(line.heading), joints)


def _line(road: Road, id: int, samples: _Samples, offset: Array, width: Array) -> LaneLine:
    """Return the centre line of a lane without the folds at kinks and at the ends of the lane."""
    s, line, heading, joints = samples
    points = np.column_stack((line.x - offset * np.sin(line.heading), line.y + offset * np.cos(line.heading)))
    if not np.isfinite(points).all():
        raise MapError(f"lane {id} of road {road.id!r} has widths or offsets that are not finite")
    slope = np.diff(offset) / np.maximum(np.diff(s), _MERGE)
    turning = float(heading[-1] - heading[0] + math.atan(slope[-1]) - math.atan(slope[0]))
    keep, length = np.ones(len(s), dtype=bool), float(np.hypot(*np.diff(points, axis=0).T).sum())
    for joint in joints:
        kink, t = float(heading[joint] - heading[joint - 1]), float(offset[joint])
        reach = t * math.tan(kink / 2)
        if not _KINK < abs(kink) <= 2.0 or reach <= _MERGE:
            continue
        # On the inner side of a kink, the lane folds; it is cut where the centre lines before and after the joint cross.
        inside = (np.abs(s - s[joint]) < reach) & keep
        inside[0] = inside[-1] = inside[joint - 1] = False
        keep[inside] = False
        if joint > 1:
            middle = float(line.heading[joint - 1]) + kink / 2
            stretch = t / math.cos(kink / 2)
            points[joint - 1] = line.x[joint] - stretch * math.sin(middle), line.y[joint] + stretch * math.cos(middle)
    # In a tight bend, points after the first point of a lane can lie behind it, and points before the last point ahead of it.
    for line_points, kept, direction in ((points, keep, heading[0]), (points[::-1], keep[::-1], heading[-1] + math.pi)):
        ahead = (line_points - line_points[0]) @ (math.cos(direction), math.sin(direction)) > -_EPS
        kept[1 : int(ahead[1:].argmax()) + 1 if ahead[1:-1].any() else 1] = False
    points, s = points[keep], s[keep]
    cut = 0.0 if keep.all() else length - float(np.hypot(*np.diff(points, axis=0).T).sum())
    far = np.concatenate(([True], np.hypot(*np.diff(points, axis=0).T) > _MERGE))
    if not far[-1] and len(far) > 2:
        far[-2:] = False, True
    far[-1] = True
    first, middle, last = (float(width[k]) for k in (0, len(width) // 2, -1))
    return LaneLine(points[far], s[far], turning, middle, (first, last), cut)


GAP_WARNING = 0.1
"""Least gap between linked lanes that gives a warning, and least step to the side that becomes a taper [m]."""
TAPER = 25**2 / 60
"""Length of a taper per metre to the side: W S^2 / 60 at S = 25 mph (MUTCD 2009, table 6C-4)."""
_SPACING = 0.5
"""Distance between the points of a taper [m]."""
_SHARP = math.radians(120.0)
"""Largest change of heading within the length `_WITHIN` that is no fold [rad]."""
_WITHIN = 0.3
"""Length within which a change of heading above `_SHARP` is a fold [m]."""
_NUDGE, _GROWTH = 0.02, 0.05
"""The ends of a cut move apart in steps until the line between the ends leads forward: least step [m], step per metre cut."""
_MOST_FOLDS = 100
"""Most folds of a lane that are cut: the cost grows with the number of folds, and no lane of a real road folds more often."""
_OVERLAP = 0.01
"""Widest overlap that needs no repair [m]: lanes that meet within a centimetre meet in one point."""


def chained(parts: list[Array]) -> tuple[Array, float]:
    """Return the line made of consecutive lines, with tapers at lateral steps, and the width of the widest step [m]."""
    line, widest = parts[-1], 0.0
    for part in parts[-2::-1]:
        step = part[-1, :2] - line[0, :2]
        gap = math.hypot(*step)
        if gap > GAP_WARNING:
            widest = max(widest, gap)
            if _along(part)[-1] > _along(line)[-1]:
                part = _moved(part[::-1], -step)[::-1]
            else:
                line = _moved(line, step)
        line = np.vstack((part, line))
    return line, widest


def unfolded(line: Array) -> tuple[Array, float]:
    """Return a line without its folds, which are sharp turns after which the line runs back, and the length cut [m]."""
    length, cuts = float(_along(line)[-1]), 0
    while cuts < _MOST_FOLDS and (fold := _fold(line)) is not None:
        line, cuts = _cut(line, *fold), cuts + 1
    return line, length - float(_along(line)[-1]) if cuts else 0.0


def continued(line: Array, point: Array, heading: float) -> tuple[Array, float, float] | None:
    """Return a line changed so that it continues another line, the length cut off [m] and the lateral step [m].

    The line begins at most `GAP_LIMIT` from the end of the other line. Its part behind this end is cut, and a taper is added if
    it begins to the side of this end. The result is None if the whole line lies behind this end.
    """
    forward = np.array([math.cos(heading), math.sin(heading)])
    ahead, along, cut = (line[:, :2] - point) @ forward, _along(line), 0.0
    if ahead[0] < -_OVERLAP:
        beyond = (ahead > 0.0) & (np.arange(len(line)) > 0)
        k = int(beyond.argmax())
        if not beyond[k] or along[k - 1] > 2 * GAP_LIMIT:
            return None
        cut = float(along[k - 1] + (along[k] - along[k - 1]) * ahead[k - 1] / (ahead[k - 1] - ahead[k]))
        if cut > along[-1] - _NUDGE:
            return None
        line = np.vstack((_at(line, cut), line[along > cut + _NUDGE]))
    step = point - line[0, :2]
    step = step - (step @ forward) * forward
    aside = math.hypot(*step)
    if aside > GAP_WARNING:
        return _moved(line, step), cut, aside
    if cut:
        line[0, :2] = point
    return line, cut, 0.0


def _along(line: Array) -> Array:
    """Return the arc length from the start of a line to every row [m]."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))))


def _at(line: Array, stations: float | Array) -> Array:
    """Return rows of a line, interpolated at arc lengths [m]."""
    along = _along(line)
    return np.column_stack([np.interp(np.atleast_1d(stations), along, column) for column in line.T])


def _moved(line: Array, step: Array) -> Array:
    """Return a line whose start is moved by `step` and that is back on its old course at the end of a taper, or of the line."""
    along = _along(line)
    reach = max(min(TAPER * math.hypot(*step), float(along[-1])), _NUDGE)
    stations = np.union1d(along, np.arange(0.0, reach, _SPACING))
    moved, share = _at(line, stations), np.clip(stations / reach, 0.0, 1.0)
    moved[:, :2] += np.outer(1.0 - share**2 * (3.0 - 2.0 * share), step)
    return moved


def _fold(line: Array) -> tuple[float, float] | None:
    """Return the arc lengths between which a line turns sharply [m]; None for a line without a sharp turn."""
    headings, along, apart = np.arctan2(*np.diff(line[:, :2], axis=0).T[::-1]), _along(line), 1
    while len(headings) > apart and (near := along[apart:-1] - along[1:-apart] <= _WITHIN).any():
        turns = np.abs(np.remainder(headings[apart:] - headings[:-apart] + math.pi, math.tau) - math.pi)
        sharp = near & (turns > _SHARP)
        if sharp.any():
            first = int(sharp.argmax())
            return float(along[first + 1]), float(along[first + apart])
        apart += 1
    return None


def _cut(line: Array, low: float, high: float) -> Array:
    """Return a line whose part from `low` to `high` [m], or a longer part, is replaced by a straight piece that leads forward."""
    along, steps = _along(line), np.diff(line[:, :2], axis=0)
    while True:
        nudge = max(_NUDGE, _GROWTH * (high - low))
        low, high = max(low - nudge, 0.0), min(high + nudge, float(along[-1]))
        ends = _at(line, np.array([low, high]))
        chord = ends[1, :2] - ends[0, :2]
        before = steps[max(int(np.searchsorted(along, low)) - 1, 0)] if low > 0.0 else chord
        after = steps[min(int(np.searchsorted(along, high, side="right")) - 1, len(steps) - 1)] if high < along[-1] else chord
        corners = (before, chord), (chord, after)
        turns = [abs(math.atan2(one[0] * two[1] - one[1] * two[0], one @ two)) for one, two in corners]
        forward = max(turns) < math.pi / 2 and (abs(sum(turns)) < _SHARP or math.hypot(*chord) > _WITHIN)
        if forward or (low == 0.0 and high == along[-1]):
            return np.vstack((line[along < low], ends, line[along > high]))
