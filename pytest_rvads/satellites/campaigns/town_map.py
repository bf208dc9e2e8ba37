"""The picture of a town's map: its lanes, and a mark per junction in the form and colour of the junction's worst verdict."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.logic.outcome import MARKS, Mark, Tallied, counted
from pytest_rvads.report.outline import Picture
from pytest_rvads.support.wording import markup, plural

_TOLERANCE = 0.2
"""Largest distance of a drawn line from the centre line of its lane [m]."""
_MARGIN = 15.0
"""Empty margin of a picture around the lanes [m]."""
_SMALLEST = 8.0
"""Least radius of the disc that shows how far a junction reaches [m]."""
_WIDTHS = (0.5, 6.0)
"""Least and greatest width with which a lane is drawn [m]."""
_LETTERS = 12
"""Greatest length of an id on the map; some converters join ids to long ids, which would cover the map."""
_MEANINGS: dict[Mark, str] = {
    "bad": "failed",
    "error": "no verdict (ERROR)",
    "doubt": "open, provoked, unavoidable, unsure or incomplete",
    "good": "passed",
    "none": "refused or not judged",
}
_FORMS: dict[Mark, tuple[str, str]] = {
    "bad": ("M-8.5 -8.5h17v17h-17z", "M-3.8 -3.8L3.8 3.8M3.8 -3.8L-3.8 3.8"),
    "error": ("M-10 -6L0 -11L10 -6V6L0 11L-10 6z", "M3.6 -4.6H-3V4.6H3.6M-3 0H2.6"),
    "doubt": ("M0 -11.5L11.5 0L0 11.5L-11.5 0z", "M0 -5.5V1.5M0 5V5.2"),
    "good": ("M-9 0a9 9 0 1 0 18 0a9 9 0 1 0 -18 0", "M-4 0L-1 3.2L4.2 -3.6"),
    "none": ("M-8 0a8 8 0 1 0 16 0a8 8 0 1 0 -16 0", "M-3.2 0H3.2"),
}
"""Paths of the body and of the sign of each mark [px]."""


class MarkedJunction(NamedTuple):
    """A junction on the map."""

    name: str
    """Name of the junction in ids."""
    report: JunctionReport
    verdicts: Counter[Tallied]
    incomplete: bool
    """Whether results of the junction are missing."""
    note: str
    """The reason why no run is possible, or further facts; empty without one."""

    @property
    def mark(self) -> Mark:
        """The worst mark of the verdicts; a junction of which results are missing is never ``good`` or ``none``."""
        marks = {outcome.mark for outcome in self.verdicts if outcome}
        worst: Mark = next((mark for mark in MARKS if mark in marks), "none")
        return "doubt" if worst in ("good", "none") and self.incomplete else worst


def town_picture(title: str, road_map: RoadMap, sites: Iterable[MarkedJunction]) -> Picture:
    """Return the picture of a map, with the numbers of its junctions by mark."""
    worst_last = sorted(sites, key=lambda site: list(MARKS).index(site.mark), reverse=True)  # their marks lie on top
    numbers = Counter(site.mark for site in worst_last)
    told = "; ".join(f"{numbers[mark]} {MARKS[mark][0]} {what}" for mark, what in _MEANINGS.items() if numbers[mark])
    groups: defaultdict[float, str] = defaultdict(str)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for id in sorted(road_map.graph.edges):
        edge = road_map.graph.edges[id]
        points = simplified(edge.points * (1.0, -1.0), _TOLERANCE)
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        width = round(min(max(edge.width, _WIDTHS[0]), _WIDTHS[1]) * 2) / 2
        tenths = np.rint(points * 10.0).astype(int)  # decimetres
        (x, y), steps = tenths[0].tolist(), np.diff(tenths, axis=0)
        path = f"M{_tenth(x)} {_tenth(y)}" + "".join(f"l{_tenth(dx)} {_tenth(dy)}" for dx, dy in steps.tolist() if dx or dy)
        groups[width] += path
    if not groups:
        low = high = np.zeros(2)
    (west, north), (wide, tall) = (low - _MARGIN).tolist(), (high - low + 2 * _MARGIN).tolist()
    lanes = "".join(
        f'<path data-width="{width:g}" stroke-width="{width:g}" d="{path}"/>' for width, path in sorted(groups.items())
    )
    areas, marks = [], []
    for site in worst_last:
        if site.report.arms:
            x, y, radius = spot(site.report)
            areas += [f'<circle class="area {site.mark}" cx="{x}" cy="{y}" r="{radius}"/>'] if site.mark != "none" else []
            marks.append(_mark(site, x, y, max(wide, tall) / 1000))
    svg = (
        f'<svg class="map" viewBox="{west:.1f} {north:.1f} {wide:.1f} {tall:.1f}" tabindex="0" role="group" '
        'aria-label="map: arrows move the view, plus and minus zoom, 0 shows the whole map">'
        f'<g class="lanes">{lanes}</g>{"".join(areas)}{"".join(marks)}</svg>'
    )
    return Picture((f"{plural(len(worst_last), 'junction')}: {told}" if told else "no junctions",), title, svg)


def _mark(site: MarkedJunction, x: float, y: float, scale: float) -> str:
    """Return the mark of a junction as SVG, a link to its items on the page."""
    facts = filter(None, (counted(site.verdicts), "results are missing" if site.incomplete else "", site.note))
    label = markup(f"{site.name}: {'; '.join(facts) or 'nothing judged'}")
    id = site.report.id
    short = id if len(id) <= _LETTERS else f"{id[:4]}…{id[-5:]}"
    body, sign = _FORMS[site.mark]
    return (
        f'<a href="#{quote(site.name)}" class="mark {site.mark}" data-x="{x}" data-y="{y}" data-name="{markup(site.name)}" '
        f'aria-label="{label}" transform="translate({x} {y}) scale({scale:.3g})"><title>{label}</title>'
        f'<path class="body" d="{body}"/><path class="sign" d="{sign}"/><text y="25">{markup(short)}</text></a>'
    )


def spot(report: JunctionReport) -> tuple[float, float, float]:
    """Return the mean position of the arms of a junction, y to the south, and a radius that reaches all arms [m]."""
    arms = report.arms
    x, y = math.fsum(arm.x for arm in arms) / len(arms), math.fsum(arm.y for arm in arms) / len(arms)
    radius = max(_SMALLEST, *(math.dist((x, y), (arm.x, arm.y)) for arm in arms))
    return round(x, 1), round(-y, 1), round(radius, 1)


def simplified(points: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Return a line with fewer points, by the algorithm of Ramer, Douglas and Peucker.

    Args:
        points: points of the line, shape ``(k, 2)``, k >= 2.

    Returns:
        Some of the points in order, including both ends, shape ``(n, 2)``.
    """
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    parts = [(0, len(points) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        start, along = points[first], points[last] - points[first]
        inner = points[first + 1 : last] - start
        length = float(along @ along)
        share = np.clip(inner @ along / length, 0.0, 1.0) if length else np.zeros(len(inner))
        off = np.hypot(*(inner - share[:, None] * along).T)
        farthest = int(off.argmax())
        if off[farthest] > tolerance:
            middle = first + 1 + farthest
            keep[middle] = True
            parts += [(first, middle), (middle, last)]
    return points[keep]


def _tenth(number: int) -> str:
    return f"{number / 10:.1f}".removesuffix(".0")
