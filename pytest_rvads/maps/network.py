"""The lanes of a map as a directed graph: one edge per lane and road, linked where traffic can go on.

Travel is along the reference line iff (lane id < 0) xor left-hand traffic (xor a reversed lane, since 1.8).
Links come from lane links inside a road, from road links between roads, and for junctions from the connection
table united with the links of the connecting roads themselves, because each alone lists only half of the
movements in some writers' files. A link whose lane drives out through the contact point is dropped.
"""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import pairwise

import numpy as np

from pytest_rvads.errors import MapError
from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.edges import Edge, End, Network
from pytest_rvads.maps.lanes import LaneLine, lane_lines, sample_count
from pytest_rvads.maps.records import Document, Road
from pytest_rvads.maps.segment import GAP_LIMIT

__all__ = ["GAP_WARNING", "build"]

GAP_WARNING = 0.1
"""Gap between linked lanes from which on a warning is given [m]."""
MAX_SAMPLES = 1_500_000
"""Most samples of lane centre lines in one map; a town has 70,000."""
MAX_ROAD = 200_000.0
"""Longest road [m]."""

_MERGE = 1e-3


def build(document: Document) -> Network:
    """Build the network of a document.

    Raises:
        MapError: a map too large to sample, or coordinates that are not finite.
    """
    for road in document.roads.values():
        if road.length > MAX_ROAD:
            raise MapError(
                f"road {road.id!r} says it is {road.length / 1000:,.0f} km long, expected at most {MAX_ROAD / 1000:.0f} km"
            )
    samples = sum(map(sample_count, document.roads.values()))
    if samples > MAX_SAMPLES:
        raise MapError(
            f"its lane centre lines would take {samples:,} samples, more than {MAX_SAMPLES:,}; "
            "check the lengths of its roads, or cut the map into pieces"
        )
    return _Builder(document).build()


class _Builder:
    def __init__(self, document: Document) -> None:
        self.document = document
        self.warnings: list[MapWarning] = []
        self.edges: dict[str, Edge] = {}
        self.arriving: dict[End, str] = {}
        self.departing: dict[End, str] = {}
        self.direct: dict[str, list[tuple[str, str]]] = defaultdict(list)
        self.left_hand = self._sides()
        self.listed: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connection table has."""
        self.linked: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into it that its connecting roads have."""

    def build(self) -> Network:
        for road in self.document.roads.values():
            self._road(road)
        for road in self.document.roads.values():
            self._road_links(road)
        for junction in self.document.junctions.values():
            self._table(junction.id)
        self._complete()
        self._gaps()
        inside: dict[str, list[str]] = defaultdict(list)
        for edge in self.edges.values():
            if edge.junction is not None:
                inside[edge.junction].append(edge.id)
        table = {junction: tuple(ids) for junction, ids in inside.items()}
        return Network(self.edges, self.arriving, self.departing, self.left_hand, dict(self.direct), table, tuple(self.warnings))

    def _sides(self) -> dict[str, bool]:
        roads = self.document.roads.values()
        stated = {road.rule for road in roads if road.rule}
        silent = [road.id for road in roads if not road.rule]
        if stated == {"LHT"} and silent:
            self.warnings.append(
                MapWarning(
                    Doubt.SIDE,
                    f"{len(silent)} roads, {silent[0]!r} first, do not say on which side traffic keeps; left as on the others",
                )
            )
        assumed = "LHT" if stated == {"LHT"} else "RHT"
        return {road.id: (road.rule or assumed) == "LHT" for road in roads}

    def _road(self, road: Road) -> None:
        """Make the edges of one road: chains of lanes that go on one to one from section to section."""
        lines = lane_lines(road, self.warnings)
        links = self._section_links(road, lines)
        follow: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
        lead: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
        for one, two in links:
            follow[one].append(two)
            lead[two].append(one)
        owner: dict[tuple[int, int], str] = {}
        nodes = [(i, lane) for i, table in enumerate(lines) for lane in table]
        for node in nodes:
            before = lead[node]
            if len(before) == 1 and len(follow[before[0]]) == 1:
                continue
            chain = [node]
            while len(follow[chain[-1]]) == 1 and len(lead[follow[chain[-1]][0]]) == 1 and follow[chain[-1]][0] != node:
                chain.append(follow[chain[-1]][0])
            edge = self._edge(road, chain, lines)
            if edge is not None:
                self.edges[edge.id] = edge
                owner.update(dict.fromkeys(chain, edge.id))
        for one, two in links:
            if one in owner and two in owner and owner[one] != owner[two]:
                self._join(owner[one], owner[two])
        last = len(lines) - 1
        for (i, lane), id in owner.items():
            forward = self.edges[id].forward
            if i == 0:
                (self.departing if forward else self.arriving)[road.id, "start", lane] = id
            if i == last:
                (self.arriving if forward else self.departing)[road.id, "end", lane] = id

    def _section_links(self, road: Road, lines: list[dict[int, LaneLine]]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """Return the links between lanes of consecutive sections, in the direction of travel, without repetition."""
        found: dict[tuple[tuple[int, int], tuple[int, int]], None] = {}
        for i in range(len(lines) - 1):
            one, two = road.sections[i].lanes, road.sections[i + 1].lanes
            pairs = [(a, b) for a in lines[i] for b in one[a].successors] + [
                (a, b) for b in lines[i + 1] for a in two[b].predecessors
            ]
            for a, b in pairs:
                if a in lines[i] and b in lines[i + 1] and self._forward(road, i, a) == self._forward(road, i + 1, b):
                    found[((i, a), (i + 1, b)) if self._forward(road, i, a) else ((i + 1, b), (i, a))] = None
        return list(found)

    def _forward(self, road: Road, section: int, lane: int) -> bool:
        return ((lane < 0) != self.left_hand[road.id]) != road.sections[section].lanes[lane].reversed

    def _edge(self, road: Road, chain: list[tuple[int, int]], lines: list[dict[int, LaneLine]]) -> Edge | None:
        parts = [lines[i][lane] for i, lane in chain]
        forward = self._forward(road, *chain[0])
        step = 1 if forward else -1
        points = np.vstack([part.points[::step] for part in parts])
        s = np.concatenate([part.s[::step] for part in parts])
        steps = np.hypot(*np.diff(points, axis=0).T)
        jump = float(steps.max())
        keep = np.concatenate(([True], steps > _MERGE))
        points, s = points[keep], s[keep]
        steps = np.hypot(*np.diff(points, axis=0).T)
        length = float(steps.sum())
        name = f"{road.id}.{chain[0][0]}.{chain[0][1]}"
        if len(points) < 2 or length < _MERGE or not steps.all():
            self.warnings.append(MapWarning(Doubt.LINK, f"lane {name} has no length and was left out", road.id))
            return None
        if len(parts) > 1 and jump > GAP_WARNING and (where := self._jump(parts, step)) > GAP_WARNING:
            self.warnings.append(MapWarning(Doubt.GAP, f"lane {name} jumps by {where:.2f} m between two lane sections", road.id))
        turning = step * sum(part.turning for part in parts)
        width = parts[len(parts) // 2].width
        return Edge(name, road.id, road.junction, forward, tuple(chain), points, s, turning, width, length)

    @staticmethod
    def _jump(parts: list[LaneLine], step: int) -> float:
        ordered = [part.points[::step] for part in parts]
        return max(math.dist(one[-1], two[0]) for one, two in pairwise(ordered))

    def _road_links(self, road: Road) -> None:
        """Link the lanes of `road` to those of the roads it names as neighbours."""
        if not road.sections:
            return
        for contact, link, section in (("start", road.predecessor, 0), ("end", road.successor, -1)):
            if link is None or link.junction:
                continue
            other = self.document.roads.get(link.element)
            if other is None:
                self.warnings.append(
                    MapWarning(Doubt.LINK, f"road {road.id!r} is linked to road {link.element!r}, which does not exist", road.id)
                )
                continue
            if link.contact not in ("start", "end"):
                self.warnings.append(
                    MapWarning(Doubt.LINK, f"the link from road {road.id!r} to road {other.id!r} has no contact point", road.id)
                )
                continue
            for lane in road.sections[section].lanes.values():
                for target in lane.predecessors if contact == "start" else lane.successors:
                    pair = self._link((road.id, contact, lane.id), (other.id, link.contact, target))
                    if pair and road.junction is not None and self.edges[pair[1]].road == road.id:
                        self.linked[road.junction].add(pair)

    def _table(self, id: str) -> None:
        """Add the links of the connection table of junction `id`."""
        junction = self.document.junctions[id]
        for row in junction.connections:
            incoming, connecting = self.document.roads.get(row.incoming), self.document.roads.get(row.connecting)
            if incoming is None or connecting is None or row.contact not in ("start", "end"):
                name = row.incoming if incoming is None else row.connecting
                what = f"has a connection from road {row.incoming!r} to road {row.connecting!r} without contact point"
                if incoming is None or connecting is None:
                    what = f"names road {name!r}, which does not exist"
                self.warnings.append(MapWarning(Doubt.LINK, f"junction {id!r} {what}", None, id))
                continue
            end = self._touching(incoming, id, connecting.id, row.contact)
            if end is None:
                self.warnings.append(
                    MapWarning(
                        Doubt.TABLE,
                        f"junction {id!r} names road {incoming.id!r} as incoming, which does not touch it",
                        incoming.id,
                        id,
                    )
                )
                continue
            for link in row.links:
                one, two = (incoming.id, end, link.source), (connecting.id, row.contact, link.target)
                if junction.type == "direct":
                    self._direct(id, one, two)
                elif pair := self._link(one, two):
                    if self.edges[pair[1]].road == connecting.id:
                        self.listed[id].add(pair)
                elif one[:2] != two[:2]:
                    self._check_table(id, one, two)
        only_listed, only_linked = len(self.listed[id] - self.linked[id]), len(self.linked[id] - self.listed[id])
        if only_listed or only_linked:
            message = (
                f"{only_listed} links into junction {id!r} are only in its table and {only_linked} only in its roads; "
                "all were taken"
            )
            self.warnings.append(MapWarning(Doubt.TABLE, message, None, id))

    def _check_table(self, id: str, one: End, two: End) -> None:
        roads = self.document.roads
        for road, end, lane in (one, two):
            sections = roads[road].sections
            if not sections or lane not in sections[0 if end == "start" else -1].lanes:
                self.warnings.append(
                    MapWarning(
                        Doubt.TABLE,
                        f"a lane link of junction {id!r} names lane {lane} at the {end} of road {road!r}, which does not exist",
                        road,
                        id,
                    )
                )
                return

    def _touching(self, incoming: Road, junction: str, connecting: str, contact: str) -> str | None:
        """Return the end of `incoming` where it meets `connecting`: by its road links, else by the connecting road's."""
        ends = [
            end
            for end, link in (("start", incoming.predecessor), ("end", incoming.successor))
            if link is not None
            and (link.element == junction if link.junction else (link.element, link.contact) == (connecting, contact))
        ]
        if len(ends) == 1:
            return ends[0]
        road = self.document.roads[connecting]
        back = road.predecessor if contact == "start" else road.successor
        if back is not None and not back.junction and back.element == incoming.id and back.contact in ("start", "end"):
            return back.contact
        return ends[0] if ends else None

    def _link(self, one: End, two: End) -> tuple[str, str] | None:
        """Link two lane ends in the direction in which traffic passes; return the edges, None where none passes."""
        for source, target in ((one, two), (two, one)):
            if source in self.arriving and target in self.departing:
                self._join(self.arriving[source], self.departing[target])
                return self.arriving[source], self.departing[target]
        return None

    def _direct(self, id: str, one: End, two: End) -> None:
        for source, target in ((one, two), (two, one)):
            if source in self.arriving and target in self.departing:
                self.direct[id].append((self.arriving[source], self.departing[target]))

    def _join(self, source: str, target: str) -> None:
        after = self.edges[source].after
        if target not in after:
            after.append(target)
            self.edges[target].before.append(source)

    def _complete(self) -> None:
        """Link lanes of connecting roads that have a link at one end only, where just one lane meets them at the other."""
        reach: dict[tuple[str, str], list[str]] = defaultdict(list)
        leave: dict[tuple[str, str], list[str]] = defaultdict(list)
        for table, ends in ((self.arriving, reach), (self.departing, leave)):
            for (owner, end, _), id in table.items():
                ends[owner, end].append(id)
        for road in self.document.roads.values():
            if road.junction is None:
                continue
            for contact, link in (("start", road.predecessor), ("end", road.successor)):
                if link is None or link.junction:
                    continue
                for id in reach[road.id, contact]:
                    if self.edges[id].before and not self.edges[id].after:
                        self._adopt(road, [(id, other) for other in leave[link.element, link.contact]])
                for id in leave[road.id, contact]:
                    if self.edges[id].after and not self.edges[id].before:
                        self._adopt(road, [(other, id) for other in reach[link.element, link.contact]])

    def _adopt(self, road: Road, pairs: list[tuple[str, str]]) -> None:
        near = []
        for one, two in ((self.edges[a], self.edges[b]) for a, b in pairs):
            turn = math.remainder(two.start_heading - one.end_heading, math.tau)
            if math.dist(one.points[-1], two.points[0]) <= GAP_WARNING and abs(turn) < 0.5:
                near.append((one.id, two.id))
        if len(near) == 1:
            self._join(*near[0])
            message = f"lanes {near[0][0]} and {near[0][1]} meet without a lane link; they were linked"
            self.warnings.append(MapWarning(Doubt.LINK, message, road.id, road.junction))

    def _gaps(self) -> None:
        for edge in self.edges.values():
            for id in list(edge.after):
                other = self.edges[id]
                gap = math.dist(edge.points[-1], other.points[0])
                if gap <= GAP_WARNING:
                    continue
                junction = edge.junction or other.junction
                self.warnings.append(
                    MapWarning(Doubt.GAP, f"lanes {edge.id} and {other.id} are linked but {gap:.2f} m apart", edge.road, junction)
                )
                if gap > GAP_LIMIT and junction is None:
                    edge.after.remove(id)
                    other.before.remove(edge.id)
