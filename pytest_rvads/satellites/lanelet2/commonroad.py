"""Reading a CommonRoad file (``.xml``, versions 2018b and 2020a): its lanelets, intersections, signs and lights.

OpenDRIVE files with the suffix ``.xml`` are read as OpenDRIVE.
"""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Iterator
from xml.etree.ElementTree import Element, TreeBuilder

import networkx as nx
import numpy as np

from pytest_rvads.geometry.control import ObjectKind
from pytest_rvads.geometry.network import Doubt, MapWarning, Network, PaintedCrosswalk
from pytest_rvads.geometry.opendrive.builder import read_network
from pytest_rvads.geometry.opendrive.map_file import speed_of
from pytest_rvads.geometry.opendrive.signals import STANDARD
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.satellites.lanelet2.lanelet_areas import Ground, listed
from pytest_rvads.satellites.lanelet2.lanelet_map import MAX_ELEMENTS, parsed
from pytest_rvads.satellites.lanelet2.lanelet_network import Regulation, Rules, network_of
from pytest_rvads.satellites.lanelet2.lanelets import Array, Bound, Lanelet, aligned, crosswalk_of, turned, with_centre_lines
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.storage import number_in
from pytest_rvads.support.wording import one_line

_SKIPPED = frozenset(
    {"dynamicObstacle", "staticObstacle", "environmentObstacle", "phantomObstacle", "obstacle", "planningProblem"}
)
"""Elements that are no part of the map."""
_NOT_DRIVABLE = frozenset({"crosswalk", "sidewalk", "bicycleLane", "busLane", "restricted"})
"""Types of lanelets that cars do not drive on."""
_LIMIT_SIGNS = frozenset({"274", "R2-1"})
"""Signs of a speed limit: StVO, annex 2; MUTCD 2B.13."""
_ARROWS = {"left": [Turn.LEFT], "straight": [Turn.STRAIGHT], "right": [Turn.RIGHT]}
"""Per direction of a light, the turns that the light regulates; other directions give no arrow."""


class _OtherFormatError(Exception):
    """The file is an OpenDRIVE file."""


class _Builder:
    """Builds the tree of the map without obstacles and planning problems."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.tree = TreeBuilder()
        self._count = self._skipping = 0

    def start(self, tag: str, attributes: dict[str, str], _row: int) -> None:
        self._count += 1
        if self._count > MAX_ELEMENTS:
            raise MapError(f"{self.name} has more than {MAX_ELEMENTS:,} elements; cut the map into pieces")
        if self._count == 1 and tag.rpartition(":")[2] == "OpenDRIVE":
            raise _OtherFormatError
        if self._count == 1 and tag != "commonRoad":
            raise MapError(
                f"{self.name} is not a map: its root element is <{one_line(tag, 40)}>, expected <commonRoad> or <OpenDRIVE>"
            )
        if self._skipping or tag in _SKIPPED:
            self._skipping += 1
        else:
            self.tree.start(tag, attributes)

    def end(self, tag: str) -> None:
        if self._skipping:
            self._skipping -= 1
        else:
            self.tree.end(tag)

    def text(self, text: str) -> None:
        if not self._skipping:
            self.tree.data(text)


def read_commonroad(path: str | os.PathLike[str]) -> Network:
    """Return the network of a CommonRoad file, or of an OpenDRIVE file."""
    builder = _Builder(f"map file {path}")
    try:
        parsed(path, "a CommonRoad file (.xml)", builder.start, builder.end, text=builder.text)
    except _OtherFormatError:
        return read_network(path)
    try:
        return _Reader(builder.tree.close()).network()
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None


class _Reader:
    """Reads the lanelets of a file, and collects warnings."""

    def __init__(self, root: Element) -> None:
        self.root = root
        self.warnings: list[MapWarning] = []
        self.elements = {id: element for element in root.iterfind("lanelet") if (id := element.get("id"))}
        self.signs = {element.get("id", ""): element for element in root.iterfind("trafficSign")}
        self.left_out: list[str] = []
        self.exchanged: list[str] = []
        """Ids of lanelets whose left bound lies on the right."""
        self.crosswalks: list[PaintedCrosswalk] = []
        self.others: Counter[str] = Counter()
        """Per type that no car drives on, the number of lanelets."""

    def network(self) -> Network:
        """Return the network of the file."""
        lanes, short = with_centre_lines(lane for id, element in self.elements.items() for lane in self._lanelets(id, element))
        self.left_out += short
        for kind, ids, message in (
            (Doubt.LANE, self.left_out, "without length or with a bound of fewer than two points were left out"),
            (Doubt.SIDE, self.exchanged, "whose left bound lies on the right were read with left and right exchanged"),
        ):
            if ids:
                self.warnings.append(MapWarning(kind, f"lanelets {message}: {listed(ids)}"))
        if +self.others:
            counts = ", ".join(f"{count} {name}" for name, count in (+self.others).most_common())
            self.warnings.append(MapWarning(Doubt.LANE, f"lanelets that no car drives on were left out: {counts}"))

        stated, outside = {}, set()
        for intersection in self.root.iterfind("intersection"):
            refs = [element.get("ref", "") for element in intersection.iter() if element.tag.startswith("successors")]
            if inside := [ref for ref in dict.fromkeys(refs) if ref in lanes]:
                stated[intersection.get("id", "")] = inside
            outside |= {element.get("ref", "") for element in intersection.iterfind("incoming/incomingLanelet")}
        links = nx.DiGraph()
        links.add_nodes_from(lanes)
        for id, element in self.elements.items():
            pairs = [(id, part.get("ref", "")) for part in element.iterfind("successor")]
            pairs += [(part.get("ref", ""), id) for part in element.iterfind("predecessor")]
            for before, after in pairs:
                for pair in ((before, after), (f"{after}:back", f"{before}:back")):
                    if pair[0] in lanes and pair[1] in lanes and pair[0] != pair[1]:
                        links.add_edge(*pair)
        ground = Ground(lanes, links, stated, outside)
        return network_of(ground, self._rules(lanes), self.warnings, len(self.elements))

    def _lanelets(self, id: str, element: Element) -> Iterator[Lanelet]:
        """Yield the lanelets of an element: none for a broken lanelet or one without cars, two for a two-way lanelet."""
        types = {(part.text or "").strip() for part in element.iterfind("laneletType")}
        lines = [_points(element.find(name)) for name in ("leftBound", "rightBound")]
        if _NOT_DRIVABLE & types:
            crosswalk = crosswalk_of(id, lines) if "crosswalk" in types else None
            self.crosswalks += [crosswalk] if crosswalk else []
            self.others[min(_NOT_DRIVABLE & types)] += crosswalk is None
            return
        if min(map(len, lines)) < 2:
            self.left_out.append(id)
            return
        bounds = []
        for points in lines:
            # A bound is named after its ends to a decimetre.
            first, last = (tuple(np.round(points[k], 1).tolist()) for k in (0, -1))
            bounds.append(Bound(points, first, last, ((f"{min(first, last)} {max(first, last)}", first <= last),)))
        left, right = bounds
        if all(one.first == other.last for one, other in zip(aligned(left, right), (left, right), strict=True)):
            left, right = right, left
            self.exchanged.append(id)
        texts: list[str] = []
        for ref in dict.fromkeys(part.get("ref", "") for part in element.iter("trafficSignRef")):
            signs = self.signs[ref].iterfind("trafficSignElement") if ref in self.signs else ()
            limits = (sign for sign in signs if (sign.findtext("trafficSignID") or "").strip() in _LIMIT_SIGNS)
            texts += [sign.findtext("additionalValue") or "" for sign in limits]
        limit = None
        try:
            limit = min((speed_of(text.strip(), "it") for text in texts), default=None)
        except MapError as error:
            self.warnings.append(MapWarning(Doubt.SPEED, f"the speed limit of lanelet {id!r} was ignored: {error}", id))
        lanelet = Lanelet(id, id, left, right, limit)
        yield lanelet
        if {(part.text or "").strip() for part in element.iterfind("userBidirectional")} & {"car", "vehicle"}:
            yield turned(lanelet)

    def _rules(self, lanes: dict[str, Lanelet]) -> Rules:
        """Return the signs, lights and stop lines of the lanelets."""
        rules = Rules(crosswalks=self.crosswalks)
        users: defaultdict[str, list[str]] = defaultdict(list)
        for id in (id for id in self.elements if id in lanes):
            parts = [part for tag in ("trafficSignRef", "trafficLightRef") for part in self.elements[id].iter(tag)]
            for ref in dict.fromkeys(part.get("ref", "") for part in parts):
                users[ref].append(id)
            line = self.elements[id].find("stopLine")
            if line is not None:
                points = _points(line)
                ends = np.array([lanes[id].left.points[-1], lanes[id].right.points[-1]])
                rules.lines[id] = points if len(points) > 1 else ends
        for ref, sign in self.signs.items():
            names = [(part.text or "").strip().lower() for part in sign.iterfind("trafficSignElement/trafficSignID")]
            for kind in dict.fromkeys(STANDARD[name] for name in names if name in STANDARD):
                rules.regulations.append(Regulation(ref, kind, tuple(users[ref]), tuple(users[ref])))
        cycles: defaultdict[tuple[str, ...], list[str]] = defaultdict(list)
        for light in self.root.iterfind("trafficLight"):
            ref = light.get("id", "")
            if (light.findtext("active") or "").strip() == "false":
                continue
            arrows = frozenset(_ARROWS.get((light.findtext("direction") or "").strip(), ()))
            rules.regulations.append(Regulation(ref, ObjectKind.LIGHT, tuple(users[ref]), tuple(users[ref]), arrows))
            cycle = light.find("cycle")
            if cycle is not None:
                cycles[tuple(text.strip() for text in cycle.itertext() if text.strip())].append(ref)
        rules.controllers = tuple(map(tuple, cycles.values()))
        return rules


def _points(element: Element | None) -> Array:
    """Return the points of an element, shape ``(k, 2)`` [m]; a malformed point is left out."""
    rows: list[tuple[float, float]] = []
    for point in () if element is None else element.iterfind("point"):
        row = number_in(point.findtext("x") or ""), number_in(point.findtext("y") or "")
        if all(abs(value) <= 1e8 for value in row) and (not rows or rows[-1] != row):
            rows.append(row)
    return np.array(rows).reshape(-1, 2)
