"""Reading a Lanelet2 file (``.osm``): OpenStreetMap XML 0.6, its lanelets and its regulatory elements.

Coordinates are the tags ``local_x`` and ``local_y`` if all nodes of ways have them. Else, if all latitudes and longitudes lie
near 0, they are metres of a data set, written in UTM zone 31 with (0, 0) as origin. Else they are projected about their median.
"""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import ObjectKind
from pytest_rvads.geometry.network import Doubt, MapWarning, Network, PaintedCrosswalk
from pytest_rvads.geometry.opendrive.builder import MAX_SAMPLES
from pytest_rvads.geometry.opendrive.map_file import MAX_BYTES, speed_of
from pytest_rvads.geometry.opendrive.signals import STANDARD
from pytest_rvads.satellites.lanelet2.lanelet_areas import Ground, listed
from pytest_rvads.satellites.lanelet2.lanelet_network import Regulation, Rules, network_of
from pytest_rvads.satellites.lanelet2.lanelets import (
    Bound,
    Lanelet,
    aligned,
    crosswalk_of,
    link_lanelets,
    turned,
    with_centre_lines,
)
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.storage import XmlError, number_in, open_file, read_xml
from pytest_rvads.support.wording import one_line, plural

MAX_ELEMENTS = 3_000_000
"""Most elements of a file that are read; a file of 20 MB has 400,000."""
_ID = re.compile(r"[\w.+-]{1,60}")
_EQUATOR, _FLATTENING = 6_378_137.0, 1 / 298.257223563
"""Radius of the equator [m] and flattening of the ellipsoid of WGS 84."""
_UTM_SCALE, _UTM_31 = 0.9996, 3.0
"""Scale of UTM, and longitude of the middle of its zone 31 [degrees]."""

Array = NDArray[np.float64]
Start = Callable[[str, dict[str, str], int], None]


@dataclass(frozen=True, slots=True)
class Way:
    """A way: consecutive nodes that the file has."""

    nodes: tuple[str, ...]
    tags: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Relation:
    """A relation, such as a lanelet or a regulatory element."""

    members: tuple[tuple[str, str, str], ...]
    """Type (``node``, ``way`` or ``relation``), id and role of every member."""
    tags: Mapping[str, str]

    def refs(self, role: str, type: str) -> list[str]:
        """Return the ids of the members of a type that have a role, in file order."""
        return [ref for kind, ref, own_role in self.members if (kind, own_role) == (type, role)]


@dataclass(frozen=True, slots=True, eq=False)
class OsmMap:
    """The content of a file; elements that an editor marked as deleted are left out."""

    points: Mapping[str, Array]
    """Plane coordinates of the nodes of ways, shape ``(2,)`` [m]."""
    ways: Mapping[str, Way]
    relations: Mapping[str, Relation]
    origin: tuple[float, float] | None = None
    """Latitude and longitude about which the coordinates are projected [degrees]; None for coordinates that are metres."""

    def line(self, way: str) -> Array | None:
        """Return the points of a way, shape ``(k, 2)`` [m]; None for a missing way or fewer than two nodes."""
        nodes = self.ways[way].nodes if way in self.ways else ()
        return np.array([self.points[node] for node in nodes]) if len(nodes) > 1 else None


class _Builder:
    """Collects nodes, ways and relations from the events of the parser."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.count = 0
        self.nodes: dict[str, tuple[str, str, str, str]] = {}
        """Per node its latitude, longitude, local_x and local_y, as written."""
        self.ways: dict[str, Way] = {}
        self.relations: dict[str, Relation] = {}
        self._attributes: dict[str, str] = {}
        self._tags: dict[str, str] = {}
        self._nodes: list[str] = []
        self._members: list[tuple[str, str, str]] = []

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise MapError(f"{self.name} has more than {MAX_ELEMENTS:,} elements; cut the map into pieces")
        if self.count == 1 and tag != "osm":
            raise MapError(f"{self.name} is not a Lanelet2 file: its root element is <{one_line(tag, 40)}>, expected <osm>")
        if tag in ("node", "way", "relation"):
            if not _ID.fullmatch(attributes.get("id", "")):
                raise MapError(
                    f"{self.name}, row {row}: the id of a <{tag}> must have 1 to 60 letters, digits and signs, "
                    f"got {attributes.get('id', '')[:40]!r}"
                )
            self._attributes, self._tags, self._nodes, self._members = attributes, {}, [], []
        elif tag == "tag":
            self._tags[attributes.get("k", "")] = attributes.get("v", "")
        elif tag == "nd":
            self._nodes.append(attributes.get("ref", ""))
        elif tag == "member":
            self._members.append((attributes.get("type", ""), attributes.get("ref", ""), attributes.get("role", "")))

    def end(self, tag: str) -> None:
        own, tags = self._attributes, self._tags
        if own.get("action") == "delete" or own.get("visible") == "false":
            return
        if tag == "node":
            self.nodes[own["id"]] = own.get("lat", ""), own.get("lon", ""), tags.get("local_x", ""), tags.get("local_y", "")
        elif tag == "way":
            self.ways[own["id"]] = Way(tuple(self._nodes), tags)
        elif tag == "relation":
            self.relations[own["id"]] = Relation(tuple(self._members), tags)


def parsed(
    path: str | os.PathLike[str], expected: str, start: Start, end: Callable[[str], None], **text: Callable[[str], None]
) -> None:
    """Read an XML file of bounded size and call a function for each element, see `pytest_rvads.support.storage.read_xml`."""
    try:
        with open_file(Path(path)) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > MAX_BYTES:
                raise MapError(f"map file {path} has {size / 2**20:.0f} MB, more than the {MAX_BYTES // 2**20} MB that are read")
            read_xml(iter(lambda: stream.read(2**18), b""), expected, start, end, **text)
    except XmlError as error:
        raise MapError(f"map file {path}: {error}") from None
    except (OSError, ValueError, TypeError) as error:
        raise MapError(f"map file {path} cannot be read: {error}, expected {expected}") from None


def read_osm(path: str | os.PathLike[str]) -> OsmMap:
    """Read a file of OpenStreetMap XML; nodes without coordinates are left out of the ways."""
    builder = _Builder(f"map file {path}")
    parsed(path, "a Lanelet2 file (.osm)", builder.start, builder.end)
    names = [id for id in dict.fromkeys(node for way in builder.ways.values() for node in way.nodes) if id in builder.nodes]
    written = np.array([[number_in(text) for text in builder.nodes[id]] for id in names]).reshape(-1, 4)
    written[~(np.abs(written) <= 1e8)] = np.nan
    local = written[:, 2:]
    metres = bool(len(names)) and bool(np.isfinite(local).all())
    plane = local if metres else projected(written[:, 0], written[:, 1])
    points = {id: point for id, point in zip(names, plane, strict=True) if np.isfinite(point).all()}
    ways = {id: Way(tuple(node for node in way.nodes if node in points), way.tags) for id, way in builder.ways.items()}
    return OsmMap(points, ways, builder.relations, None if metres else _located(written[:, 0], written[:, 1])[2])


def projected(latitude: Array, longitude: Array) -> Array:
    """Return the plane coordinates, shape ``(k, 2)`` [m], of points on the earth, shape ``(k,)`` [degrees]; NaN if unknown.

    The coordinates are those of UTM zone 31 minus those of (0, 0) if all points lie within 0.1 degrees of (0, 0), else those of a
    transverse Mercator projection about the median point.
    """
    valid, places, origin = _located(latitude, longitude)
    points = np.full((len(latitude), 2), np.nan)
    if not valid.any():
        return points
    if origin is None:
        points[valid] = _UTM_SCALE * (mercator(places, _UTM_31) - mercator(np.zeros((1, 2)), _UTM_31))
    else:
        near = (np.abs(places - origin) < 3.0).all(axis=1)  # the width of half a zone of UTM
        flat = np.full(places.shape, np.nan)
        flat[near] = mercator(places[near], origin[1]) - mercator(np.array([origin]), origin[1])
        points[valid] = flat
    return points


def _located(latitude: Array, longitude: Array) -> tuple[NDArray[np.bool_], Array, tuple[float, float] | None]:
    """Return which points lie on the earth, their places ``(points, 2)`` and the median place: latitudes, longitudes [degrees].

    The median is None if there are no such points, or if latitudes and longitudes are metres of a data set.
    """
    valid = (np.abs(latitude) <= 89.0) & (np.abs(longitude) <= 180.0)
    places = np.column_stack((latitude[valid], longitude[valid]))
    if not len(places) or (np.abs(places) < 0.1).all():  # metres of a data set
        return valid, places, None
    north, east = np.median(places, axis=0).tolist()
    return valid, places, (north, east)


def plane_of_utm(origin: tuple[float, float]) -> tuple[complex, complex]:
    """Return the similarity from UTM coordinates to the plane about a place, for points within some kilometres of the place.

    A point ``east + north * 1j`` of UTM [m], in the zone of the place, lies at ``turn * (point - utm)`` in the plane [m]. Both
    projections are conformal, so within 1 km the similarity is exact to some millimetres. `origin` is in degrees.
    """
    latitude, longitude = origin
    places = np.array([origin, (latitude + 0.001, longitude)])
    east, north = 500_000.0, 0.0 if latitude >= 0.0 else 10_000_000.0
    utm, utm_north = _UTM_SCALE * mercator(places, 6.0 * np.floor(longitude / 6.0) + 3.0) @ [1.0, 1j] + complex(east, north)
    plane, plane_north = mercator(places, longitude) @ [1.0, 1j]
    return complex((plane_north - plane) / (utm_north - utm)), complex(utm)


def mercator(places: Array, middle: float) -> Array:
    """Return transverse Mercator coordinates of scale 1, shape ``(k, 2)`` [m], by Krüger's series (Karney 2011, eqs. 7 to 12).

    `places` are latitudes and longitudes, shape ``(k, 2)``; `middle` is the longitude of the middle meridian [degrees].
    """
    latitude, longitude = np.radians(places[:, 0]), np.radians(places[:, 1] - middle)
    n = _FLATTENING / (2 - _FLATTENING)
    radius = _EQUATOR / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    series = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    eccentricity = 2 * np.sqrt(n) / (1 + n)
    t = np.sinh(np.arctanh(np.sin(latitude)) - eccentricity * np.arctanh(eccentricity * np.sin(latitude)))
    north = np.arctan2(t, np.cos(longitude))
    east = np.arctanh(np.sin(longitude) / np.sqrt(1 + t**2))
    x, y = east.copy(), north.copy()
    for j, factor in enumerate(series, 1):
        x += factor * np.cos(2 * j * north) * np.sinh(2 * j * east)
        y += factor * np.sin(2 * j * north) * np.cosh(2 * j * east)
    return radius * np.column_stack((x, y))


_DRIVABLE = frozenset({"", "road", "highway", "play_street", "exit"})
"""Subtypes of lanelets for cars."""
_NOT_DRIVABLE = frozenset(
    {"crosswalk", "walkway", "shared_walkway", "stairs", "bicycle_lane", "bus_lane", "emergency_lane", "rail", "road_shoulder"}
    | {"pedestrian_lane", "parking", "border", "without subtype", *_DRIVABLE}
)
"""Subtypes of lanelets that no car drives on; a lanelet of a subtype for cars is left out if its participants say so."""
_LEFT = frozenset(
    "ag ai au bb bd bm bn bs bt bw cc ck cx cy dm fj fk gb gd gg gy hk id ie im in jm je jp ke ki kn ky lc lk ls mo ms mt "  # noqa: SIM905 - a list has a line per code
    "mu mv mw my mz na nf np nr nu nz pg pk pn sb sc sg sh sr sz tc th tk tl to tt tv tz ug uk vc vg vi ws za zm zw".split()
)
"""Codes of the regions where traffic keeps left (ISO 3166-1 and ``uk``)."""
_YES, _NO = frozenset({"yes", "true", "1"}), frozenset({"no", "false", "0"})


def read_lanelet2(path: str | os.PathLike[str]) -> Network:
    """Return the network of a Lanelet2 file."""
    osm = read_osm(path)
    try:
        return _Reader(osm).network()
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None


class _Reader:
    """Reads the lanelets and regulatory elements of a file, and collects warnings."""

    def __init__(self, osm: OsmMap) -> None:
        self.osm = osm
        self.warnings: list[MapWarning] = []
        self.left_out: defaultdict[str, list[str]] = defaultdict(list)
        """Per reason, the ids of lanelets that are left out."""
        self.nodes = 0
        """Number of nodes of the bounds that were read, a node once per bound."""
        self.crosswalks: list[PaintedCrosswalk] = []
        self.others: Counter[str] = Counter()
        """Per subtype that no car drives on, the number of lanelets."""
        self.referring: defaultdict[str, list[str]] = defaultdict(list)
        """Per regulatory element, the lanelets that refer to the element."""
        self.elements = {id: item for id, item in osm.relations.items() if item.tags.get("type") == "regulatory_element"}
        self.relations = {id: item for id, item in osm.relations.items() if item.tags.get("type") == "lanelet"}

    def network(self) -> Network:
        """Return the network of the file."""
        if not self.relations:
            raise MapError(
                f"it has {plural(len(self.osm.ways), 'way')} but no lanelet, as an extract of OpenStreetMap or a map of a "
                "parking lot, expected relations with the tag type=lanelet; convert it to Lanelet2 first"
            )
        for id, relation in self.relations.items():
            for element in relation.refs("regulatory_element", "relation"):
                self.referring[element].append(id)
        lanes, short = with_centre_lines(chain.from_iterable(self._lanelets(id, item) for id, item in self.relations.items()))
        self.left_out["have no length"] += short
        for reason, ids in self.left_out.items():
            if ids:
                self.warnings.append(MapWarning(Doubt.LANE, f"lanelets that {reason} were left out: {listed(ids)}"))
        strange = Counter({subtype: count for subtype, count in (+self.others).items() if subtype not in _NOT_DRIVABLE})
        for which, table in (("that no car drives on", self.others - strange), ("of an unknown subtype", strange)):
            if table:
                counts = ", ".join(f"{count} {one_line(subtype, 40)}" for subtype, count in table.most_common(10))
                self.warnings.append(MapWarning(Doubt.LANE, f"lanelets {which} were left out: {counts}"))
        rules = self._rules(lanes)
        regions = Counter(region for item in self.relations.values() if (region := item.tags.get("region", "").lower()[:2]))
        hand = next(("left" if name in _LEFT else "right" for name, _ in regions.most_common(1)), None)
        return network_of(Ground(lanes, link_lanelets(lanes), region=hand), rules, self.warnings, len(self.relations))

    def _lanelets(self, id: str, relation: Relation) -> Iterator[Lanelet]:
        """Yield the lanelets of a relation: none for a broken lanelet or one without cars, two for a two-way lanelet."""
        tags = relation.tags
        bounds = [self._bound(relation.refs(role, "way")) for role in ("left", "right")]
        # Whether cars drive on the lanelet: by the tags ``participant:*`` if there are any, else by the subtype.
        if any(key.startswith("participant:") for key in tags):
            for_cars = any(tags.get(key) in _YES for key in ("participant:vehicle", "participant:vehicle:car"))
        else:
            for_cars = tags.get("subtype", "") in _DRIVABLE
        if not for_cars:
            lines = [bound.points for bound in bounds if bound is not None]
            crosswalk = crosswalk_of(id, lines) if tags.get("subtype") == "crosswalk" and len(lines) == 2 else None
            self.crosswalks += [crosswalk] if crosswalk else []
            self.others[tags.get("subtype", "") or "without subtype"] += crosswalk is None
            return
        if bounds[0] is None or bounds[1] is None:
            self.left_out["have a bound with fewer than two points or of ways that do not meet"].append(id)
            return
        left, right = aligned(bounds[0], bounds[1])
        # The speed limit is a tag of the lanelet, or that of a regulatory element.
        elements = [self.elements[ref] for ref in relation.refs("regulatory_element", "relation") if ref in self.elements]
        signs = [item.tags.get("sign_type", "") for item in elements if item.tags.get("subtype") == "speed_limit"]
        text = tags.get("speed_limit") or next(filter(None, signs), "")
        limit: float | None = None
        try:
            if text:
                limit = speed_of(text.strip() if re.search("[a-zA-Z]", text) else f"{text.strip()} km/h", "it")
        except MapError as error:
            self.warnings.append(MapWarning(Doubt.SPEED, f"the speed limit of lanelet {id!r} was ignored: {error}", id))
        turn = tags.get("turn_direction", "")
        lanelet = Lanelet(id, id, left, right, limit, area=tags.get("intersection_area"), turn=turn)
        yield lanelet
        if tags.get("one_way") in _NO:
            yield turned(lanelet)

    def _bound(self, ways: Sequence[str]) -> Bound | None:
        """Return a bound of one or several ways, joined at shared end nodes; None if the ways do not meet."""
        lines = {way: self.osm.ways[way].nodes for way in ways if way in self.osm.ways and len(self.osm.ways[way].nodes) > 1}
        if not lines or len(lines) < len(ways):
            return None
        users: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for name, line in reversed(lines.items()):
            users[line[0]][name] = users[line[-1]][name] = None
        name = next(iter(lines))
        nodes, order = [lines[name][0]], list[tuple[str, bool]]()
        for _ in range(2):  # the bound is continued at its end, then at its beginning
            while users[nodes[-1]]:
                name, _ = users[nodes[-1]].popitem()
                line = lines.pop(name)
                for end in (line[0], line[-1]):
                    users[end].pop(name, None)
                along = line[0] == nodes[-1]
                nodes += (line if along else line[::-1])[1:]
                order.append((name, along))
            nodes, order = nodes[::-1], [(name, not along) for name, along in reversed(order)]
        if lines:
            return None
        self.nodes += len(nodes)
        if self.nodes > MAX_SAMPLES:
            raise MapError(f"the bounds of its lanelets have more than {MAX_SAMPLES:,} nodes; cut the map into pieces")
        points = np.array([self.osm.points[node] for node in nodes])
        points = points[np.append(True, (points[1:] != points[:-1]).any(axis=1))]
        return Bound(points, nodes[0], nodes[-1], tuple(order)) if len(points) > 1 else None

    def _rules(self, lanes: dict[str, Lanelet]) -> Rules:
        """Return the lights, signs and stop lines of the regulatory elements."""
        rules = Rules(crosswalks=self.crosswalks)
        lines = [id for id, way in self.osm.ways.items() if way.tags.get("type") == "stop_line"]
        unknown: Counter[str] = Counter()
        for id, element in self.elements.items():
            subtype = element.tags.get("subtype", "")
            own_lines = tuple(element.refs("ref_line", "way"))
            referring = self.referring[id]
            drivable = tuple(source for source in referring if source in lanes)
            shown = [self.osm.ways[way].tags.get("subtype", "") for way in element.refs("refers", "way") if way in self.osm.ways]
            kinds = [STANDARD.get(re.sub("^(us|de)", "", sign.lower())) for sign in shown]
            if subtype == "traffic_light":
                if drivable or not referring:  # a light that only crosswalks refer to is for pedestrians
                    rules.regulations.append(Regulation(id, ObjectKind.LIGHT, drivable, own_lines))
            elif subtype == "all_way_stop":
                yielding = tuple(element.refs("yield", "relation")) or drivable
                rules.regulations.append(Regulation(id, ObjectKind.STOP, yielding, own_lines))
            elif subtype == "right_of_way":
                prior, yielding = (tuple(element.refs(role, "relation")) for role in ("right_of_way", "yield"))
                sign = ObjectKind.STOP if ObjectKind.STOP in kinds else ObjectKind.YIELD
                rules.regulations.append(Regulation(id, sign, yielding, own_lines, prior=prior))
            elif subtype == "traffic_sign":
                rules.regulations += [Regulation(id, kind, drivable, own_lines) for kind in dict.fromkeys(filter(None, kinds))]
            elif subtype not in ("speed_limit", "road_marking", "crosswalk"):
                unknown[subtype or "without subtype"] += 1
                continue
            lines += own_lines
        if unknown:
            counts = ", ".join(f"{count} {subtype}" for subtype, count in unknown.most_common())
            message = f"regulatory elements that say nothing about junctions were left out: {counts}"
            self.warnings.append(MapWarning(Doubt.SIGNAL, message))
        rules.lines = {id: line for id in dict.fromkeys(lines) if (line := self.osm.line(id)) is not None}
        return rules
