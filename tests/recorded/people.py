"""Vehicles and persons of SUMO at a junction with four arms and a crosswalk over each arm.

SUMO writes no crosswalks into its OpenDRIVE maps, so they are laid here from the edges of the crossings in SUMO's net.
"""

import random
import re
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment

from .traffic import ARMS, RECKLESS

ENDS = {"E": (150, 0), "N": (0, 150), "W": (-150, 0), "S": (0, -150)}
SIZE = 4.6, 1.8
MAD = 0.4
"""Share of the vehicles that let nobody pass."""


@dataclass(frozen=True)
class Street:
    """What SUMO wrote; the names of vehicles that let nobody pass begin with ``m``, of other vehicles with ``c``."""

    place: Junction
    tracks: Path
    lights: Path | None
    struck: frozenset[tuple[str, str]]
    """Pairs of a vehicle and a person that SUMO says collided."""


def simulate(kind: str, folder: Path, home: Path, *, seconds: float, seed: int) -> Street:
    """Let vehicles drive and persons walk, all persons from arm to arm.

    Args:
        kind: ``priority`` for zebras, at a junction where two arms have the right of way, or ``traffic_light``.
        folder: for the files.
        home: where SUMO is.
        seconds: in which vehicles and persons appear [s].
        seed: of the demand.
    """
    _net(kind, folder, home)
    _demand(folder, seconds, seed)
    (folder / "add.xml").write_text(
        '<additional><timedEvent type="SaveTLSStates" source="C" dest="tls.xml"/></additional>'
        if kind == "traffic_light"
        else "<additional/>"
    )
    command = ["-n", "net.xml", "-r", "demand.xml", "-a", "add.xml", "--step-length", "0.1", "--end", str(seconds + 60)]
    command += ["--fcd-output", "fcd.xml", "--collision.action", "warn", "--collision.check-junctions", "true", "--seed", "1"]
    command += ["--time-to-teleport", "-1", "--no-step-log", "true", "--precision", "6", "--log", "log.txt"]
    subprocess.run([str(home / "bin" / "sumo"), *command], cwd=folder, check=True, capture_output=True)
    struck = re.findall(r"Vehicle '(\w+)' collision with person '(\w+)'", (folder / "log.txt").read_text())
    place = find("nearest to 150, 150", map=folder / "map.xodr")
    net = ElementTree.parse(folder / "net.xml").getroot()
    place = replace(place, crossings=tuple(_crosswalks(place, net)))
    lights = None if kind == "priority" else _lights(place, net, folder)
    return Street(place, folder / "fcd.xml", lights, frozenset((vehicle, f"person {name}") for vehicle, name in struck))


def _net(kind: str, folder: Path, home: Path) -> None:
    edges = ""
    for arm in ARMS:
        rank = 1 if kind == "priority" and arm in "NS" else 2
        for way, ways in (("i", f'from="{arm}" to="C"'), ("o", f'from="C" to="{arm}"')):
            edges += f'<edge id="{arm}{way}" {ways} numLanes="1" speed="13.89" priority="{rank}"/>'
    nodes = "".join(f'<node id="{arm}" x="{x}" y="{y}" type="dead_end"/>' for arm, (x, y) in ENDS.items())
    zebras = "".join(f'<crossing node="C" edges="{arm}i {arm}o" priority="true" width="4"/>' for arm in ARMS)
    (folder / "nodes.xml").write_text(f'<nodes><node id="C" x="0" y="0" type="{kind}"/>{nodes}</nodes>')
    (folder / "edges.xml").write_text(f"<edges>{edges}</edges>")
    (folder / "connections.xml").write_text(f"<connections>{zebras}</connections>")
    command = ["-n", "nodes.xml", "-e", "edges.xml", "-x", "connections.xml", "-o", "net.xml", "--opendrive-output", "map.xodr"]
    command += ["--sidewalks.guess", "true", "--no-turnarounds", "true", "--default.junctions.radius", "6"]
    subprocess.run([str(home / "bin" / "netconvert"), *command], cwd=folder, check=True, capture_output=True)


def _demand(folder: Path, seconds: float, seed: int) -> None:
    rng, number = random.Random(seed), 0
    trips: list[tuple[float, str]] = []
    for rate, walks in ((0.27, False), (0.12, True)):
        time = 0.0
        while (time := time + rng.expovariate(rate)) < seconds:
            origin, number = rng.choice(ARMS), number + 1
            goal = rng.choice([arm for arm in ARMS if arm != origin])
            if walks:
                walk = f'<walk from="{origin}i" to="{goal}o" arrivalPos="20"/>'
                trips.append((time, f'<person id="{number}" depart="{time:.2f}" departPos="120">{walk}</person>'))
                continue
            kind = "mad" if rng.random() < MAD else "car"
            head = f'id="{kind[0]}{number}" type="{kind}" depart="{time:.2f}" departSpeed="max"'
            trips.append((time, f'<vehicle {head}><route edges="{origin}i {goal}o"/></vehicle>'))
    types = f'<vType id="car" length="{SIZE[0]}" width="{SIZE[1]}" maxSpeed="16" sigma="0.5"/>'
    types += f'<vType id="mad" length="{SIZE[0]}" width="{SIZE[1]}" {RECKLESS}/>'
    (folder / "demand.xml").write_text(f"<routes>{types}{''.join(trip for _, trip in sorted(trips))}</routes>")


def _crosswalks(place: Junction, net: ElementTree.Element) -> list[Crosswalk]:
    """Return the crosswalks of the arms in their order."""
    found = []
    for edge in net.iter("edge"):
        if edge.get("function") != "crossing":
            continue
        lane = next(edge.iter("lane"))
        ends = np.array([[float(value) for value in point.split(",")] for point in lane.get("shape", "").split()])
        half = float(lane.get("width", "")) / 2
        x, y = ENDS[edge.get("crossingEdges", "")[0]]
        starts = [lane.approach.points[0] for lane in place.entrances]
        entrance = int(np.argmin([np.hypot(*(start - (x + 150.0, y + 150.0))) for start in starts]))
        arm = place.entrances[entrance].arm
        inwards, outwards = place.way_in(entrance).points[-1], place.way_out(place.arms[arm].exits[0]).points[0]
        if np.hypot(*(ends[0] - inwards)) > np.hypot(*(ends[-1] - inwards)):
            ends = ends[::-1]
        across = (ends[-1] - ends[0]) / np.hypot(*(ends[-1] - ends[0]))
        side = half * np.array([-across[1], across[0]])
        area = np.array([ends[0] - side, ends[-1] - side, ends[-1] + side, ends[0] + side])
        middle = float(((inwards + outwards) / 2 - ends[0]) @ across)
        phase = place.entrances[entrance].phase
        path = Segment(edge.get("id", ""), ends)
        found.append(Crosswalk(path.id, arm, area, path, middle, phase=None if phase is None else 1 - phase))
    return sorted(found, key=lambda crosswalk: crosswalk.arm)


def _lights(place: Junction, net: ElementTree.Element, folder: Path) -> Path:
    """Write a file of lights, in which the lights of crosswalks have their names, and return its path."""
    crosswalks = {crosswalk.id: number for number, crosswalk in enumerate(place.crossings)}
    names = {
        int(link.get("linkIndex", "")): f"w{crosswalks[link.get('to', '')]}" if link.get("to") in crosswalks else ""
        for link in net.iter("connection")
        if link.get("tl")
    }
    colours, shown = {"G": "green", "g": "green", "y": "yellow", "r": "red"}, dict[int, str]()
    lines = ["time,signal,colour"]
    for row in ElementTree.parse(folder / "tls.xml").getroot().iter("tlsState"):
        for link, letter in enumerate(row.get("state", "")):
            if shown.get(link) != colours[letter]:
                shown[link] = colours[letter]
                lines.append(f"{row.get('time')},{names[link] or f'C_{link}'},{colours[letter]}")
    (folder / "lights.csv").write_text("\n".join(lines))
    return folder / "lights.csv"
