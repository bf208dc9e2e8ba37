"""The JSON object of ``rvads map FILE --json``."""

import json

from pytest_rvads.maps.builtin import path_of
from pytest_rvads.maps.road_map import describe, read_map
from pytest_rvads.maps.writer import Layout, opendrive


def test_all_fields() -> None:
    path = path_of("light3")
    record = json.loads(json.dumps(describe(read_map(path))))
    (junction,) = record.pop("junctions")
    assert record == {"file": str(path), "warnings": []}
    movements = {(m["entrance"], m["exit"]): (m["turn"], m["length"]) for m in junction.pop("movements")}
    assert {key: turn for key, (turn, _) in movements.items()} == {
        (0, 1): "right",
        (0, 2): "left",
        (1, 0): "left",
        (1, 2): "straight",
        (2, 0): "right",
        (2, 1): "straight",
    }
    assert movements[1, 2][1] == 30.0
    assert junction == {
        "id": "1",
        "ways": 3,
        "control": "lights",
        "usable": True,
        "reason": None,
        "entrances": ["e0", "e1", "e2"],
        "approach": [120.0, 120.0, 120.0],
        "right_of": [[0, 2], [1, 0]],
        "opposite": [[1, 2], [2, 1]],
    }


def test_warnings_are_records(read, tree) -> None:
    root = tree()
    signal = root.find("road/signals/signal")
    signal.set("orientation", "+")
    record = describe(read(root))
    assert [warning["kind"] for warning in record["warnings"]] == ["orientation"]
    assert record["warnings"][0]["junction"] == "1"
    assert record["junctions"][0]["control"] == "stop"


def test_unusable_junctions_keep_ways_and_control(read) -> None:
    # The first arm loses its way out: exits lead to a sidewalk there.
    road_map = read(opendrive(Layout()).replace('id="-1" type="driving"', 'id="-1" type="sidewalk"', 1))
    (junction,) = describe(road_map)["junctions"]
    assert (junction["ways"], junction["control"], junction["usable"]) == (4, "stop", False)
    assert (
        junction["reason"] == "arm 0 (road '0') is one-way and has no exit lane, expected one entrance and one exit lane per arm"
    )
    assert {(m["entrance"], m["exit"]) for m in junction["movements"]} == {(i, k) for i in range(4) for k in (1, 2, 3) if i != k}


def test_connecting_roads_complete_the_table(read, tree) -> None:
    root = tree()
    junction = root.find("junction")
    for row in junction.findall("connection")[::2]:
        junction.remove(row)
    (found,) = read(root).junctions
    assert found.usable
