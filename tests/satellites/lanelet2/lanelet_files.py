"""Lanelet2 files written by the tests: a crossing of four roads, and pieces to add."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

Point = tuple[float, float]


class Osm:
    """A Lanelet2 file with coordinates in the tags local_x and local_y."""

    def __init__(self) -> None:
        self.root = Element("osm", version="0.6")
        self.nodes: dict[Point, str] = {}
        self.elements: dict[str, Element] = {}

    def _element(self, tag: str, tags: dict[str, str]) -> str:
        id = str(len(self.elements) + 1)
        self.elements[id] = SubElement(self.root, tag, id=id)
        for key, value in tags.items():
            SubElement(self.elements[id], "tag", k=key, v=value)
        return id

    def node(self, point: Point) -> str:
        place = round(point[0], 6), round(point[1], 6)
        if place not in self.nodes:
            self.nodes[place] = self._element("node", {"local_x": repr(place[0]), "local_y": repr(place[1])})
        return self.nodes[place]

    def way(self, points: Iterable[Point], **tags: str) -> str:
        nodes = [self.node(point) for point in points]
        id = self._element("way", tags)
        for node in nodes:
            SubElement(self.elements[id], "nd", ref=node)
        return id

    def relation(self, members: Sequence[tuple[str, str]], **tags: str) -> str:
        """Add a relation of (role, id of a way or relation)."""
        id = self._element("relation", tags)
        for role, ref in members:
            SubElement(self.elements[id], "member", type=self.elements[ref].tag, ref=ref, role=role)
        return id

    def lanelet(self, left: str | Sequence[str], right: str | Sequence[str], **tags: str) -> str:
        members = [
            (role, way)
            for role, ways in (("left", left), ("right", right))
            for way in ([ways] if isinstance(ways, str) else ways)
        ]
        return self.relation(members, **{"type": "lanelet", "subtype": "road", "one_way": "yes"} | tags)

    def regulate(self, subtype: str, members: Sequence[tuple[str, str]], referring: Iterable[str] = (), **tags: str) -> str:
        """Add a regulatory element and let lanelets refer to the element."""
        id = self.relation(members, type="regulatory_element", subtype=subtype, **tags)
        for lanelet in referring:
            SubElement(self.elements[lanelet], "member", type="relation", ref=id, role="regulatory_element")
        return id

    def change(self, id: str, key: str, value: str) -> None:
        SubElement(self.elements[id], "tag", k=key, v=value)

    def drop(self, id: str) -> None:
        self.root.remove(self.elements[id])

    def turn(self, way: str) -> None:
        """Reverse the nodes of a way."""
        refs = [nd.get("ref") for nd in self.elements[way].iter("nd")]
        for nd, ref in zip(self.elements[way].iter("nd"), reversed(refs), strict=True):
            nd.set("ref", ref)

    def write(self, path: Path) -> Path:
        path.write_bytes(tostring(self.root))
        return path


class Crossing(Osm):
    """A crossing of four roads, 50 m long, with one lane of 3.5 m per direction; road 0 lies in the east, road 1 in the north."""

    def __init__(self, *, left_hand: bool = False) -> None:
        super().__init__()
        side = -1.0 if left_hand else 1.0
        self.middles: list[str] = []
        self.entries: list[str] = []
        self.exits: list[str] = []
        self.movements: dict[tuple[int, int], str] = {}
        """Lanelet by number of the road in and of the road out."""
        kerb = {}
        for k in range(4):
            middle = self.way([place(k, 60.0, 0.0), place(k, 10.0, 0.0)], type="line_thin")
            kerb[k] = [self.way([place(k, 60.0, side * at), place(k, 10.0, side * at)], type="road_border") for at in (3.5, -3.5)]
            self.middles.append(middle)
            # Seen outwards, traffic that keeps right comes in on the left.
            sides = [(middle, kerb[k][0]), (middle, kerb[k][1])]
            pairs = [pair[::-1] if left_hand else pair for pair in sides]
            self.entries.append(self.lanelet(*pairs[0]))
            self.exits.append(self.lanelet(*pairs[1]))
        for k in range(4):
            for turn in (1, 2, 3):
                end = (k + turn) % 4
                lines = curve(k, end, 0.0, 0.0), curve(k, end, side * 3.5, -side * 3.5)
                ways = [self.way(line, type="virtual") for line in lines]
                self.movements[k, end] = self.lanelet(*(ways[::-1] if left_hand else ways))

    def line(self, road: int, distance: float) -> str:
        """Add a stop line across the lane in, at a distance before the junction [m]."""
        return self.way([place(road, 10.0 + distance, 0.2), place(road, 10.0 + distance, 3.3)], type="stop_line")


def place(road: int, out: float, aside: float) -> Point:
    """Return the point at a distance from the centre on a road, and to the left seen outwards."""
    angle = road * math.pi / 2
    return math.cos(angle) * out - math.sin(angle) * aside, math.sin(angle) * out + math.cos(angle) * aside


def curve(road: int, end: int, aside: float, aside_out: float) -> list[Point]:
    """Return a parabola from a road to a road."""
    start, goal = place(road, 10.0, aside), place(end, 10.0, aside_out)
    if (road - end) % 2 == 0:
        return [start, goal]
    # The tangents meet where the coordinates of the one cross those of the other.
    corner = (start[0], goal[1]) if road % 2 else (goal[0], start[1])
    return [
        (
            (1 - t) ** 2 * start[0] + 2 * t * (1 - t) * corner[0] + t**2 * goal[0],
            (1 - t) ** 2 * start[1] + 2 * t * (1 - t) * corner[1] + t**2 * goal[1],
        )
        for t in (k / 8 for k in range(9))
    ]
