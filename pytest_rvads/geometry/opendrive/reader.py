"""Reading the records of an OpenDRIVE file.

The reader follows ASAM OpenDRIVE 1.4 to 1.8. Ids are strings. Elements can stand in any order: the reader sorts them by station.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from xml.etree.ElementTree import Element

from pytest_rvads.geometry.network import Doubt, MapWarning
from pytest_rvads.geometry.opendrive.map_file import ARM, integer, limit_of, load, number
from pytest_rvads.geometry.opendrive.records import (
    Connection,
    CrosswalkRecord,
    Cubic,
    Document,
    JunctionRecord,
    Lane,
    Road,
    RoadLink,
    Section,
    Shape,
    Signal,
)
from pytest_rvads.geometry.segment import Limits
from pytest_rvads.support.errors import MapError

_STOP_LINE = ("stopline", "stop_line", "stop line", "haltlinie", "holdingline")
_SHAPES = {
    "line": (),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": ("a", "b", "c", "d"),
    "paramPoly3": ("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"),
}
"""Per kind of geometry its attributes."""


def read(path: str | os.PathLike[str]) -> Document:
    """Read the records of an OpenDRIVE file; a broken sign, light, stop line or speed limit is left out with a warning."""
    root = load(path)
    warnings: list[MapWarning] = []
    roads: dict[str, Road] = {}
    for element in root.findall("road"):
        reader = _RoadReader(element, path)
        road = reader.road()
        if road.id in roads:
            raise MapError(f"map file {path} has two roads with id {road.id!r}, expected unique ids")
        roads[road.id] = road
        warnings += reader.warnings
    junctions: dict[str, JunctionRecord] = {}
    for element in root.findall("junction"):
        junction = _junction(element, f"map file {path}, junction {element.get('id', '?')!r}")
        if junction.id in junctions:
            raise MapError(f"map file {path} has two junctions with id {junction.id!r}, expected unique ids")
        junctions[junction.id] = junction
    if not junctions:
        raise MapError(
            f"map file {path} has {len(roads)} roads but no <junction>, so it offers nothing to test; "
            "add junctions with connecting roads, or use another map"
        )
    controllers = {
        element.get("id", ""): tuple(control.get("signalId", "") for control in element.findall("control"))
        for element in root.findall("controller")
    }
    for junction in junctions.values():
        for name in dict.fromkeys(name for pair in junction.priorities for name in pair if name not in roads):
            message = f"junction {junction.id!r} states a priority of road {name!r}, which does not exist; that was ignored"
            warnings.append(MapWarning(Doubt.LINK, message, None, junction.id))
    warnings += _assign_junctions(roads, junctions)
    header = root.find("header")
    if header is not None:
        unit = header.get("unit") or header.get("units") or "m"
        for word in (header.findtext("geoReference") or "").split():
            if word.startswith("+units="):
                unit = word.removeprefix("+units=")
        if unit not in ("m", "meter", "metre"):
            message = f"the header names the unit {unit[:20]!r}; coordinates were read in metres, as the standard says"
            warnings.append(MapWarning(Doubt.UNITS, message))
    return Document(str(path), roads, junctions, controllers, tuple(warnings))


def _assign_junctions(roads: dict[str, Road], junctions: Mapping[str, JunctionRecord]) -> list[MapWarning]:
    """Correct, in `roads`, which junction a road lies in, and return a warning per correction."""
    warnings = []
    for road in list(roads.values()):
        if road.junction is not None and road.junction not in junctions:
            roads[road.id] = replace(road, junction=None)
            message = (
                f"road {road.id!r} says it lies in junction {road.junction!r}, which does not exist; taken as outside of any"
            )
            warnings.append(MapWarning(Doubt.LINK, message, road.id))
    for junction in junctions.values():
        for name in dict.fromkeys(row.connecting for row in junction.connections if junction.made_of_roads):
            connecting = roads.get(name)
            if connecting is None or connecting.junction is not None:
                continue
            if any(link is not None and link.junction for _, link in connecting.contacts):
                message = (
                    f"junction {junction.id!r} names road {connecting.id!r} as connecting, which ends at a junction; "
                    "it was taken as outside"
                )
            else:
                roads[connecting.id] = replace(connecting, junction=junction.id)
                message = f"road {connecting.id!r} connects roads in junction {junction.id!r} but does not say that it lies in it"
            warnings.append(MapWarning(Doubt.TABLE, message, connecting.id, junction.id))
    return warnings


class _RoadReader:
    """Reads a ``<road>`` and collects warnings about it."""

    def __init__(self, element: Element, path: str | os.PathLike[str]) -> None:
        self.element = element
        self.id = element.get("id", "")
        self.place = f"map file {path}, road {element.get('id', '?')!r}"
        self.warnings: list[MapWarning] = []

    def road(self) -> Road:
        """Return the record of the road."""
        element, place = self.element, self.place
        if not self.id:
            raise MapError(f"{place}: <road> has no id")
        length = number(element, "length", place)
        if length < 0:
            raise MapError(f"{place}: length {length:g} m is negative")
        junction = element.get("junction", "-1")
        rule = element.get("rule", "").upper()
        lanes = element.find("lanes")
        links = element.find("link")
        ends = [None if links is None else links.find(tag) for tag in ("predecessor", "successor")]
        before, after = (
            RoadLink(end.get("elementType") == "junction", end.get("elementId", ""), end.get("contactPoint", ""))
            if end is not None and end.get("elementId")
            else None
            for end in ends
        )
        return Road(
            self.id,
            length,
            None if junction in ("-1", "") else junction,
            rule if rule in ("RHT", "LHT") else None,
            tuple(sorted(_shape(geometry, place) for geometry in element.iterfind("planView/geometry"))),
            () if lanes is None else _cubics(lanes, "laneOffset", "s", place),
            () if lanes is None else self._sections(lanes),
            before,
            after,
            tuple(self._signals()),
            any(part.get("type") == "motorway" for part in element.iterfind("type")),
            self._limits([(part, "s", part.find("speed")) for part in element.iterfind("type")]),
            tuple(self._crosswalks()),
            next((part.get("value") for part in element.iterfind("userData") if part.get("code") == ARM), None),
        )

    def _sections(self, lanes: Element) -> tuple[Section, ...]:
        sections = []
        for element in lanes.iterfind("laneSection"):
            table: dict[int, Lane] = {}
            for side in ("left", "right"):
                for lane in map(self._lane, element.iterfind(f"{side}/lane")):
                    twin = table.get(lane.id)
                    if twin is not None:
                        if twin.drivable and lane.drivable:
                            raise MapError(f"{self.place}: a lane section has two lanes with id {twin.id} that are driven on")
                        omitted = twin if lane.drivable else lane
                        message = (
                            f"road {self.id!r} has two lanes with id {twin.id} in one section; "
                            f"the {omitted.type} lane was left out"
                        )
                        self.warnings.append(MapWarning(Doubt.LANE, message, self.id))
                        if omitted is lane:
                            continue
                    table[lane.id] = lane
            sections.append(Section(number(element, "s", self.place), table))
        return tuple(sorted(sections, key=lambda section: section.s))

    def _lane(self, element: Element) -> Lane:
        links = [part for tag in ("predecessor", "successor") for part in element.iterfind(f"link/{tag}")]
        named = [part for part in links if part.get("id")]
        lane = Lane(
            integer(element, "id", self.place),
            element.get("type", "none").lower(),
            _cubics(element, "width", "sOffset", self.place),
            _cubics(element, "border", "sOffset", self.place),
            tuple(integer(part, "id", self.place) for part in named if part.tag == "predecessor"),
            tuple(integer(part, "id", self.place) for part in named if part.tag == "successor"),
            reversed=element.get("direction") == "reversed",
        )
        if not lane.drivable:
            return lane
        if len(named) < len(links):
            message = f"a link of lane {lane.id} of road {self.id!r} names no lane; it was read as if it were absent"
            self.warnings.append(MapWarning(Doubt.LINK, message, self.id))
        return lane._replace(limits=self._limits([(part, "sOffset", part) for part in element.iterfind("speed")]))

    def _limits(self, rows: Sequence[tuple[Element, str, Element | None]]) -> Limits:
        """Return the speed limits of the road or of a lane; an unreadable limit is ignored with a warning.

        A row is the element with the station of a limit, the name of its attribute, and the element with the speed, if any.
        """
        limits = []
        for place, name, speed in rows:
            try:
                limits.append((number(place, name, "its place", 0.0), None if speed is None else limit_of(speed)))
            except MapError as error:
                message = f"a speed limit of road {self.id!r} was ignored: {error}"
                self.warnings.append(MapWarning(Doubt.SPEED, message, self.id))
        return tuple(sorted(limits, key=itemgetter(0)))

    def _signals(self) -> Iterator[Signal]:
        """Yield the signals and stop lines of the road; a broken signal or line is left out with a warning."""
        for element in (*self.element.iterfind("signals/*"), *self.element.iterfind("objects/object")):
            text = " ".join(element.get(n, "") for n in ("name", "type", "subtype")).lower()
            if element.tag not in ("signal", "signalReference") and not any(word in text for word in _STOP_LINE):
                continue
            try:
                yield (_line if element.tag == "object" else _signal)(element, self.id, self.place)
            except MapError as error:
                fault = str(error).removeprefix(f"{self.place}: ")
                message = f"the {element.tag} {element.get('id', '')!r} of road {self.id!r} was left out: {fault}"
                self.warnings.append(MapWarning(Doubt.SIGNAL, message, self.id))

    def _crosswalks(self) -> Iterator[CrosswalkRecord]:
        """Yield the crosswalks of the road; a broken crosswalk is left out with a warning."""
        for element in self.element.iterfind("objects/object"):
            if element.get("type", "").strip().lower() == "crosswalk":
                try:
                    yield _crosswalk(element, self.place)
                except MapError as error:
                    fault = str(error).removeprefix(f"{self.place}: ")
                    message = f"the crosswalk {element.get('id', '')!r} of road {self.id!r} was left out: {fault}"
                    self.warnings.append(MapWarning(Doubt.CROSSWALK, message, self.id))


def _crosswalk(element: Element, place: str) -> CrosswalkRecord:
    """Return the record of a crosswalk: its first outline of three corners or more, else the box of its length and width."""
    s, t, heading = (number(element, name, place, default) for name, default in (("s", None), ("t", 0.0), ("hdg", 0.0)))
    for outline in (*element.iterfind("outline"), *element.iterfind("outlines/outline")):
        for tag, names in (("cornerRoad", ("s", "t")), ("cornerLocal", ("u", "v"))):
            rows = [(number(part, names[0], place), number(part, names[1], place)) for part in outline.iterfind(tag)]
            if len(set(rows)) > 2:
                return CrosswalkRecord(element.get("id", ""), s, t, heading, tuple(rows), tag == "cornerLocal")
    u, v = number(element, "length", place, 0.0) / 2, number(element, "width", place, 0.0) / 2
    if min(u, v) <= 0:
        raise MapError("it has neither an outline of three corners nor a length and a width above 0, expected one of the two")
    return CrosswalkRecord(element.get("id", ""), s, t, heading, ((u, v), (-u, v), (-u, -v), (u, -v)), True)


def _shape(element: Element, place: str) -> Shape:
    part = next((part for kind in _SHAPES if (part := element.find(kind)) is not None), None)
    if part is None:
        raise MapError(f"{place}: a <geometry> has none of {', '.join(_SHAPES)}")
    values = tuple(number(part, name, place, 0.0) for name in _SHAPES[part.tag])
    normalized = part.tag == "paramPoly3" and part.get("pRange", "normalized") != "arcLength"
    length = number(element, "length", place)
    if length < 0:
        raise MapError(f"{place}: a <geometry> has the negative length {length:g} m")
    s, x, y, heading = (number(element, n, place) for n in ("s", "x", "y", "hdg"))
    return Shape(s, x, y, heading, length, part.tag, values, normalized)


def _cubics(parent: Element, tag: str, station: str, place: str) -> tuple[Cubic, ...]:
    rows = [Cubic(*(number(e, n, place, 0.0) for n in (station, "a", "b", "c", "d"))) for e in parent.iterfind(tag)]
    return tuple(sorted(rows, key=lambda row: row.s))


def _line(element: Element, road: str, place: str) -> Signal:
    s, t = number(element, "s", place), number(element, "t", place, 0.0)
    heading, length, width = (number(element, name, place, 0.0) for name in ("hdg", "length", "width"))
    across = (heading, length) if length > width else (heading + math.pi / 2, width)
    lanes = _validity(element, place)
    return Signal(
        element.get("id", ""), road, s, t, element.get("orientation", ""), False, "", "", False, lanes, True, across=across
    )


def _signal(element: Element, road: str, place: str) -> Signal:
    reference = element.tag == "signalReference"
    type = "" if reference else element.get("type", "").strip().lower()
    text = element.get("name", "").lower()
    semantics = element.find("semantics")
    return Signal(
        element.get("id", ""),
        road,
        number(element, "s", place),
        number(element, "t", place, 0.0),
        element.get("orientation", ""),
        reference,
        type,
        element.get("subtype", "").strip().lower(),
        element.get("dynamic", "").lower() in ("yes", "true", "1"),
        _validity(element, place),
        not reference and (type == "294" or any(word in text for word in _STOP_LINE)),
        element.get("country", "").lower(),
        text,
        None if semantics is None else tuple(part.get("type", "").lower() for part in semantics.iterfind("priority")),
    )


def _validity(element: Element, place: str) -> tuple[tuple[int, int], ...]:
    ranges = [(integer(part, "fromLane", place), integer(part, "toLane", place)) for part in element.iterfind("validity")]
    return tuple((min(lanes), max(lanes)) for lanes in ranges)


def _junction(element: Element, place: str) -> JunctionRecord:
    id = element.get("id")
    if not id:
        raise MapError(f"{place}: <junction> has no id")
    rows = []
    for row in element.iterfind("connection"):
        links = tuple((integer(e, "from", place), integer(e, "to", place)) for e in row.iterfind("laneLink") if e.attrib)
        connecting = row.get("connectingRoad") or row.get("linkedRoad") or ""
        rows.append(Connection(row.get("incomingRoad", ""), connecting, row.get("contactPoint", ""), links))
    priorities = [(part.get("high", ""), part.get("low", "")) for part in element.iterfind("priority")]
    return JunctionRecord(
        id,
        element.get("type", "default").lower(),
        tuple(rows),
        tuple(pair for pair in priorities if all(pair)),
        tuple((part.get("id", ""), part.get("crossingRoad", "")) for part in element.iterfind("crossPath")),
    )
