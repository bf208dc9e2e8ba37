"""What is written as OpenDRIVE, in the file and as the reader gets it: elements, junctions of other maps, the roundabout."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import NAMES, path_of
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.geometry.segment import NO_LIMIT, Pose, Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.satellites.relations.variants import moved
from pytest_rvads.support.errors import MapError
from tools.crossings import Layout, joined, opendrive
from tools.make_maps import CROSSINGS, LAYOUTS
from tools.roundabouts import Roundabout, roundabout

from .conftest import Read

TURN_LANE = (((1, 2), (3,)),) * 4
"""An X whose arms have a lane for right and straight at the kerb, and one for left."""


def signals(text: str) -> Iterator[tuple[str, str, str, str, tuple[int, int]]]:
    """Yield road, country, type, subtype and lanes of every sign and light."""
    for road in ET.fromstring(text.encode()).iter("road"):
        for signal in road.iter("signal"):
            lanes = signal.find("validity")
            assert lanes is not None
            kind = tuple(signal.attrib[name] for name in ("country", "type", "subtype"))
            yield road.attrib["id"], *kind, (int(lanes.attrib["fromLane"]), int(lanes.attrib["toLane"]))  # type: ignore[misc]


def lanes_of(junction: Junction) -> list[tuple[tuple[int, int], tuple[int, int], Turn]]:
    """Return arm and lane of both ends of every movement, and its turn."""
    ends = junction.entrances, junction.exits
    return sorted(
        ((ends[0][m.entrance].arm, ends[0][m.entrance].lane), (ends[1][m.exit].arm, ends[1][m.exit].lane), m.turn)
        for m in junction.movements.values()
    )


def test_signs_have_the_numbers_of_the_german_catalogue() -> None:
    written = {road: found for road, *found in signals(path_of("yield4").read_text(encoding="utf-8"))}
    # StVO, annex 2, sign 205 and annex 3, sign 306: the minor road runs from south to north.
    assert written == {road: ["DE", type, "-1", (1, 1)] for road, type in zip("0123", ("205", "306") * 2, strict=True)}
    assert list(signals(path_of("right4").read_text(encoding="utf-8"))) == []
    lines = [e.attrib["name"] for e in ET.parse(path_of("yield4")).getroot().iter("object")]
    assert lines == ["HoldingLine"] * 2, "nobody waits on the major road"


def test_a_lane_for_the_turn_across_has_an_arrow_and_a_phase() -> None:
    text = path_of("lanes4").read_text(encoding="utf-8")
    # The catalogue of OpenDRIVE: 1000001 for all directions, 1000011 with an arrow, 10 to the left.
    assert sorted(signals(text)) == sorted(
        (str(arm), "OpenDRIVE", *light) for arm in range(4) for light in (("1000001", "-1", (2, 2)), ("1000011", "10", (1, 1)))
    )
    junction = find("lanes4")
    assert junction.lanes == (2, 2, 2, 2)
    assert [len(arm.exits) for arm in junction.arms] == [1, 1, 1, 1]
    groups = [{(junction.entrances[e].arm, junction.entrances[e].lane) for e in group} for group in junction.phase_groups]
    assert groups == [{(0, 0), (2, 0)}, {(0, 1), (2, 1)}, {(1, 0), (3, 0)}, {(1, 1), (3, 1)}]
    mirrored = opendrive(replace(CROSSINGS["lanes4"], left_hand=True, lanes=(((2, 3), (1,)),) * 4))
    assert {subtype for _, _, type, subtype, _ in signals(mirrored) if type == "1000011"} == {"20"}


def test_turn_lanes_lead_where_they_allow() -> None:
    expected = [((a, 0), ((a + 1) % 4, 0), Turn.RIGHT) for a in range(4)]
    expected += [((a, 0), ((a + 2) % 4, 0), Turn.STRAIGHT) for a in range(4)]
    expected += [((a, 1), ((a + 3) % 4, 0), Turn.LEFT) for a in range(4)]
    junction = find("lanes4")
    assert lanes_of(junction) == sorted(expected)
    lengths = {m.turn: m.length for m in junction.movements.values()}
    # Lanes in 3.5 m and 0 m to the right of the axis, out 3.5 m to its other side, vertices 15 m from the centre. Right: a
    # quarter circle of 15 - 3.5 m. Left: 3.5 m straight on, then one of 15 m.
    assert lengths[Turn.RIGHT] == pytest.approx(math.pi / 2 * 11.5, abs=0.01)
    assert lengths[Turn.STRAIGHT] == pytest.approx(30, abs=1e-6)
    assert lengths[Turn.LEFT] == pytest.approx(3.5 + math.pi / 2 * 15, abs=0.01)
    facing = {(one, two) for one, two in junction.conflicts or () if {m[0] for m in (one, two)} == {1, 5}}
    assert facing == set(), "opposite left turns pass each other"


@pytest.mark.parametrize("left_hand", [False, True])
def test_two_lanes_keep_their_order(read: Read, left_hand: bool) -> None:
    """Two lanes allow straight on, both also a turn: at the kerb to the kerb, across oncoming traffic to the centre."""
    near, far = (3, 1) if left_hand else (1, 3)
    layout = Layout(stop=20, lanes=(((near, 2), (2, far)),) * 4, exits=(2,) * 4, left_hand=left_hand)
    junction = read(opendrive(layout)).junction("1")
    ways = {(one, two) for one, two, _ in lanes_of(junction)}
    assert ways == {
        *(((a, 0), ((a + near) % 4, 0)) for a in range(4)),
        *(((a, k), ((a + 2) % 4, k)) for a in range(4) for k in (0, 1)),
        *(((a, 1), ((a + far) % 4, 1)) for a in range(4)),
    }
    assert {turn for one, two, turn in lanes_of(junction) if (two[0] - one[0]) % 4 == far} == {junction.far}


def test_layout_of_one_way_arms_and_shifted_lanes(read: Read) -> None:
    """Nothing leads out into the south; from the west one comes straight across into another lane of the east, by two arcs."""
    lanes = (((1, 2),), ((1, 2),), (), ((2,),))
    layout = Layout(control=JunctionControl.NONE, lanes=lanes, exits=(0, 1, 1, 1), shift=1.0)
    junction = read(opendrive(layout)).junction("1")
    assert [(len(arm.entrances), len(arm.exits)) for arm in junction.arms] == [(1, 0), (1, 1), (0, 1), (1, 1)]
    # Lanes in lie 0.75 m from the axis, lanes out 2.75 m: two metres aside over 30 m, by arcs of the angle t, tan(t/2) = 2/30.
    half = math.atan2(2, 30)
    assert junction.movements[2, 0].length == pytest.approx(30 * 2 * half / math.sin(2 * half), abs=0.01)


def test_ways_are_tangent_at_both_ends() -> None:
    for end in (Pose(12.0, 5.0, 1.2), Pose(9.0, 14.0, math.pi / 2), Pose(30.0, -2.0, 0.0), Pose(8.0, -9.0, -1.0)):
        pieces = joined(Pose(0.0, 0.0, 0.0), end)
        for one, two in zip(pieces, [*(piece.start for piece in pieces[1:]), end], strict=True):
            (x, y, heading), turn = one.start, one.length * one.curvature
            chord = one.length if not one.curvature else 2 * math.sin(turn / 2) / one.curvature
            reached = (x + chord * math.cos(heading + turn / 2), y + chord * math.sin(heading + turn / 2), heading + turn)
            assert reached == pytest.approx(two, abs=1e-9)
    for behind in (Pose(-5.0, 0.0, 0.0), Pose(-5.0, 5.0, 1.0)):
        with pytest.raises(MapError, match=r"no (arc|way) leads from"):
            joined(Pose(0.0, 0.0, 0.0), behind)


@pytest.mark.parametrize("name", LAYOUTS)
def test_marks_are_on_both_sides_of_every_road_lane(name: str) -> None:
    for road in ET.parse(path_of(name)).getroot().iter("road"):
        marks = {int(lane.attrib["id"]): [m.attrib["type"] for m in lane.iter("roadMark")] for lane in road.iter("lane")}
        kinds = {int(lane.attrib["id"]): lane.attrib["type"] for lane in road.iter("lane")}
        for id in (id for id, kind in kinds.items() if kind == "driving"):
            side = 1 if id > 0 else -1
            inner, outer = marks[id - side], marks[id]
            if road.attrib["junction"] != "-1":
                assert (inner, outer) == (["none"], ["none"])
            else:
                between = kinds.get(id + side) == "driving"
                assert outer == (["broken"] if between else ["solid"])
                parted = kinds[id - side] == "none" and -side in kinds
                assert inner == (["solid", "broken"] if parted else ["broken"] if kinds[id - side] == "driving" else ["solid"])


def test_a_roundabout_is_a_ring_of_small_junctions() -> None:
    road_map = read_map(path_of("roundabout4"))
    assert [report.id for report in road_map.junctions] == ["1", "2", "3", "4"]
    for report in road_map.junctions:
        assert report.usable, report.reason
        junction = road_map.junction(report.id)
        (arm,) = [number for number, arm in enumerate(junction.arms) if arm.entrances and arm.exits]
        (ring,) = [number for number, arm in enumerate(junction.arms) if arm.entrances and not arm.exits]
        ways = {(junction.entrances[m.entrance].arm, junction.exits[m.exit].arm): m for m in junction.movements.values()}
        (away,) = {0, 1, 2} - {arm, ring}
        assert {key: m.turn for key, m in ways.items()} == {
            (ring, away): Turn.STRAIGHT,
            (ring, arm): Turn.RIGHT,
            (arm, away): Turn.RIGHT,
        }
        assert ways[ring, away].length == pytest.approx(25 * math.radians(40), abs=0.01)
        merging = {ways[ring, away].key, ways[arm, away].key}
        assert {frozenset(pair) for pair in junction.conflicts or ()} == {frozenset(merging)}
        # A quarter of the ring without the 20 degrees that lie in the junctions on either side.
        (entrance,) = junction.arms[ring].entrances
        assert junction.approach(entrance) == pytest.approx(25 * math.radians(50), abs=0.01)
    assert junction.name == "roundabout4.4"
    assert find("roundabout4").name == "roundabout4"
    signs = {road: type for road, _, type, _, _ in signals(path_of("roundabout4").read_text(encoding="utf-8"))}
    assert signs == dict.fromkeys("0123", "205")


@pytest.mark.parametrize("arms", [3, 5, 6])
def test_roundabouts_of_other_numbers_of_arms(read: Read, arms: int) -> None:
    found = read(roundabout(Roundabout(arms, radius=32, stop=44))).junctions
    assert [(report.usable, report.ways) for report in found] == [(True, 3)] * arms


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"control": JunctionControl.YIELD}, "control yield, but this control needs signs, one per arm"),
        ({"control": JunctionControl.PARTIAL}, "control partial, but this control needs signs"),
        ({"signs": (Sign.YIELD,) * 4}, "control stop, but its signs make up yield"),
        ({"signs": (Sign.STOP,) * 3}, "a junction of 4 ways needs 4 signs, got 3"),
        ({"lanes": TURN_LANE[:2]}, "a junction of 4 ways needs 4 lanes, got 2"),
        ({"exits": (1, 1)}, "needs 4 exits, got 2"),
        ({"lanes": (((1, 4),),) * 4}, "lane 0 of arm 0 allows direction 4, expected 1 to 3 and a lane that leads out there"),
        ({"lanes": TURN_LANE, "exits": (1, 0, 1, 1)}, "lane 0 of arm 0 allows direction 1, expected 1 to 3 and a lane"),
        ({"lanes": (((1, 2), (2, 3)),) * 4}, "2 lanes of arm 0 lead to arm 2, expected no more than the 1 that lead out there"),
        ({"lanes": ((),) * 4, "control": JunctionControl.NONE}, "needs a lane that leads in"),
        ({"shift": math.nan}, "lengths of a junction must be positive"),
    ],
)
def test_invalid_layout_is_refused(values: dict[str, object], says: str) -> None:
    with pytest.raises(MapError, match=says):
        Layout(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"arms": 2}, "3 to 8 arms"),
        ({"radius": 40.0}, "the arms begin outside the ring"),
        ({"approach": math.inf}, "lengths above 0"),
        ({"lane_offset": 1.0}, "leave no island"),
        ({"sector": 0.8}, "leave nothing of the ring"),
    ],
)
def test_invalid_roundabout_is_refused(values: dict[str, float], says: str) -> None:
    with pytest.raises(MapError, match=says):
        Roundabout(**values)  # type: ignore[arg-type]


def reread(junction: Junction, folder: Path) -> Junction:
    """Write a junction as if it came from a map of lanelets, read the written file, and compare everything but the phases."""
    other = folder / "town.osm"
    other.write_text("<osm/>", encoding="utf-8")
    path = folder / "written.xodr"
    path.write_text(replace(junction, map=str(other)).opendrive(), encoding="utf-8")
    road_map = read_map(path)
    assert not [warning for warning in road_map.warnings if warning.kind not in ("right_of", "signal")]
    after = road_map.junction(junction.id)
    assert after.arms == junction.arms
    assert [lane.sign for lane in after.entrances] == [lane.sign for lane in junction.entrances]
    assert [lane.sign_setback for lane in after.entrances] == [
        lane.sign_setback and pytest.approx(lane.sign_setback, abs=0.01) for lane in junction.entrances
    ]
    assert after.setbacks == pytest.approx([back if back <= 10.0 else 0.0 for back in junction.setbacks], abs=0.01)
    turns, turns_after = ({key: way.turn for key, way in place.movements.items()} for place in (junction, after))
    assert turns_after == turns
    for name in ("right_of", "opposite", "left_hand", "stated"):
        assert getattr(after, name) == getattr(junction, name)
    for walk, read in zip(junction.crossings, after.crossings, strict=True):
        assert (read.id, read.arm, read.phase) == (walk.id, walk.arm, walk.phase)
        assert np.hypot(*(read.area[:, None] - walk.area).T).min(axis=0).max() < 0.01
    for before, line in zip(lines(junction), lines(after), strict=True):
        assert line.length == pytest.approx(before.length, abs=0.1)
        stations = np.linspace(0.0, before.length, 50)
        assert np.hypot(*(line.centre(stations)[0] - before.centre(stations)[0]).T).max() < 0.1
    return after


def lines(junction: Junction) -> list[Segment]:
    ways = [junction.way_through(*key) for key in sorted(junction.movements)]
    entrances, exits = range(len(junction.entrances)), range(len(junction.exits))
    return [*map(junction.way_in, entrances), *ways, *map(junction.way_out, exits)]


@pytest.mark.parametrize("name", NAMES)
def test_built_in_junction_is_read_as_it_was_written(tmp_path: Path, name: str) -> None:
    place = find(name)
    after = reread(place, tmp_path)
    assert after.yields == place.yields
    assert after.phase_groups == place.phase_groups


def test_limits_and_distant_signs_are_read_as_they_were_written(tmp_path: Path) -> None:
    place = find("stop3")
    line = place.way_in(0)
    limits = ((0.0, None), (40.0, 13.9), (70.0, NO_LIMIT))
    first = replace(place.entrances[0], approach=replace(line, limits=limits), setback=1.5, sign_setback=4.0)
    entrances = (first, replace(place.entrances[1], sign=Sign.NONE, setback=2.0), place.entrances[2])
    after = reread(replace(place, entrances=entrances), tmp_path)
    assert [limit for _, limit in after.way_in(0).limits] == [limit for _, limit in limits]
    assert [at for at, _ in after.way_in(0).limits] == pytest.approx([0.0, 40.0, 70.0], abs=0.01)


def test_priorities_are_read_as_they_were_written(tmp_path: Path) -> None:
    stated = frozenset({((0, 2), (1, 3))})
    assert reread(replace(find("right4"), stated=stated), tmp_path).yields[(0, 2), (1, 3)] == "stated"


def test_junction_with_a_distant_line_cannot_be_moved(tmp_path: Path) -> None:
    place = find("stop4")
    other = tmp_path / "town.osm"
    other.write_text("<osm/>", encoding="utf-8")
    far = replace(place, map=str(other), entrances=(replace(place.entrances[0], setback=12.5), *place.entrances[1:]))
    with pytest.raises(MapError, match=r"has a stopping line 12\.5 m before it, and a map in OpenDRIVE"):
        moved(far, (1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("file", "id"),
    [
        ("lanelet2/awcore__lanelet2_map.osm", "J49"),
        ("lanelet2/own__all_way_stop.osm", "J3001"),
        ("lanelet2/validator__sample_map.osm", "10803"),
        ("lanelet2/ssv2__intersection.osm", "4132"),
        ("lanelet2/ssv2__kashiwanoha_map.osm", "J34666"),
        ("commonroad/USA_Lanker-1_3_T-1.xml", "11530"),
    ],
)
def test_public_junction_is_read_as_it_was_written(shared: Path, tmp_path: Path, file: str, id: str) -> None:
    path = shared / "maps" / file
    if not path.is_file():
        pytest.skip("the maps of lanelets in ../shared/maps are absent")
    place = find(id, path)
    after = reread(place, tmp_path)
    assert after.yields == place.yields
    assert after.phase_groups == place.phase_groups
    shifted = moved(place, (100.0, -20.0, 0.0))
    assert {key: way.turn for key, way in shifted.movements.items()} == {key: way.turn for key, way in place.movements.items()}
    assert np.allclose(shifted.way_in(0).points[-1], place.way_in(0).points[-1] + (100.0, -20.0), atol=0.01)
