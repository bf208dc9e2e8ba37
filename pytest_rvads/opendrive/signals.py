"""From signals to entrances: which stop sign or light is for which entrance, and where the stopping line lies.

The `orientation` of a signal cannot be trusted: RoadRunner and LGSVL write it inverted, SUMO writes lights right
and stop signs inverted. Read strictly, whole towns have no controlled junction. So a signal counts for the
entrance lanes at the end of the road it stands near, or by the lanes it names; `orientation` only breaks a tie.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator

import networkx as nx

from pytest_rvads.maps.control import MapObject, ObjectKind
from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.segment import Turn
from pytest_rvads.opendrive.draft import Chain, Draft
from pytest_rvads.opendrive.records import Document, Road, Signal

__all__ = ["LINE_RANGE", "attach", "kind_of"]

SIGNAL_RANGE = 50.0
"""Farthest place of a signal before the junction it is for [m]."""
LINE_RANGE = 10.0
"""Farthest place of a stopping line before the entrance vertex [m]."""
_STANDARD = {
    **dict.fromkeys(("206", "r1", "r1-1", "stop", "stop_sign"), ObjectKind.STOP),
    **dict.fromkeys(("205", "r1-2", "yield", "yield_sign", "give_way", "giveway"), ObjectKind.YIELD),
    **dict.fromkeys(("301", "306", "priority", "priority_road"), ObjectKind.PRIORITY),
    **dict.fromkeys(("traffic_light", "traffic_lights", "traffic_signal", "traffic_signals", "trafficlight"), ObjectKind.LIGHT),
}
"""Numbers of the German (StVO, annexes 2 and 3) and the US catalogue (MUTCD 2B); words of OpenStreetMap and its converters."""
_ABROAD: dict[tuple[str, ...], tuple[str, str, str]] = {
    ("gb", "uk", "gbr"): ("601.1", "602", ""),
    ("fr", "fra"): ("ab4", "ab3a", "ab2 ab6"),
    ("be", "bel"): ("b5", "b1", "b9 b15"),
    ("nl", "nld"): ("b7", "b6", "b1"),
    ("es", "esp"): ("r2", "r1", "r3"),
    ("pl", "pol"): ("b20", "a7", "d1"),
    ("cz", "cze"): ("p6", "p4", "p1 p2"),
    ("se", "swe"): ("b2", "b1", "b4"),
    ("fi", "fin"): ("b6", "b5", "b1"),
    ("no", "nor"): ("204", "202", "206"),
    ("dk", "dnk"): ("b13", "b11", "b16"),
    ("ch", "che"): ("3.01", "3.02", "3.03"),
    ("jp", "jpn"): ("330 330a", "", ""),
    ("ca", "can"): ("ra1", "ra2", ""),
}
"""Per country, in two or three letters: numbers in its own catalogue of the stop sign (Vienna Convention on Road Signs and
Signals 1968, sign B,2), of the yield sign (B,1) and of the signs that give priority (B,3 and its like)."""
_SIGNS_ABROAD = {
    (country, number): kind
    for countries, catalogue in _ABROAD.items()
    for country in countries
    for kind, numbers in zip((ObjectKind.STOP, ObjectKind.YIELD, ObjectKind.PRIORITY), catalogue, strict=True)
    for number in numbers.split()
}
_UNTYPED = frozenset({"", "-1", "none", "unknown"})
_STOP_NAME = re.compile(r"(?<![a-z])stop([ _-]?sign)?(?![a-z])|(?<![a-z])sign[ _-]?stop(?![a-z])")
_YIELD_NAME = re.compile(r"(?<![a-z])(yield|give[ _-]?way)(?![a-z])")
_LIGHT_NAME = re.compile(r"traffic[ _-]?(light|signal)|signal[ _-]?3?light")
_OTHER_NAME = re.compile(r"pedestrian|walk|bicycle|bike|bus|tram|rail|line|ahead")
_LIGHT = frozenset({1_000_001, *range(1_000_008, 1_000_013), *range(1_000_020, 1_000_100)})
_ARROWS = {
    "10": frozenset({Turn.LEFT}),
    "20": frozenset({Turn.RIGHT}),
    "30": frozenset({Turn.STRAIGHT}),
    "40": frozenset({Turn.STRAIGHT, Turn.LEFT}),
    "50": frozenset({Turn.STRAIGHT, Turn.RIGHT}),
}
"""Per subtype of 1000011, the light of three heads with arrows: where they point (OpenDRIVE 1.4, list of signals)."""


def kind_of(signal: Signal) -> ObjectKind | None:
    """Return what a signal is to the rules: a stop, yield or priority sign, a light for vehicles, a stop line, or nothing."""
    if signal.line:
        return ObjectKind.LINE
    if signal.type in _UNTYPED:
        return _by_name(signal.name)
    abroad = _SIGNS_ABROAD.get((signal.country, re.sub(r"[\s_-]", "", signal.type)))
    if abroad is not None:
        return abroad
    if signal.type == "r1" and signal.subtype == "2":
        return ObjectKind.YIELD  # the US catalogue's R1-2
    standard = _STANDARD.get(re.sub(r"\s+", "_", signal.type))
    if standard is ObjectKind.LIGHT and _OTHER_NAME.search(signal.name):
        return None
    if standard is not None:
        return standard
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
    if _YIELD_NAME.search(name):
        return ObjectKind.YIELD
    return ObjectKind.STOP if _STOP_NAME.search(name) else None


def _arrows_of(signal: Signal) -> frozenset[Turn]:
    """Return the turns that a light with arrows is for; empty for every other signal."""
    return _ARROWS.get(signal.subtype, frozenset()) if signal.type.replace(".", "") == "1000011" else frozenset()


def _counts_from_kerb(document: Document) -> bool:
    """Whether lanes in ``<validity>`` are those of SUMO, counted from the kerb from 0, as its netconvert wrote them up to 1.15.

    That file has no references, every range is one lane, and its roads are one-way: none has a lane of the number that is meant.
    """
    signals = [(road, signal) for road in document.roads.values() for signal in road.signals]
    if any(signal.reference for _, signal in signals):
        return False
    ranges = [(road, low, high) for road, signal in signals for low, high in signal.lanes]
    return bool(ranges) and all(
        low == high and 0 <= low < len(_lanes_right(road)) and not any(lane > 0 for lane in _numbers(road))
        for road, low, high in ranges
    )


def _numbers(road: Road) -> set[int]:
    return {lane for section in road.sections for lane in section.lanes}


def _lanes_right(road: Road) -> list[int]:
    """Return the lanes on the right at the end of a road, from the kerb."""
    return sorted(lane for lane in road.lanes_at("end") if lane < 0)


def attach(draft: Draft) -> list[MapObject]:
    """Find the entrances of all signs, vehicle lights and stop lines of linked lanes.

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
        self.from_kerb = _counts_from_kerb(draft.document)
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
        found: dict[tuple[ObjectKind, str, str, str], MapObject] = {}
        for signal, kind, junction, edge in self._placed():
            home = self.homes[signal.id] if signal.reference else signal
            found[kind, signal.id, junction, edge] = self._object(home, kind, junction, self.edges[edge])
        for signal in self._all():
            if kind_of(signal) is ObjectKind.LINE:
                for junction, edge in self._lines(signal):
                    key = ObjectKind.LINE, f"{signal.id}@{signal.road}:{signal.s}", junction, edge
                    found[key] = self._object(signal, ObjectKind.LINE, junction, self.edges[edge])
        for junction, ids in self.inverted.items():
            names = ", ".join(sorted(set(ids))[:5])
            count = len(set(ids))
            message = f"{count} signals at junction {junction!r} ({names}) are oriented against their traffic; that was ignored"
            self.draft.warn(Doubt.ORIENTATION, message, None, junction)
        return list(found.values())

    def _all(self) -> Iterator[Signal]:
        return (signal for road in self.draft.document.roads.values() for signal in road.signals)

    def _placed(self) -> list[tuple[Signal, ObjectKind, str, str]]:
        """Return signals and references with what they are and the junction and entrance edge they are for."""
        at_home: list[tuple[Signal, ObjectKind, str, str]] = []
        referred: list[tuple[Signal, ObjectKind, str, str]] = []
        why: dict[tuple[str, str], str | None] = {}
        for signal in self._all():
            home = self.homes.get(signal.id) if signal.reference else signal
            if home is None:
                message = f"road {signal.road!r} refers to signal {signal.id!r}, which does not exist"
                self.draft.warn(Doubt.SIGNAL, message, signal.road)
                continue
            kind = kind_of(home)
            if kind is None or kind is ObjectKind.LINE:
                continue
            places, reason = self._entrances(self.draft.document.roads[signal.road], signal, kind)
            (referred if signal.reference else at_home).extend((signal, kind, j, e) for j, e in places)
            # References tell better what a signal is for than the place of its mast does.
            key = home.id, home.road
            why[key] = None if places or why.get(key, reason) is None else reason
        self._tell_lost([reason for reason in why.values() if reason is not None], len(why))
        far = {(signal.id, junction) for signal, _, junction, _ in referred}
        return [entry for entry in at_home if (entry[0].id, entry[2]) not in far] + referred

    def _tell_lost(self, reasons: list[str], total: int) -> None:
        if reasons:
            (reason, count), *_ = Counter(reasons).most_common(1)
            most = "" if count == len(reasons) else f"{count} of them "
            message = f"{len(reasons)} of {total} signs and lights are for no entrance: {most}{reason}"
            self.draft.warn(Doubt.SIGNAL, message)

    def _entrances(self, road: Road, signal: Signal, kind: ObjectKind) -> tuple[list[tuple[str, str]], str | None]:
        """Return (junction, entrance edge) that a signal or reference is for, and why there is none."""
        ranges = self._ranges(road, signal)
        if signal.lanes and not ranges:
            return [], "name lane 0 alone, where the pole stands"
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
            places = [(road.junction, id) for edge in edges for id in self._before([edge.id], self.inside[road.junction])]
            return places, None if places else "are for lanes of a connecting road that no traffic comes to"
        near = self._near_end(road, signal)
        places = [(junction, edge.id) for junction, edge in near if meant(edge)]
        if not places and kind is ObjectKind.LIGHT:
            places = self._across(road, signal, [edge for edge in self.by_road[road.id] if meant(edge)])
        if places:
            return places, None
        return (
            [],
            "name lanes that lead into no junction" if near else "stand near no end of a road where lanes lead into a junction",
        )

    def _ranges(self, road: Road, signal: Signal) -> list[tuple[int, int]]:
        """Return the ranges of lanes that a signal is valid for, in the numbers of OpenDRIVE, without lane 0."""
        if self.from_kerb:
            lanes = _lanes_right(road)
            return [(lanes[low], lanes[high]) for low, high in signal.lanes]
        return [ranged for ranged in signal.lanes if ranged != (0, 0)]

    def _across(self, road: Road, signal: Signal, edges: Iterable[Chain]) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) that a light at the beginning of an exit road is for: traffic that goes straight on.

        There the masts stand on the far side, and nothing refers to them.
        """
        reach = min(SIGNAL_RANGE, road.length / 2)
        found: dict[tuple[str, str], None] = {}
        for edge in edges:
            if abs((0.0 if edge.forward else road.length) - signal.s) <= reach + 1e-6:
                inside = [self.edges[id] for id in self.draft.links.pred[edge.id] if self.edges[id].junction is not None]
                ahead = min(inside, key=lambda one: (abs(one.turning), one.id), default=None)
                if ahead is not None and ahead.junction is not None and Turn.of(ahead.turning) is Turn.STRAIGHT:
                    for id in self._before([ahead.id], self.inside[ahead.junction]):
                        found[ahead.junction, id] = None
        return list(found)

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
        arrows = _arrows_of(signal) if kind is ObjectKind.LIGHT else frozenset[Turn]()
        return MapObject(signal.id, kind, junction, edge.id, max(edge.length - place, 0.0), setback, arrows)


def _against(signal: Signal, forward: bool) -> bool:
    """Tell whether the orientation of a signal contradicts the direction of the lanes it is for."""
    return signal.orientation in ("+", "-") and (signal.orientation == "+") != forward
