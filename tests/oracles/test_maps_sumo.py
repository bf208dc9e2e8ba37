"""Movements and turn types against SUMO's ``netconvert`` (only where the eclipse-sumo wheel is installed)."""

import math
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.maps.road_map import read_map

sumo = pytest.importorskip("sumo")

STEMS = [
    *("Town01", "Town04", "Town07", "multi_intersections", "Crossing8Course", "fabriksgatan", "fabriksgatan_traffic_lights"),
    *("simple_4way_intersection", "simple_3way_intersection_lht", "intersection_3_5m_width", "cubetown", "Issue295a"),
    *("sumo_stop4", "sumo_lights4", "sumo_t3", "sumo_skew4"),
]
TURNS = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right"}


def connections(path: Path, out: Path) -> dict[tuple[str, str], set[str]]:
    """Return the turn types netconvert gives to pairs of edges."""
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "--opendrive", str(path), "-o", str(out)]
    subprocess.run(command, capture_output=True, check=True)
    found: dict[tuple[str, str], set[str]] = {}
    for row in ElementTree.parse(out).getroot().iter("connection"):
        one, two = (re.sub(r"\.\d+(\.\d+)?$", "", row.get(name, "")) for name in ("from", "to"))
        if not one.startswith(":") and not two.startswith(":"):
            found.setdefault((one, two), set()).add(row.get("dir", ""))
    return found


@pytest.mark.parametrize("stem", STEMS)
def test_turn_types(shared: Path, tmp_path: Path, stem: str) -> None:
    path = shared / "maps" / f"{stem}.xodr"
    road_map, theirs = read_map(path), connections(path, tmp_path / "net.xml")
    edges = road_map.network.edges
    compared, other = 0, []
    for report in road_map.junctions:
        if not report.usable:
            continue
        for way in report.movements:
            # SUMO names the edge along the reference line -id, the one against it id.
            one, two = (f"{'-' if edges[e].forward else ''}{edges[e].road}" for e in (way.path.entrance, way.path.exit))
            assert (one, two) in theirs, f"netconvert has no movement from {one} to {two}"
            compared += 1
            if {TURNS.get(dir, dir) for dir in theirs[one, two]} != {way.turn.value}:
                other.append(
                    (report.id, way.entrance, way.exit, way.turn.value, theirs[one, two], round(math.degrees(way.turning), 1))
                )
    print(f"{stem}: {compared} movements, {len(other)} with another turn type {other}")  # noqa: T201
    assert compared
    # SUMO calls a turn what bends by 44 degrees, and a gentle one a turn where a straighter movement shares its entrance.
    assert all(44.0 <= abs(row[-1]) < 45.0 or row[4] & {"L", "R"} for row in other)
    assert len(other) <= (5 if stem == "Issue295a" else 0)
