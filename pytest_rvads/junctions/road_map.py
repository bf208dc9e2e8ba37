"""A map file as the model sees it: metric graph, junctions and warnings."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pytest_rvads.errors import MapError, suggest
from pytest_rvads.junctions.analysis import JunctionReport, analyse
from pytest_rvads.junctions.formats import read_file
from pytest_rvads.junctions.graph import MetricGraph
from pytest_rvads.junctions.junction import Junction, Movement, cross
from pytest_rvads.junctions.projection import Locator, Track
from pytest_rvads.junctions.ways import walk
from pytest_rvads.maps.control import MapObject
from pytest_rvads.maps.doubts import MapWarning
from pytest_rvads.maps.segment import Segment, join

__all__ = ["WALK_LIMIT", "RoadMap", "describe", "read_map"]

WALK_LIMIT = 600.0
"""How much of an approach or exit road becomes geometry, at most [m]."""


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A map file, read."""

    path: str
    graph: MetricGraph
    """The metric graph of all drivable lanes."""
    junctions: tuple[JunctionReport, ...]
    """One per junction that the file declares, in file order, usable or not."""
    warnings: tuple[MapWarning, ...]

    @cached_property
    def locator(self) -> Locator:
        """Finds the segments a pose can be on."""
        return Locator(map(self.graph.segment, self.graph.segments))

    def track(self, id: str, entrance: int, exit: int) -> Track:
        """Return the segments of the metric graph from the start of an approach through junction `id` down an exit road.

        Args:
            id: of the junction.
            entrance: number of the entrance.
            exit: number of the exit.

        Raises:
            MapError: no such junction or movement.
        """
        report = self.report(id)
        way = next((way for way in report.movements if (way.entrance, way.exit) == (entrance, exit)), None)
        if way is None:
            raise MapError(f"junction {id!r} of map file {self.path} has no movement from entrance {entrance} to exit {exit}")
        before = walk(self.graph, way.path.entrance, upstream=True)[::-1]
        after = walk(self.graph, way.path.exit, upstream=False)
        return Track([self.graph.segment(edge) for edge in (*before, *way.path.edges, *after)])

    def entex(self, id: str) -> dict[str, str]:
        """Return the paper's ``entex`` of junction `id`: per entrance vertex the neighbouring exit vertex.

        Raises:
            MapError: there is no such junction.
        """
        pairs = [(arm.entrances, arm.exits) for arm in self.report(id).arms]
        return {self.graph.ends(one)[1]: self.graph.ends(two)[0] for ones, twos in pairs for one in ones[:1] for two in twos[:1]}

    def report(self, id: str) -> JunctionReport:
        """Return the report of junction `id`.

        Raises:
            MapError: there is no such junction.
        """
        for report in self.junctions:
            if report.id == id:
                return report
        ids = [report.id for report in self.junctions]
        usable = [report.id for report in self.junctions if report.usable]
        listed = ", ".join(usable[:20]) + (", ..." if len(usable) > 20 else "")
        raise MapError(
            f"map file {self.path} has no junction {id!r}; its {len(usable)} usable ones are {listed or 'none'}{suggest(id, ids)}"
        )

    def junction(self, id: str, *, name: str | None = None, drop_uturns: bool = False) -> Junction:
        """Return junction `id` with its geometry.

        Args:
            id: of the ``<junction>``.
            name: name in test ids; ``stem.id`` when None.
            drop_uturns: leave U-turns out instead of refusing the junction.

        Raises:
            MapError: there is no such junction, or it is unusable; the message says why.
        """
        report = self.report(id)
        if drop_uturns and not report.usable:
            report = analyse(self.graph, id, report.objects, [], drop_uturns=True)
        if report.reason is not None:
            raise MapError(f"junction {id!r} of map file {self.path} cannot be used: {report.reason}")
        # Every arm of a usable junction has one entrance and one exit, so their numbers are its own.
        movements: dict[tuple[int, int], Movement] = {}
        for way in reversed(report.movements):  # of several from one arm to another the shortest comes first
            parts = [Segment(e, self.graph.edges[e].points, way.turn, id) for e in way.path.edges]
            path = self._joined(parts)
            movements[way.entrance, way.exit] = Movement(way.entrance, way.exit, way.turn, path.length, path.id, path)
        edges = [self.graph.edges[arm.entrances[0]] for arm in report.arms]
        entrances, exits = cross(
            report.signs,
            phase_groups=report.phase_groups,
            setbacks=report.setbacks,
            approaches=[self._road(edge.id, upstream=True) for edge in edges],
            roads=[self._road(arm.exits[0], upstream=False) for arm in report.arms],
        )
        return Junction(
            name or f"{Path(self.path).stem}.{id}",
            id,
            entrances,
            exits,
            dict(sorted(movements.items())),
            report.right_of,
            report.opposite,
            report.left_hand,
            sum(edge.width for edge in edges) / len(edges),
            self.path,
        )

    def _road(self, start: str, *, upstream: bool) -> Segment:
        """Join the segments of a walk, at most `WALK_LIMIT` of them, into one."""
        total, kept = 0.0, []
        for id in walk(self.graph, start, upstream=upstream):
            kept.append(self.graph.segment(id))
            total += self.graph.edges[id].length
            if total >= WALK_LIMIT:
                break
        segment = self._joined(kept[::-1] if upstream else kept)
        if segment.length <= WALK_LIMIT:
            return segment
        return segment.tail(WALK_LIMIT) if upstream else segment.head(WALK_LIMIT)

    def _joined(self, parts: list[Segment]) -> Segment:
        segment = join(parts)
        if segment is None:
            raise MapError(f"the lanes {', '.join(part.id for part in parts)} of map file {self.path} do not meet")
        return segment


def read_map(path: str | os.PathLike[str]) -> RoadMap:
    """Read a map file, by its suffix.

    Raises:
        MapError: the file cannot be used at all; the message is one sentence.
    """
    graph = MetricGraph(read_file(path))
    network = graph.network
    warnings = [*network.warnings]
    objects: dict[str, list[MapObject]] = {id: [] for id in network.junctions}
    for item in network.objects:
        objects[item.junction].append(item)
    try:
        reports = tuple(analyse(graph, id, items, warnings) for id, items in objects.items())
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None
    return RoadMap(str(path), graph, reports, tuple(warnings))


def describe(road_map: RoadMap) -> dict[str, Any]:
    """Return the JSON object of ``rvads map FILE --json``, as builtins."""
    return {
        "file": road_map.path,
        "junctions": [_describe(report) for report in road_map.junctions],
        "warnings": [warning.record() for warning in road_map.warnings],
    }


def _describe(report: JunctionReport) -> dict[str, Any]:
    entrances = [i for i, arm in enumerate(report.arms) if arm.entrances]
    return {
        "id": report.id,
        "ways": report.ways,
        "control": report.control.value,
        "usable": report.usable,
        "reason": None if report.reason is None else f"{report.reason[0].upper()}{report.reason[1:]}.",
        "entrances": [f"e{i}" for i in entrances],
        "movements": [
            {"entrance": way.entrance, "exit": way.exit, "turn": way.turn.value, "length": round(way.length, 4)}
            for way in report.movements
        ],
        "approach": [round(report.approach[i], 4) for i in entrances],
        "right_of": sorted([list(pair) for pair in report.right_of]),
        "opposite": sorted([list(pair) for pair in report.opposite]),
    }
