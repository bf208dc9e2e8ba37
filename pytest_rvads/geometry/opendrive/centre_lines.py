"""Repairs of centre lines: folds and overlaps are cut, steps to the side become tapers. No repaired line runs backwards.

A line is an array of rows ``(x, y, s)``, shape ``(k, 3)`` [m]: the points of a centre line in the direction of travel with their
stations on the road.

The reader repairs centre lines before the graph is made, so that lengths, stations, pictures and exports agree.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import GAP_LIMIT

Array = NDArray[np.float64]

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
