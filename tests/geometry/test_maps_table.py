"""The table "Which file shows what" of maps from elsewhere: ids, arity, control, approach, refusals."""

from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.road_map import RoadMap, describe, read_map
from pytest_rvads.support.errors import MapError

# file, junction, ways, control, shortest approach [m]
TABLE = [
    ("Town07", "169", 4, "stop", 32),
    ("Town07", "68", 4, "lights", 34),
    ("Town04", "148", 4, "lights", 34),
    ("Town04", "916", 4, "lights", 34),
    ("Town04", "621", 4, "lights", 31),
    ("Town04", "785", 4, "lights", 31),
    ("Town04", "335", 4, "lights", 6),
    ("Town04", "1249", 4, "lights", 4),
    ("Town04", "483", 4, "lights", 1),
    ("multi_intersections", "150", 4, "lights", 109),
    ("cubetown", "12", 3, "stop", 86),
    ("cubetown", "11", 3, "lights", 86),
    ("Town07", "260", 3, "stop", 43),
    ("Town07", "146", 3, "stop", 34),
    ("Town07", "430", 3, "stop", 32),
    ("Town07", "402", 3, "stop", 25),
    ("Town07", "907", 3, "stop", 15),
    ("Town01", "87", 3, "lights", 109),
    ("Town01", "143", 3, "lights", 108),
    ("multi_intersections", "148", 3, "lights", 218),
    ("multi_intersections", "152", 3, "lights", 218),
    ("multi_intersections", "154", 3, "lights", 217),
    ("fabriksgatan", "4", 4, "none", 17),
    ("simple_4way_intersection", "1", 4, "none", 100),
    ("simple_3way_intersection_lht", "1", 3, "none", 100),
    # The table says 537, which leaves out the 4 m road at the far end of the walk: 4 + 532.7 + 4 m.
    ("Crossing8Course", "2", 4, "lights", 541),
]
USABLE = {
    "Town01": {(3, "lights"): 12},
    "Town04": {(4, "lights"): 7, (3, "lights"): 4, (4, "none"): 2},
    # Seven of the ten that have no stop sign and no light have yield signs (205); one of these has an arm of two lanes.
    "Town07": {(4, "stop"): 1, (3, "stop"): 5, (4, "lights"): 1, (3, "lights"): 3, (3, "none"): 4, (3, "yield"): 6},
}
"""Those with one entrance and one exit lane per arm, and a movement from every entrance to every other arm."""


@cache
def load(folder: Path, stem: str) -> RoadMap:
    return read_map(folder / "maps" / f"{stem}.xodr")


@pytest.mark.parametrize(("stem", "id", "ways", "control", "approach"), TABLE)
def test_junctions(shared: Path, stem: str, id: str, ways: int, control: str, approach: float) -> None:
    report = load(shared, stem).report(id)
    assert report.usable, report.reason
    assert (report.ways, report.control) == (ways, control)
    assert min(report.approach) == pytest.approx(approach, abs=0.6)


@pytest.mark.parametrize("stem", USABLE)
def test_counts(shared: Path, stem: str) -> None:
    counts: Counter[tuple[int, str]] = Counter()
    for report in load(shared, stem).junctions:
        # In towns all of it is two-way roads; whatever joins three or more is usable, with however many lanes.
        assert report.usable == (report.ways > 2), report.reason
        movements = {(way.entrance, way.exit) for way in report.movements}
        if (
            report.usable
            and len(report.entrances) == len(report.exits) == report.ways
            and len(movements) == report.ways * (report.ways - 1)
        ):
            counts[report.ways, report.control.value] += 1
    assert counts == USABLE[stem]


@pytest.mark.parametrize(
    ("stem", "control"), [("sumo_stop4", "stop"), ("sumo_lights4", "lights"), ("sumo_t3", "none"), ("sumo_skew4", "none")]
)
def test_maps_written_by_sumo(shared: Path, stem: str, control: str) -> None:
    (report,) = load(shared, stem).junctions
    assert report.usable
    assert report.control == control
    assert min(report.approach) >= 100


def test_partial_control_names_the_bare_entrances(shared: Path) -> None:
    road_map = load(shared, "fabriksgatan_traffic_lights")
    (report,) = road_map.junctions
    assert report.control == "partial"
    assert any("have no sign or light" in warning.message for warning in road_map.warnings)


def test_a_y_has_nobody_right_of_another(shared: Path) -> None:
    road_map = load(shared, "simple_3way_intersection_lht")
    (report,) = road_map.junctions
    assert report.left_hand
    assert report.right_of == report.opposite == frozenset()
    assert [warning.kind for warning in road_map.warnings] == ["right_of"]


@pytest.mark.parametrize(
    ("stem", "ids", "words"),
    [
        ("direct_junction_simple", ["4"], 'type "direct"'),
        ("connected_junctions_simple", ["100", "200"], "is itself part of junction"),
        ("Town07", ["453"], "it has 2 arms"),
    ],
)
def test_unusable_junctions_say_why(shared: Path, stem: str, ids: list[str], words: str) -> None:
    for id in ids:
        report = load(shared, stem).report(id)
        assert not report.usable
        assert words in (report.reason or "")
        with pytest.raises(MapError, match=f"junction '{id}' of map file .* cannot be used: "):
            find(id, shared / "maps" / f"{stem}.xodr")


@pytest.mark.parametrize(("stem", "id", "lanes"), [("lane_offset_intersection", "8", (2, 2, 2)), ("Town07", "725", (1, 2, 1, 1))])
def test_several_lanes_per_arm(shared: Path, stem: str, id: str, lanes: tuple[int, ...]) -> None:
    assert find(id, shared / "maps" / f"{stem}.xodr").lanes == lanes


def test_a_file_without_junction_is_refused(shared: Path) -> None:
    with pytest.raises(MapError, match="4 roads but no <junction>"):
        load(shared, "XCrossStopAllWay")


def test_gaps_above_a_metre_make_a_junction_unusable(shared: Path) -> None:
    road_map = load(shared, "Issue295a")
    assert any(report.usable for report in road_map.junctions)
    assert any(warning.kind == "gap" for warning in road_map.warnings)
    for report in road_map.junctions:
        if report.usable:
            edges = road_map.graph.edges
            for way in report.movements:
                first, last = edges[way.path.edges[0]], edges[way.path.edges[-1]]
                x, y = first.points[0] - edges[way.path.entrance].points[-1]
                assert x * x + y * y <= 1.0
                x, y = last.points[-1] - edges[way.path.exit].points[0]
                assert x * x + y * y <= 1.0


@pytest.mark.parametrize("files", ["sumo_*", pytest.param("*", marks=pytest.mark.extended)])
def test_every_file_lists_every_junction_once(shared: Path, files: str) -> None:
    for path in sorted((shared / "maps").glob(f"{files}.xodr")):
        if path.stem == "XCrossStopAllWay":
            continue
        found = [junction["id"] for junction in describe(load(shared, path.stem))["junctions"]]
        assert len(found) == path.read_text(encoding="utf-8").count("<junction ")
        assert len(set(found)) == len(found)


def test_walks_follow_the_lanes(shared: Path) -> None:
    """Approaches end, and exits start, where the movements do."""
    for stem, id in (("Town07", "169"), ("Town07", "68"), ("cubetown", "12"), ("multi_intersections", "148")):
        junction = find(id, shared / "maps" / f"{stem}.xodr")
        assert junction.drivable
        for (entrance, exit), segment in ((key, m.path) for key, m in junction.movements.items()):
            assert sum((segment.points[0] - junction.way_in(entrance).points[-1]) ** 2) <= 1.0
            assert sum((segment.points[-1] - junction.way_out(exit).points[0]) ** 2) <= 1.0


@pytest.mark.parametrize("stem", ["Town01", "Town04", "Town07"])
def test_inverted_orientations_are_told(shared: Path, stem: str) -> None:
    """RoadRunner orients every light and stop sign of the CARLA towns against the traffic it is for."""
    road_map = load(shared, stem)
    told = {warning.junction for warning in road_map.warnings if warning.kind == "orientation"}
    assert told == {report.id for report in road_map.junctions if report.control != "none"}
