"""OpenStreetMap XML 0.6, the format of Lanelet2 files: nodes with plane coordinates, ways and relations.

Coordinates are the tags ``local_x`` and ``local_y`` if all nodes of ways have them. Else, if all latitudes and longitudes lie
near 0, they are metres of a data set, written in UTM zone 31 with (0, 0) as origin. Else they are projected about their median.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.opendrive.map_file import MAX_BYTES
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.storage import XmlError, number_in, open_file, read_xml
from pytest_rvads.support.wording import one_line

MAX_ELEMENTS = 3_000_000
"""Most elements of a file that are read; a file of 20 MB has 400,000."""
_ID = re.compile(r"[\w.+-]{1,60}")
_CHUNK = 2**18
_DATA_SET = 0.1
"""Largest latitude and longitude of a file in the metres of a data set [degrees]."""
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
            read_xml(iter(lambda: stream.read(_CHUNK), b""), expected, start, end, **text)
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
    if not len(places) or (np.abs(places) < _DATA_SET).all():
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
