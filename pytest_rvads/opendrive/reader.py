"""Reading the records of an OpenDRIVE file.

Follows ASAM OpenDRIVE 1.4 to 1.8. Ids are strings, elements may stand in any order, stations are sorted here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from xml.etree.ElementTree import Element

from pytest_rvads.errors import MapError
from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.opendrive.records import (
    Connection,
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
from pytest_rvads.opendrive.speeds import stated
from pytest_rvads.opendrive.xmlfile import integer, load, number

__all__ = ["read"]

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
    """Read the records of an OpenDRIVE file.

    Raises:
        MapError: not a readable OpenDRIVE file, a number that is none, an id used twice, or no ``<junction>`` at all. A broken
            sign, light or stop line costs that one only, and a lane that nobody drives on with the id of another one likewise.
    """
    root = load(path)
    warnings: list[MapWarning] = []
    roads: dict[str, Road] = {}
    for element in root.findall("road"):
        road = _road(element, f"map file {path}, road {element.get('id', '?')!r}", warnings)
        if road.id in roads:
            raise MapError(f"map file {path} has two roads with id {road.id!r}, expected unique ids")
        roads[road.id] = road
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
        _check_priorities(junction, roads, warnings)
    _adopt(roads, junctions, warnings)
    _header(root.find("header"), warnings)
    return Document(str(path), roads, junctions, controllers, tuple(warnings))


def _adopt(roads: dict[str, Road], junctions: dict[str, JunctionRecord], warnings: list[MapWarning]) -> None:
    """Put connecting roads into the junction whose table names them, and take roads out of junctions that do not exist.

    A road that a junction follows at one of its ends lies outside, whatever a table says.
    """
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
                what = f"names road {connecting.id!r} as connecting, which ends at a junction; it was taken as outside"
                message = f"junction {junction.id!r} {what}"
                warnings.append(MapWarning(Doubt.TABLE, message, connecting.id, junction.id))
            else:
                roads[connecting.id] = replace(connecting, junction=junction.id)
                message = f"road {connecting.id!r} connects roads in junction {junction.id!r} but does not say that it lies in it"
                warnings.append(MapWarning(Doubt.TABLE, message, connecting.id, junction.id))


def _check_priorities(junction: JunctionRecord, roads: Mapping[str, Road], warnings: list[MapWarning]) -> None:
    for name in dict.fromkeys(name for pair in junction.priorities for name in pair if name not in roads):
        message = f"junction {junction.id!r} states a priority of road {name!r}, which does not exist; that was ignored"
        warnings.append(MapWarning(Doubt.LINK, message, None, junction.id))


def _header(header: Element | None, warnings: list[MapWarning]) -> None:
    if header is None:
        return
    unit = header.get("unit") or header.get("units") or "m"
    for word in (header.findtext("geoReference") or "").split():
        if word.startswith("+units="):
            unit = word.removeprefix("+units=")
    if unit not in ("m", "meter", "metre"):
        message = f"the header names the unit {unit[:20]!r}; coordinates were read in metres, as the standard says"
        warnings.append(MapWarning(Doubt.UNITS, message))


def _road(element: Element, place: str, warnings: list[MapWarning]) -> Road:
    id = element.get("id")
    if not id:
        raise MapError(f"{place}: <road> has no id")
    length = number(element, "length", place)
    if length < 0:
        raise MapError(f"{place}: length {length:g} m is negative")
    junction = element.get("junction", "-1")
    rule = element.get("rule", "").upper()
    lanes = element.find("lanes")
    links = element.find("link")
    return Road(
        id,
        length,
        None if junction in ("-1", "") else junction,
        rule if rule in ("RHT", "LHT") else None,
        tuple(sorted(_shape(g, place) for g in element.iterfind("planView/geometry"))),
        () if lanes is None else _cubics(lanes, "laneOffset", "s", place),
        () if lanes is None else _sections(lanes, id, place, warnings),
        _link(links, "predecessor"),
        _link(links, "successor"),
        tuple(_signals(element, id, place, warnings)),
        any(part.get("type") == "motorway" for part in element.iterfind("type")),
        stated([(part, "s", part.find("speed")) for part in element.iterfind("type")], id, warnings),
    )


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
    rows.sort(key=lambda row: row.s)
    return tuple(rows)


def _sections(lanes: Element, road: str, place: str, warnings: list[MapWarning]) -> tuple[Section, ...]:
    found = []
    for element in lanes.iterfind("laneSection"):
        table: dict[int, Lane] = {}
        for side in ("left", "right"):
            for lane in element.iterfind(f"{side}/lane"):
                new = _lane(lane, road, place, warnings)
                twin = table.get(new.id)
                if twin is not None:
                    if twin.drivable and new.drivable:
                        raise MapError(f"{place}: a lane section has two lanes with id {twin.id} that are driven on")
                    less = twin if new.drivable else new
                    message = f"road {road!r} has two lanes with id {twin.id} in one section; the {less.type} lane was left out"
                    warnings.append(MapWarning(Doubt.LANE, message, road))
                    if less is new:
                        continue
                table[new.id] = new
        found.append(Section(number(element, "s", place), table))
    found.sort(key=lambda section: section.s)
    return tuple(found)


def _lane(element: Element, road: str, place: str, warnings: list[MapWarning]) -> Lane:
    link = element.find("link")
    before, after = (
        () if link is None else tuple(integer(e, "id", place) for e in link.iterfind(tag)) for tag in ("predecessor", "successor")
    )
    return Lane(
        integer(element, "id", place),
        element.get("type", "none").lower(),
        _cubics(element, "width", "sOffset", place),
        _cubics(element, "border", "sOffset", place),
        before,
        after,
        reversed=element.get("direction") == "reversed",
        limits=stated([(part, "sOffset", part) for part in element.iterfind("speed")], road, warnings),
    )


def _link(links: Element | None, tag: str) -> RoadLink | None:
    element = None if links is None else links.find(tag)
    if element is None or not element.get("elementId"):
        return None
    return RoadLink(element.get("elementType") == "junction", element.get("elementId", ""), element.get("contactPoint", ""))


def _signals(road: Element, id: str, place: str, warnings: list[MapWarning]) -> Iterator[Signal]:
    """Yield the signals and stop lines of a road; a broken one is left out, with a warning."""
    for element in (*road.iterfind("signals/*"), *road.iterfind("objects/object")):
        text = " ".join(element.get(n, "") for n in ("name", "type", "subtype")).lower()
        if element.tag not in ("signal", "signalReference") and not any(word in text for word in _STOP_LINE):
            continue
        try:
            yield _line(element, id, place) if element.tag == "object" else _signal(element, id, place)
        except MapError as error:
            what = str(error).removeprefix(f"{place}: ")
            message = f"the {element.tag} {element.get('id', '')!r} of road {id!r} was left out: {what}"
            warnings.append(MapWarning(Doubt.SIGNAL, message, id))


def _line(element: Element, road: str, place: str) -> Signal:
    s, t = number(element, "s", place), number(element, "t", place, 0.0)
    lanes = _validity(element, place)
    return Signal(element.get("id", ""), road, s, t, element.get("orientation", ""), False, "", "", False, lanes, True)


def _signal(element: Element, road: str, place: str) -> Signal:
    reference = element.tag == "signalReference"
    type = "" if reference else element.get("type", "").strip().lower()
    text = element.get("name", "").lower()
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
    )


def _validity(element: Element, place: str) -> tuple[tuple[int, int], ...]:
    ranges = []
    for part in element.iterfind("validity"):
        one, two = integer(part, "fromLane", place), integer(part, "toLane", place)
        ranges.append((min(one, two), max(one, two)))
    return tuple(ranges)


def _junction(element: Element, place: str) -> JunctionRecord:
    id = element.get("id")
    if not id:
        raise MapError(f"{place}: <junction> has no id")
    rows = []
    for row in element.iterfind("connection"):
        links = tuple((integer(e, "from", place), integer(e, "to", place)) for e in row.iterfind("laneLink"))
        connecting = row.get("connectingRoad") or row.get("linkedRoad") or ""
        rows.append(Connection(row.get("incomingRoad", ""), connecting, row.get("contactPoint", ""), links))
    stated = [(part.get("high", ""), part.get("low", "")) for part in element.iterfind("priority")]
    return JunctionRecord(id, element.get("type", "default").lower(), tuple(rows), tuple(pair for pair in stated if all(pair)))
