"""Assigning signals to entrances: the entrances of every sign and light, and the places of stop lines.

The `orientation` of a signal is unreliable: RoadRunner and LGSVL invert the orientation, and SUMO inverts the orientation of stop
signs. Whole towns would have no controlled junction if the reader relied on `orientation`. So a signal regulates the entrance
lanes at the near end of the road, or the lanes that the signal names. The `orientation` of a signal only decides between the two
ends of a road.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator
from itertools import product

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import MapObject, ObjectKind
from pytest_rvads.geometry.network import Doubt
from pytest_rvads.geometry.opendrive.centre_lines import borders_at
from pytest_rvads.geometry.opendrive.draft import Chain, Draft
from pytest_rvads.geometry.opendrive.records import Document, Road, Signal, pose_at
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.wording import plural

Array = NDArray[np.float64]
SIGNAL_RANGE = 50.0
"""Largest distance of a signal from the junction that the signal regulates [m]."""
LINE_RANGE = 10.0
"""Greatest distance of a stopping line before the entrance vertex [m]."""
INSIDE = 20.0
"""Greatest distance of a stopping line behind the entrance vertex [m]."""
_HALF = 1.75
"""Half the length of a stop line in a junction for which the file gives no length and no lane [m]."""
_SQUARE = math.cos(math.radians(45.0))
"""Least sine of the angle between a stop line and traffic that crosses it, and cosine between lanes that share a line."""
STANDARD = {
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
_MEANINGS: dict[str, ObjectKind | None] = {
    **dict.fromkeys(("stop", "4way"), ObjectKind.STOP),
    "yield": ObjectKind.YIELD,
    "priorityroad": ObjectKind.PRIORITY,
    "trafficlight": ObjectKind.LIGHT,
    **dict.fromkeys(("stopline", "waitingline"), ObjectKind.LINE),
    "noturnonred": ObjectKind.NO_TURN_ON_RED,
    **dict.fromkeys(("keepclearline", "noparkingline", "priorityroadend", "prioritytotherightrule", "turnonredallowed")),
}
"""Kinds by the values of ``<priority>`` in ``<semantics>``, in lower case (OpenDRIVE 1.8, section 14.8); of several values of a
signal the first here counts. None: the value changes nothing, because it states what holds without a sign, or another line."""
_CATALOGUES = frozenset({"", "de", "deu", "ger", "us", "usa", "opendrive", *(country for country, _ in _SIGNS_ABROAD)})
"""Countries whose catalogues are known; signals without a country have the numbers of the standard, of Germany or of the US."""
_STANDARD_NUMBER = re.compile(r"1\.?000\.?\d{3}")
_NUMBER = re.compile(rf"{_STANDARD_NUMBER.pattern}|\d{{3}}(-\d+)?|[a-z]\d+(-\d+\w*)?")
_UNTYPED = frozenset({"", "-1", "none", "unknown"})
_NAMES = (
    (re.compile(r"traffic[ _-]?(light|signal)|signal[ _-]?3?light"), ObjectKind.LIGHT),
    (re.compile(r"(?<![a-z])(yield|give[ _-]?way)(?![a-z])"), ObjectKind.YIELD),
    (re.compile(r"(?<![a-z])stop([ _-]?sign)?(?![a-z])|(?<![a-z])sign[ _-]?stop(?![a-z])"), ObjectKind.STOP),
)
"""Names of signals without type that are clearly for vehicles; of several the first counts."""
_OTHER_NAME = re.compile(r"pedestrian|walk|bicycle|bike|bus|tram|rail|line|ahead")
_NO_SIGN_NAME = re.compile(_OTHER_NAME.pattern + r"|speed|arrow")
_BESIDE, _PAST = 10.0, 1.0
"""Farthest place of a sign that names no lane, from the end of its lane: to the side of the kerb, and along the lane [m]."""
_LIGHT = frozenset({1_000_001, *range(1_000_008, 1_000_013), *range(1_000_020, 1_000_100)})
_ARROWS = {
    "10": frozenset({Turn.LEFT}),
    "20": frozenset({Turn.RIGHT}),
    "30": frozenset({Turn.STRAIGHT}),
    "40": frozenset({Turn.STRAIGHT, Turn.LEFT}),
    "50": frozenset({Turn.STRAIGHT, Turn.RIGHT}),
}
"""Per subtype of 1000011, the light of three heads with arrows: the turns of the arrows (OpenDRIVE 1.4, list of signals)."""


def kind_of(signal: Signal) -> ObjectKind | None:
    """Return the kind of a signal: a stop, yield or priority sign, a light for vehicles, a stop line; None for other signals.

    The catalogue of the country decides. Where the country or the type is unknown, the ``<semantics>`` of the signal decide.
    """
    if signal.line:
        return ObjectKind.LINE
    meant = next((kind for word, kind in _MEANINGS.items() if kind and word in (signal.meanings or ())), None)
    if meant is ObjectKind.LIGHT and _OTHER_NAME.search(signal.name):
        return None
    if meant is not None and (signal.type in _UNTYPED or signal.country not in _CATALOGUES):
        return meant
    if signal.type in _UNTYPED:
        by_name = (kind for pattern, kind in _NAMES if pattern.search(signal.name))
        return None if _OTHER_NAME.search(signal.name) else next(by_name, None)
    if _STANDARD_NUMBER.fullmatch(signal.type):  # the catalogue of the standard writes 1.000.001
        return ObjectKind.LIGHT if signal.dynamic and int(signal.type.replace(".", "")) in _LIGHT else None
    abroad = _SIGNS_ABROAD.get((signal.country, re.sub(r"[\s_-]", "", signal.type)))
    if abroad is not None:
        return abroad
    if signal.type == "r1" and signal.subtype == "2":
        return ObjectKind.YIELD  # the US catalogue's R1-2
    standard = STANDARD.get(re.sub(r"\s+", "_", signal.type))
    return meant if standard is ObjectKind.LIGHT and _OTHER_NAME.search(signal.name) else standard or meant


def _counts_from_kerb(document: Document) -> bool:
    """Return whether the lanes in ``<validity>`` have the numbers of SUMO, from 0 at the kerb, as netconvert wrote until 1.15.

    Files with such numbers have no references, every range is one lane, and the roads are one-way without lanes of positive ids.
    """
    signals = [(road, signal) for road in document.roads.values() for signal in road.signals]
    if any(signal.reference for _, signal in signals):
        return False
    ranges = [(road, low, high) for road, signal in signals for low, high in signal.lanes]
    return bool(ranges) and all(
        low == high
        and 0 <= low < sum(lane < 0 for lane in road.lanes_at("end"))
        and not any(lane > 0 for section in road.sections for lane in section.lanes)
        for road, low, high in ranges
    )


class Attacher:
    """Assigns the signs, vehicle lights and stop lines of a draft with linked lanes to entrances."""

    def __init__(self, draft: Draft, left_hand: Container[str]) -> None:
        self.draft = draft
        self.left_hand = left_hand
        self.edges = draft.edges
        self.homes: dict[str, Signal] = {}
        """Per id, the signal that has the id, which references name."""
        self.by_road: dict[str, list[Chain]] = defaultdict(list)
        self.entered: dict[str, list[str]] = defaultdict(list)
        """Per edge, the junctions that the edge enters."""
        self.inverted: dict[str, list[str]] = defaultdict(list)
        """Per junction, the ids of signals that are oriented against their traffic."""
        self.from_kerb = _counts_from_kerb(draft.document)
        self.referred = {signal.id for signal in self._signals() if signal.reference}
        self.by_place: dict[str, None] = {}
        """Ids of signs that name no lane and were assigned by their place."""
        self.inside: dict[str, dict[str, None]] = defaultdict(dict)
        """Per junction, the edges in the junction."""
        for edge in draft.edges.values():
            self.by_road[edge.road].append(edge)
            if edge.junction is not None:
                self.inside[edge.junction][edge.id] = None
        for junction in draft.document.junctions:
            # An edge into a junction is an entrance only if traffic can leave the junction again.
            inside = self.inside[junction]
            leaving = [id for id in inside if not draft.links.succ[id].keys() <= inside.keys()]
            for id in dict.fromkeys([*self._before(leaving, inside), *(source for source, _ in draft.direct[junction])]):
                self.entered[id].append(junction)
        for road in draft.document.roads.values():
            for signal in road.signals:
                if not signal.reference and (signal.id not in self.homes or kind_of(self.homes[signal.id]) is None):
                    self.homes[signal.id] = signal

    def _before(self, starts: Iterable[str], inside: Container[str]) -> list[str]:
        """Return the edges outside a junction from which traffic reaches an edge of `starts` inside the junction."""
        before = self.draft.links.pred

        def predecessors(id: str | None) -> Iterator[str]:
            return iter(starts if id is None else before[id] if id in inside else ())

        reached = nx.generic_bfs_edges(self.draft.links, None, predecessors)
        return [id for _, id in reached if id not in inside]

    def attach(self) -> list[MapObject]:
        """Return an object per signal and entrance."""
        objects: dict[tuple[ObjectKind, str, str, str], MapObject] = {}
        used, unused = list[str](), list[str]()
        for signal, kind, junction, edge in self._placed():
            home = self.homes[signal.id] if signal.reference else signal
            objects[kind, signal.id, junction, edge] = self._object(home, kind, junction, self.edges[edge])
        for signal in self._signals():
            if kind_of(signal) is ObjectKind.LINE:
                kind, id = ObjectKind.LINE, f"{signal.id}@{signal.road}:{signal.s}"
                if (inside := self.draft.document.roads[signal.road].junction) is None:
                    for junction, edge in self._line_entrances(signal):
                        objects[kind, id, junction, edge] = self._object(signal, kind, junction, self.edges[edge])
                    continue
                setbacks = self._lanes_across(signal, inside)
                (used if setbacks else unused).append(id)
                for edge, setback in setbacks.items():
                    station = self.edges[edge].length - max(setback, 0.0)
                    objects[kind, id, inside, edge] = MapObject(signal.id, kind, inside, edge, station, setback)
        if unused:
            message = (
                f"{len(unused)} of {plural(len(used) + len(unused), 'stop line')} in junctions, {unused[0].partition('@')[0]!r} "
                f"first, were ignored: no lane into the junction crosses them within {INSIDE:g} m of its end"
            )
            self.draft.warn(Doubt.SIGNAL, message)
        for junction, ids in self.inverted.items():
            names = ", ".join(sorted(set(ids))[:5])
            count = len(set(ids))
            message = f"{count} signals at junction {junction!r} ({names}) are oriented against their traffic; that was ignored"
            self.draft.warn(Doubt.ORIENTATION, message, None, junction)
        self._warn_of_unknown()
        return list(objects.values())

    def _warn_of_unknown(self) -> None:
        """Add a warning that counts the signals at entrances whose meaning is unknown."""
        unknown: dict[str, Signal] = {}
        for signal in self._signals():
            home = self.homes.get(signal.id, signal)
            if home.reference or kind_of(home) is not None or _NO_SIGN_NAME.search(home.name):
                continue
            # The meaning is told by the ``<semantics>``, or else by a known catalogue.
            if home.meanings is not None:
                told = set(home.meanings) <= _MEANINGS.keys()
            else:
                known = home.country in _CATALOGUES if home.country else _NUMBER.fullmatch(home.type)
                told = bool(known) and home.type not in _UNTYPED
            if not told and self._entrances(self.draft.document.roads[signal.road], signal, ObjectKind.STOP)[0]:
                unknown[home.id] = home
        if unknown:
            first = next(iter(unknown.values()))
            words = f"country {first.country!r}, type {first.type[:40]!r}, name {first.name[:40]!r}"
            message = (
                f"{plural(len(unknown), 'signal')} of unknown type at entrances were ignored, first the signal {first.id!r} "
                f"({words}); expected a number of a known catalogue, or <semantics>"
            )
            self.draft.warn(Doubt.SIGNAL, message, first.road)

    def _signals(self) -> Iterator[Signal]:
        return (signal for road in self.draft.document.roads.values() for signal in road.signals)

    def _placed(self) -> list[tuple[Signal, ObjectKind, str, str]]:
        """Return signals and references with their kind and the junction and entrance edge that they regulate."""
        at_home: list[tuple[Signal, ObjectKind, str, str]] = []
        referred: list[tuple[Signal, ObjectKind, str, str]] = []
        reasons: dict[tuple[str, str], str | None] = {}
        for signal in self._signals():
            home = self.homes.get(signal.id) if signal.reference else signal
            if home is None:
                message = f"road {signal.road!r} refers to signal {signal.id!r}, which does not exist"
                self.draft.warn(Doubt.SIGNAL, message, signal.road)
                continue
            kind = kind_of(home)
            if kind is None or kind is ObjectKind.LINE:
                continue
            places, reason = self._entrances(self.draft.document.roads[signal.road], signal, kind)
            kinds = [kind, *[ObjectKind.NO_TURN_ON_RED] * ("noturnonred" in (home.meanings or ()))]
            (referred if signal.reference else at_home).extend((signal, kind, *place) for kind, place in product(kinds, places))
            # References state the entrances of a signal more reliably than the place of its mast.
            key = home.id, home.road
            reasons[key] = None if places or reasons.get(key, reason) is None else reason
        unassigned = [reason for reason in reasons.values() if reason is not None]
        if unassigned:
            (reason, count), *_ = Counter(unassigned).most_common(1)
            most = "" if count == len(unassigned) else f"{count} of them "
            message = f"{len(unassigned)} of {len(reasons)} signs and lights are for no entrance: {most}{reason}"
            self.draft.warn(Doubt.SIGNAL, message)
        if self.by_place:
            signs = f"{plural(len(self.by_place), 'sign')} ({', '.join([*self.by_place][:5])})"
            message = f"{signs} of lane 0 alone, which no reference names, were assigned to the lanes at whose end they stand"
            self.draft.warn(Doubt.SIGNAL, message)
        far = {(signal.id, junction) for signal, _, junction, _ in referred}
        return [entry for entry in at_home if (entry[0].id, entry[2]) not in far] + referred

    def _entrances(self, road: Road, signal: Signal, kind: ObjectKind) -> tuple[list[tuple[str, str]], str | None]:
        """Return (junction, entrance edge) that a signal or reference regulates, and the reason if there are none."""
        # The ranges of lanes that the signal is valid for, in the numbers of OpenDRIVE, without lane 0.
        ranges = [ranged for ranged in signal.lanes if ranged != (0, 0)]
        if self.from_kerb:
            right = sorted(lane for lane in road.lanes_at("end") if lane < 0)
            ranges = [(right[low], right[high]) for low, high in signal.lanes]
        if signal.lanes and not ranges:
            places = self._beside(road, signal) if kind is not ObjectKind.LIGHT and signal.id not in self.referred else []
            self.by_place.update(dict.fromkeys([signal.id] if places else []))
            return places, None if places else "name lane 0 alone, where the pole stands"
        section = max(bisect_right([part.s for part in road.sections], signal.s + 1e-6) - 1, 0)

        def is_named(edge: Chain) -> bool:
            if not ranges:
                return True
            # A lane that forks off after the signal has no number beside the signal; the number at the end of the lane counts.
            numbers = [lane for i, lane in edge.lanes if i == section] or [edge.lanes[-1][1]]
            return any(low <= numbers[0] <= high for low, high in ranges)

        if road.junction is not None and road.junction in self.draft.document.junctions:
            edges = [edge for edge in self.by_road[road.id] if is_named(edge)]
            if edges and all(_against(signal, edge.forward) for edge in edges):
                self.inverted[road.junction].append(signal.id)
            places = [(road.junction, id) for edge in edges for id in self._before([edge.id], self.inside[road.junction])]
            return places, None if places else "are for lanes of a connecting road that no traffic comes to"
        near = self._near_end(road, signal)
        places = [(junction, edge.id) for junction, edge in near if is_named(edge)]
        if not places and kind is ObjectKind.LIGHT:
            places = self._across(road, signal, [edge for edge in self.by_road[road.id] if is_named(edge)])
        reason = "stand near no end of a road where lanes lead into a junction"
        return places, None if places else "name lanes that lead into no junction" if near else reason

    def _beside(self, road: Road, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) of the lanes of a road end beside which a sign stands, on the side of the kerb."""
        own = [edge.id for edge in self.by_road[road.id]]
        near = [self.edges[id] for id in (own if road.junction is None else self._before(own, self.inside[road.junction]))]
        heads = set()
        for edge in (edge for edge in near if edge.id in self.entered):
            (x, y), (u, v), heading = edge.points[-1], point_of(road, signal), edge.end_heading
            past = (u - x) * np.cos(heading) + (v - y) * np.sin(heading)
            aside = (u - x) * np.sin(heading) - (v - y) * np.cos(heading)
            if abs(past) <= _PAST and 0.0 < (-aside if edge.road in self.left_hand else aside) <= _BESIDE:
                heads.add(edge.head)
        if len(heads) != 1:
            return []
        (head,) = heads
        lanes = [edge.id for edge in self.by_road[head[0]] if edge.head == head]
        return [(junction, id) for id in lanes for junction in self.entered.get(id, ())]

    def _across(self, road: Road, signal: Signal, edges: Iterable[Chain]) -> list[tuple[str, str]]:
        """Return the pairs (junction, entrance edge) that a light at the start of an exit road regulates.

        These are the entrances whose traffic goes straight on into the exit road. The mast of such a light stands on the far side
        of the junction, and no reference names the light.
        """
        reach = min(SIGNAL_RANGE, road.length / 2)
        places: dict[tuple[str, str], None] = {}
        for edge in edges:
            if abs((0.0 if edge.forward else road.length) - signal.s) <= reach + 1e-6:
                inside = [self.edges[id] for id in self.draft.links.pred[edge.id] if self.edges[id].junction is not None]
                ahead = min(inside, key=lambda way: (abs(way.turning), way.id), default=None)
                if ahead is not None and ahead.junction is not None and Turn.of(ahead.turning) is Turn.STRAIGHT:
                    for id in self._before([ahead.id], self.inside[ahead.junction]):
                        places[ahead.junction, id] = None
        return list(places)

    def _near_end(self, road: Road, signal: Signal) -> list[tuple[str, Chain]]:
        """Return (junction, entrance edge) near a signal on a road outside junctions, on this road or on the roads after it."""
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
        """Return (junction, entrance edge) within `SIGNAL_RANGE` of a signal that is `distance` before the end of an edge [m].

        If the last road before a junction is short, its signals stand on the road that leads to the short road.
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

    def _line_entrances(self, signal: Signal) -> list[tuple[str, str]]:
        """Return (junction, entrance edge) of a stop line, which lies on the entrance edge or on the edge that leads to it."""
        road = self.draft.document.roads[signal.road]
        places = []
        for edge in self.by_road[road.id]:
            ahead = edge.length - edge.station(signal.s)
            behind = edge.length - ahead
            if edge.id in self.entered:
                twin = any(lane.forward != edge.forward and lane.id in self.entered for lane in self.by_road[road.id])
                if ahead <= LINE_RANGE and not (twin and ahead > behind):
                    places += [(junction, edge.id) for junction in self.entered[edge.id]]
                continue
            for id in self.draft.links.succ[edge.id]:
                if id in self.entered and ahead + self.edges[id].length <= LINE_RANGE:
                    places += [(junction, id) for junction in self.entered[id]]
        return places

    def _lanes_across(self, signal: Signal, junction: str) -> dict[str, float]:
        """Return, per entrance edge whose traffic crosses a stop line in a junction, the setback of the line [m].

        The line can lie on the way of another entrance than that of its road. Traffic that crosses the line in another direction
        than the traffic that crosses it first has another line.
        """
        road = self.draft.document.roads[signal.road]
        x, y, heading = pose_at(road, signal.s)
        (turn, length), t = signal.across, signal.t
        if not length:
            # A line without a length in the file lies across the lanes that it is valid for, or else the lanes on its side of the
            # road. A line that lies beside all of these is as long as a lane is wide.
            ranges = [part for part in signal.lanes if part != (0, 0)]
            lanes = {id: ends for id, ends in borders_at(road, signal.s).items() if id * t >= 0.0}
            named = [ends for id, ends in lanes.items() if not ranges or any(low <= id <= high for low, high in ranges)]
            low, high = min(map(min, named), default=t), max(map(max, named), default=t)
            low, high = (low, high) if low < high and low <= t <= high else (t - _HALF, t + _HALF)
            turn, length, t = math.pi / 2, high - low, (low + high) / 2
        middle = np.array([x - t * math.sin(heading), y + t * math.cos(heading)])
        along = np.array([math.cos(heading + turn), math.sin(heading + turn)])
        crossed: list[tuple[float, float, str]] = []
        for id in self.inside[junction]:
            for before in self.draft.links.pred[id]:
                lane = self.edges[before]
                if junction not in self.entered.get(before, ()):
                    continue
                for station, direction in _crossings(np.vstack((lane.points, self.edges[id].points)), middle, along, length / 2):
                    crossed.append((round(lane.length - station, 6), direction, before))
        near = sorted(
            (row for row in crossed if -INSIDE <= row[0] <= LINE_RANGE), key=lambda row: (abs(row[0]), row[2]), reverse=True
        )
        return {before: setback for setback, direction, before in near if math.cos(direction - near[-1][1]) > _SQUARE}

    def _object(self, signal: Signal, kind: ObjectKind, junction: str, edge: Chain) -> MapObject:
        """Return the map object of a signal of the file, with its position on an entrance edge."""
        before: float = -1.0
        if signal.road == edge.road:
            before = edge.length - edge.station(signal.s)
        else:
            for id in self.draft.links.pred[edge.id]:
                previous = self.edges[id]
                if previous.road == signal.road and previous.junction is None:
                    before = edge.length + previous.length - previous.station(signal.s)
        place = max(before, 0.0)
        setback = place if kind is not ObjectKind.LIGHT and before >= 0 and place <= LINE_RANGE else None
        with_arrows = kind is ObjectKind.LIGHT and signal.type.replace(".", "") == "1000011"
        arrows = _ARROWS.get(signal.subtype, frozenset()) if with_arrows else frozenset[Turn]()
        point = point_of(self.draft.document.roads[signal.road], signal) if kind is ObjectKind.LIGHT else None
        return MapObject(signal.id, kind, junction, edge.id, max(edge.length - place, 0.0), setback, arrows, point)


def point_of(road: Road, signal: Signal) -> tuple[float, float]:
    """Return the place of a signal [m], `Signal.t` to the left of the reference line of its road."""
    x, y, heading = pose_at(road, signal.s)
    return float(x - signal.t * np.sin(heading)), float(y + signal.t * np.cos(heading))


def _crossings(path: Array, middle: Array, along: Array, half: float) -> Iterator[tuple[float, float]]:
    """Yield the arc lengths at which a path of points ``(k, 2)`` crosses a line [m], and the headings of the path there [rad].

    The line has a middle [m], a unit vector `along` it, and half its length [m].
    """
    steps, apart = np.diff(path, axis=0), path - middle
    lengths, ahead = np.hypot(*steps.T), along[0] * apart[:, 1] - along[1] * apart[:, 0]
    stations = np.concatenate(([0.0], np.cumsum(lengths)))
    for k in np.flatnonzero((ahead[:-1] < 0.0) != (ahead[1:] < 0.0)).tolist():
        share = float(ahead[k] / (ahead[k] - ahead[k + 1]))
        if abs((apart[k] + share * steps[k]) @ along) <= half and abs(ahead[k + 1] - ahead[k]) > _SQUARE * lengths[k]:
            yield float(stations[k] + share * lengths[k]), math.atan2(*steps[k][::-1])


def _against(signal: Signal, forward: bool) -> bool:
    """Return whether the orientation of a signal contradicts the direction of the lanes that the signal regulates."""
    return signal.orientation in ("+", "-") and (signal.orientation == "+") != forward
