"""From signals to entrances: which stop sign or light is for which entrance, and where the stopping line lies.

The `orientation` of a signal cannot be trusted: RoadRunner and LGSVL write it inverted, SUMO writes lights right
and stop signs inverted. Read strictly, whole towns have no controlled junction. So a signal counts for the
entrance lanes at the end of the road it stands near, or by the lanes it names; `orientation` only breaks a tie.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator

import networkx as nx

from pytest_rvads.maps.control import MapObject, ObjectKind
from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.opendrive.draft import Chain, Draft
from pytest_rvads.opendrive.records import Road, Signal

__all__ = ["LINE_RANGE", "attach", "kind_of"]

SIGNAL_RANGE = 50.0
"""Farthest place of a signal before the junction it is for [m]."""
LINE_RANGE = 10.0
"""Farthest place of a stopping line before the entrance vertex [m]."""
_STOP = frozenset({"206", "r1", "r1-1", "stop"})
_STOP_ABROAD = frozenset(
    {
        *(("gb", "601.1"), ("uk", "601.1"), ("gbr", "601.1"), ("fr", "ab4"), ("fra", "ab4"), ("be", "b5"), ("bel", "b5")),
        *(("nl", "b7"), ("nld", "b7"), ("es", "r2"), ("esp", "r2"), ("pl", "b20"), ("pol", "b20"), ("cz", "p6"), ("cze", "p6")),
        *(("se", "b2"), ("swe", "b2"), ("fi", "b6"), ("fin", "b6"), ("no", "204"), ("nor", "204"), ("dk", "b13"), ("dnk", "b13")),
        *(("ch", "3.01"), ("che", "3.01"), ("jp", "330"), ("jpn", "330"), ("jp", "330a"), ("ca", "ra1"), ("can", "ra1")),
    }
)
"""Country and number of the stop sign in catalogues other than the German and the US one."""
_UNTYPED = frozenset({"", "-1", "none", "unknown"})
_STOP_NAME = re.compile(r"(?<![a-z])stop([ _-]?sign)?(?![a-z])|(?<![a-z])sign[ _-]?stop(?![a-z])")
_LIGHT_NAME = re.compile(r"traffic[ _-]?(light|signal)|signal[ _-]?3?light")
_OTHER_NAME = re.compile(r"pedestrian|walk|bicycle|bike|bus|tram|rail|line|ahead")
_LIGHT = frozenset({1_000_001, *range(1_000_008, 1_000_013), *range(1_000_020, 1_000_100)})


def kind_of(signal: Signal) -> ObjectKind | None:
    """Return what a signal is to the rules: a stop sign, a light for vehicles, a stop line, or nothing."""
    if signal.line:
        return ObjectKind.LINE
    if signal.type in _UNTYPED:
        return _by_name(signal.name)
    if signal.type in _STOP:
        # In the US catalogue R1 with subtype 2 is the yield sign R1-2.
        return None if signal.type == "r1" and signal.subtype == "2" else ObjectKind.STOP
    if (signal.country, re.sub(r"[\s_-]", "", signal.type)) in _STOP_ABROAD:
        return ObjectKind.STOP
    digits = signal.type.replace(".", "")  # the catalogue of the standard writes 1.000.001
    if signal.dynamic and digits.isascii() and digits.isdigit() and int(digits[:9]) in _LIGHT:
        return ObjectKind.LIGHT
    return None


def _by_name(name: str) -> ObjectKind | None:
    """Return what a signal without type is, by its name; what is not clearly for vehicles is nothing."""
    if _OTHER_NAME.search(name):
        return None
    if _LIGHT_NAME.search(name):
        return ObjectKind.LIGHT
    return ObjectKind.STOP if _STOP_NAME.search(name) else None


def attach(draft: Draft) -> list[MapObject]:
    """Find the entrances of all stop signs, vehicle lights and stop lines of linked lanes.

    Args:
        draft: references to nothing, unattached and inverted signals are added to its warnings.

    Returns:
        One object per signal and entrance.
    """
    return _Attacher(draft).attach()


class _Attacher:
    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.edges = draft.edges
        self.homes: dict[str, Signal] = {}
        self.by_road: dict[str, list[Chain]] = defaultdict(list)
        self.entered: dict[str, list[str]] = defaultdict(list)
        """Junctions that an edge enters."""
        self.inverted: dict[str, list[str]] = defaultdict(list)
        self.inside: dict[str, dict[str, None]] = defaultdict(dict)
        """Per junction, the edges that lie in it."""
        for edge in draft.edges.values():
            self.by_road[edge.road].append(edge)
            if edge.junction is not None:
                self.inside[edge.junction][edge.id] = None
        for junction in draft.document.junctions:
            # An edge that leads into a junction but not out of it again is no entrance.
            inside = self.inside[junction]
            leaving = [id for id in inside if not draft.links.succ[id].keys() <= inside.keys()]
            for id in dict.fromkeys([*self._before(leaving, inside), *(one for one, _ in draft.direct[junction])]):
                self.entered[id].append(junction)
        for road in draft.document.roads.values():
            for signal in road.signals:
                if not signal.reference and (signal.id not in self.homes or kind_of(self.homes[signal.id]) is None):
                    self.homes[signal.id] = signal

    def _before(self, starts: Iterable[str], inside: Container[str]) -> list[str]:
        """Return the edges outside a junction from which one of `starts`, inside, is reached."""
        before = self.draft.links.pred

        def back(id: str | None) -> Iterator[str]:
            return iter(starts if id is None else before[id] if id in inside else ())

        reached = nx.generic_bfs_edges(self.draft.links, None, back)
        return [id for _, id in reached if id not in inside]

    def attach(self) -> list[MapObject]:
        at_home: list[tuple[Signal, ObjectKind, str, str]] = []
        referred: list[tuple[Signal, ObjectKind, str, str]] = []
        lines: list[Signal] = []
        for road in self.draft.document.roads.values():
            for signal in road.signals:
                home = self.homes.get(signal.id) if signal.reference else signal
                if home is None:
                    message = f"road {road.id!r} refers to signal {signal.id!r}, which does not exist"
                    self.draft.warn(Doubt.SIGNAL, message, road.id)
                    continue
                kind = kind_of(home)
                if kind is ObjectKind.LINE:
                    lines.append(signal)
                elif kind is not None:
                    places = self._entrances(road, signal)
                    (referred if signal.reference else at_home).extend((signal, kind, j, e) for j, e in places)
        far = {(signal.id, junction) for signal, _, junction, _ in referred}
        kept = [entry for entry in at_home if (entry[0].id, entry[2]) not in far] + referred
        found: dict[tuple[ObjectKind, str, str, str], MapObject] = {}
        for signal, kind, junction, edge in kept:
            home = self.homes[signal.id] if signal.reference else signal
            found[kind, signal.id, junction, edge] = self._object(home, kind, junction, self.edges[edge])
        for signal in lines:
            for junction, edge in self._lines(signal):
                key = ObjectKind.LINE, f"{signal.id}@{signal.road}:{signal.s}", junction, edge
                found[key] = self._object(signal, ObjectKind.LINE, junction, self.edges[edge])
        for junction, ids in self.inverted.items():
            names = ", ".join(sorted(set(ids))[:5])
            count = len(set(ids))
            message = f"{count} signals at junction {junction!r} ({names}) are oriented against their traffic; that was ignored"
            self.draft.warn(Doubt.ORIENTATION, message, None, junction)
        return list(found.values())

    def _entrances(self, road: Road, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) that a signal or reference is for."""
        ranges = [r for r in signal.lanes if r != (0, 0)]
        if signal.lanes and not ranges:
            return []  # valid for lane 0 only: this is just where the pole stands
        section = max(bisect_right([part.s for part in road.sections], signal.s + 1e-6) - 1, 0)

        def meant(edge: Chain) -> bool:
            if not ranges:
                return True
            # A lane that forks off after the signal has no number beside it; there the number at its end counts.
            here = [lane for i, lane in edge.lanes if i == section] or [edge.lanes[-1][1]]
            return any(low <= here[0] <= high for low, high in ranges)

        if road.junction is not None and road.junction in self.draft.document.junctions:
            edges = [edge for edge in self.by_road[road.id] if meant(edge)]
            if edges and all(_against(signal, edge.forward) for edge in edges):
                self.inverted[road.junction].append(signal.id)
            return [(road.junction, id) for edge in edges for id in self._before([edge.id], self.inside[road.junction])]
        return [(junction, edge.id) for junction, edge in self._near_end(road, signal) if meant(edge)]

    def _near_end(self, road: Road, signal: Signal) -> list[tuple[str, Chain]]:
        """Return (junction, entrance edge) near a signal on a road outside, on this road or on one it leads into."""
        reach = min(SIGNAL_RANGE, road.length / 2)
        ends: dict[bool, list[tuple[str, Chain]]] = {}
        for edge in self.by_road[road.id]:
            distance = abs((road.length if edge.forward else 0.0) - signal.s)
            if edge.id in self.entered:
                if distance <= reach + 1e-6:
                    ends.setdefault(edge.forward, []).extend((junction, edge) for junction in self.entered[edge.id])
            elif places := self._ahead(edge, distance):
                ends.setdefault(edge.forward, []).extend(places)
        if len(ends) == 2:
            return ends[signal.orientation != "-"]
        for forward, places in ends.items():
            if _against(signal, forward):
                for junction, _ in places[:1]:
                    self.inverted[junction].append(signal.id)
            return places
        return []

    def _ahead(self, edge: Chain, distance: float) -> list[tuple[str, Chain]]:
        """Return (junction, entrance edge) that traffic reaches within `SIGNAL_RANGE` from `distance` before the end of `edge`.

        That is where the last road before a junction is so short that its signals stand on the road before.
        """
        seen = {edge.id}
        while distance <= SIGNAL_RANGE:
            after = list(self.draft.links.succ[edge.id])
            if len(after) != 1 or after[0] in seen:
                return []
            edge = self.edges[after[0]]
            seen.add(edge.id)
            distance += edge.length
            if edge.junction is not None:
                return []
            if edge.id in self.entered:
                return [(junction, edge) for junction in self.entered[edge.id]] if distance <= SIGNAL_RANGE else []
        return []

    def _lines(self, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) that a stop line is for, also where it lies on the road before."""
        road = self.draft.document.roads[signal.road]
        found = []
        for edge in self.by_road[road.id]:
            ahead = edge.length - edge.station(signal.s)
            behind = edge.length - ahead
            if edge.id in self.entered:
                twin = any(other.forward != edge.forward and other.id in self.entered for other in self.by_road[road.id])
                if ahead <= LINE_RANGE and not (twin and ahead > behind):
                    found += [(junction, edge.id) for junction in self.entered[edge.id]]
                continue
            for id in self.draft.links.succ[edge.id]:
                if id in self.entered and ahead + self.edges[id].length <= LINE_RANGE:
                    found += [(junction, id) for junction in self.entered[id]]
        return found

    def _object(self, signal: Signal, kind: ObjectKind, junction: str, edge: Chain) -> MapObject:
        """Place an object on the edge of its entrance."""
        before: float = -1.0
        if signal.road == edge.road:
            before = edge.length - edge.station(signal.s)
        else:
            for id in self.draft.links.pred[edge.id]:
                other = self.edges[id]
                if other.road == signal.road and other.junction is None:
                    before = edge.length + other.length - other.station(signal.s)
        place = max(before, 0.0)
        setback = place if kind is not ObjectKind.LIGHT and before >= 0 and place <= LINE_RANGE else None
        return MapObject(signal.id, kind, junction, edge.id, max(edge.length - place, 0.0), setback)


def _against(signal: Signal, forward: bool) -> bool:
    """Tell whether the orientation of a signal contradicts the direction of the lanes it is for."""
    return signal.orientation in ("+", "-") and (signal.orientation == "+") != forward
