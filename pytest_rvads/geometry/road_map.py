"""Map files: the reader of each format, and the content of a map file as metric graph, junctions and warnings.

Junctions whose ways lead into each other, without a road between the junctions, are a cluster and are read as one junction.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np

from pytest_rvads.geometry.analysis import JunctionReport, analyse, cut, joints_of, lifted
from pytest_rvads.geometry.arms import FEWEST, MOST
from pytest_rvads.geometry.conflicts import Stretch
from pytest_rvads.geometry.control import MapObject, ObjectKind, sign_of_arm
from pytest_rvads.geometry.crosswalk_arms import lay
from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.graph import MetricGraph, walk
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.network import DeclaredJunction, Doubt, Edge, MapWarning, Network, gathered
from pytest_rvads.geometry.opendrive.builder import read_network
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.segment import Segment, join
from pytest_rvads.geometry.turns import turn_word
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.support.errors import MapError, suggest
from pytest_rvads.support.installed import by_suffix
from pytest_rvads.support.wording import plural

WALK_LIMIT = 600.0
"""Longest part of an approach or exit road that becomes geometry [m]."""


@dataclass(frozen=True, eq=False)
class RoadMap:
    """The content of a map file as metric graph, junctions and warnings."""

    path: str
    graph: MetricGraph
    junctions: tuple[JunctionReport, ...]
    """Reports of the junctions that the file declares, usable or not, in file order."""
    warnings: tuple[MapWarning, ...]
    joints: frozenset[str] = frozenset()
    """Ids of junctions that only join two roads; approaches and exit roads continue through them."""
    crossings: Mapping[str, tuple[Crosswalk, ...]] = field(default_factory=dict)
    """Per id of a junction with crosswalks, its crosswalks, arm by arm."""

    def walk(self, start: str, *, upstream: bool) -> list[str]:
        """Return the edges from edge `start` to the next junction or the end of the road, see `pytest_rvads.geometry.graph`."""
        return walk(self.graph, start, upstream=upstream, joints=self.joints)

    @cached_property
    def bends(self) -> tuple[MapWarning, ...]:
        """Warnings about movements on which no car keeps its lane, one per junction; computed at the first use."""
        warnings = []
        for report in self.junctions:
            tight = self._cut(report, report.id, roads=True).tight if report.usable else {}
            if tight:
                entrance, exit = min(tight, key=tight.__getitem__)
                more = f"; nor on {plural(len(tight) - 1, 'more movement')}" if len(tight) > 1 else ""
                message = (
                    f"no path of its rear axle keeps a usual car in its lane on the movement from entrance {entrance} to exit "
                    f"{exit} of junction {report.id!r}, which bends with a radius of {tight[entrance, exit]:.1f} m{more}"
                )
                warnings.append(MapWarning(Doubt.BEND, message, None, report.id))
        return tuple(warnings)

    def relations(self, report: JunctionReport) -> Junction | None:
        """Return a junction for relations between its ways, with roads only if it has crosswalks; None if it is unusable."""
        return self._cut(report, report.id, roads=report.id in self.crossings) if report.usable else None

    def entex(self, id: str) -> dict[str, str]:
        """Return the paper's ``entex`` of junction `id`: per entrance vertex the neighbouring exit vertex."""
        pairs = [(arm.entrances, arm.exits) for arm in self.report(id).arms]
        return {
            self.graph.ends(entrance)[1]: self.graph.ends(exits[0])[0]
            for entrances, exits in pairs
            if exits
            for entrance in entrances
        }

    def report(self, id: str) -> JunctionReport:
        """Return the report of junction `id`."""
        for report in self.junctions:
            if report.id == id:
                return report
        ids = [report.id for report in self.junctions]
        usable = [report.id for report in self.junctions if report.usable]
        listed = ", ".join(usable[:20]) + (", ..." if len(usable) > 20 else "")
        raise MapError(
            f"map file {self.path} has no junction {id!r}; its {len(usable)} usable ones are {listed or 'none'}{suggest(id, ids)}"
        )

    def junction(self, id: str, *, name: str | None = None, uturns: bool = False) -> Junction:
        """Return junction `id` with its geometry."""
        report = self.report(id)
        if uturns:
            report = analyse(self.graph, cut(self.graph, id), report.objects, joints=self.joints, uturns=True)
        if report.reason is not None:
            raise MapError(f"junction {id!r} of map file {self.path} cannot be used: {report.reason}")
        return self._cut(report, name or f"{Path(self.path).stem}.{id}", roads=True)

    def _cut(self, report: JunctionReport, name: str, *, roads: bool) -> Junction:
        """Return a junction; without `roads` its approaches and exit roads, which take longest to join, have no geometry."""
        movements: dict[tuple[int, int], Movement] = {}
        for way in reversed(report.movements):  # of several ways between two lanes, the shortest comes first and is kept
            edges = [self.graph.edges[e] for e in way.path.edges]
            parts = [Segment(edge.id, edge.points, way.turn, report.id, edge.limits) for edge in edges]
            path = self._joined(parts)
            movements[way.entrance, way.exit] = Movement(way.entrance, way.exit, way.turn, path.length, path.id, path)
        phases = {entrance: number for number, group in enumerate(report.phase_groups) for entrance in group}
        edges = [self.graph.edges[end.edge] for end in report.entrances]
        lights = {item.edge: item.point for item in reversed(report.objects) if item.kind is ObjectKind.LIGHT}
        forbidding = {item.edge for item in report.objects if item.kind is ObjectKind.NO_TURN_ON_RED}
        lanes = zip(report.entrances, report.signs, report.setbacks, report.sign_setbacks, report.beyond, strict=True)
        approaches = {end.edge: self._road(end.edge, upstream=True) for end in report.entrances if roads}
        exit_roads = {end.edge: self._road(end.edge, upstream=False) for end in report.exits if roads}
        return Junction(
            name,
            report.id,
            tuple(
                Entrance(
                    *(end.arm, end.lane, sign, phases.get(k), back, approaches.get(end.edge), posted),
                    *(lights.get(end.edge), end.edge in forbidding, beyond),
                )
                for k, (end, sign, back, posted, beyond) in enumerate(lanes)
            ),
            tuple(Exit(end.arm, end.lane, exit_roads.get(end.edge)) for end in report.exits),
            dict(sorted(movements.items())),
            lifted(report.right_of, report.entrances),
            lifted(report.opposite, report.entrances),
            report.left_hand,
            math.fsum(edge.width for edge in edges) / len(edges),
            self.path,
            report.stated,
            report.joining,
            crossings=self.crossings.get(report.id, ()),
        )

    def _road(self, start: str, *, upstream: bool) -> Segment:
        """Join the segments of a walk into one segment, cut to `WALK_LIMIT`."""
        total, parts = 0.0, []
        for id in self.walk(start, upstream=upstream):
            parts.append(self.graph.segment(id))
            total += self.graph.edges[id].length
            if total >= WALK_LIMIT:
                break
        segment = self._joined(parts[::-1] if upstream else parts)
        if segment.length <= WALK_LIMIT:
            return segment
        return segment.tail(WALK_LIMIT) if upstream else segment.head(WALK_LIMIT)

    def _joined(self, parts: list[Segment]) -> Segment:
        segment = join(parts)
        if segment is None:
            raise MapError(f"the lanes {', '.join(part.id for part in parts)} of map file {self.path} do not meet")
        return segment


def read_map(path: str | os.PathLike[str], *, uturns: bool = False, clusters: bool = True) -> RoadMap:
    """Read a map file, by its suffix."""
    graph = MetricGraph(read_file(path))
    try:
        graph = _clustered(graph) if clusters else graph
        network = graph.network
        objects: dict[str, list[MapObject]] = {id: [] for id in network.junctions}
        for item in network.objects:
            objects[item.junction].append(item)
        cuts = {id: cut(graph, id) for id in objects}
        joints = joints_of(cuts.values())
        reports = tuple(analyse(graph, cuts[id], items, joints=joints, uturns=uturns) for id, items in objects.items())
        crossings, at_no_junction = lay(graph, reports, joints)
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None
    warnings = (*network.warnings, *(warning for report in reports for warning in report.warnings), *at_no_junction)
    return RoadMap(str(path), graph, reports, warnings, joints, crossings)


Reader = Callable[[str | os.PathLike[str]], Network]


READERS: dict[str, Reader] = {
    ".xodr": read_network,
    **by_suffix("maps"),
}
"""Per suffix, in lower case, a reader, which raises MapError for a file that it can't read.

Formats of other packages are entry points ``rvads.maps``, named by the suffix.
"""


def read_file(path: str | os.PathLike[str]) -> Network:
    """Return the network of a map file; a file with an unknown suffix is read as OpenDRIVE."""
    return READERS.get(Path(str(path)).suffix.lower(), read_network)(path)


def _clustered(graph: MetricGraph) -> MetricGraph:
    """Return a metric graph in which each cluster of junctions with `FEWEST` to `MOST` arms in all is one junction."""
    network = graph.network
    beside = nx.Graph()
    for edge, next_edge in network.links.edges:
        junction, next_junction = network.edges[edge].junction, network.edges[next_edge].junction
        if junction is not None and next_junction is not None and junction != next_junction:
            beside.add_edge(junction, next_junction)
    order = {id: k for k, id in enumerate(network.junctions)}
    clusters = [sorted(group, key=order.__getitem__) for group in nx.connected_components(beside)]
    # Per junction of a cluster, the name of the cluster: the ids of its junctions in file order.
    names = {id: "+".join(group) for group in clusters for id in group}
    if not names:
        return graph
    merged = MetricGraph(_with_clusters(network, names))
    fitting = {name for name in set(names.values()) if FEWEST <= len(cut(merged, name).arms) <= MOST}
    if fitting == set(names.values()):
        return merged
    return MetricGraph(_with_clusters(network, {id: name for id, name in names.items() if name in fitting}))


def _with_clusters(network: Network, names: Mapping[str, str]) -> Network:
    """Return a network in which the junctions of each cluster are one junction, with the name of the cluster."""
    junctions: dict[str, list[DeclaredJunction]] = {}
    for id, junction in network.junctions.items():
        junctions.setdefault(names.get(id, id), []).append(junction)
    warnings = [replace(warning, junction=names.get(warning.junction or "", warning.junction)) for warning in network.warnings]
    for name in dict.fromkeys(names.values()):
        ids = " and ".join(repr(id) for id, cluster in names.items() if cluster == name)
        message = f"the ways of junctions {ids} lead into each other without a road between; they were read as one, {name!r}"
        warnings.append(MapWarning(Doubt.TABLE, message, None, name))
    return replace(
        network,
        edges={id: replace(edge, junction=names.get(edge.junction or "", edge.junction)) for id, edge in network.edges.items()},
        junctions={
            name: replace(
                parts[0],
                lost=next((part.lost for part in parts if part.lost is not None), None),
                priorities=tuple(pair for part in parts for pair in part.priorities),
            )
            for name, parts in junctions.items()
        },
        objects=tuple(replace(item, junction=names.get(item.junction, item.junction)) for item in network.objects),
        warnings=tuple(warnings),
    )


def describe(road_map: RoadMap) -> dict[str, Any]:
    """Return the JSON object of ``rvads map FILE --json`` as builtins, without warnings about the bodies of standing vehicles."""
    return {
        "file": road_map.path,
        "junctions": [
            _describe(report, road_map.relations(report), road_map.graph.edges, road_map.crossings.get(report.id, ()))
            for report in road_map.junctions
        ],
        "warnings": gathered((*road_map.warnings, *road_map.bends)),
    }


def _describe(
    report: JunctionReport, junction: Junction | None, edges: Mapping[str, Edge], crosswalks: Sequence[Crosswalk]
) -> dict[str, Any]:
    """Return a report as builtins; conflicts and yields are given only for a usable junction."""
    entering = [i for i, arm in enumerate(report.arms) if arm.entrances]
    # Vehicles drive the shortest of several ways between two lanes, which comes first among the movements.
    numbers = {(way.entrance, way.exit): k for k, way in reversed([*enumerate(report.movements)])}
    by_arm = {i: [k for k, end in enumerate(report.entrances) if end.arm == i] for i in range(report.ways)}
    conflicts, yields = (junction.conflicts or (), junction.yields or {}) if junction else ((), {})
    undecided = {pair for pair, reason in yields.items() if reason is Reason.UNDECIDED}
    # Per arm, the speed limits of its lanes at the junction [m/s].
    speed_limits = []
    for arm in report.arms:
        stated = [*(edges[lane].limits[-1:] for lane in arm.entrances), *(edges[lane].limits[:1] for lane in arm.exits)]
        speed_limits.append(sorted({round(limit, 4) for limits in stated for _, limit in limits if limit is not None}))
    return {
        "id": report.id,
        "ways": report.ways,
        "control": report.control.value,
        "usable": report.usable,
        "kind": junction.kind if junction else None,
        "usable_from": round(report.usable_from, 4) if report.usable else None,
        "reason": None if report.reason is None else f"{report.reason[0].upper()}{report.reason[1:]}.",
        "entrances": [
            {
                "entrance": k,
                "arm": end.arm,
                "lane": end.lane,
                "sign": report.signs[k].value,
                "setback": round(report.setbacks[k], 4),
                "no_turn_on_red": any((item.edge, item.kind) == (end.edge, ObjectKind.NO_TURN_ON_RED) for item in report.objects),
            }
            for k, end in enumerate(report.entrances)
        ],
        "arms": [
            {
                "entrances": len(arm.entrances),
                "exits": len(arm.exits),
                "control": sign_of_arm([report.signs[k] for k in by_arm[i]]).value,
                "speed_limits": speed_limits[i],
            }
            for i, arm in enumerate(report.arms)
        ],
        "movements": [
            {
                "entrance": way.entrance,
                "arm": report.entrances[way.entrance].arm,
                "lane": report.entrances[way.entrance].lane,
                "exit": way.exit,
                "exit_arm": report.exits[way.exit].arm,
                "exit_lane": report.exits[way.exit].lane,
                "turn": turn_word(report, way),
                "length": round(way.length, 4),
            }
            for way in report.movements
        ],
        "conflicts": sorted(
            [numbers[key], numbers[other_key]] for key, other_key in conflicts if numbers[key] < numbers[other_key]
        ),
        "yields": sorted([numbers[key], numbers[other_key]] for key, other_key in yields.keys() - undecided),
        "undecided": sorted(
            [numbers[key], numbers[other_key]] for key, other_key in undecided if numbers[key] < numbers[other_key]
        ),
        "approach": [round(min(report.approach[k] for k in by_arm[i]), 4) for i in entering],
        "right_of": sorted([list(pair) for pair in report.right_of]),
        "opposite": sorted([list(pair) for pair in report.opposite]),
        "crossings": [_describe_crosswalk(report, junction, *numbered) for numbered in enumerate(crosswalks)],
    }


def _describe_crosswalk(report: JunctionReport, junction: Junction | None, number: int, crosswalk: Crosswalk) -> dict[str, Any]:
    """Return a crosswalk as builtins; the stretches that it covers are given only for a usable junction.

    Stations on an exit are measured from the exit vertex [m], other stations from the entrance vertex.
    """
    covers = {key: stretch for (k, key), stretch in junction.covers.items() if k == number} if junction else {}
    numbers = {(way.entrance, way.exit): k for k, way in reversed([*enumerate(report.movements)])}
    movements, entrances, exits = {}, dict[int, Stretch](), dict[int, Stretch]()
    for key, (start, end) in covers.items():
        movements[numbers[key]] = Stretch(start, end)
        length = junction.movements[key].length if junction else 0.0
        for lanes, lane, ends, vertex in ((entrances, key[0], report.entrances, 0.0), (exits, key[1], report.exits, length)):
            if ends[lane].arm == crosswalk.arm:
                known = lanes.get(lane, Stretch(math.inf, -math.inf))
                lanes[lane] = Stretch(min(known.start, start - vertex), max(known.end, end - vertex))
    behind = [stretch.start + report.setbacks[lane] for lane, stretch in entrances.items()]
    group = () if crosswalk.phase is None else report.phase_groups[crosswalk.phase]
    return {
        "id": crosswalk.id,
        "arm": crosswalk.arm,
        "corners": np.round(crosswalk.area, 4).tolist(),
        "path": np.round(crosswalk.path.points, 4).tolist(),
        "length": round(crosswalk.path.length, 4),
        "middle": round(crosswalk.middle, 4),
        "island": round(crosswalk.island, 4),
        "phase": crosswalk.phase,
        "green": sorted({report.entrances[k].arm for k in group}),
        "behind_line": round(min(behind), 4) if behind else None,
        "movements": [_on(k, "movement", stretch) for k, stretch in sorted(movements.items())],
        "entrances": [
            _on(k, "entrance", stretch) | {"lane": report.entrances[k].lane} for k, stretch in sorted(entrances.items())
        ],
        "exits": [_on(k, "exit", stretch) | {"lane": report.exits[k].lane} for k, stretch in sorted(exits.items())],
    }


def _on(number: int, name: str, stretch: Stretch) -> dict[str, float]:
    return {name: number, "from": round(stretch.start, 4), "to": round(stretch.end, 4)}
