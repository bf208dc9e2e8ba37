"""The page of a town: its map with the junctions in the colours of their verdicts, and the results of each junction."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import Block
from pytest_rvads.report.page import rendered
from pytest_rvads.satellites.campaigns.town_tally import Tally, TownMark, cell
from pytest_rvads.support.wording import markup, plural, quoted

TOLERANCE = 0.2
"""Largest distance of a drawn line from the centre line of its lane [m]."""
_MARGIN = 15.0
"""Empty margin of a picture around the lanes [m]."""
_SMALLEST = 8.0
"""Least radius of the disc that marks a junction [m]."""
_WIDTHS = (0.5, 6.0)
"""Least and greatest width with which a lane is drawn [m]."""


class TownPicture(NamedTuple):
    """The lanes of a map as SVG; x grows to the east, and y grows to the south [m]."""

    view: tuple[float, float, float, float]
    """The SVG view box: x of the west edge, y of the north edge, width and height [m]."""
    lanes: tuple[tuple[float, str], ...]
    """Pairs of a lane width [m] and the attribute ``d`` of an SVG path with the centre lines of all lanes of this width."""


class Spot(NamedTuple):
    """Position of a junction in the picture of a map [m]."""

    x: float
    y: float
    radius: float
    """Radius of the disc that marks the junction and reaches all its arms [m]."""


@dataclass(frozen=True, slots=True)
class TownMap:
    """A map of a town."""

    name: str
    picture: TownPicture


@dataclass(frozen=True, slots=True)
class Site:
    """A junction of a town, with its properties on the page."""

    name: str
    """Name of the junction in ids."""
    id: str
    """Id of the junction in its map."""
    map: int
    """Position of the junction's map among the maps of the page, from 0."""
    spot: Spot | None
    """Position of the junction in the picture of the map; None for a junction without arms."""
    kind: str
    """Kind of the junction, such as ``4-way stop``."""
    planned: int = 0
    refused: str = ""
    """The reason why no run is possible at the junction; empty if runs are possible."""
    notes: tuple[str, ...] = ()
    """Further sentences, for example on scenarios that were left out."""


def town_picture(road_map: RoadMap) -> TownPicture:
    """Return a picture of the lanes of a map; a map without lanes gives an empty picture of 30 m by 30 m."""
    groups: dict[float, list[str]] = {}
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for id in sorted(road_map.graph.edges):
        edge = road_map.graph.edges[id]
        points = simplified(edge.points * (1.0, -1.0), TOLERANCE)
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        width = round(min(max(edge.width, _WIDTHS[0]), _WIDTHS[1]) * 2) / 2
        tenths = np.rint(points * 10.0).astype(int)  # decimetres
        (x, y), steps = tenths[0].tolist(), np.diff(tenths, axis=0)
        path = f"M{_tenth(x)} {_tenth(y)}" + "".join(f"l{_tenth(dx)} {_tenth(dy)}" for dx, dy in steps.tolist() if dx or dy)
        groups.setdefault(width, []).append(path)
    if not groups:
        low = high = np.zeros(2)
    (west, north), (wide, tall) = (low - _MARGIN).tolist(), (high - low + 2 * _MARGIN).tolist()
    view = round(west, 1), round(north, 1), round(wide, 1), round(tall, 1)
    return TownPicture(view, tuple((width, "".join(groups[width])) for width in sorted(groups)))


def spot(report: JunctionReport) -> Spot | None:
    """Return the position of a junction, which is the mean position of its arms; None for a junction without arms."""
    arms = report.arms
    if not arms:
        return None
    x, y = math.fsum(arm.x for arm in arms) / len(arms), math.fsum(arm.y for arm in arms) / len(arms)
    radius = max(_SMALLEST, *(math.dist((x, y), (arm.x, arm.y)) for arm in arms))
    return Spot(round(x, 1), round(-y, 1), round(radius, 1))


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


LEGEND: tuple[tuple[TownMark, str], ...] = (
    ("bad", "failed"),
    ("error", "no verdict (ERROR)"),
    ("doubt", "open, provoked, unavoidable, unsure or incomplete"),
    ("good", "passed"),
    ("none", "refused or not judged"),
)
"""The marks (colours) of junctions on the map, with their meanings, from the worst to the best."""


def state(site: Site, tally: Tally) -> TownMark:
    """Return the mark (colour) of a junction on the map; a junction of which results are missing is never ``good``."""
    return "doubt" if tally.mark == "good" and tally.runs < site.planned else tally.mark


def worst_first(sites: Sequence[Site], tallies: Mapping[str, Tally]) -> list[Site]:
    """Return the junctions sorted by their marks and numbers of failures, the worst first; ties keep the given order."""

    def wrong(site: Site) -> tuple[int, ...]:
        tally = tallies.get(site.name, Tally())
        marks = [mark for mark, _ in LEGEND]
        outcomes = tally.outcomes
        return marks.index(state(site, tally)), *(
            -outcomes[outcome] for outcome in Outcome.worst_first() if outcome.mark in ("bad", "doubt")
        )

    return sorted(sites, key=wrong)


def town_page(
    title: str,
    blocks: Sequence[Block],
    maps: Sequence[TownMap],
    sites: Sequence[Site],
    tallies: Mapping[str, Tally],
    looks: Mapping[tuple[str, str], str],
    again: str,
) -> str:
    """Return the HTML page of a town."""
    ordered = worst_first(sites, tallies)
    junctions = [_junction_data(site, tallies.get(site.name, Tally()), looks, again) for site in ordered]
    marks = Counter(str(entry["state"]) for entry in junctions)
    counts_text = "; ".join(f"{marks[mark]} {what}" for mark, what in LEGEND if marks[mark])
    content = {
        "maps": [{"name": entry.name, "view": entry.picture.view, "lanes": entry.picture.lanes} for entry in maps],
        "junctions": junctions,
        "legend": LEGEND,
    }
    heading_text = markup(f"{plural(len(junctions), 'junction')}: {counts_text}" if junctions else "no junctions")
    return rendered(title, blocks, content, ("pytest_rvads.satellites.campaigns", "town_page"), marked=heading_text)


def _junction_data(site: Site, tally: Tally, looks: Mapping[tuple[str, str], str], again: str) -> dict[str, object]:
    configurations = sorted({cfg for _, cfg, _ in tally.table})
    rules = list(dict.fromkeys(rule for rule, _, _ in sorted(tally.table)))
    outcomes = {(rule, cfg): Counter[Outcome]() for rule in rules for cfg in configurations}
    for (rule, cfg, outcome), count in tally.table.items():
        outcomes[rule, cfg][outcome] = count
    missing = site.planned - tally.runs
    notes = [f"refused: {site.refused}"] if site.refused else []
    notes += [f"{missing} of {site.planned} runs are missing"] if missing > 0 else []
    notes += [f"{tally.unlisted} more verdicts have causes of their own"] if tally.unlisted else []
    causes = [
        (
            title,
            [
                {
                    "count": cause.count,
                    "rule": ", ".join(cause.rules[:3]) + (f" and {len(cause.rules) - 3} more" if len(cause.rules) > 3 else ""),
                    "text": cause.text,
                    "look": quote(looks.get((cause.run, cause.rule), ""), safe="/#=."),
                    "again": f"{again} {quoted(f'{cause.run}-{cause.rule}')}",
                }
                for cause in group
            ],
        )
        for title, group in tally.grouped()
    ]
    return {
        "name": site.name,
        "id": site.id,
        "map": site.map,
        "spot": site.spot,
        "kind": site.kind,
        "state": state(site, tally),
        "told": tally.text or ("refused" if site.refused else "nothing judged"),
        "notes": [*notes, *site.notes],
        "configurations": configurations,
        "rules": [(rule, [cell(outcomes[rule, cfg]) for cfg in configurations]) for rule in rules],
        "causes": causes,
        "again": f"{again} {quoted(f'{site.name}-*')}" if tally.runs else "",
    }
