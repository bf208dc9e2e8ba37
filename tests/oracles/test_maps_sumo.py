"""Movements and turn types against SUMO's ``netconvert`` (only where the eclipse-sumo wheel is installed)."""

import math
import re
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from pytest_rvads.junctions.road_map import read_map

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


def compare(path: Path, out: Path) -> tuple[int, list[tuple[object, ...]]]:
    """Return the number of movements at usable junctions, and those with another turn type than netconvert's."""
    road_map, theirs = read_map(path), connections(path, out)
    edges = road_map.graph.edges
    compared, other = 0, list[tuple[object, ...]]()
    for report in road_map.junctions:
        if not report.usable:
            continue
        for way in report.movements:
            # SUMO names the edge along the reference line -id, the one against it id.
            one, two = (f"{'-' if edges[e].forward else ''}{edges[e].road}" for e in (way.path.entrance, way.path.exit))
            assert (one, two) in theirs, f"netconvert has no movement from {one} to {two}"
            compared += 1
            if {TURNS.get(dir, dir) for dir in theirs[one, two]} != {way.turn.value}:
                angle = round(math.degrees(way.turning), 1)
                other.append((report.id, way.entrance, way.exit, way.turn.value, theirs[one, two], angle))
    return compared, other


@pytest.mark.parametrize("stem", STEMS)
def test_turn_types(shared: Path, tmp_path: Path, stem: str) -> None:
    compared, other = compare(shared / "maps" / f"{stem}.xodr", tmp_path / "net.xml")
    print(f"{stem}: {compared} movements, {len(other)} with another turn type {other}")
    assert compared
    # What is "partially right" to SUMO (R), because a straighter movement shares its entrance, is straight to the paper.
    assert all(row[4] in ({"L"}, {"R"}) and row[3] == "straight" for row in other)
    assert len(other) <= (1 if stem == "Issue295a" else 0)


GRID = ("--grid", "--grid.number", "3", "--grid.length", "120", "--grid.attach-length", "100")
SPIDER = ("--spider", "--spider.circle-number", "1", "--spider.arm-number")


@pytest.mark.parametrize("left_hand", [False, True], ids=["right", "left"])
@pytest.mark.parametrize(
    ("shape", "type", "expected"),
    [
        (GRID, "priority", {(4, "none"): 9}),
        (GRID, "traffic_light", {(4, "lights"): 9}),
        ((*SPIDER, "5"), "priority", {(5, "none"): 1, (3, "none"): 5}),
        ((*SPIDER, "8"), "priority", {(8, "none"): 1, (3, "none"): 8}),
    ],
    ids=["grid", "lights", "spider5", "spider8"],
)
def test_generated_maps(tmp_path: Path, shape: tuple[str, ...], type: str, expected: dict[str, Any], left_hand: bool) -> None:
    """Ways, control and side of traffic as netgenerate was told; no road of these files states on which side traffic keeps."""
    home, net, path = Path(sumo.SUMO_HOME) / "bin", tmp_path / "g.net.xml", tmp_path / "g.xodr"
    side = ("--lefthand",) if left_hand else ()
    make = [str(home / "netgenerate"), *shape, "-j", type, "--no-turnarounds", "-o", str(net), *side]
    subprocess.run(make, capture_output=True, check=True)
    subprocess.run([str(home / "netconvert"), "-s", str(net), "--opendrive-output", str(path)], capture_output=True, check=True)
    reports = read_map(path).junctions
    found: dict[tuple[int, str], int] = {}
    for report in reports:
        assert report.usable, report.reason
        found[report.ways, report.control.value] = found.get((report.ways, report.control.value), 0) + 1
    assert found == expected
    assert {report.left_hand for report in reports} == {left_hand}
    assert 'rule="' not in path.read_text(encoding="utf-8")
    _, other = compare(path, tmp_path / "back.net.xml")
    assert all(row[4] in ({"L"}, {"R"}) and row[3] == "straight" for row in other), other
