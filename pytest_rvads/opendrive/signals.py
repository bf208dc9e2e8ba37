"""From signals to entrances: which stop sign or light is for which entrance, and where the stopping line lies.

The `orientation` of a signal cannot be trusted: RoadRunner and LGSVL write it inverted, SUMO writes lights right
and stop signs inverted. Read strictly, whole towns have no controlled junction. So a signal counts for the
entrance lanes at the end of the road it stands near, or by the lanes it names; `orientation` only breaks a tie.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Edge, Network
from pytest_rvads.opendrive.records import Document, Road, Signal

__all__ = ["LINE_RANGE", "MapObject", "ObjectKind", "attach", "kind_of"]

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


class ObjectKind(StrEnum):
    """Kinds of objects that matter to the rules."""

    STOP = "stop"
    LIGHT = "light"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class MapObject:
    """A stop sign, light or stop line with its position on the metric graph."""

    id: str
    kind: ObjectKind
    junction: str
    edge: str
    """The edge of the entrance it is for."""
    station: float
    """Along that edge; at its end where the object stands in or beyond the junction [m]."""
    setback: float | None
    """Distance of a stop line or stop sign before the entrance vertex, None beyond `LINE_RANGE` or for lights [m]."""


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


def attach(
    document: Document, network: Network, entrances: Mapping[str, Iterable[str]], warnings: list[MapWarning]
) -> list[MapObject]:
    """Find the entrances of all stop signs, vehicle lights and stop lines.

    Args:
        document: the records of the map.
        network: its lanes.
        entrances: per junction, the edges that enter it.
        warnings: references to nothing, unattached and inverted signals are appended here.

    Returns:
        One object per signal and entrance.
    """
    return _Attacher(document, network, entrances, warnings).attach()


class _Attacher:
    def __init__(
        self, document: Document, network: Network, entrances: Mapping[str, Iterable[str]], warnings: list[MapWarning]
    ) -> None:
        self.document = document
        self.network = network
        self.warnings = warnings
        self.homes: dict[str, Signal] = {}
        self.by_road: dict[str, list[Edge]] = defaultdict(list)
        self.entered: dict[str, list[str]] = defaultdict(list)
        """Junctions that an edge enters."""
        self.inverted: dict[str, list[str]] = defaultdict(list)
        for edge in network.edges.values():
            self.by_road[edge.road].append(edge)
        for junction, ids in entrances.items():
            for id in ids:
                self.entered[id].append(junction)
        for road in document.roads.values():
            for signal in road.signals:
                if not signal.reference and (signal.id not in self.homes or kind_of(self.homes[signal.id]) is None):
                    self.homes[signal.id] = signal

    def attach(self) -> list[MapObject]:
        at_home: list[tuple[Signal, ObjectKind, str, str]] = []
        referred: list[tuple[Signal, ObjectKind, str, str]] = []
        lines: list[Signal] = []
        for road in self.document.roads.values():
            for signal in road.signals:
                home = self.homes.get(signal.id) if signal.reference else signal
                if home is None:
                    message = f"road {road.id!r} refers to signal {signal.id!r}, which does not exist"
                    self.warnings.append(MapWarning(Doubt.SIGNAL, message, road.id))
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
            found[kind, signal.id, junction, edge] = self._object(home, kind, junction, self.network.edges[edge])
        for signal in lines:
            for junction, edge in self._lines(signal):
                key = ObjectKind.LINE, f"{signal.id}@{signal.road}:{signal.s}", junction, edge
                found[key] = self._object(signal, ObjectKind.LINE, junction, self.network.edges[edge])
        for junction, ids in self.inverted.items():
            names = ", ".join(sorted(set(ids))[:5])
            count = len(set(ids))
            message = f"{count} signals at junction {junction!r} ({names}) are oriented against their traffic; that was ignored"
            self.warnings.append(MapWarning(Doubt.ORIENTATION, message, None, junction))
        return list(found.values())

    def _entrances(self, road: Road, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) that a signal or reference is for."""
        ranges = [r for r in signal.lanes if r != (0, 0)]
        if signal.lanes and not ranges:
            return []  # valid for lane 0 only: this is just where the pole stands
        section = max(bisect_right([part.s for part in road.sections], signal.s + 1e-6) - 1, 0)

        def meant(edge: Edge) -> bool:
            if not ranges:
                return True
            # A lane that forks off after the signal has no number beside it; there the number at its end counts.
            here = [lane for i, lane in edge.lanes if i == section] or [edge.lanes[-1][1]]
            return any(low <= here[0] <= high for low, high in ranges)

        if road.junction is not None and road.junction in self.document.junctions:
            edges = [edge for edge in self.by_road[road.id] if meant(edge)]
            if edges and all(_against(signal, edge.forward) for edge in edges):
                self.inverted[road.junction].append(signal.id)
            return [(road.junction, id) for edge in edges for id in self._upstream(edge)]
        return [(junction, edge.id) for junction, edge in self._near_end(road, signal) if meant(edge)]

    def _upstream(self, edge: Edge) -> list[str]:
        """Return the entrance edges from which `edge`, inside a junction, is reached."""
        found, seen, queue = [], {edge.id}, [edge.id]
        while queue:
            for id in self.network.edges[queue.pop()].before:
                if id in seen:
                    continue
                seen.add(id)
                if self.network.edges[id].junction == edge.junction:
                    queue.append(id)
                else:
                    found.append(id)
        return found

    def _near_end(self, road: Road, signal: Signal) -> list[tuple[str, Edge]]:
        """Return (junction, entrance edge) near a signal on a road outside, on this road or on one it leads into."""
        reach = min(SIGNAL_RANGE, road.length / 2)
        ends: dict[bool, list[tuple[str, Edge]]] = {}
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

    def _ahead(self, edge: Edge, distance: float) -> list[tuple[str, Edge]]:
        """Return (junction, entrance edge) that traffic reaches within `SIGNAL_RANGE` from `distance` before the end of `edge`.

        That is where the last road before a junction is so short that its signals stand on the road before.
        """
        seen = {edge.id}
        while distance <= SIGNAL_RANGE and len(edge.after) == 1 and edge.after[0] not in seen:
            edge = self.network.edges[edge.after[0]]
            seen.add(edge.id)
            distance += edge.length
            if edge.junction is not None:
                return []
            if edge.id in self.entered:
                return [(junction, edge) for junction in self.entered[edge.id]] if distance <= SIGNAL_RANGE else []
        return []

    def _lines(self, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) that a stop line is for, also where it lies on the road before."""
        road = self.document.roads[signal.road]
        found = []
        for edge in self.by_road[road.id]:
            ahead = edge.length - edge.station(signal.s)
            behind = edge.length - ahead
            if edge.id in self.entered:
                twin = any(other.forward != edge.forward and other.id in self.entered for other in self.by_road[road.id])
                if ahead <= LINE_RANGE and not (twin and ahead > behind):
                    found += [(junction, edge.id) for junction in self.entered[edge.id]]
                continue
            for id in edge.after:
                if id in self.entered and ahead + self.network.edges[id].length <= LINE_RANGE:
                    found += [(junction, id) for junction in self.entered[id]]
        return found

    def _object(self, signal: Signal, kind: ObjectKind, junction: str, edge: Edge) -> MapObject:
        """Place an object on the edge of its entrance."""
        before: float = -1.0
        if signal.road == edge.road:
            before = edge.length - edge.station(signal.s)
        else:
            for id in edge.before:
                other = self.network.edges[id]
                if other.road == signal.road and other.junction is None:
                    before = edge.length + other.length - other.station(signal.s)
        place = max(before, 0.0)
        setback = place if kind is not ObjectKind.LIGHT and before >= 0 and place <= LINE_RANGE else None
        return MapObject(signal.id, kind, junction, edge.id, max(edge.length - place, 0.0), setback)


def _against(signal: Signal, forward: bool) -> bool:
    """Tell whether the orientation of a signal contradicts the direction of the lanes it is for."""
    return signal.orientation in ("+", "-") and (signal.orientation == "+") != forward


def setback_of(objects: Iterable[MapObject]) -> float:
    """Return the distance of the stopping line before the vertex [m]: the nearest stop line, else stop sign, else 0."""
    lines, signs = math.inf, math.inf
    for item in objects:
        if item.setback is not None and item.kind is ObjectKind.LINE:
            lines = min(lines, item.setback)
        elif item.setback is not None:
            signs = min(signs, item.setback)
    return lines if lines < math.inf else signs if signs < math.inf else 0.0
