"""CommonRoad files come out as they say: lanelets, links, intersections, signs, lights and stop lines."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.errors import MapError

from .commonroad_files import commonroad, lanelet, light
from .lanelet_files import place

Read = Callable[..., RoadMap]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Return a function that reads the file that `commonroad` returns for its arguments."""

    def read(*args: str, **keywords: str) -> RoadMap:
        path = tmp_path / "cross.xml"
        path.write_text(commonroad(*args, **keywords), encoding="utf-8")
        return read_map(path)

    return read


def signs(road_map: RoadMap) -> dict[str, str]:
    (report,) = road_map.junctions
    return {end.edge: sign.value for end, sign in zip(report.entrances, report.signs, strict=True)}


def test_public_file_has_one_junction_with_lights(shared: Path) -> None:
    path = shared / "maps" / "commonroad" / "USA_Lanker-1_3_T-1.xml"
    if not path.is_file():
        pytest.skip("the folder ../shared/maps/commonroad is absent")
    road_map = read_map(path)
    report = road_map.report("11530")
    # The intersection of the file: 4 incomings with 17 lanelets, which name 20 successors, of which each leads to one exit.
    assert (report.ways, len(report.entrances), len(report.movements)) == (4, 17, 20)
    assert report.control == "lights"
    assert not report.left_hand
    assert [other.id for other in road_map.junctions if other.usable] == ["11530"]
    assert set(report.setbacks) == {0.0}
    assert road_map.junction("11530").conflicts


@pytest.mark.parametrize("version", ["2018b", "2020a"])
def test_lanelets_without_intersection_form_a_junction_by_geometry(read: Read, version: str) -> None:
    road_map = read(version=version)
    (report,) = road_map.junctions
    assert report.usable
    assert (report.id, report.ways, len(report.entrances), len(report.movements)) == ("J301", 4, 4, 12)
    assert not report.left_hand
    assert not road_map.warnings


def test_intersection_names_the_junction_and_its_lanelets(read: Read) -> None:
    incomings = "".join(
        f'<incoming id="9{k}"><incomingLanelet ref="1{k}"/>'
        + "".join(f'<successorsStraight ref="3{k}{end}"/>' for end in range(4) if end != k)
        + "</incoming>"
        for k in range(4)
    )
    (report,) = read(elements=f'<intersection id="77">{incomings}</intersection>').junctions
    assert (report.id, report.usable, len(report.movements)) == ("77", True, 12)


@pytest.mark.parametrize(
    ("number", "kind"),
    [("R1-1", "stop"), ("206", "stop"), ("R1-2", "yield"), ("205", "yield"), ("306", "priority"), ("101", "none")],
)
def test_signs_regulate_the_lanelets_that_refer_to_them(read: Read, number: str, kind: str) -> None:
    sign = f'<trafficSign id="5"><trafficSignElement><trafficSignID>{number}</trafficSignID></trafficSignElement></trafficSign>'
    found = signs(read('<trafficSignRef ref="5"/>', sign))
    assert found == {"10": kind, "11": "none", "12": "none", "13": "none"}


@pytest.mark.parametrize("points", [True, False])
def test_stop_line_lies_at_its_points_or_at_the_end_of_the_lanelet(read: Read, points: bool) -> None:
    ends = "".join(f"<point><x>13.0</x><y>{y}</y></point>" for y in (0.1, 3.4)) if points else ""
    (report,) = read(f"<stopLine>{ends}<lineMarking>solid</lineMarking></stopLine>").junctions
    backs = {end.edge: back for end, back in zip(report.entrances, report.setbacks, strict=True)}
    assert backs == pytest.approx({"10": 3.0 if points else 0.0, "11": 0.0, "12": 0.0, "13": 0.0})
    assert [item.kind for item in report.objects] == ["line"]


def test_lights_have_arrows_and_groups_of_equal_cycles(read: Read) -> None:
    lights = light(5, 30, "left") + light(6, 30) + light(7, 40)
    road_map = read('<trafficLightRef ref="5"/><trafficLightRef ref="6"/>', lights)
    assert signs(road_map)["10"] == "lights"
    assert {item.id: item.arrows for item in road_map.junctions[0].objects} == {"5": {Turn.LEFT}, "6": frozenset()}
    assert road_map.graph.network.controllers == (("5", "6"), ("7",))


def test_light_that_is_not_active_counts_for_nobody(read: Read) -> None:
    assert signs(read('<trafficLightRef ref="5"/>', light(5, 30).replace("true", "false")))["10"] == "none"


@pytest.mark.parametrize("number", ["274", "R2-1"])
def test_speed_limit_of_a_sign_is_in_metres_per_second(read: Read, number: str) -> None:
    sign = (
        f'<trafficSign id="5"><trafficSignElement><trafficSignID>{number}</trafficSignID>'
        "<additionalValue>13.9</additionalValue></trafficSignElement></trafficSign>"
    )
    assert read('<trafficSignRef ref="5"/>', sign).graph.edges["10"].limits == ((0.0, 13.9),)


def test_lanelet_of_two_directions_is_two_lanes(read: Read) -> None:
    edges = read("<userBidirectional>vehicle</userBidirectional>").graph.edges
    assert edges["10:back"].points == pytest.approx(edges["10"].points[::-1])


def test_sidewalk_is_no_lane(read: Read) -> None:
    assert "10" not in read("<laneletType>sidewalk</laneletType>").graph.edges


def test_crosswalk_lies_over_its_arm(read: Read) -> None:
    left, right = ([place(1, out, -6.0), place(1, out, 6.0)] for out in (11.0, 14.0))
    road_map = read(elements=lanelet(77, left, right, more="<laneletType>crosswalk</laneletType>"))
    (report,) = road_map.junctions
    (zebra,) = road_map.junction(report.id).crossings
    assert (zebra.id, report.arms[zebra.arm].entrances) == ("77", ("11",))
    assert zebra.path.points[:, 1] == pytest.approx(12.5)


@pytest.mark.parametrize("id", ["10", "301"])
def test_lanelet_with_exchanged_bounds_is_read_the_right_way_round(tmp_path: Path, id: str) -> None:
    text = commonroad()
    start = text.index(f'<lanelet id="{id}">')
    end = text.index("</lanelet>", start)
    names = {"leftBound": "rightBound", "rightBound": "leftBound"}
    exchanged = re.sub("leftBound|rightBound", lambda match: names[match[0]], text[start:end])
    path = tmp_path / "cross.xml"
    path.write_text(text[:start] + exchanged + text[end:])
    road_map = read_map(path)
    (report,) = road_map.junctions
    assert (report.usable, report.ways, len(report.movements), report.left_hand) == (True, 4, 12, False)
    assert [warning.kind for warning in road_map.warnings] == ["side"]
    assert road_map.warnings[0].message.endswith(f"with left and right exchanged: {id}")


def test_refusal_counts_lanelets_without_cars(tmp_path: Path) -> None:
    path = tmp_path / "cross.xml"
    path.write_text(commonroad().replace("</leftBound>", "</leftBound><laneletType>sidewalk</laneletType>"))
    with pytest.raises(MapError, match=r"none that a car can drive on.*were left out: 20 sidewalk"):
        read_map(path)
