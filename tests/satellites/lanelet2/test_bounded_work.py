"""Small files of lanelets that would cost much are read, or refused in one sentence, within a gigabyte and some seconds."""

import re
from itertools import pairwise
from pathlib import Path

from ...bounded import answers
from .commonroad_files import commonroad
from .lanelet_files import Crossing, Osm, place


def mistyped(folder: Path, name: str, by: float, node: int = 1) -> Path:
    """Write a crossing of which one node lies `by` metres too far in the east."""
    crossing = Crossing()
    x = next(tag for tag in crossing.elements[list(crossing.nodes.values())[node]] if tag.get("k") == "local_x")
    x.set("v", str(float(x.get("v", "")) + by))
    return crossing.write(folder / name)


def scaled(folder: Path, name: str, factor: float) -> Path:
    """Write a crossing in another unit of length."""
    crossing = Crossing()
    for tag in crossing.root.iter("tag"):
        if tag.get("k") in ("local_x", "local_y"):
            tag.set("v", str(float(tag.get("v", "")) * factor))
    return crossing.write(folder / name)


def crossing_lanes(folder: Path, name: str, length: float) -> Path:
    """Write two lanelets of a length that cross, with a lanelet before and behind each."""
    osm = Osm()
    for road in (0, 1):
        stations = [-length / 2 - 50.0, -length / 2, length / 2, length / 2 + 50.0]
        for a, b in pairwise(stations):
            osm.lanelet(*(osm.way([place(road, a, side), place(road, b, side)]) for side in (1.75, -1.75)))
    return osm.write(folder / name)


def back_and_forth(folder: Path, name: str, count: int) -> Path:
    osm = Osm()
    one, two = (osm.way([(0.0, y), (10.0, y)]) for y in (0.0, -4.0))
    back = [osm.way([(10.0, y), (0.0, y)]) for y in (-4.0, 0.0)]
    for _ in range(count):
        osm.lanelet(one, two)
        osm.lanelet(*back)
    return osm.write(folder / name)


def many_ways(folder: Path, name: str, count: int) -> Path:
    """Write a crossing of which one bound consists of many ways, in an order that joins no two of them one after the other."""
    crossing = Crossing()
    crossing.drop(crossing.entries[0])
    outs = [60.0 - 50.0 * k / count for k in range(count + 1)]
    parts = [crossing.way([place(0, a, 3.5), place(0, b, 3.5)]) for a, b in pairwise(outs)]
    crossing.lanelet(crossing.middles[0], [parts[0], *parts[:0:-1]])
    return crossing.write(folder / name)


def crosswalks(folder: Path, name: str, count: int) -> Path:
    crossing = Crossing()
    left, right = (crossing.way([place(1, out, -5.0), place(1, out, 5.0)]) for out in (11.0, 14.0))
    for _ in range(count):
        crossing.lanelet(left, right, subtype="crosswalk")
    return crossing.write(folder / name)


def shared_bound(folder: Path, name: str) -> Path:
    """Write 200 lanelets that share a bound of 10,000 nodes."""
    osm = Osm()
    bound = osm.way([(k * 0.01, k % 2 * 0.01) for k in range(10_000)])
    for k in range(200):
        osm.lanelet(bound, osm.way([(0.0, -3.0 - k / 100), (100.0, -3.0 - k / 100)]))
    return osm.write(folder / name)


def priorities(folder: Path, name: str) -> Path:
    crossing = Crossing()
    members = [(role, id) for role in ("right_of_way", "yield") for id in crossing.movements.values()]
    for _ in range(800):
        crossing.regulate("right_of_way", members)
    return crossing.write(folder / name)


def tiles(folder: Path, name: str, count: int) -> Path:
    """Write a square of crossings without a road between, which become one junction."""
    osm = Osm()
    for i, k in ((i, k) for i in range(count) for k in range(count)):
        x, y = 20.0 * i, 20.0 * k
        osm.lanelet(*(osm.way([(x - 10.0, y + side), (x + 10.0, y + side)]) for side in (1.5, -1.5)))
        osm.lanelet(*(osm.way([(x + side, y - 10.0), (x + side, y + 10.0)]) for side in (-1.5, 1.5)))
    osm.lanelet(*(osm.way([(-40.0, y), (-10.0, y)]) for y in (1.5, -1.5)))
    osm.lanelet(*(osm.way([(20.0 * count - 10.0, y), (20.0 * count + 20.0, y)]) for y in (1.5, -1.5)))
    osm.lanelet(*(osm.way([(x, -40.0), (x, -10.0)]) for x in (-1.5, 1.5)))
    return osm.write(folder / name)


def stop_line(folder: Path, name: str, nodes: int) -> Path:
    crossing = Crossing()
    line = [place(0, 11.0 - 0.3 * (k % 2), 0.2 + 3.1 * k / nodes) for k in range(nodes)]
    crossing.way(line, type="stop_line")
    return crossing.write(folder / name)


def test_lanelet2(tmp_path: Path) -> None:
    expected = {
        mistyped(tmp_path, "node_1.osm", 89_000.0): "lanelet '10' is 89.0 km long, expected at most 20 km",
        mistyped(tmp_path, "node_40.osm", 5_000.0, 40): "its movement from lane 43 to lane 11 is 5,",
        scaled(tmp_path, "millimetres.osm", 1000.0): "km long, expected at most 20 km; check the unit of length",
        scaled(tmp_path, "times_200.osm", 200.0): "m long, expected at most 1,000 m; check the unit of length",
        crossing_lanes(tmp_path, "long.osm", 15_000.0): "4 arms",
        back_and_forth(tmp_path, "back_and_forth.osm", 600): "more than 100 lanelets begin where lanelet",
        many_ways(tmp_path, "ways.osm", 4000): "4 arms",
        crosswalks(tmp_path, "crosswalks.osm", 100): "more than 50 crosswalks lie over arm",
        shared_bound(tmp_path, "shared_bound.osm"): "the bounds of its lanelets have more than 1,500,000 nodes",
        priorities(tmp_path, "priorities.osm"): "its lights, signs and priorities are for more than 100,000 places",
        stop_line(tmp_path, "stop_line.osm", 20_000): "4 arms",
        tiles(tmp_path, "tiles.osm", 20): "it has 2 arms",
    }
    found = answers(list(expected))
    assert {file.name: words for file, words in expected.items() if words.lower() not in found[file.name].lower()} == {}


def test_commonroad(tmp_path: Path) -> None:
    def scale(factor: float) -> str:
        return re.sub(r"<([xy])>([^<]*)</", lambda match: f"<{match[1]}>{float(match[2]) * factor!r}</", commonroad())

    texts = {
        "millimetres.xml": (scale(1000.0), "km long, expected at most 20 km; check the unit of length"),
        "times_200.xml": (scale(200.0), "m long, expected at most 1,000 m; check the unit of length"),
        "huge.xml": (commonroad().replace("<x>10.0</x>", "<x>9e7</x>", 1), " km long, expected at most 20 km"),
    }
    for name, (text, _) in texts.items():
        (tmp_path / name).write_text(text)
    found = answers([tmp_path / name for name in texts])
    assert {name: words for name, (_, words) in texts.items() if words not in found[name]} == {}
