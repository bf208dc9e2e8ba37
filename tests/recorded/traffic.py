"""Traffic of SUMO at one junction with four arms, and a count of who broke which rule that shares no code with the package.

SUMO says of every vehicle which lane it is on and how far along it; the count goes by that, the package by x and y on the map.
"""

import math
import random
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.sweep import EXIT_LENGTH
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.states import Agent, Colour, Kind

KINDS = {"stop": "allway_stop", "lights": "traffic_light", "yield": "priority"}
SIZES = {"car": (4.6, 1.8), "truck": (10.0, 2.5), "mad": (4.6, 1.8)}
ARMS = "ENWS"
SIGNS = {
    "stop": dict.fromkeys(ARMS, Sign.STOP),
    "yield": {"E": Sign.PRIORITY, "W": Sign.PRIORITY, "N": Sign.STOP, "S": Sign.STOP},  # where SUMO lets them roll through
}
RECKLESS = (
    'jmIgnoreFoeProb="1" jmIgnoreFoeSpeed="50" jmDriveAfterRedTime="100" jmDriveAfterYellowTime="100" '
    'jmIgnoreJunctionFoeProb="1" impatience="1" sigma="0.8"'
)
COLOURS = {"G": Colour.GREEN, "g": Colour.GREEN, "y": Colour.YELLOW, "r": Colour.RED}
RIGHT_OF = {("E", "S"), ("S", "W"), ("W", "N"), ("N", "E")}
"""The first comes from the right of the second."""


@dataclass(frozen=True)
class Vehicle:
    """What SUMO said of a vehicle, one row per step."""

    name: str
    kind: str
    origin: str
    """The arm that it comes from."""
    goal: str
    """The arm that it leaves by."""
    rows: np.ndarray
    """Time [s], x, y [m], heading [rad], speed [m/s] of the front bumper, shape ``(steps, 5)``."""
    place: np.ndarray
    """How far its front is behind the end of its approach [m], negative before; NaN beyond the junction."""


@dataclass(frozen=True)
class Traffic:
    """What happened at a junction."""

    kind: str
    map: Path
    vehicles: tuple[Vehicle, ...]
    lights: tuple[tuple[float, str, Colour], ...] = ()
    """Changes: time [s], arm, colour."""


def simulate(kind: str, folder: Path, home: Path, *, seconds: float, rate: float, seed: int) -> Traffic:
    """Let SUMO drive: eight in a hundred are trucks, twelve drive as if they were alone.

    Args:
        kind: of the junction, see `KINDS`.
        folder: for its files.
        home: where SUMO is.
        seconds: in which vehicles appear [s].
        rate: of them [1/s].
        seed: of the demand.
    """
    _net(kind, folder, home)
    _demand(folder, seconds, rate, seed)
    lights = folder / "lights.xml"
    watch = f'<additional><timedEvent type="SaveTLSSwitchStates" source="C" dest="{lights}"/></additional>'
    (folder / "add.xml").write_text(watch if kind == "lights" else "<additional/>")
    command = ["-n", "net.xml", "-r", "demand.xml", "-a", "add.xml", "--step-length", "0.01", "--end", str(seconds + 60)]
    command += ["--fcd-output", "fcd.xml", "--collision.action", "none", "--collision.check-junctions", "true"]
    command += ["--time-to-teleport", "-1", "--seed", "1", "--no-step-log", "true", "--no-warnings", "--precision", "6"]
    subprocess.run([str(home / "bin" / "sumo"), *command], cwd=folder, check=True, capture_output=True)
    return read(kind, folder / "map.xodr", folder / "fcd.xml", lights if kind == "lights" else None)


def _net(kind: str, folder: Path, home: Path) -> None:
    ends = {"E": (150, 0), "N": (0, 150), "W": (-150, 0), "S": (0, -150)}
    nodes = "".join(f'<node id="{arm}" x="{x}" y="{y}" type="dead_end"/>' for arm, (x, y) in ends.items())
    edges = ""
    for arm in ARMS:
        rank = 1 if kind == "yield" and arm in "NS" else 2
        for way, ways in (("i", f'from="{arm}" to="C"'), ("o", f'from="C" to="{arm}"')):
            edges += f'<edge id="{arm}{way}" {ways} numLanes="1" speed="13.89" priority="{rank}"/>'
    (folder / "nodes.xml").write_text(f'<nodes><node id="C" x="0" y="0" type="{KINDS[kind]}"/>{nodes}</nodes>')
    (folder / "edges.xml").write_text(f"<edges>{edges}</edges>")
    command = ["-n", "nodes.xml", "-e", "edges.xml", "-o", "net.xml", "--opendrive-output", "map.xodr"]
    command += ["--no-turnarounds", "true", "--default.junctions.radius", "6"]
    subprocess.run([str(home / "bin" / "netconvert"), *command], cwd=folder, check=True, capture_output=True)


def _demand(folder: Path, seconds: float, rate: float, seed: int) -> None:
    rng, time, number = random.Random(seed), 0.0, 0
    lines = ['<routes><vType id="car" length="4.6" width="1.8" maxSpeed="16" sigma="0.5"/>']
    lines += ['<vType id="truck" vClass="truck" length="10" width="2.5" accel="1.3" sigma="0.5"/>']
    lines += [f'<vType id="mad" length="4.6" width="1.8" {RECKLESS}/>']
    while (time := time + rng.expovariate(rate)) < seconds:
        origin = rng.choice(ARMS)
        goal = rng.choice([arm for arm in ARMS if arm != origin])
        kind = rng.choices(["car", "truck", "mad"], [0.8, 0.08, 0.12])[0]
        edges = f'<route edges="{origin}i {goal}o"/>'
        lines.append(f'<vehicle id="{kind[0]}{number}" type="{kind}" depart="{time:.2f}" departSpeed="max">{edges}</vehicle>')
        number += 1
    (folder / "demand.xml").write_text("\n".join(lines) + "</routes>")


def read(kind: str, road_map: Path, fcd: Path, lights: Path | None = None) -> Traffic:
    """Return what SUMO wrote, up to where exit roads end for the package; vehicles that never reach theirs are left out."""
    told: dict[str, list[dict[str, str]]] = {}
    for row in _rows(fcd):
        told.setdefault(row["id"], []).append(row)
    vehicles = []
    for name, rows in told.items():
        lanes = [row["lane"] for row in rows]
        origin = next((lane[0] for lane in lanes if lane[1] == "i"), None)
        goal = next((lane[0] for lane in lanes if lane[1] == "o"), None)
        if origin is None or goal is None:
            continue
        numbers = [[float(row[key]) for key in ("time", "x", "y", "angle", "speed", "pos")] for row in rows]
        values = np.array(numbers)
        values[:, 3] = math.pi / 2 - np.radians(values[:, 3])
        # The lanes of the approach are 140.8 m long; whoever is on a lane of the junction is somewhere behind that.
        on = np.array([lane[1] if lane[0] != ":" else ":" for lane in lanes])
        place = np.select([on == "i", on == ":"], [values[:, 5] - 140.8, 1.0], math.nan)
        seen = (on != "o") | (values[:, 5] < EXIT_LENGTH)
        vehicles.append(Vehicle(name, rows[0]["type"], origin, goal, values[seen, :5], place[seen]))
    return Traffic(kind, road_map, tuple(vehicles), tuple(_changes(lights)) if lights else ())


def _rows(fcd: Path) -> Iterator[dict[str, str]]:
    time = ""
    for event, element in ElementTree.iterparse(fcd, ("start", "end")):
        if event == "start" and element.tag == "timestep":
            time = element.get("time", "")
        elif event == "end" and element.tag == "vehicle":
            yield {**element.attrib, "time": time}
        elif event == "end" and element.tag == "timestep":
            element.clear()


def _changes(lights: Path) -> Iterator[tuple[float, str, Colour]]:
    """SUMO numbers the links of a light clockwise from the north, three to an arm."""
    before = ""
    for row in ElementTree.parse(lights).getroot().iter("tlsState"):
        state = row.get("state", "")
        if state != before:
            for number, arm in enumerate("NESW"):
                yield float(row.get("time", "")), arm, COLOURS[state[3 * number]]
        before = state


def junction_of(traffic: Traffic) -> Junction:
    """Return the junction, with the signs that SUMO does not write into its map."""
    place = find("nearest to 150, 150", map=traffic.map)
    signs = SIGNS.get(traffic.kind)
    if signs is None:
        return place
    lanes = (replace(lane, sign=signs[arm]) for lane, arm in zip(place.entrances, arms_of(place), strict=True))
    return replace(place, entrances=tuple(lanes))


def arms_of(place: Junction) -> list[str]:
    """Return on which side of the junction, in the middle of its map, every arm lies."""
    ends = np.array([lane.approach.points[-1] for lane in place.entrances]) - 150.0
    return ["EW"[x < 0] if abs(x) > abs(y) else "NS"[y < 0] for x, y in ends.tolist()]


def recorded(traffic: Traffic, every: int = 1) -> Recording:
    """Return the traffic as recorded with every n-th row only."""
    place = junction_of(traffic)
    arms = arms_of(place)
    tracks = []
    for vehicle in traffic.vehicles:
        way = Itinerary.through(place, arms.index(vehicle.origin), arms.index(vehicle.goal))
        rows = vehicle.rows[(np.round(vehicle.rows[:, 0] * 100).astype(int) % every) == 0]
        station, near = [], -way.origin
        for x, y in rows[:, 1:3].tolist():
            near, _ = way.project(x, y, near + 1.0)
            station.append(near)
        along = np.array(station)
        keep = along < way.end
        if keep.sum() > 1:
            kind = Kind.TRUCK if vehicle.kind == "truck" else Kind.CAR
            agent = Agent(vehicle.name, place.movements[way.entrance, way.exit], kind, SIZES[vehicle.kind])
            tracks.append(Track(agent, rows[keep, 0], along[keep], rows[keep, 4], rows[keep][:, 1:4]))
    lights = {}
    for number, arm in enumerate(arms):
        told = [(time, colour) for time, side, colour in traffic.lights if side == arm]
        if told:
            times, colours = zip(*told, strict=True)
            lights[number] = Changes(np.array(times), np.array(colours, dtype=np.int8))
    return Recording(traffic.kind, place, tuple(tracks), lights)
