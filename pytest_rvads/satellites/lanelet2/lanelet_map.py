"""Reading a Lanelet2 file (``.osm``): its lanelets and its regulatory elements."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from pytest_rvads.geometry.control import ObjectKind
from pytest_rvads.geometry.network import Doubt, MapWarning, Network, PaintedCrosswalk
from pytest_rvads.geometry.opendrive.builder import MAX_SAMPLES
from pytest_rvads.geometry.opendrive.map_file import speed_of
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
from pytest_rvads.satellites.lanelet2.osm_file import OsmMap, Relation, read_osm
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.wording import one_line, plural

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
