"""The built-in maps: what they promise, measured on what the reader makes of them."""

import math
import subprocess
import sys
from itertools import pairwise

import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.itineraries import Itinerary
from tools.crossings import Layout, opendrive
from tools.make_maps import LAYOUTS
from tools.roundabouts import Roundabout, roundabout

from .conftest import Read

CYCLE = {(0, 3), (1, 0), (2, 1), (3, 2)}
"""Entrance i + 1 is to the right of entrance i, counter-clockwise, in an X (the paper's figure)."""


PLAIN = ("stop4", "stop3", "light4", "light3", "paper_stop4", "paper_light4")
"""One lane per arm, stop signs or lights everywhere."""
DIGESTS = {
    "stop4": "64487f83106f56e66ab0b94e1194d313aadb32d3261a4c84208e4c5238ebfb2b",
    "stop3": "509933c4def138231a7b94bc05a7bc2a06cd3b05c87e724f5ec73c66f7618113",
    "light4": "ce7e3d8380262966f6cbfee57548df26d0a7efd6e636b6ab1da1d1f83c79592e",
    "light3": "c39178baea7685ece5ef93b87bad3ec67d69d7fab368d15cb6087e22055f9192",
    "paper_stop4": "9eee0e30581b46fd94b921688f12cf5d229a1681d75d26a94634e813cdce2a87",
    "paper_light4": "f871d67de52db8b3e32eb1998b7ae942cd14ae67e27f2cca551963d18d943bee",
}
"""Of these junctions since 0.1: run hashes and caches hang on them."""


@pytest.mark.parametrize("name", PLAIN)
def test_built_in_junction_matches_its_name(name: str) -> None:
    junction = find(name)
    assert junction.name == name
    assert junction.ways == int(name[-1])
    assert junction.control is (JunctionControl.LIGHTS if "light" in name else JunctionControl.STOP)
    assert junction.setbacks == (0.0,) * junction.ways
    assert junction.drivable
    assert all(
        road.length >= 100 for road in (*map(junction.way_in, range(junction.ways)), *map(junction.way_out, range(junction.ways)))
    )
    assert read_map(path_of(name)).warnings == ()
    assert find(name) is junction
    assert junction.digest == DIGESTS[name]


@pytest.mark.parametrize("name", PLAIN)
def test_priorities(name: str) -> None:
    junction = find(name)
    if junction.ways == 4:
        assert junction.right_of == CYCLE
        assert junction.opposite == {(0, 2), (2, 0), (1, 3), (3, 1)}
    else:  # the stem, entrance 0, faces nobody; the pair between the two ends of the bar is missing
        assert junction.right_of == {(1, 0), (0, 2)}
        assert junction.opposite == {(1, 2), (2, 1)}
    groups = {4: (frozenset({0, 2}), frozenset({1, 3})), 3: (frozenset({0}), frozenset({1, 2}))}[junction.ways]
    assert junction.phase_groups == (groups if "light" in name else ())


def test_directions_are_right_straight_left() -> None:
    for entrance in range(4):
        turns = [find("stop4").leads(entrance, d).turn for d in (1, 2, 3)]
        assert turns == [Turn.RIGHT, Turn.STRAIGHT, Turn.LEFT]


def test_lengths_are_those_of_quarter_circles() -> None:
    lengths = {m.turn: m.length for m in find("stop4").movements.values()}
    # Stop lines 15 m from the centre, lanes 1.75 m from the axis; a polyline with a step of 0.5 m is a little shorter.
    assert lengths[Turn.RIGHT] == pytest.approx(math.pi / 2 * (15 - 1.75), abs=0.01)
    assert lengths[Turn.STRAIGHT] == pytest.approx(30, abs=1e-6)
    assert lengths[Turn.LEFT] == pytest.approx(math.pi / 2 * (15 + 1.75), abs=0.01)


@pytest.mark.parametrize("name", ["paper_stop4", "paper_light4"])
def test_recorded_junctions_have_about_the_recorded_lengths(name: str) -> None:
    measured = {Turn.RIGHT: (14.1, 17.9), Turn.STRAIGHT: (26.3, 30.7), Turn.LEFT: (26.6, 31.5)}
    for movement in find(name).movements.values():
        low, high = measured[movement.turn]
        assert low <= movement.length <= high


@pytest.mark.parametrize("name", names())
def test_itineraries_are_smooth_and_without_gaps(name: str) -> None:
    junction = find(name)
    # 0.5 m of the tightest circle: radius 9.9 m; in the roundabout, where lanes 2.75 m from the axis turn by 70 degrees onto the
    # ring, 25 m from the centre and 20 degrees further on, (25 sin 20 - 2.75) / cos 20 / tan 35 m.
    tightest = 8.81 if name == "roundabout4" else 9.9
    for entrance, exit in junction.movements:
        itinerary = Itinerary.through(junction, entrance, exit)
        points = itinerary.path.points
        headings = [itinerary.path.pose(s + 1e-9).heading for s in itinerary.path.stations[:-1]]
        assert max(math.dist(a, b) for a, b in pairwise(junction.way_through(*(entrance, exit)).points)) <= 30
        assert max(abs(math.remainder(b - a, math.tau)) for a, b in pairwise(headings)) <= 0.5 / tightest + 1e-3
        assert math.dist(points[0], points[-1]) > (40 if name == "roundabout4" else 100)


@pytest.mark.parametrize("name", names())
def test_files_are_what_the_layouts_write(name: str) -> None:
    layout = LAYOUTS[name]
    text = roundabout(layout, name) if isinstance(layout, Roundabout) else opendrive(layout, name)
    assert path_of(name).read_text(encoding="utf-8") == text


def test_the_graph_library_waits_for_the_first_map() -> None:
    code = "import sys, pytest_rvads.plugin, pytest_rvads.geometry.junction; sys.exit('networkx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("setback", [0.0, 2.0, 4.0, 8.0])
@pytest.mark.parametrize("left_hand", [False, True])
def test_stop_lines_before_the_junction(read: Read, setback: float, left_hand: bool) -> None:
    report = read(opendrive(Layout(setback=setback, left_hand=left_hand))).report("1")
    assert report.setbacks == pytest.approx((setback,) * 4, abs=1e-6)
    assert report.control is JunctionControl.STOP


@pytest.mark.parametrize("ways", range(3, 9))
def test_any_arity(read: Read, ways: int) -> None:
    report = read(opendrive(Layout(ways, JunctionControl.LIGHTS, stop=25.0))).report("1")
    assert report.usable, report.reason
    assert report.ways == ways
    assert len(report.movements) == ways * (ways - 1)
    assert sorted(e for group in report.phase_groups for e in group) == list(range(ways))


def test_left_hand_traffic_is_the_mirror_image(read: Read) -> None:
    right = read(opendrive(Layout())).report("1")
    left = read(opendrive(Layout(left_hand=True))).report("1")
    # Mirrored at the north-south axis arm i becomes arm -i, and who was to the right is to the left.
    assert left.left_hand
    assert left.right_of == {(-a % 4, -b % 4) for a, b in right.right_of}
    assert left.opposite == {(-a % 4, -b % 4) for a, b in right.opposite}
    mirrored = {Turn.LEFT: Turn.RIGHT, Turn.RIGHT: Turn.LEFT, Turn.STRAIGHT: Turn.STRAIGHT}
    turns = {(m.entrance, m.exit): m.turn for m in right.movements}
    assert {(m.entrance, m.exit): m.turn for m in left.movements} == {
        (-a % 4, -b % 4): mirrored[t] for (a, b), t in turns.items()
    }


@pytest.mark.parametrize("left_hand", [False, True])
def test_neighbours_at_45_degrees_are_turns_on_both_sides(read: Read, left_hand: bool) -> None:
    """In a regular 8-way junction the arms beside the straight one are at 45 degrees; rounding must not decide."""
    report = read(opendrive(Layout(8, JunctionControl.STOP, stop=40, left_hand=left_hand))).report("1")
    turns = {(way.entrance, way.exit): way.turn.value for way in report.movements}
    for entrance in range(8):
        kinds = [turns[entrance, (entrance + direction) % 8] for direction in range(1, 8)]
        assert kinds == ["right"] * 3 + ["straight"] + ["left"] * 3
