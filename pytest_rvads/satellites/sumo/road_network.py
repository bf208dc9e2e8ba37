"""The road network of SUMO for a junction: edges, connections, right of way and signal program.

Arm 0 of the junction is represented by the edge ``in0`` toward the junction, with a lane per entrance, and the edge ``out0`` away
from the junction, with a lane per exit. The edge ``in0`` ends at the stopping line, because SUMO's vehicles stop at the end of an
edge. From the stopping line, a connection leads along the center line of each movement.

The network is made from the `Junction` and not from its map file, so that SUMO can simulate junctions of every map format.
netconvert, SUMO's program that builds road networks, makes the network from files in plain XML.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from importlib.util import find_spec
from itertools import pairwise
from math import dist, fsum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, ParseError, SubElement, fromstring, tostring

from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import RANK, Reason
from pytest_rvads.geometry.segment import SPEED_LIMIT, Segment, join
from pytest_rvads.geometry.sweep import EXIT_LENGTH
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Arm, Key
from pytest_rvads.physics.braking import FASTEST
from pytest_rvads.runs.states import Colour, SignalPlan
from pytest_rvads.support.errors import RunError, ScenarioError, needs
from pytest_rvads.support.wording import one_line

_LETTERS = {Colour.YELLOW: "y", Colour.RED: "r"}
"""By colour other than green, the letter for the colour in SUMO's signal programs."""
_RESULT = "net.xml"
_NETCONVERT_OPTIONS = (
    "--offset.disable-normalization",  # keep the coordinates of the map
    "--no-turnarounds",  # add no U-turns, which the junction does not have
    "--junctions.endpoint-shape",  # keep the positions of the ends of lanes
    "--precision=9",
    "--xml-validation=never",
)


@dataclass(frozen=True, slots=True)
class Network:
    """A road network in the file format of SUMO."""

    text: bytes
    """Content of the network file."""

    @property
    def name(self) -> str:
        """Name of the network file, which is made from a hash of its content."""
        return f"{sha256(self.text).hexdigest()[:16]}.net.xml"


@lru_cache(maxsize=64)
def network(junction: Junction, plan: SignalPlan) -> Network:
    """Return the network of a junction with the signal plan of its lights."""
    # The input files of netconvert by option, in plain XML (page "Networks/PlainXML" of SUMO).
    nodes, edges, connections = Element("nodes"), Element("edges"), Element("connections")
    ends = [junction.way_in(k).points[-1] for k in range(len(junction.entrances))]
    middle = [fsum(float(end[axis]) for end in ends) / len(ends) for axis in (0, 1)]
    SubElement(nodes, "node", id="J", x=repr(middle[0]), y=repr(middle[1]), type=node_type(junction))
    for number, arm in enumerate(junction.arms):
        _add_arm(junction, number, arm, nodes, edges)
    for entrance, exit in sorted(junction.movements):
        (edge_in, entrance_lane), (edge_out, exit_lane) = lane_in(junction, entrance), lane_out(junction, exit)
        way = junction.way_through(entrance, exit)
        setback = junction.setbacks[entrance]
        if setback < 0.0:
            way = way.tail(way.length + setback)
        if setback > 0.0 and (extended_way := join((junction.way_in(entrance).tail(setback), way))):
            way = extended_way
        attributes = {"from": edge_in, "to": edge_out, "fromLane": str(entrance_lane), "toLane": str(exit_lane)}
        SubElement(connections, "connection", attributes, shape=_shape(way.points))
    files = {"node-files": nodes, "edge-files": edges, "connection-files": connections}
    root = netconvert(files, left_hand=junction.left_hand)
    node = next(item for item in root.iter("junction") if item.get("id") == "J")
    entrances = {lane_in(junction, k): k for k in range(len(junction.entrances))}
    exits = {lane_out(junction, k): k for k in range(len(junction.exits))}
    by_lane: dict[str, list[Key]] = {}
    for item in root.iter("connection"):
        start = item.attrib["from"], int(item.attrib["fromLane"])
        if start in entrances:
            key = entrances[start], exits[item.attrib["to"], int(item.attrib["toLane"])]
            by_lane.setdefault(f"{start[0]}_{start[1]}", []).append(key)
    # SUMO numbers the links (connections through its junction) in this order.
    links = [key for lane in node.attrib["incLanes"].split() for key in by_lane.get(lane, ())]
    check_yields(junction, node, links)
    _restore(root, files["edge-files"])
    for item in root.findall("tlLogic"):
        root.insert(list(root).index(item), signal_program(junction, plan, links))
        root.remove(item)
    return Network(tostring(root))


@lru_cache(maxsize=1)
def straight(length: float) -> Network:
    """Return a network with a single straight lane, on the edge ``in0``, of a length [m]."""
    nodes, edges = Element("nodes"), Element("edges")
    for name, x in (("start", 0.0), ("end", length)):
        SubElement(nodes, "node", id=name, x=repr(x), y="0")
    SubElement(edges, "edge", {"id": "in0", "from": "start", "to": "end", "numLanes": "1", "speed": repr(FASTEST)})
    return Network(tostring(netconvert({"node-files": nodes, "edge-files": edges}, left_hand=False)))


def lane_in(junction: Junction, entrance: int) -> tuple[str, int]:
    """Return edge and lane number of the lane that ends at the stopping line of an entrance."""
    lane = junction.entrances[entrance]
    return f"in{lane.arm}", lane.lane


def lane_out(junction: Junction, exit: int) -> tuple[str, int]:
    """Return edge and lane number of the lane that begins at an exit."""
    lane = junction.exits[exit]
    return f"out{lane.arm}", lane.lane


def lane_limit(way: Segment, end: int) -> float:
    """Return the speed limit of a lane in SUMO [m/s]: a single limit per lane, which is the limit at one end of the road."""
    return way.limits[end][1] or SPEED_LIMIT if way.limits else SPEED_LIMIT


def _to_line(junction: Junction, entrance: int) -> Segment:
    """Return the lane to an entrance up to its stopping line; up to a line behind the entrance, it goes on as a way ahead."""
    lane, setback = junction.way_in(entrance), junction.setbacks[entrance]
    if setback >= 0.0:
        return lane.head(lane.length - setback)
    ways = [way for way in junction.movements.values() if way.entrance == entrance]
    ahead = junction.way_through(*min(ways, key=lambda way: way.turn is not Turn.STRAIGHT).key)
    return join((lane, ahead.head(-setback))) or lane


def _add_arm(junction: Junction, number: int, arm: Arm, nodes: Element, edges: Element) -> None:
    """Add the edges of an arm to the network, and the node at the far end of each edge."""
    ways_in = [_to_line(junction, k) for k in arm.entrances]
    ways_out = [way.head(min(way.length, EXIT_LENGTH)) for way in map(junction.way_out, arm.exits)]
    ranks = [RANK[junction.entrances[k].sign] + 1 for k in arm.entrances]  # SUMO's priorities begin at 1
    for edge, far_end, lanes, end in (("in", "from", ways_in, 0), ("out", "to", ways_out, -1)):
        if not lanes:
            continue
        x, y = lanes[0].points[end].tolist()
        SubElement(nodes, "node", id=f"{far_end}{number}", x=repr(x), y=repr(y), type="dead_end")
        ways = ("J", f"{far_end}{number}") if end else (f"{far_end}{number}", "J")
        attributes = {
            "id": f"{edge}{number}",
            "from": ways[0],
            "to": ways[1],
            "numLanes": str(len(lanes)),
            "speed": repr(SPEED_LIMIT),
            "priority": str(max(ranks, default=1)),
            "shape": _shape(lanes[0].points),
        }
        item = SubElement(edges, "edge", attributes)
        for lane, way in enumerate(lanes):
            part = SubElement(item, "lane", index=str(lane), width=repr(junction.lane_width), shape=_shape(way.points))
            if way.limits:
                part.set("speed", repr(lane_limit(way, -1 - end)))


def _restore(root: Element, edges: Element) -> None:
    """Reset shape and length of every lane of a SUMO network to the values in the model of the junction.

    This is needed because netconvert moves the ends of lanes and makes lanes equally long if the lanes of an edge end at
    different distances from the junction.
    """
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    shapes = {name: lane.attrib["shape"].split() for name, lane in lanes.items()}
    shapes |= {f"{e.attrib['id']}_{lane.attrib['index']}": lane.attrib["shape"].split() for e in edges for lane in e}
    for item in root.iter("connection"):
        start, via = f"{item.attrib['from']}_{item.attrib['fromLane']}", item.get("via")
        if via is None:
            shapes[start][-1] = shapes[f"{item.attrib['to']}_{item.attrib['toLane']}"][0]
        else:
            shapes[via][0] = shapes[start][-1]
    for name, shape in shapes.items():
        points = [tuple(map(float, point.split(",")[:2])) for point in shape]
        length = fsum(dist(begin, end) for begin, end in pairwise(points))
        lanes[name].set("shape", " ".join(shape))
        if abs(length - float(lanes[name].attrib["length"])) > 1e-6:
            lanes[name].set("length", repr(length))


def _shape(points: NDArray[Any]) -> str:
    return " ".join(f"{x!r},{y!r}" for x, y in points.tolist())


def node_type(junction: Junction) -> str:
    """Return SUMO's node type for a junction, such as ``allway_stop`` (page "Networks/PlainXML" of SUMO, node types)."""
    signs = {entrance.sign for entrance in junction.entrances}
    lower = {sign for sign in signs if RANK[sign] == min(RANK[s] for s in signs)}
    if Sign.LIGHTS in signs:
        if len(signs) > 1 or None in {entrance.phase for entrance in junction.entrances}:
            raise _unsupported(junction, "lights at some entrances only, and SUMO has lights at all entrances or at none")
        return "traffic_light"
    if signs == {Sign.STOP}:
        return "allway_stop"
    if len({RANK[sign] for sign in signs}) == 1 and Sign.STOP not in signs:
        return "right_before_left"
    if lower == {Sign.STOP, Sign.YIELD}:
        raise _unsupported(junction, "stop signs beside yield signs, and SUMO has the same sign at all minor roads")
    return "priority_stop" if lower == {Sign.STOP} else "priority"


def check_yields(junction: Junction, node: Element, links: Sequence[Key]) -> None:
    """Check that SUMO's network has the right of way of the junction.

    Each movement that must give way to another movement in the junction must give way to it in SUMO, and not the other way round.
    In SUMO, further pairs of movements may have to give way: pairs without a conflict in the junction, and undecided pairs. An
    all-way stop is not checked, because at an all-way stop the arrival times decide who gives way.
    """
    if node.get("type") == "allway_stop":
        return
    # SUMO writes the digits of a response from the last link to link 0, so the digits are reversed.
    rows = {links[int(item.attrib["index"])]: item.attrib["response"][::-1] for item in node.iter("request")}
    entrances, lights = junction.entrances, node.get("type") == "traffic_light"
    for (lower, higher), reason in (junction.yields or {}).items():
        if reason is Reason.UNDECIDED:
            continue
        at_once = not lights or entrances[lower[0]].phase == entrances[higher[0]].phase
        lower_waits, higher_waits = rows[lower][links.index(higher)] == "1", rows[higher][links.index(lower)] == "1"
        if at_once and (higher_waits or not lower_waits):
            ways = f"the movement {lower[0]} to {lower[1]} gives way to the movement {higher[0]} to {higher[1]}"
            raise _unsupported(junction, f"a right of way that SUMO's network does not have: {ways}")


def _unsupported(junction: Junction, why: str) -> ScenarioError:
    return ScenarioError(f"junction {junction.name!r} can't be simulated in SUMO, it has {why}: choose another simulator")


def signal_program(junction: Junction, plan: SignalPlan, links: Sequence[Key]) -> Element:
    """Return a signal plan as an element ``tlLogic`` (page "Simulation/Traffic Lights" of SUMO)."""
    logic = Element("tlLogic", id="J", type="static", programID="rvads", offset="0")
    for begin, duration in plan.phases():
        colours = plan.colours(begin, len(junction.entrances))
        yielding = {lower for lower, higher in junction.yields or {} if colours[higher[0]] is Colour.GREEN}
        letters = []
        for key in links:
            green = "g" if key in yielding else "G"
            letters.append(green if colours[key[0]] is Colour.GREEN else _LETTERS[colours[key[0]]])
        SubElement(logic, "phase", duration=f"{duration:g}", state="".join(letters))
    return logic


def netconvert(files: Mapping[str, Element], *, left_hand: bool) -> Element:
    """Return the network that netconvert makes from files in plain XML."""
    program, home = program_and_home()
    # File names are given without folders, because netconvert takes a comma in a path for the end of the path.
    names = {option: f"{option}.xml" for option in files}
    options = [f"--{option}={name}" for option, name in names.items()]
    options += [*_NETCONVERT_OPTIONS, *(["--lefthand"] if left_hand else []), f"--output-file={_RESULT}"]
    try:
        with TemporaryDirectory(prefix="rvads-net-") as folder:
            for option, root in files.items():
                ElementTree(root).write(Path(folder, names[option]), encoding="utf-8")
            try:
                finished = subprocess.run(
                    [program, *options],
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    timeout=60.0,  # [s]; a junction takes some hundredths of a second
                    check=False,
                    env=os.environ | ({"SUMO_HOME": home} if home else {}),
                )
            except (OSError, subprocess.TimeoutExpired) as error:
                raise RunError(f"SUMO's netconvert can't be run: {one_line(str(error), 300)}") from None
            messages = finished.stderr.decode(errors="replace")
            result = Path(folder, _RESULT)
            content = result.read_bytes() if result.exists() else b""
    except OSError as error:
        raise RunError(f"files for SUMO's netconvert can't be written or read: {error}") from None
    try:
        return fromstring(content)
    except ParseError:
        raise RunError(f"SUMO's netconvert ({program}) made no network: {one_line(messages[-500:])}") from None


@lru_cache(maxsize=1)
def program_and_home() -> tuple[str, str | None]:
    """Return the path of netconvert and the path of SUMO's home, which is None if netconvert was found on the PATH.

    netconvert is searched in the package eclipse-sumo, in the folder that SUMO_HOME names, and on the PATH, in this order.
    """
    spec = find_spec("sumo")
    homes = [*((spec and spec.submodule_search_locations) or ()), os.environ.get("SUMO_HOME", "")]
    for home in map(os.path.abspath, filter(None, homes)):  # absolute, because netconvert runs in another folder
        if program := shutil.which("netconvert", path=str(Path(home, "bin"))):
            return program, home
    program = shutil.which("netconvert")
    if program is None:
        raise RunError(needs("simulator 'sumo' makes networks by netconvert and", "eclipse-sumo", "sumo"))
    return os.path.abspath(program), None
