"""Junction areas: which lanelets form a junction, found by geometry, because Lanelet2 has no junctions.

Lanelets in conflict with each other form a cluster. Clusters that adjoin are joined, or one of the two is part of an approach.
The limits of this module were chosen on 58 public maps.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from itertools import combinations, product

import networkx as nx
import numpy as np

from pytest_rvads.geometry.network import Doubt, MapWarning
from pytest_rvads.satellites.lanelet2.lanelets import Lanelet, Pair, cell_of, conflicts_of, free_ends
from pytest_rvads.support.wording import first

_JOINT = 25.0
"""Length up to which a lanelet between two clusters with crossings joins the clusters [m]."""
_SMALL = 12.0
"""Mean length of lanelets up to which a cluster without crossings joins a cluster with crossings [m]."""
_BESIDE, _MOST_CHAINED = 5, 4
"""Distance between lanelets of a junction and the ends of a turn lane of its own [m]; most lanelets of such a turn lane."""
_FREE, _MARGIN = 30.0, 15.0
"""Length from which a lanelet that is in nobody's way is cut off a junction [m], and the part of this length that is kept [m]."""


@dataclass(slots=True, eq=False)
class Ground:
    """The lanelets of a map with their links."""

    lanes: dict[str, Lanelet]
    links: nx.DiGraph

    stated: Mapping[str, Collection[str]] = field(default_factory=dict)
    """Per junction that the file states, the sources of lanelets in the junction."""
    outside: Collection[str] = ()
    """Sources that the file states to be outside of junctions."""
    region: str | None = None
    """The side on which traffic keeps in the region that the file states, ``left`` or ``right``; None without a region."""


def listed(ids: Iterable[str]) -> str:
    """Return the first five of some ids for a message, with the number of further ids."""
    return first(list(dict.fromkeys(ids)), 5)


def areas_of(ground: Ground, controlled: Collection[str]) -> tuple[dict[str, list[str]], list[MapWarning]]:
    """Find the junctions of a map, and cut off, in `ground`, long parts of lanelets that lie before or behind their conflicts.

    `controlled` are the sources with a light or sign: a lanelet of these that crosses nobody leads to a junction.
    """
    finder = _Finder(ground, controlled)
    finder.join_small()
    finder.take_between()
    finder.find_cuts()
    finder.leave_out_few_ends()
    finder.settle_neighbours()
    named = finder.named()
    for id in (id for members in named.values() for id in members):
        before, behind = finder.cuts[id]
        if before:
            cut_off(ground, id, "before", before, back=False)
        if behind:
            cut_off(ground, id, "after", ground.lanes[id].length - behind, back=True)
    return named, [MapWarning(Doubt.TABLE, message) for message in finder.doubts]


class _Finder:
    def __init__(self, ground: Ground, controlled: Collection[str]) -> None:
        self.ground, self.lanes, self.links = ground, ground.lanes, ground.links
        self.doubts: list[str] = []
        self.cuts: dict[str, tuple[float, float]] = dict.fromkeys(self.lanes, (0.0, 0.0))
        """Per lanelet, the lengths that are cut off before and behind its conflicts; 0 where nothing is cut off [m]."""
        source = {id: lane.source for id, lane in self.lanes.items()}
        crossing, touching = conflicts_of(self.lanes, self.links)
        # A conflict with a lanelet that the file states to be outside of junctions forms no junction.
        outside = set(ground.outside)
        self.pairs = [pair for pair in crossing + touching if outside.isdisjoint(source[id] for id in pair)]
        self.crossing = {source[id] for pair in crossing for id in pair}
        self.approaches = set(controlled) - self.crossing
        classes = nx.utils.UnionFind()
        for sources in (*([source[a], source[b]] for a, b in self.pairs), *ground.stated.values()):
            classes.union(*sources)
        self.cluster = {id: min(sources, key=_order) for sources in classes.to_sets() for id in sources}
        """Per source in a cluster, the name of the cluster, which is a source."""
        self.joined: list[str] = []
        """Names of the clusters that were joined to others."""

    def groups(self) -> dict[str, list[str]]:
        """Return the ids of the lanelets of every cluster."""
        groups: dict[str, list[str]] = {}
        for id, lane in self.lanes.items():
            if lane.source in self.cluster:
                groups.setdefault(self.cluster[lane.source], []).append(id)
        return groups

    def adjoining(self) -> list[tuple[str, str, str, str]]:
        """Return the links from one cluster into another: the two lanelets and the names of the two clusters."""
        names = {id: self.cluster.get(lane.source) for id, lane in self.lanes.items()}
        pairs = ((a, b, names[a], names[b]) for a, b in self.links.edges if not self.cuts[a][1] and not self.cuts[b][0])
        return [(a, b, one, two) for a, b, one, two in pairs if one is not None and two is not None and one != two]

    def crosses(self, ids: Iterable[str]) -> bool:
        return not self.crossing.isdisjoint(self.lanes[id].source for id in ids)

    def mean(self, ids: Iterable[str]) -> float:
        return float(np.mean([self.lanes[id].length for id in ids]))

    def join_small(self) -> None:
        """Join adjoining clusters of crossing lanelets, and small clusters with clusters of crossing lanelets."""
        groups, links = self.groups(), self.adjoining()
        crossing = {name for name, ids in groups.items() if self.crosses(ids)}
        small = {name for name, ids in groups.items() if self.mean(ids) < _SMALL}
        around: defaultdict[str, list[int]] = defaultdict(list)
        for number, (_, _, *names) in enumerate(links):
            for name in names:
                around[name].append(number)
        parent = {name: name for name in groups}
        waiting = list(range(len(links)))  # a heap: the first link that joins two clusters is next
        while waiting:
            a, b, *ends = links[heappop(waiting)]
            clusters = {_root(parent, name) for name in ends}
            if len(clusters) < 2:
                continue
            short = min(self.lanes[a].length, self.lanes[b].length) < _JOINT and crossing >= clusters
            near = not crossing.isdisjoint(clusters) and not small.isdisjoint(clusters - crossing)
            if (short or near) and self.approaches.isdisjoint(self.lanes[id].source for id in (a, b)):
                name, other = sorted(clusters, key=_order)
                parent[other] = name
                self.joined.append(other)
                for number in (number for new in clusters - crossing for number in around[new]):
                    heappush(waiting, number)
                crossing |= clusters
        self.cluster = {source: _root(parent, name) for source, name in self.cluster.items()}

    def take_between(self) -> None:
        """Add turn lanes of their own: lanelets, or chains of them, that begin and end beside the lanelets of one cluster.

        A lanelet with a tag that says that it turns needs lanelets of any kind beside it, others need lanelets that cross.
        """
        cells: defaultdict[tuple[int, int, bool], set[str]] = defaultdict(set)
        for name, ids in self.groups().items():
            for id in ids:
                for x, y in map(cell_of, self.lanes[id].corners):
                    cells[x, y, True].add(name)
                    if self.crosses([id]):
                        cells[x, y, False].add(name)

        def beside(id: str, at: int, turns: bool, reach: int) -> set[str]:
            around, places = range(-reach, reach + 1), map(cell_of, self.lanes[id].corners[2 * at : 2 * at + 2])
            return set[str]().union(*(cells.get((x + i, y + k, turns), ()) for x, y in places for i in around for k in around))

        def clusters(ids: Iterable[str]) -> set[str]:
            return {self.cluster.get(self.lanes[id].source, "") for id in ids}

        for reach, (id, lane) in product((1, _BESIDE), self.lanes.items()):
            chain, turns = [id], lane.turn in ("left", "right")
            if lane.source in self.cluster or not self.links.pred[id] or (reach > 1 and not turns):
                continue
            names = beside(id, 0, turns, reach) - clusters(self.links.pred[id])
            while names and (after := list(self.links.succ[chain[-1]])):
                found = names & beside(chain[-1], 1, turns, reach) - clusters(after)
                if found:
                    self.cluster |= dict.fromkeys((self.lanes[part].source for part in chain), min(found, key=_order))
                if found or len(after) > 1 or clusters(after) != {""} or len(chain) == _MOST_CHAINED:
                    break
                chain += after

    def find_cuts(self) -> None:
        """Find how much is cut off the lanelets; lanelets side by side are cut at the same distance."""
        pairs: defaultdict[str, list[Pair]] = defaultdict(list)
        for pair in self.pairs:
            pairs[self.cluster[self.lanes[pair[0]].source]].append(pair)
        for name, ids in self.groups().items():
            free = free_ends(self.lanes, pairs[name], set(ids))
            for group in _side_by_side([self.lanes[id] for id in free]):
                # Per end of the road, the shortest free part.
                ends = [min(free[id][at if along else 1 - at] for id, along in group) for at in (0, 1)]
                cuts = [end - _MARGIN if end > _FREE else 0.0 for end in ends]
                for id, along in group:
                    self.cuts[id] = (cuts[0], cuts[1]) if along else (cuts[1], cuts[0])

    def ends(self, ids: Sequence[str]) -> tuple[int, int]:
        """Return how many lanelets lead into a cluster and out of it."""
        inside = set(ids)
        before = {lane for id in ids for lane in ([f"{id}:before"] if self.cuts[id][0] else self.links.pred[id])} - inside
        after = {lane for id in ids for lane in ([f"{id}:after"] if self.cuts[id][1] else self.links.succ[id])} - inside
        return len(before), len(after)

    def leave_out_few_ends(self) -> None:
        """Drop clusters with fewer than three lanes that lead in or out."""
        groups = self.groups()
        dropped = [name for name, ids in groups.items() if sum(self.ends(ids)) < 3]
        for id in (id for name in dropped for id in groups[name]):
            self.cluster.pop(self.lanes[id].source, None)
        if dropped:
            self.doubts.append(
                f"places where lanelets meet, with fewer than three lanes in and out, are no junctions: {listed(dropped)}"
            )

    def settle_neighbours(self) -> None:
        """Join clusters without a lane between, or drop one of the two that only parts or only joins the lanes of an approach."""
        groups, places = self.groups(), {id: number for number, id in enumerate(self.lanes)}
        for a, b, *_ in self.adjoining():
            names = [name for id in (a, b) if (name := self.cluster.get(self.lanes[id].source))]
            if len(set(names)) < 2:
                continue
            weak = next((name for name in names if self.parts_or_joins(groups[name])), None)
            if weak is None:
                name, other = sorted(names, key=_order)
                self.joined.append(other)
                self.cluster |= {self.lanes[id].source: name for id in groups[other]}
                groups[name] = sorted(groups[name] + groups.pop(other), key=places.__getitem__)
                continue
            for id in groups[weak]:
                self.cluster.pop(self.lanes[id].source, None)
            lanelets, other = listed(self.lanes[id].source for id in groups[weak]), names[names[0] == weak]
            self.doubts.append(f"lanelets {lanelets} only part or join lanes beside junction J{other} and were read as its roads")
        table: defaultdict[str, list[str]] = defaultdict(list)
        for name in (name for name in self.joined if name in self.cluster):
            table[self.cluster[name]].append(name)
        for name, others in table.items():
            self.doubts.append(f"junctions of lanelets {listed([name, *others])} with no lane between were read as one")

    def parts_or_joins(self, ids: Sequence[str]) -> bool:
        """Return whether a cluster of lanelets that do not cross only parts or only joins lanes, or holds an approach."""
        if self.crosses(ids):
            return False
        approach = not self.approaches.isdisjoint(self.lanes[id].source for id in ids)
        return approach or (min(self.ends(ids)) < 2 and self.mean(ids) > _SMALL)

    def named(self) -> dict[str, list[str]]:
        """Return the ids of the lanelets of every junction by its name: the stated name, the area, or ``J`` and a lanelet."""
        named: dict[str, list[str]] = {}
        for cluster, ids in self.groups().items():
            sources = {self.lanes[id].source for id in ids}
            areas = Counter(area for id in ids if (area := self.lanes[id].area) is not None)
            names = [name for name, stated in self.ground.stated.items() if not sources.isdisjoint(stated)]
            names += [area for area, _ in areas.most_common()]
            named[next((name for name in names if name not in named), f"J{cluster}")] = ids
        return named


def _root(parent: dict[str, str], name: str) -> str:
    """Return the cluster that a cluster was joined to."""
    while parent[name] != name:
        parent[name] = name = parent[parent[name]]
    return name


def _order(id: str) -> tuple[int, str]:
    """Return the key that sorts ids: numbers of fewer digits first."""
    return len(id), id


def _side_by_side(lanes: Sequence[Lanelet]) -> list[list[tuple[str, bool]]]:
    """Return groups of lanelets that share whole ways as bounds, each lanelet with whether it runs along the group's first."""
    users: defaultdict[str, list[tuple[str, bool]]] = defaultdict(list)
    for lane in lanes:
        for way, along in (*lane.left.ways, *lane.right.ways):
            users[way].append((lane.id, along))
    beside = nx.Graph()
    beside.add_nodes_from(lane.id for lane in lanes)
    for row in users.values():
        for (one, along), (two, other_along) in combinations(row[:8], 2):
            if one != two:
                beside.add_edge(one, two, same=along == other_along)
    groups = []
    for component in nx.connected_components(beside):
        start = min(component, key=_order)
        direction = {start: True}
        for one, two in nx.bfs_edges(beside, start):
            direction[two] = direction[one] == beside.edges[one, two]["same"]
        groups.append(list(direction.items()))
    return groups


def cut_off(ground: Ground, id: str, name: str, station: float, *, back: bool) -> None:
    """Cut a lanelet in two at the point of its centre line nearest to a station [m], and change `ground`."""
    lane = ground.lanes[id]
    k = int(np.clip(np.abs(lane.stations - station).argmin(), 1, len(lane.points) - 2))
    # The name of the place where a bound is cut is the same for both lanelets that the bound lies between.
    left, right = (
        ("cut", tuple(sorted(way for way, _ in bound.ways)), all(along for _, along in bound.ways) == back)
        for bound in (lane.left, lane.right)
    )
    head = replace(lane, left=replace(lane.left, last=left), right=replace(lane.right, last=right))
    head = replace(head, points=lane.points[: k + 1], stations=lane.stations[: k + 1])
    tail = replace(lane, left=replace(lane.left, first=left), right=replace(lane.right, first=right))
    tail = replace(tail, points=lane.points[k:], stations=lane.stations[k:] - lane.stations[k])
    part = replace(tail if back else head, id=f"{id}:{name}")
    ground.lanes[id] = head if back else tail
    ground.lanes[part.id] = part
    for neighbour in list(ground.links.succ[id] if back else ground.links.pred[id]):
        ground.links.remove_edge(*((id, neighbour) if back else (neighbour, id)))
        ground.links.add_edge(*((part.id, neighbour) if back else (neighbour, part.id)))
    ground.links.add_edge(*((id, part.id) if back else (part.id, id)))
