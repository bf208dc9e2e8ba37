"""A damaged Lanelet2 or CommonRoad file is read or refused in one sentence, and nothing else comes out."""

import random
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.support.errors import MapError

from .commonroad_files import commonroad, lanelet, light
from .lanelet_files import Crossing, place

VALUES = (
    *("nan", "inf", "1e308", "-1e308", "1e9", "-5", "0", "", "x", "1e-12", "-1", "1", "2", "99", "a" * 2000, "\u202e"),
    *("yes", "no", "road", "left", "right", "lanelet", "stop_line", "regulatory_element", "relation", "way", "type", "delete"),
)


def lanelet2_seed(folder: Path) -> bytes:
    """Return a Lanelet2 file with an element of each kind."""
    osm = Crossing()
    osm.change(osm.entries[0], "one_way", "no")
    osm.change(osm.entries[0], "speed_limit", "50")
    osm.change(osm.movements[0, 1], "intersection_area", "7")
    osm.regulate("traffic_light", [("ref_line", osm.line(1, 1.0))], [osm.movements[1, 2]])
    osm.regulate("right_of_way", [("right_of_way", osm.entries[2]), ("yield", osm.entries[3]), ("ref_line", osm.line(3, 2.0))])
    osm.regulate("right_of_way", [("right_of_way", osm.movements[0, 2]), ("yield", osm.movements[1, 2])])
    osm.regulate("all_way_stop", [("yield", osm.entries[0])])
    left, right = (osm.way([place(1, out, -5.0), place(1, out, 5.0)]) for out in (11.0, 14.0))
    osm.lanelet(left, right, subtype="crosswalk")
    return osm.write(folder / "seed.osm").read_bytes()


def commonroad_seed() -> str:
    """Return a CommonRoad file with an element of each kind."""
    sign = "<trafficSign id='5'><trafficSignElement><trafficSignID>206</trafficSignID></trafficSignElement></trafficSign>"
    incoming = "<incoming id='91'><incomingLanelet ref='10'/><successorsRight ref='301'/><successorsLeft ref='303'/></incoming>"
    into = "<trafficSignRef ref='5'/><trafficLightRef ref='6'/><stopLine/><userBidirectional>car</userBidirectional>"
    left, right = ([place(1, out, -5.0), place(1, out, 5.0)] for out in (11.0, 14.0))
    zebra = lanelet(7, left, right, more="<laneletType>crosswalk</laneletType>")
    return commonroad(into, zebra + light(6, 30, "left") + sign + f"<intersection id='90'>{incoming}</intersection>")


def damaged(seed: bytes, source: random.Random) -> bytes:
    """Return a file with changed elements, or with changed bytes."""
    if source.random() < 0.25:
        data = bytearray(seed)
        for _ in range(source.randint(1, 5)):
            at = source.randrange(len(data))
            data[at : at + source.choice((0, 1, 9))] = data[: source.randint(0, 9)]
        return bytes(data)
    root = ElementTree.fromstring(seed)
    elements = list(root.iter())[1:]
    for _ in range(source.randint(1, 5)):
        element, other = source.choice(elements), source.choice(elements)
        change = source.choice(("set", "set", "set", "text", "drop", "clear", "copy", "move"))
        if change == "set" and element.attrib:
            element.set(source.choice(sorted(element.attrib)), source.choice(VALUES))
        elif change == "text" and element.text:
            element.text = source.choice(VALUES)
        elif change == "drop" and element.attrib:
            del element.attrib[source.choice(sorted(element.attrib))]
        elif change == "clear" and len(element) < 20:
            element.clear()
        elif change == "copy" and element.tag == other.tag:
            element.attrib.update(other.attrib)
        elif change == "move" and not len(other) and other is not element:
            element.append(other)
    return ElementTree.tostring(root)


def survive(seeds: list[tuple[str, bytes]], folder: Path, count: int) -> int:
    """Read damaged files and return how many were read; each must be read or refused in at most 10 s."""
    source = random.Random(7)
    read = 0
    for _ in range(count):
        suffix, seed = source.choice(seeds)
        path = folder / f"map{suffix}"
        path.write_bytes(damaged(seed, source))
        start = time.process_time()
        message = str(path)
        try:
            read_map(path)
            read += 1
        except MapError as error:
            message = str(error)
        assert str(path) in message
        assert "\n" not in message
        assert time.process_time() - start < 10
    return read


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_lanelet2_file_is_read_or_refused(tmp_path: Path, count: int) -> None:
    assert 0.2 < survive([(".osm", lanelet2_seed(tmp_path))], tmp_path, count) / count < 0.8


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_commonroad_file_is_read_or_refused(tmp_path: Path, count: int) -> None:
    assert 0.2 < survive([(".xml", commonroad_seed().encode())], tmp_path, count) / count < 0.8


@pytest.mark.slow
def test_damaged_public_file_is_read_or_refused(shared: Path, tmp_path: Path) -> None:
    files = [*sorted((shared / "maps" / "lanelet2").glob("*.osm")), *sorted((shared / "maps" / "commonroad").glob("*.xml"))]
    if not files:
        pytest.skip("the folders of ../shared/maps with lanelets are absent")
    assert survive([(file.suffix, file.read_bytes()) for file in files], tmp_path, 100)
