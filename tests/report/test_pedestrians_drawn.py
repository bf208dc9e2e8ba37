"""Pictures, replay pages and notebooks show crosswalks, pedestrians and parked vehicles, and name them in words."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.report.animated import animated
from pytest_rvads.report.map_picture import draw_map
from pytest_rvads.report.scene import draw_ways, picture
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.notebook import html
from pytest_rvads.satellites.pages.replay import events, replay
from pytest_rvads.scenarios.ids import recalled
from tests.zebras import zebra


class Stands:
    """Stands where it starts."""

    def control(self, seen: Observation) -> Command:
        return rvads.Control(brake=1.0)


def walk(name: str, *walkers: rvads.Pedestrian, lit: bool = False, duration: float = 20.0) -> Run:
    start: dict[str, Any] = {"distance": 20, "speed": 0, "subject": 1, "duration": duration}
    return rvads.simulate(rvads.Case(rvads.Scenario(zebra(name, lit=lit), "0200", pedestrians=walkers, **start), Stands))


@pytest.fixture(scope="module")
def run() -> Run:
    return walk(
        *("light4", rvads.Pedestrian(1, "near", "hidden", -1.0), rvads.Pedestrian(3, "far", "group", -3.0)),
        lit=True,
        duration=9.0,
    )


def test_still_pictures_and_pages_show_zebra_stripes_and_pedestrians(run: Run) -> None:
    for document in (picture(run, 400, "title"), replay(run, "title"), animated(run)):
        assert document.count('<polygon class="crosswalk"') == document.count('<polyline class="crosswalk"') == 4
        stripes = re.findall(
            r'<polyline class="crosswalk" fill="none" stroke="#fff" stroke-dasharray=".5" stroke-width="([^"]*)"', document
        )
        assert stripes == ["3.00"] * 4, "the crosswalks of this junction are 3 m wide"
        assert 'class="further"' not in document
        for name in ("p0", "p1", "p1+1", "p1+2"):
            (group,) = re.findall(rf'data-agent="{re.escape(name)}".*?</g>', document)
            assert 'width="0.6" height="0.6" rx="0.3"' in group, "a circle of radius 0.3 m"
            assert (f">{name}</text>" in group) == ("+" not in name)
        (parked,) = re.findall(r'data-agent="parked0".*?</g>', document)
        assert 'width="4.6" height="1.86" rx="0.4" fill="#8a9099"' in parked


def test_page_needs_no_style_that_its_policy_forbids(run: Run) -> None:
    svg = re.search(r"<svg xmlns.*?</svg>", replay(run, "title"), re.DOTALL)
    assert svg
    assert "style=" not in svg.group()


def test_junction_in_which_nobody_walks_is_drawn_as_before() -> None:
    plain, crossed = rvads.find("stop4"), zebra("stop4")
    runs = [
        rvads.simulate(rvads.Case(rvads.Scenario(place, "0200", distance=20, duration=1.0), Stands)) for place in (plain, crossed)
    ]
    assert picture(runs[0], 50, "title") == picture(runs[1], 50, "title")
    assert replay(runs[0], "title") == replay(runs[1], "title")


def test_lamps_of_pedestrians_stand_at_both_ends_of_every_crosswalk(run: Run) -> None:
    lamps = re.findall(r'<g class="lamp" data-entrance="(\d+)"[^>]*?( scale\(.6\))?">', picture(run, 0, "title"))
    assert [int(entrance) for entrance, _ in lamps] == list(range(12))
    assert [bool(small) for _, small in lamps] == [False] * 4 + [True] * 8


def test_events_tell_what_pedestrians_do(run: Run) -> None:
    told = [text for _, text in events(run)]
    assert [text for text in told if text.startswith("p0 ")] == [
        "p0 comes to the crosswalk of arm 1",
        "p0 steps onto the crosswalk of arm 1",
        "p0 leaves the crosswalk of arm 1",
    ]
    assert "p1+2 steps onto the crosswalk of arm 3" in told
    assert not any("parked0" in text for text in told)
    # WALK ends after 8 s at the crosswalks whose pedestrians walk in the first green, which are those of arms 1 and 3.
    assert [text for text in told if "light" in text] == [f"light for pedestrians {arm} turns yellow" for arm in (1, 3)]
    steps = {text: time for time, text in events(run)}
    assert steps["p1+1 steps onto the crosswalk of arm 3"] > steps["p1 steps onto the crosswalk of arm 3"]


def test_pedestrian_who_turns_back_goes_back_to_the_sidewalk() -> None:
    told = [text for _, text in events(walk("stop4", rvads.Pedestrian(1, "near", "returns")))]
    assert told == [
        "p0 comes to the crosswalk of arm 1",
        "p0 steps onto the crosswalk of arm 1",
        "p0 goes back to the sidewalk",
    ]


def test_page_names_lights_and_agents(run: Run) -> None:
    content = re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', replay(run, "title"), re.DOTALL)
    assert content
    data = json.loads(content.group(1))
    ends = ["for pedestrians 0", "", "for pedestrians 1", "", "for pedestrians 2", "", "for pedestrians 3", ""]
    assert data["entrances"] == ["0", "1", "2", "3", *ends, *[""] * 4]
    assert data["kinds"] == ["car", "pedestrian", "car", *["pedestrian"] * 3]
    assert data["agents"] == ["a1", "p0", "parked0", "p1", "p1+1", "p1+2"]


def test_hostile_names_of_pedestrians_and_crosswalks_are_texts(run: Run) -> None:
    hostile = "</text></script><script>alert(1)</script><img src=x onerror=alert(2)>\"'"
    crossings = tuple(replace(crosswalk, id=hostile) for crosswalk in run.junction.crossings)
    named = replace(
        run,
        agents=tuple(replace(agent, name=f"{hostile}{agent.name}") for agent in run.agents),
        junction=replace(run.junction, crossings=crossings),
    )
    for draw in (lambda one: picture(one, 400, "title"), lambda one: replay(one, "title"), animated, html):
        shown, tame = draw(named), draw(run)
        assert re.findall("<[a-zA-Z/][^ >]*", shown) == re.findall("<[a-zA-Z/][^ >]*", tame)
    read = read_map(path_of("stop4"))
    road_map = replace(read, crossings={read.junctions[0].id: crossings})
    drawn = draw_map(road_map)
    assert drawn.count("<script") == drawn.count("<img") == 0
    ET.fromstring(drawn)


def test_notebooks_show_pedestrians(run: Run) -> None:
    shown = html(run)
    assert "2 vehicles, 4 pedestrians; 9.00 s" in shown
    assert "crossing of arm 1" in shown
    assert "parking place of arm 1" in shown
    assert repr(run).endswith("2 vehicles, 4 pedestrians, 9.00 s>")
    scenario = recalled(run.provenance["scenario"], run.junction, "scenario")
    start = html(scenario)
    assert "can't be drawn" not in start
    assert start.count("crossing of arm 3") == 3
    assert "p1+2" in start
    place = html(zebra("stop4"))
    assert "pedestrians" not in place
    assert "1, 2, pedestrians" in html(zebra("stop4").walked)
    assert draw_ways(zebra("stop4").walked).count('<polygon class="crosswalk"') == 4


def test_replay_draws_a_kept_run(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rvads.files.save_run(run, "run.npz")
    assert main(["replay", "run.npz", "--rules", "no_collision"]) == 0
    assert 'data-agent="p1+2"' in (tmp_path / "run-no_collision.html").read_text(encoding="utf-8")


@pytest.mark.extended
def test_case_of_a_kept_run_gives_the_same_run(tmp_path: Path) -> None:
    scenario = rvads.Scenario(
        zebra("stop4"),
        "0222",
        distance=15,
        speed=6,
        subject=1,
        pedestrians=[rvads.Pedestrian(1, "near", "hidden"), rvads.Pedestrian(3, "far", "yields", 0.5)],
    )
    first = rvads.simulate(rvads.Case(scenario, rvads.Reference, traffic=rvads.Reference))
    rvads.files.save_run(first, tmp_path / "run.npz")
    kept = rvads.files.load_run(tmp_path / "run.npz")
    again = recalled(kept.provenance["scenario"], kept.junction, "scenario")
    assert again == scenario
    assert rvads.simulate(rvads.Case(again, rvads.Reference, traffic=rvads.Reference)).hash == first.hash
    assert rvads.simulate(rvads.Case(again, rvads.Reference, traffic=rvads.Replay(kept))).hash == first.hash


def test_name_of_a_pedestrian_is_readable_on_asphalt_and_stripes(run: Run) -> None:
    for document in (picture(run, 400, "title"), replay(run, "title")):
        (group,) = re.findall(r'data-agent="p0".*?</g>', document)
        (name,) = re.findall("<text[^>]*>", group)
        assert 'stroke="#fff"' in name
        assert 'paint-order="stroke"' in name, "the white edge lies below the letters"


def test_hostile_name_of_a_recorded_pedestrian_is_text(run: Run) -> None:
    hostile = "</text><script>alert(1)</script>&\"'\u202e" + "x" * 80
    named = replace(run, agents=tuple(replace(a, name=hostile) if a.name == "p0" else a for a in run.agents))
    for document in (picture(named, 400, "title"), replay(named, "title", "p0\n" + hostile), animated(named)):
        assert "<script>alert" not in document
        assert "\u202e" not in document
        assert "&lt;script&gt;alert(1)" in document
