"""Public Lanelet2 files come out as their facts say: lanelets, links, junctions, lines and doubts."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.geometry.road_map import READERS, RoadMap, read_map
from pytest_rvads.support.errors import MapError

STEMS = (
    "awcore__lanelet2_map",
    "own__all_way_stop",
    "ssv2__intersection",
    "ssv2__kashiwanoha_map",
    "ssv2__simple_cross_map",
    "validator__sample_map",
)
EXPLAINED = {
    # The only stop sign stands with its line 84 m before the junction; the reader takes signs within 50 m.
    ("ssv2__kashiwanoha_map", "J4"): {"control": "none"},
    # A crossing of two lanes in the open, with one lane in and one lane out, is no junction.
    ("ssv2__intersection", "J2"): None,
}
"""Differences from the expected junctions: other values, or None for no junction."""
WHEEL = """
import json, sys
from xml.etree.ElementTree import parse

import lanelet2
from lanelet2.io import Origin
from lanelet2.projection import UtmProjector
from lanelet2.traffic_rules import Locations, Participants, create

node = parse(sys.argv[1]).getroot().find("node")
lanelets, _ = lanelet2.io.loadRobust(sys.argv[1], UtmProjector(Origin(float(node.get("lat")), float(node.get("lon")))))
rules = create(Locations.Germany, Participants.Vehicle)
graph = lanelet2.routing.RoutingGraph(lanelets, rules)
lanes = [lanelet for lanelet in lanelets.laneletLayer if rules.canPass(lanelet)]
lanes += [lanelet.invert() for lanelet in lanes if not rules.isOneWay(lanelet)]
name = lambda lanelet: f"{lanelet.id}:back" if lanelet.inverted() else str(lanelet.id)
print(json.dumps([(name(lane), name(after)) for lane in lanes for after in graph.following(lane)]))
"""
"""Program that prints the links of a file by the official library."""


@pytest.fixture(scope="module")
def folder(shared: Path) -> Path:
    files = shared / "maps" / "lanelet2"
    if not files.is_dir():
        pytest.skip("the folder ../shared/maps/lanelet2 is absent")
    return files


@pytest.fixture(scope="module")
def expected(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "expected.json").read_text(encoding="utf-8"))["maps"]


def members(road_map: RoadMap, junction: str) -> set[str]:
    return {id.split(":")[0] for id in road_map.graph.inside(junction)}


@pytest.mark.parametrize("stem", STEMS)
def test_public_file_has_the_expected_junctions(folder: Path, expected: dict[str, Any], stem: str) -> None:
    road_map = read_map(folder / f"{stem}.osm")
    found = {frozenset(members(road_map, report.id)): report for report in road_map.junctions}
    for row in expected[stem]["junctions"]:
        difference = EXPLAINED.get((stem, row["id"]), {})
        report = found.pop(frozenset(id.split(":")[0] for id in row["members"]), None)
        if difference is None:
            assert report is None
            continue
        lines = {item.edge for item in report.objects if item.kind == "line"}
        assert {
            "arms": report.ways,
            "entrances": len(report.entrances),
            "exits": len(report.exits),
            "movements": len(report.movements),
            "control": report.control.value,
            "usable": report.usable,
            "lines": sum(end.edge in lines for end in report.entrances),
            "left_hand": report.left_hand,
        } == {
            key: difference.get(key, row[key])
            for key in row
            if key not in ("id", "signs", "reason", "x", "y", "members", "official")
        }
        # The official library's lanes into and out of these lanelets; it cuts no lanelets.
        if not any(":" in id for id in road_map.graph.edges):
            assert {int(end.edge) for end in report.entrances} == set(row["official"]["entrances"])
            assert {int(end.edge) for end in report.exits} == set(row["official"]["exits"])
            assert len(report.movements) == row["official"]["movements"]
    assert not found


@pytest.mark.parametrize("stem", STEMS)
def test_official_library_has_the_same_number_of_links(folder: Path, expected: dict[str, Any], stem: str) -> None:
    network = read_map(folder / f"{stem}.osm").graph.network
    cuts = sum(":before" in id or ":after" in id or ":next" in id for id in network.edges)
    assert network.links.number_of_edges() - cuts == expected[stem]["wheel"]["follow"]


@pytest.mark.parametrize(("stem", "pairs"), [("validator__sample_map", 19), ("ssv2__intersection", 16)])
def test_autoware_states_who_gives_way(folder: Path, stem: str, pairs: int) -> None:
    assert sum(len(report.stated) for report in read_map(folder / f"{stem}.osm").junctions) == pairs


def test_two_way_lanelets_are_two_lanes(folder: Path) -> None:
    edges = read_map(folder / "fzi__mapping_example.osm").graph.edges
    sources = {id.split(":")[0] for id in edges}
    assert len(sources) == 328  # of 371 lanelets; the official library lets vehicles pass on as many
    assert len({id.split(":")[0] for id in edges if ":back" in id}) == 60


@pytest.mark.extended
@pytest.mark.parametrize("stem", [*STEMS, "fzi__mapping_example"])
def test_links_equal_those_of_the_official_library(folder: Path, stem: str) -> None:
    pytest.importorskip("lanelet2")
    done = subprocess.run([sys.executable, "-c", WHEEL, str(folder / f"{stem}.osm")], capture_output=True, text=True, check=True)
    official = {(lane, after) for lane, after in json.loads(done.stdout)}
    graph = read_map(folder / f"{stem}.osm").graph
    parts = {id for id in graph.edges if id.endswith((":before", ":after", ":next"))}
    ours = {(a, b) for a, b in graph.links.edges if not {a, b} & parts}
    assert official
    assert {
        (a, b) for a, b in official if not {f"{a}:{end}" for end in ("after", "next")} & parts and f"{b}:before" not in parts
    } <= ours
    for a, b in ours - official:  # these lanelets share no nodes
        assert math.dist(graph.edges[a].points[-1], graph.edges[b].points[0]) <= 0.6


@pytest.mark.parametrize("stem", STEMS)
def test_usable_junctions_of_public_files_can_be_used(folder: Path, stem: str) -> None:
    road_map = read_map(folder / f"{stem}.osm")
    for report in road_map.junctions:
        if report.usable:
            assert road_map.junction(report.id).conflicts


def test_entry_points_read_lanelet2_and_commonroad() -> None:
    assert {".osm", ".xml"} <= READERS.keys()


def test_opendrive_file_with_the_suffix_xml_is_read_as_opendrive(shared: Path, tmp_path: Path) -> None:
    (tmp_path / "cross.xml").write_bytes((shared / "maps" / "sumo_t3.xodr").read_bytes())
    reports = [read_map(path).junctions for path in (tmp_path / "cross.xml", shared / "maps" / "sumo_t3.xodr")]
    assert [report.id for report in reports[0]] == [report.id for report in reports[1]]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "a.osm",
            "<osm><node id='1' lat='49' lon='8'/><way id='2'><nd ref='1'/></way></osm>",
            "it has 1 way but no lanelet, as an ex",
        ),
        ("a.osm", "<gpx/>", "is not a Lanelet2 file: its root element is <gpx>, expected <osm>"),
        (
            "a.osm",
            "<osm><node lat='49' lon='8'/></osm>",
            "row 1: the id of a <node> must have 1 to 60 letters, digits and signs, got ''",
        ),
        ("a.osm", "<osm><node", "not XML: unclosed token, the file is cut off; expected a Lanelet2 file"),
        (
            "a.osm",
            "<osm><relation id='1'><tag k='type' v='lanelet'/></relation></osm>",
            "it has 1 lanelet, and none that a car can dri",
        ),
        ("a.xml", "<commonRoad/>", "it has 0 lanelets, and none that a car can drive on"),
        ("a.xml", "<routes/>", "is not a map: its root element is <routes>, expected <commonRoad> or <OpenDRIVE>"),
    ],
)
def test_file_without_lanelets_is_refused_in_one_sentence(tmp_path: Path, name: str, content: str, message: str) -> None:
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    with pytest.raises(MapError, match="map file") as caught:
        read_map(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"none\.osm cannot be read: .*No such file"):
        read_map(tmp_path / "none.osm")
