"""What the author of a driver reads from a junction: its OpenDRIVE file, the places of lines and lights, the exits of a turn."""

from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.opendrive.map_file import NAMES, path_of
from pytest_rvads.support.errors import MapError, ScenarioError


@pytest.mark.parametrize("name", NAMES)
def test_text_of_a_built_in_junction_is_that_of_its_file(name: str) -> None:
    assert find(name).opendrive() == path_of(name).read_text(encoding="utf-8")


def test_text_of_a_map_is_read_in_the_encoding_that_the_map_declares(tmp_path: Path) -> None:
    text = path_of("stop3").read_text(encoding="utf-8")
    head, body = text.split("\n", 1)
    assert "encoding" in head
    written = '<?xml version="1.0" encoding="ISO-8859-1"?>\n<!-- Straße -->\n' + body
    path = tmp_path / "mine.xodr"
    path.write_bytes(written.encode("latin-1"))
    assert find("1", path).opendrive() == written


def test_map_that_is_no_text_is_one_error(tmp_path: Path) -> None:
    place = find("stop4")
    other = tmp_path / "town.osm"
    other.write_bytes(b'<?xml version="1.0" encoding="klingon"?><OpenDRIVE/>')
    with pytest.raises(MapError, match="can't be read as text: unknown encoding"):
        replace(place, map=str(other)).opendrive()
    other.unlink()
    with pytest.raises(MapError, match="can't be read as text"):
        replace(place, map=str(other)).opendrive()
    with pytest.raises(MapError, match="junction 'mine' has no map file"):
        replace(place, name="mine").opendrive()


def test_stop_line_and_light_of_an_entrance_lie_where_the_map_was_written() -> None:
    """Vertices 15 m from the centre, lanes of 3.5 m beside the axis of the arm, lights 0.8 m beside the lane."""
    south, east, *_ = find("light4").entrances
    assert south.stop_line == pytest.approx((1.75, -15.0, 1.5708), abs=1e-4)
    assert east.stop_line == pytest.approx((15.0, 1.75, 3.1416), abs=1e-4)
    assert (south.light, east.light) == (pytest.approx((4.3, -15.0)), pytest.approx((15.0, 4.3)))
    assert replace(south, setback=2.5).stop_line == pytest.approx((1.75, -17.5, 1.5708), abs=1e-4)
    (stop, *_) = find("stop4").entrances
    assert stop.light is None
    assert replace(stop, approach=None).stop_line is None


def test_exits_of_a_turn_by_name() -> None:
    """The arms are numbered counter-clockwise from the south."""
    place = find("stop4")
    assert [place.exits_of(0, turn) for turn in ("right", "straight", "left")] == [(1,), (2,), (3,)]
    assert place.exits_of(3, "right") == (0,)
    assert find("stop3").exits_of(0, "straight") == (), "the stem of a T"
    for entrance, turn in ((0, "Left"), (4, "left"), (-1, "left")):
        with pytest.raises(ScenarioError, match=r"its entrances are 0 to 3, and the turns left, straight, right"):
            place.exits_of(entrance, turn)
