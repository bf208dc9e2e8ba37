"""Pictures and replay pages show what the run holds."""

import json
import re
import xml.etree.ElementTree as ET
from base64 import b64encode
from collections import Counter
from dataclasses import replace
from functools import partial
from hashlib import sha256

import numpy as np
import pytest

from pytest_rvads.cli.map_commands import draw_classes
from pytest_rvads.geometry.finder import find
from pytest_rvads.report.scene import Scene, picture
from pytest_rvads.runs.run import Collision, Run
from pytest_rvads.runs.states import Kind, Zone
from pytest_rvads.satellites.pages.replay import events, replay
from pytest_rvads.scenarios.classes import Orbits, classes
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import printable

from ..run_builders import gliding

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def run() -> Run:
    """A run along the centre lines at constant speeds, 5 m/s for a0, 1 m/s more for each further vehicle."""
    scenario = Scenario(find("light4"), "1233", distance=10)
    return gliding(scenario, [5.0, 6.0, 7.0, 8.0], 2000, collisions=(Collision(3.5, ("a0", "a2"), 4.2),))


def vehicles(document: str) -> dict[str, ET.Element]:
    return {g.attrib["data-agent"]: g for g in ET.fromstring(document).iter(f"{SVG}g") if "data-agent" in g.attrib}


def test_the_picture_shows_every_vehicle_where_it_is(run: Run) -> None:
    drawn = vehicles(picture(run, 250, "title", {"a1"}))
    assert set(drawn) == {"a0", "a1", "a2", "a3"}
    for column, name in enumerate(sorted(drawn)):
        x, y = map(float, re.match(r"translate\((\S+) (\S+)\)", drawn[name].attrib["transform"]).groups())
        assert (x, -y) == pytest.approx(tuple(run.pose[250, column, :2]), abs=1e-3)
    assert [name for name, g in drawn.items() if g.find(f"{SVG}rect[@class='broken']") is not None] == ["a1"]


def test_trucks_cyclists_and_pedestrians_are_drawn_by_kind(run: Run) -> None:
    kinds = (Kind.CAR, Kind.TRUCK, Kind.CYCLIST, Kind.PEDESTRIAN)
    mixed = replace(run, agents=tuple(replace(a, kind=kind, size=(2.0, 1.0)) for a, kind in zip(run.agents, kinds, strict=True)))
    page = replay(mixed, "title")
    for document in (picture(mixed, 250, "title"), page[page.index("<svg") : page.index("</svg>") + 6]):
        drawn = vehicles(document)
        assert [g.findtext(f"{SVG}title") for g in drawn.values()] == [None, "truck a1", "cyclist a2", "pedestrian a3"]
        assert [g.find(f"{SVG}rect").attrib["rx"] for g in drawn.values()] == ["0.4", "0", "0.5", "0.5"]
    assert data(page)["kinds"] == ["car", "truck", "cyclist", "pedestrian"]


@pytest.fixture(scope="module")
def queues() -> Run:
    """One state of vehicles that queue on the two lanes of each arm of lanes4."""
    scenario = Scenario(find("lanes4"), (1, 3, 2, 3, 1, 3, 2, 3), distance=5, followers=1)
    itineraries, plan, agents = scenario.itineraries(), scenario.signals(), scenario.agents()
    station = np.array([[-5.0 - 8.0 * ("+" in agent.name) for agent in agents]])
    return Run(
        scenario.name,
        scenario.place,
        agents,
        np.zeros((1, len(agents)), dtype=np.int8),
        np.array([plan.colours(0.0, 8)], dtype=np.int8),
        station=station,
        speed=np.zeros((1, len(agents))),
        pose=np.array([[i.pose(s) for i, s in zip(itineraries, station[0], strict=True)]]),
    )


def test_lanes_are_shown_with_marks_arrows_and_a_light_each(queues: Run) -> None:
    page = replay(queues, "title")
    for document in (picture(queues, 0, "title"), page[page.index("<svg") : page.index("</svg>") + 6]):
        root = ET.fromstring(document)
        classes = [element.attrib.get("class") for element in root.iter()]
        # Per arm: the kerb on either side, the line between the directions, a broken one between two lanes.
        assert (classes.count("mark"), classes.count("mark broken"), classes.count("arrow")) == (12, 4, 8)
        assert classes.count("number") == 4
        lamps = {g.attrib["data-entrance"]: g.findtext(f"{SVG}text") for g in root.iter(f"{SVG}g") if "data-entrance" in g.attrib}
        # The phase of the lanes for right and straight from the south and the north comes first.
        assert lamps == {str(e): "G" if e in (0, 4) else "R" for e in range(8)}
    assert data(page)["entrances"] == ["0.0", "0.1", "1.0", "1.1", "2.0", "2.1", "3.0", "3.1"]


def test_vehicles_in_a_queue_can_be_told_apart(queues: Run) -> None:
    drawn = vehicles(picture(queues, 0, "title"))
    assert set(drawn) == {f"a{arm}.{lane}{more}" for arm in range(4) for lane in range(2) for more in ("", "+1")}
    assert len({g.find(f"{SVG}rect").attrib["fill"] for g in drawn.values()}) == 16, "a colour each"
    for g in drawn.values():
        rect, name = g.find(f"{SVG}rect"), g.find(f"{SVG}text")
        # Letters of a bold face are about 0.6 of its height wide; the name lies along the vehicle, within it.
        wide = 0.6 * float(name.attrib["font-size"]) * len(name.text)
        assert wide <= float(rect.attrib["width"])
        assert "rotate(0.00)" in name.attrib["transform"] or "rotate(180.00)" in name.attrib["transform"]


def test_one_vehicle_per_entrance_has_the_colour_of_its_entrance(run: Run) -> None:
    first, *others = (g.find(f"{SVG}rect").attrib["fill"] for g in vehicles(picture(run, 0, "")).values())
    fewer = replace(
        run,
        agents=run.agents[1:],
        collisions=None,
        **{name: getattr(run, name)[:, 1:] for name in ("zone", "station", "speed", "pose")},
    )
    assert [g.find(f"{SVG}rect").attrib["fill"] for g in vehicles(picture(fewer, 0, "")).values()] == others
    assert first not in others


@pytest.mark.parametrize(("name", "signs"), [("stop4", {"sign stop": 4}), ("right4", {})])
def test_signs_stand_beside_the_arms(name: str, signs: dict[str, int]) -> None:
    drawn = [e.attrib.get("class", "") for e in ET.fromstring(f"<g>{Scene(find(name)).road()}</g>").iter()]
    assert Counter(kind for kind in drawn if kind.startswith("sign")) == signs


def test_vehicles_that_left_are_not_drawn(run: Run) -> None:
    last = run.steps - 1
    here = {a.name for k, a in enumerate(run.agents) if run.zone[last, k] != Zone.GONE}
    assert set(vehicles(picture(run, last, ""))) == here
    assert here != {a.name for a in run.agents}


def test_titles_are_escaped(run: Run) -> None:
    assert "a &lt; b &amp; c" in picture(run, 0, "a < b & c")
    page = replay(run, "<script>alert(1)</script>", "</script>", [(1.0, "</script>")])
    assert "<script>alert" not in page
    assert page.count("</script>") == 2, "the data and the script of the page"


@pytest.mark.parametrize("name", ['"><script>alert(1)</script>', "]]>", "&lt;", "\x00\x1b\x85\ud800\ufffe", "a0", ""])
def test_vehicles_with_any_name_are_drawn_and_replayed(run: Run, name: str) -> None:
    agents = tuple(replace(agent, name=name, kind=Kind.TRUCK) for agent in run.agents)
    hostile = replace(run, agents=agents, collisions=None)
    document, page = picture(hostile, 250, name, {name}), replay(hostile, name)
    scene = page[page.index("<svg") : page.index("</svg>") + 6]
    for drawn in (document, scene):
        root = ET.fromstring(drawn)
        assert {e.tag.removeprefix(SVG) for e in root.iter()} <= {
            *["svg", "style", "rect", "polyline", "line", "text", "path", "g", "circle", "title"]
        }
        shown = [g.findtext(f"{SVG}text") for g in root.iter(f"{SVG}g") if "data-agent" in g.attrib]
        assert set(shown) == {printable(name)}
        assert len(shown) == 4
    assert data(page)["agents"] == [printable(name)] * 4


def test_a_page_runs_its_own_script_and_nothing_else(run: Run) -> None:
    page = replay(run, "title")
    (policy,) = re.findall('<meta http-equiv="Content-Security-Policy" content="(.*)">', page)
    allowed = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert allowed["default-src"] == allowed["base-uri"] == allowed["form-action"] == "'none'"
    for kind, element in (("script-src", "script"), ("style-src", "style")):
        (own,) = re.findall(f"<{element}>(.*?)</{element}>", page, re.DOTALL)
        assert allowed[kind] == f"'sha256-{b64encode(sha256(own.encode()).digest()).decode()}'"
    assert not re.search(r"\sstyle=|\son\w+=", page[: page.index("<script")]), "what the policy would not let through"


def data(page: str) -> dict[str, object]:
    """What the script of a page is given, which JSON has to hold: a browser reads no NaN."""
    (text,) = re.findall('<script type="application/json" id="data">(.*)</script>', page)
    found: dict[str, object] = json.loads(text, parse_constant=pytest.fail)
    return found


def test_the_page_holds_the_states_of_the_run(run: Run) -> None:
    held = data(replay(run, "title"))
    assert run.pose is not None
    assert np.array(held["motion"])[:, :, :2] == pytest.approx(run.pose[::5, :, :2], abs=6e-4)
    for column, changes in enumerate(held["zones"]):  # type: ignore[arg-type, var-annotated]
        ticks, values = zip(*changes, strict=True)
        rebuilt = np.repeat(values, np.diff([*ticks, run.steps]))
        assert (rebuilt == run.zone[:, column]).all()


def test_who_is_gone_needs_no_place(run: Run) -> None:
    assert run.pose is not None
    gone = np.where((run.zone == Zone.GONE)[..., None], np.nan, run.pose)
    assert np.isnan(gone).any()
    held, before = (data(replay(replace(run, pose=pose), "title"))["motion"] for pose in (gone, run.pose))
    here = run.zone[::5] != Zone.GONE
    assert (np.array(held)[here] == np.array(before)[here]).all()


def test_events_have_the_times_of_the_run(run: Run) -> None:
    found = events(run)
    # a0 needs 2 s for its 10 m at 5 m/s; it is in the junction from the first state past the vertex.
    assert [t for t, text in found if text == "a0 enters the junction"] == [pytest.approx(2.0, abs=0.011)]
    # The plan: green for 15 s, then yellow for 3, then red.
    assert [(t, text) for t, text in found if text.startswith("light 0")] == [
        (15.0, "light 0 turns yellow"),
        (18.0, "light 0 turns red"),
    ]
    assert (3.5, "a0 and a2 collide at 4.2 m/s") in found
    assert found == sorted(found)


def test_a_run_without_positions_or_states_says_so(run: Run) -> None:
    none = {name: getattr(run, name)[:0] for name in ("zone", "lights", "station", "speed", "pose")}
    with pytest.raises(RunError, match="has no states"):
        replay(replace(run, **none), "")
    bare = replace(run, pose=None)
    for draw in (partial(picture, bare, 0, ""), partial(replay, bare, "")):
        with pytest.raises(RunError, match="holds no positions"):
            draw()


@pytest.mark.parametrize("ways", [3, 4, 8])
def test_the_figure_of_classes_has_a_movement_per_vehicle(ways: int) -> None:
    rows = [(f"class{n}", Orbits.plain(ways).members(code)) for n, code in zip(range(5), classes(ways), strict=False)]
    document = ET.fromstring(draw_classes(ways, "title", rows))
    drawn = [p for p in document.iter(f"{SVG}path") if "marker-end" in p.attrib]
    key = ways - 1
    assert len(drawn) == key + sum(len(code) for _, group in rows for code in group), "a line per direction and per vehicle"
