"""What a notebook shows of a value, and the example notebook: complete in itself, in any theme, and never a traceback."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

import pytest_rvads as rvads
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.outcome import MARKS, Outcome
from pytest_rvads.report.svg import draw_braking
from pytest_rvads.runs.measured import Kpis, PairKpis, VehicleKpis
from pytest_rvads.runs.run import Excerpt, Fault, Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.satellites.notebook import Picture, html, telling
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import usual

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "examples" / "explore.ipynb"
TAGS = {"div", "p", "b", "img", "table", "thead", "tbody", "tr", "th", "td", "details", "summary", "pre"}
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\"' \x1b]0;"
SVG = "{http://www.w3.org/2000/svg}"


class Page(HTMLParser):
    """The tags, attributes, texts and pictures of what is shown."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.cells: list[str] = []
        self.text = ""
        self.pictures: list[ET.Element] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if tag in ("td", "th"):
            self.cells.append("")
        if tag == "img":
            kind, _, data = dict(attrs)["src"].partition(";base64,")
            assert kind == "data:image/svg+xml"
            self.pictures.append(ET.fromstring(b64decode(data)))

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.cells:
            self.cells[-1] += data


@pytest.fixture
def crash(drive: Callable[..., Run]) -> Run:
    """Two that meet in the middle of an all-way stop at 6 s."""
    return drive("stop4", {0: (2, -30.0, [(0, 5.0)]), 1: (2, -30.0, [(0, 5.0)])}, 800, collisions=[(650, "a0", "a1")])


def shown(value: Any) -> Page:
    return Page(value._repr_html_())


@pytest.mark.parametrize("name", names())
def test_a_junction_shows_its_ways_and_who_gives_way(name: str) -> None:
    junction = find(name)
    page = shown(junction)
    (picture,) = page.pictures
    courses = [line for line in picture.iter(f"{SVG}polyline") if line.get("class") == "trail"]
    assert len(courses) == len(junction.movements)
    assert f"{junction.ways}-way {junction.control}; traffic keeps right; usable" in page.text
    assert [cell for cell in page.cells if cell.endswith(" m")] == [
        f"{junction.approach(entrance):.0f} m" for entrance in range(len(junction.entrances))
    ]


def test_junction_page_lists_the_entrances_that_have_priority() -> None:
    page = shown(find("yield4"))
    assert page.cells[4] == "gives way to"
    assert [page.cells[5 * row + 4] for row in range(1, 5)] == ["1, 2, 3", "3", "0, 1, 3", "1"]
    assert "gives way in a tie to" in shown(find("stop4")).cells


def test_page_of_a_junction_without_lanes_names_its_use(topology: Callable[[Junction], Junction]) -> None:
    page = shown(topology(find("stop4")))
    assert not page.pictures
    assert "only for judging zones of recorded runs" in page.text
    assert "no picture: junction 'stop4' comes from a recording without positions" in page.text
    assert page.cells.count("not known") == 8, "neither the lengths of approaches nor who gives way"


def test_a_scenario_shows_every_vehicle_where_it_starts() -> None:
    scenario = Scenario(find("light4"), "1030", distance=(20, 0, 70, 0), speed=3, subject=0, followers=1)
    page = shown(scenario)
    (picture,) = page.pictures
    starts = [way.pose(way.start(d)) for way, (d, _) in zip(scenario.itineraries(), scenario.starts(), strict=True)]
    placed = [
        re.match(r"translate\((\S+) (\S+)\)", g.attrib["transform"]) for g in picture.iter(f"{SVG}g") if "data-agent" in g.attrib
    ]
    drawn = [(float(at[1]), -float(at[2])) for at in placed]
    assert drawn == [pytest.approx((x, y), abs=1e-3) for x, y, _ in starts]
    left, top, wide, high = map(float, picture.attrib["viewBox"].split())
    assert all(left < x < left + wide and top < -y < top + high for x, y in drawn)
    assert page.cells[4:8] == ["a0 (under test)", "0 to 1, right", "20 m", "3 m/s"]
    assert page.cells[8].startswith("a0+1")
    assert "class" in page.text


def test_page_of_an_impossible_scenario_lists_its_vehicles() -> None:
    page = shown(Scenario(find("stop4"), "1000", distance=500))
    assert not page.pictures
    assert "distance 500 m does not fit" in page.text
    assert page.cells[4:] == ["a0", "0 to 1, right", "500 m", "0 m/s"]


def test_a_run_shows_its_collision(crash: Run) -> None:
    page = shown(crash)
    (picture,) = page.pictures
    assert "6.50 s: a0 and a1 collide" in "".join(picture.itertext())
    assert "2 vehicles; 7.99 s; a0 and a1 collide at 6.50 s" in page.text
    # The line is 0 m before the junction, the zone before it 1 m long: 29 m and 30 m at 5 m/s.
    assert page.cells[5:9] == ["a0", "0 to 2, straight", "5.80 s", "6.01 s"]
    assert page.cells[9] == "never"


def test_page_of_a_run_names_driver_and_simulator(crash: Run) -> None:
    assert shown(replace(crash, provenance={"autopilot": "Mine", "traffic": "reference", "simulator": "bullet"})).text.startswith(
        "by-hand: 2 vehicles; 7.99 s; a0 and a1 collide at 6.50 s; driven by Mine among reference; simulated by bullet"
    )
    assert "driven" not in shown(crash).text


def test_the_most_telling_moment_of_a_run(crash: Run, drive: Callable[..., Run]) -> None:
    assert telling(crash) == (650, "a0 and a1 collide")
    later = replace(crash, collisions=(), fault=Fault(3.0, "a0", "it raised"))
    assert telling(later) == (300, "the run ends by a fault")
    both = drive("stop4", {0: (2, -5.0, [(0, 5.0)]), 1: (2, -10.0, [(0, 5.0)])}, 800)
    tick, why = telling(both)
    assert why == "2 in the junction"
    assert (both.zone[tick] == Zone.JUNCTION).all()
    together = np.flatnonzero((both.zone == Zone.JUNCTION).all(axis=1))
    assert tick == (together[0] + together[-1]) // 2
    assert telling(drive("stop4", {0: (2, -90.0, [(0, 5.0)])}, 100)) == (99, "the last state, nobody was in the junction")


def test_a_run_without_positions_is_a_table(make: Callable[..., Run]) -> None:
    page = shown(make("stop4", {0: (1, 100, 200, None)}, 300))
    assert not page.pictures
    assert "no picture: run 'by-hand' holds no positions" in page.text
    assert "collisions were not recorded" in page.text
    assert page.cells[5:] == ["a0", "0 to 1, right", "1.00 s", "2.00 s", "never"]


def test_a_run_without_states_is_shown(make: Callable[..., Run]) -> None:
    assert "no picture: run 'by-hand' has no states" in shown(make("stop4", {0: (1, None, None, None)}, 0)).text


def test_arrival_before_the_recording_is_by_its_start(drive: Callable[..., Run]) -> None:
    found = drive("stop4", {0: (2, 1.0, [(0, 5.0)])}, 100)
    assert shown(replace(found, excerpt=Excerpt(start=40.0))).cells[7:9] == ["by 40.00 s", "by 40.00 s"]


def test_recorded_traffic_has_short_trails_at_the_same_moment(drive: Callable[..., Run]) -> None:
    run = drive("stop4", {0: (2, -90.0, [(0, 5.0)]), 1: (2, -99.0, [(0, 5.0)])}, 3000)
    whole, (part,) = shown(run).pictures[0], shown(replace(run, excerpt=Excerpt())).pictures
    bodies = [[g.attrib["transform"] for g in picture.iter(f"{SVG}g") if "data-agent" in g.attrib] for picture in (whole, part)]
    assert bodies[0] == bodies[1]
    lines = [line.attrib["points"].split() for line in part.iter(f"{SVG}polyline") if line.get("class") == "trail"]
    assert [len(line) for line in lines] == [61, 61], "every fifth state of three seconds"


def test_of_many_vehicles_the_first_are_listed(make: Callable[..., Run]) -> None:
    run = make("stop4", {0: (1, 1, 2, 3)}, 10)
    page = shown(replace(run, agents=run.agents * 30, zone=np.tile(run.zone, 30)))
    assert page.cells.count("a0") == 24
    assert page.text.endswith("and 6 more")


@pytest.mark.parametrize("rule", ["no_collision", "full_stop", "right_on_red"])
def test_page_of_a_verdict_shows_every_field(crash: Run, rule: str) -> None:
    verdict = rvads.check(crash, rule)
    page = shown(verdict)
    assert verdict.status in page.text
    assert verdict.message in page.text
    assert verdict.explanation in page.text
    assert sum(cell == "FAIL" for cell in page.cells) == verdict.counts.get("fail", 0)
    assert ("<details open>" in verdict._repr_html_()) == (verdict.status is Status.FAIL)


def test_unavoidable_and_provoked_verdicts_are_not_shown_as_fail() -> None:
    verdict = Verdict("p2", Status.FAIL, "p2: in a circle", unavoidable=True)
    assert "! UNAVOIDABLE" in shown(verdict).text
    assert "! PROVOKED" in shown(structs.replace(verdict, unavoidable=False, provoked=True)).text
    assert "✗ FAIL" in shown(structs.replace(verdict, unavoidable=False)).text


def test_every_status_has_its_mark() -> None:
    assert {outcome.mark for outcome in Outcome} == set(MARKS)
    for status in Status:
        assert status.value in shown(Verdict("r", status, "message")).text


@pytest.mark.extended
def test_a_list_of_verdicts_is_a_table_in_a_notebook() -> None:
    interactive = pytest.importorskip("IPython.core.interactiveshell", reason="IPython is not installed")
    code = f"""
from {interactive.__name__} import InteractiveShell
shell = InteractiveShell.instance(history_manager=None)
from pytest_rvads.logic.judging.verdicts import Status, Verdict
bad = Verdict("p1", Status.FAIL, "p1 at t=1.00 s: {HOSTILE[:26]}")
for value in ([bad, Verdict("p2", Status.PASS, "kept")], [bad, 1], []):
    print(shell.display_formatter.format(value)[0].get("text/html"))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    table, *others = done.stdout.splitlines()
    page = Page(table)
    assert page.cells == ["rule", "verdict", "message", "p1", "✗ FAIL", f"p1 at t=1.00 s: {HOSTILE[:26]}", "p2", "✓ PASS", "kept"]
    assert page.tags <= TAGS
    assert others == ["None", "None"], "IPython shows any other list as it always does"


def test_indicators_are_tables_of_vehicles_and_pairs() -> None:
    vehicles = VehicleKpis("a0", 3.0, 1.5, None, 2.25, 9.0), VehicleKpis(HOSTILE)
    page = shown(Kpis(vehicles, (PairKpis(("a0", HOSTILE), 1.25, -0.5),), ("weather",)))
    name = HOSTILE.replace("\x1b", "\\x1b")
    assert page.cells[:5] == ["vehicle", "arrives", "waits", "braking", "jerk"], "no vehicle has a delay"
    assert page.cells[5:15] == ["a0", "3.00 s", "1.50 s", "2.25 m/s²", "9.00 m/s³", name, "", "0.00 s", "", ""]
    assert page.cells[18:20] == [f"a0, {name}", "1.25 s"]
    assert page.cells[20].startswith("-0.50 s")
    assert page.text.endswith("not recorded: weather")
    assert page.tags <= TAGS


class Hasty(rvads.Follower):
    """Drives over every line."""

    def target_speed(self, seen: rvads.Observation) -> float:
        return 5.0


def test_results_show_their_totals_and_causes() -> None:
    scenario = Scenario(find("stop4"), "2000", distance=5, duration=3)
    page = shown(rvads.campaign([rvads.Case(scenario, Hasty)], "full_stop"))
    assert page.text.startswith("1 verdict on 1 run: 1 fail")
    assert page.cells[:5] == ["", "items", "rule", "cause", "first"]
    assert page.cells[5:8] == ["causes of failures", "1", "full_stop"]
    assert scenario.name in page.cells[9]
    assert page.tags <= TAGS


def test_white_letters_can_be_read_on_every_mark() -> None:
    for _, colour, _ in MARKS.values():
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        light = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        assert 1.05 / (light + 0.05) > 5.0


def test_pages_of_values_escape_markup(crash: Run) -> None:
    junction = replace(crash.junction, name=HOSTILE, id=HOSTILE, map=HOSTILE)
    agents = tuple(replace(agent, name=HOSTILE) for agent in crash.agents)
    run = replace(
        crash,
        label=HOSTILE,
        junction=junction,
        agents=agents,
        fault=Fault(1.0, HOSTILE, HOSTILE),
        provenance={"autopilot": HOSTILE},
    )
    instance = InstanceVerdict(((HOSTILE, HOSTILE),), Status.UNSURE, (HOSTILE,), 1, 2, (HOSTILE,), 0.1, HOSTILE)
    verdict = Verdict(
        HOSTILE, Status.UNSURE, HOSTILE, HOSTILE, instances=(instance,), notes=(HOSTILE,), explanation=HOSTILE,
        title=HOSTILE, requirement=HOSTILE,
    )  # fmt: skip
    for value in (
        junction,
        run,
        replace(run, pose=None),
        verdict,
        Scenario(junction, "1000"),
        Scenario(junction, "1000", distance=999),
    ):
        page = shown(value)
        assert page.tags <= TAGS
        assert page.attributes <= {"style", "src", "alt", "width", "open"}
        assert "alert(1)" in page.text
        assert "\x1b" not in value._repr_html_()
        for picture in page.pictures:  # an image is never executed, and is well-formed all the same
            assert not [e for e in picture.iter() if e.tag.removeprefix(SVG) in ("script", "image", "foreignObject")]


def test_any_drawing_can_be_shown() -> None:
    page = shown(Picture(draw_braking({1: [(0.3, 1.0), (20.0, 11.0)]}, HOSTILE), HOSTILE))
    assert HOSTILE.partition("\x1b")[0] in "".join(page.pictures[0].itertext())
    assert page.tags == {"img"}


def test_undrawable_value_is_a_text(crash: Run) -> None:
    odd = replace(crash, agents=crash.agents[:1] * 5)
    assert shown(odd).text.startswith("<Run> can't be drawn: IndexError")
    assert Page(html(HOSTILE)).tags == {"p"}


def test_judging_and_driving_import_no_drawing() -> None:
    code = """
import sys
import pytest_rvads as rvads
scenario = rvads.Scenario(rvads.find("stop4"), "1000", distance=2, duration=0.1)
run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
rvads.check(run, "full_stop")
print("pytest_rvads.satellites.notebook" in sys.modules)
run._repr_html_()
print("pytest_rvads.satellites.notebook" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\nTrue\n"


@pytest.mark.extended
def test_the_example_notebook_runs_and_shows_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes some seconds: a kernel is a process of its own, and eight runs are simulated in it."""
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name))
    new = tmp_path / "explore.ipynb"
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools" / "make_notebook.py"), str(new)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    stored, got = cells(NOTEBOOK), cells(new)
    # Where another engine is the usual one its name stands there, and all else is the same.
    named = [[text.replace(f"simulated by {usual().name}", f"simulated by {rvads.bullet.name}") for text in said] for said in got]
    assert named == stored, "run: python tools/make_notebook.py"
    assert sum(map(bool, got)) >= 8
    assert NOTEBOOK.stat().st_size < 300_000, "hosts of code show no larger ones"


def cells(file: Path) -> list[list[str]]:
    """What the cells of a notebook show, without pictures."""
    found = []
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        assert all(output["output_type"] != "error" for output in cell.get("outputs", ()))
        data = [{"text/plain": o["text"]} if "text" in o else o["data"] for o in cell.get("outputs", ())]
        said = ["".join(item.get("text/html") or item["text/plain"]) for item in data]
        found.append([unescape(re.sub(r'src="[^"]*"', "", re.sub(r" object>|0x[0-9a-f]+", "", text))) for text in said])
    return found
