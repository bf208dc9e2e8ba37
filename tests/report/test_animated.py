"""An animated picture shows what the run holds, in few bytes, whatever its texts are."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.report.animated import animated
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import RunError

from ..run_builders import gliding

SVG = "{http://www.w3.org/2000/svg}"
SECONDS = 20.0


@pytest.fixture(scope="module")
def run() -> Run:
    """A run at a junction with lights, at 5 m/s for a0 and 1 m/s more for each further vehicle; they leave before its end."""
    return gliding(Scenario(find("light4"), "1233", distance=10), [5.0, 6.0, 7.0, 8.0], round(SECONDS * 100))


def frames(document: str, name: str) -> list[tuple[float, str]]:
    """Return the keyframes of a name: at which share of the whole, and what then."""
    (found,) = re.findall(rf"@keyframes {name}\{{((?:[^{{}}]*\{{[^{{}}]*\}})*)\}}", document)
    return [(float(share) / 100, style) for share, style in re.findall(r"([\d.]+)%\{([^}]*)\}", found)]


def length(document: str) -> float:
    """Return how long a round takes [s]."""
    (found,) = set(re.findall(r"animation:v\d+ ([\d.]+)s linear", document))
    return float(found)


def test_vehicles_are_where_the_run_says(run: Run) -> None:
    document = animated(run, title="title", responsible={"a0"}, around=3.0, before=2.0, after=1.0)
    whole = length(document)
    assert whole == pytest.approx(2.0 + 2.0 + 1.0 + 1.0), "before, standing still, after, and at the end"
    for share, style in frames(document, "v0"):
        shown = share * whole
        time = 1.0 + shown if shown < 2.0 else max(3.0, shown - 1.0)
        x, y = map(float, re.findall(r"(-?[\d.]+)px", style))
        expected = run.need("pose")[min(round(time * 100), 400), 0, :2]
        assert (x, -y) == pytest.approx(tuple(expected), abs=0.04), shown
    ET.fromstring(document)


def test_animation_begins_when_vehicles_are_near(run: Run) -> None:
    """At 5 m/s, a0 comes to within 1 m of its line, 10 m from its start, after 1.8 s, so the film begins at 0.8 s."""
    far = replace(run, pose=run.need("pose") + np.where(run.times < 2.0, 500.0, 0.0)[:, None, None] * [1.0, 0.0, 0.0])
    assert length(animated(run, responsible={"a0"}, around=3.0, before=3.0, after=1.0)) == pytest.approx(
        3.0 - 0.8 + 2.0 + 1.0 + 1.0
    )
    assert length(animated(far, responsible={"a0"}, around=3.0, before=3.0, after=1.0)) == pytest.approx(5.0)


def test_the_still_picture_shows_the_junction_and_all_vehicles_near_it(run: Run) -> None:
    document = animated(run, responsible={"a0"}, around=3.0)
    left, top, wide, high = map(float, re.findall(r'viewBox="([^"]*)"', document)[1].split())
    for column in range(4):
        length, (x, y, heading) = 4.6, run.need("pose")[300, column]
        for px, py in ((x, y), (x - length * np.cos(heading), y - length * np.sin(heading))):
            assert left < px < left + wide
            assert top < -py < top + high
    assert wide < 60.0, "no more than that"


def test_departed_vehicle_is_hidden(run: Run) -> None:
    gone = int(np.argmax(run.zone[:, 3] == Zone.GONE)) / 100
    document = animated(run, around=gone, before=1.0, after=1.0)
    assert [style for _, style in frames(document, "s3")] == ["visibility:visible"] * 2 + ["visibility:hidden"]
    root = ET.fromstring(document)
    assert root.find(f".//{SVG}g[@class='s3']").attrib["visibility"] == "hidden", "so it is where nothing moves"


def test_lights_change(run: Run) -> None:
    document = animated(run, around=15.0, before=1.0, after=3.5)
    lamps = [g for g in ET.fromstring(document).iter(f"{SVG}g") if re.fullmatch(r"l\d", g.attrib.get("class", ""))]
    # Green, yellow from 15 s, red from 18 s, at entrances 0 and 2.
    assert [lamp.findtext(f".//{SVG}g[@data-entrance='0']/{SVG}text") for lamp in lamps] == ["G", "Y", "R"]
    assert [lamp.attrib.get("visibility") for lamp in lamps] == ["hidden", None, "hidden"]


def test_the_text_appears_when_it_happens(run: Run) -> None:
    document = animated(run, title="it happens", around=3.0, before=2.0, after=1.0)
    (before, hidden), (then, shown) = frames(document, "told")
    assert (before, hidden, shown) == (0.0, "opacity:0", "opacity:1")
    assert then * length(document) == pytest.approx(2.0, abs=0.01)
    assert "told" not in animated(run, title="the whole run")


def test_a_subject_is_named_until_then(run: Run) -> None:
    tested = replace(run, facts=replace(run.facts, subject="a1"))
    said = "a1 is under test, the others are traffic"
    assert said in animated(tested, title="title", around=3.0)
    assert said not in animated(run, title="title", around=3.0)


def test_a_title_is_broken_into_even_lines(run: Run) -> None:
    title = "t = 5.09 s: a0 entered the junction before it had stopped at the line of its entrance, which is marked"
    drawn = [e.text for e in ET.fromstring(animated(run, title=title, around=3.0)).iter(f"{SVG}text") if e.text in title]
    shown = [text for text in drawn if len(text) > 10]
    assert " ".join(shown) == title
    assert len(shown) == 2
    assert abs(len(shown[0]) - len(shown[1])) < 20


def test_animation_has_less_than_100_kilobytes(run: Run) -> None:
    assert len(animated(run, title="title", around=4.0)) < 100_000
    assert len(animated(run, title="title")) < 400_000, "all of its 20 s"
    hour = replace(run, dt=1.8)
    assert len(animated(hour, title="title", around=0.0, before=1e9, after=1e9)) < 100_000, "at most a minute of a run"


@pytest.mark.parametrize(
    "text", ['"><script>alert(1)</script>', "]]>&lt;", "\x00\x1b\x85\ud800\ufffe", "</style>{}%", "word" * 200]
)
def test_any_text_is_shown_as_text(run: Run, text: str) -> None:
    agents = tuple(replace(agent, name=f"{text}{n}") for n, agent in enumerate(run.agents))
    hostile = replace(run, agents=agents, label=text, facts=replace(run.facts, subject=agents[0].name))
    root = ET.fromstring(animated(hostile, title=text, responsible={agents[0].name}, around=3.0))
    assert {e.tag.removeprefix(SVG) for e in root.iter()} <= {
        *["svg", "style", "rect", "polyline", "line", "text", "path", "g", "circle", "title"]
    }
    assert not [name for e in root.iter() for name in e.attrib if name.startswith("on")]


def test_run_without_positions_or_states_is_refused(run: Run) -> None:
    with pytest.raises(RunError, match="holds no positions"):
        animated(replace(run, pose=None))
    none = {name: getattr(run, name)[:0] for name in ("zone", "lights", "station", "speed", "pose")}
    with pytest.raises(RunError, match="has no states"):
        animated(replace(run, **none))


@pytest.mark.parametrize("around", [-5.0, 0.0, SECONDS, 1e6])
def test_a_time_outside_the_run_is_its_beginning_or_end(run: Run, around: float) -> None:
    document = animated(run, title="title", responsible={"a0", "nobody"}, around=around)
    ET.fromstring(document)
    assert "nan" not in document
    assert "inf" not in re.findall(r"viewBox=\"[^\"]*\"", document)[1]
