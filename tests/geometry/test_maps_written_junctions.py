"""Junctions of maps in other formats, written as OpenDRIVE and read again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.geometry.builtin import NAMES
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.geometry.segment import NO_LIMIT, Segment
from pytest_rvads.satellites.relations.variants import moved
from pytest_rvads.support.errors import MapError


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
