"""The pages work in a browser: they open without a complaint, and what can be clicked does what it says."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.scene import picture
from pytest_rvads.report.session_report import Change, Comparison, Report, in_order
from pytest_rvads.report.terminal import summary
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.recording import Track as Samples
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Kind
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.pages.page import page
from pytest_rvads.satellites.pages.replay import Track, replay
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.wording import printable

from .large_session import large_session

Chrome = Any  # of selenium.webdriver, which not everybody has
Open = Callable[..., Chrome]
LAST = 2.0


@pytest.fixture
def open_page(browser: Chrome, tmp_path: Path) -> Iterator[Open]:
    """Open a page under a name; in the end its console must be empty."""

    def opened(text: str, fragment: str = "", ending: str = "html") -> Chrome:
        path = tmp_path / f"page.{ending}"
        path.write_text(text, encoding="utf-8")
        browser.get("about:blank")  # a change of the fragment alone would not load the page again
        browser.get(f"file://{path}{fragment}")
        return browser

    yield opened
    assert browser.get_log("browser") == []


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(Case(Scenario(find("light4"), "1132", distance=0.3, duration=LAST), LgsvlLike))


@pytest.fixture(scope="module")
def replayed(run: Run) -> str:
    tracks = [Track("p6 a2, a0", ((0, "watching"), (50, "due"), (81, "violated")))]
    return replay(run, "p6 at t=0.81 s", "notes", [(0.81, "p6 is violated")], tracks, {"a2"})


def by_id(browser: Chrome, name: str) -> Any:
    return browser.find_element("id", name)


def wait(browser: Chrome, until: Callable[[], bool]) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, 10, poll_frequency=0.05).until(lambda _: until())


def clock(browser: Chrome) -> str:
    return str(by_id(browser, "clock").text)


@pytest.mark.extended
def test_a_deep_link_shows_its_instant(open_page: Open, replayed: str) -> None:
    browser = open_page(replayed, "#t=0.81")
    assert clock(browser) == "0.81 s"
    labels = [row.find_element("tag name", "span").text for row in browser.find_elements("css selector", "#strips .row")]
    assert labels[-1] == "p6 a2, a0: violated"
    assert "a2 (responsible)" in by_id(browser, "states").text
    assert browser.find_elements("css selector", '[data-agent="a2"] .broken')
    browser.execute_script("location.hash = '#t=0.5'")
    wait(browser, lambda: clock(browser) == "0.50 s")


@pytest.mark.extended
def test_lights_and_queues_of_several_lanes(open_page: Open) -> None:
    scenario = Scenario(find("lanes4"), (1, 3, 0, 0, 0, 0, 0, 0), distance=2, followers=1, duration=1.0)
    browser = open_page(replay(simulate(Case(scenario, LgsvlLike)), "lanes"), "#t=0.5")
    labels = [row.find_element("tag name", "span").text for row in browser.find_elements("css selector", "#strips .row")]
    assert [label.partition(":")[0] for label in labels][:6] == ["a0.0", "a0.0+1", "a0.1", "a0.1+1", "light 0.0", "light 0.1"]
    for name in ("a0.0+1", "a0.1+1"):
        text, body = (browser.find_element("css selector", f'[data-agent="{name}"] {tag}').rect for tag in ("text", "rect"))
        assert body["y"] - 1 <= text["y"] <= text["y"] + text["height"] <= body["y"] + body["height"] + 1, "written along it"


@pytest.fixture(scope="module")
def traffic() -> str:
    """The page of a log: v0 is there from 100 s to 116 s, v1 from 110 s on, both at 5 m/s; it opens at 112 s."""
    place = find("stop4")
    tracks = []
    for number, entrance in enumerate((0, 1)):
        movement = place.leads(entrance, 2)
        way = Itinerary.through(place, *movement.key)
        times = 100.0 + 10.0 * number + np.arange(0.0, 16.01, 0.1)
        station = 5.0 * (times - times[0]) - 40.0
        pose = np.array([way.pose(float(s)) for s in station])
        tracks.append(Samples(Agent(f"v{number}", movement, size=(4.6, 1.8)), times, station, np.full(len(times), 5.0), pose))
    (run,) = Recording("log", place, tuple(tracks))
    lines = [Track("p1 v0, v1", ((0, "watching"), (1200, "violated")))]
    return replay(run, "p1", "", [(112.0, "p1 is violated"), (113.0, "and again")], lines, {"v1"}, 112.0)


def test_a_page_of_traffic_opens_where_it_is_about(open_page: Open, traffic: str) -> None:
    browser = open_page(traffic, "")
    assert clock(browser) == "112.00 s"

    def shows(time: str) -> bool:
        return clock(browser) == time

    def seen() -> list[str]:
        rows = browser.find_elements("css selector", "#states tbody tr")
        drawn = browser.find_elements("css selector", ".vehicle")  # not all of them in view
        bodies = [b.get_attribute("data-agent") for b in drawn if b.value_of_css_property("display") != "none"]
        assert bodies == [row.text.split()[0] for row in rows if row.is_displayed()]
        return bodies

    assert seen() == ["v0", "v1"]
    labels = [row.find_element("tag name", "span").text for row in browser.find_elements("css selector", "#strips .row")]
    assert labels == ["v1: approach", "p1 v0, v1: violated", "v0: junction"], "what it is about comes first"
    assert len(browser.find_elements("css selector", "#strips .row:first-child u")) == 1
    assert len(browser.find_elements("css selector", "#events .told")) == 2
    for time, there in (("105", ["v0"]), ("120", ["v1"]), ("112.5", ["v0", "v1"])):
        browser.execute_script(f"location.hash = '#t={time}'")
        wait(browser, partial(shows, f"{float(time):.2f} s"))
        assert seen() == there
    x, y = (
        float(v) for v in re.findall(r"-?[\d.]+", browser.find_element("css selector", ".vehicle").get_attribute("transform"))[:2]
    )
    way = Itinerary.through(find("stop4"), *find("stop4").leads(0, 2).key)
    assert (x, -y) == pytest.approx(way.pose(5.0 * 12.5 - 40.0)[:2], abs=0.06)


@pytest.mark.extended
def test_play_runs_to_the_end_and_pauses(open_page: Open, replayed: str) -> None:
    browser = open_page(replayed, "")
    before = browser.find_element("css selector", '[data-agent="a0"]').get_attribute("transform")
    browser.find_element("css selector", "#speed option[value='4']").click()
    # A busy machine may need longer for a question than the replay takes: the page itself notes the labels of the button.
    browser.execute_script(
        "labels = []; new MutationObserver(() => labels.push(arguments[0].textContent)).observe(arguments[0], {childList: true})",
        by_id(browser, "play"),
    )
    by_id(browser, "play").click()
    wait(browser, lambda: clock(browser) == f"{LAST:.2f} s")
    assert browser.execute_script("return labels.filter((label, k) => label !== labels[k - 1])") == ["pause", "play"]
    assert browser.find_element("css selector", '[data-agent="a0"]').get_attribute("transform") != before


def test_scrubbing_keys_events_and_strips_go_to_a_time(open_page: Open, replayed: str) -> None:
    from selenium.webdriver.common.keys import Keys

    browser = open_page(replayed, "")
    scrub = by_id(browser, "scrub")
    browser.execute_script("arguments[0].value = 120; arguments[0].dispatchEvent(new Event('input'))", scrub)
    assert clock(browser) == "1.20 s"
    body = browser.find_element("tag name", "body")
    body.send_keys(Keys.ARROW_RIGHT)
    assert clock(browser) == "1.21 s"
    body.send_keys(Keys.HOME)
    assert clock(browser) == "0.00 s"
    (told,) = browser.find_elements("css selector", "#events .told")
    assert "p6 is violated" in told.text, "what else happens in that instant does not stand out"
    told.click()
    assert clock(browser) == "0.81 s"
    assert browser.current_url.endswith("#t=0.81")
    browser.find_elements("css selector", "#strips .strip")[0].click()  # in its middle
    assert float(clock(browser).split()[0]) == pytest.approx(LAST / 2, abs=0.02)


def test_light_and_dark(open_page: Open, replayed: str) -> None:
    browser = open_page(replayed, "")

    def background() -> str:
        return str(browser.execute_script("return getComputedStyle(document.body).backgroundColor"))

    first = background()
    by_id(browser, "theme").click()
    assert background() != first
    by_id(browser, "theme").click()
    assert background() == first


def record(cls: int, rule: str, status: str) -> Record:
    keys: dict[str, str | int] = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": "C", "rotation": 0, "rule": rule}
    found = planned_record(f"test_x.py::test[stop4-class{cls:02d}-{rule}]", 3, "test", keys, 4)
    verdict = Verdict(rule, Status(status), f"{rule} <b>", violated=f"{rule} broken", time=1.0)
    outcome, look = ("failed", f".rvads/{cls}.html#t=1.00") if status == "FAIL" else ("passed", "")
    return conclude(structs.replace(found, look=look), [verdict], "call", outcome, text=f"{rule} <b>at</b> t=1")


def unfold(browser: Chrome, selector: str) -> None:
    """Open a folded part, which is made then."""
    browser.find_element("css selector", f"{selector} > summary").click()
    wait(browser, lambda: bool(browser.find_elements("css selector", f"{selector} > :not(summary)")))


def items(browser: Chrome, within: str = "#found") -> list[str]:
    """The items that are shown there."""
    script = "return [...document.querySelectorAll(arguments[0])].map(item => item.innerText)"
    return list(browser.execute_script(script, f"{within} .items > li"))


@pytest.mark.extended
def test_the_index_leads_from_a_cell_to_its_replay(open_page: Open) -> None:
    from selenium.webdriver.support.select import Select

    records = [
        record(cls, rule, "FAIL" if (cls, rule) == (2, "p1") else "PASS") for cls in range(1, 400) for rule in ("p1", "p2")
    ]
    report = Report(in_order(records), {4: (24, 81)}, (), {}, 1, ("2 items did not run",))
    browser = open_page(page(report, Path(".rvads")), "")
    assert by_id(browser, "count").text == "1 failing of 798 items"
    assert len(items(browser, "")) == 1, "what passed is not there until it is asked for"
    unfold(browser, ".passed")
    assert len(items(browser, ".passed")) == 100
    browser.find_element("css selector", ".passed .more").click()
    assert len(items(browser, ".passed")) == 200
    assert "2 items did not run" in browser.find_element("css selector", ".note").text
    unfold(browser, ".tables")
    browser.find_element("xpath", "//table[@class='matrix']//button[text()='FAIL']").click()
    assert by_id(browser, "count").text == "1 of 798 items"
    assert "<b>at</b>" in items(browser)[0]
    assert browser.find_element("css selector", "#found a").get_dom_attribute("href") == "2.html#t=1.00"
    by_id(browser, "clear").click()
    Select(by_id(browser, "rule")).select_by_value("p2")
    assert by_id(browser, "count").text == "399 of 798 items"
    assert not by_id(browser, "grouped").is_displayed()
    assert by_id(browser, "failures").text == "items found"
    by_id(browser, "search").send_keys("class01-")
    assert by_id(browser, "count").text == "1 of 798 items"
    by_id(browser, "clear").click()
    assert by_id(browser, "grouped").is_displayed()
    browser.find_element("css selector", ".causes button").click()
    assert by_id(browser, "count").text == "1 of 798 items"


@pytest.mark.extended
def test_the_sums_of_a_town_lead_to_the_table_and_the_items_of_a_junction(open_page: Open) -> None:
    records = [
        structs.replace(record(cls, rule, "FAIL" if (place, cls) == (24, 2) else "PASS"), junction=f"J{place}", control="stop")
        for place in range(25)
        for cls in (1, 2)
        for rule in ("p1", "p2")
    ]
    browser = open_page(page(Report(tuple(records)), Path(".rvads")), "")

    def names() -> list[str]:
        return [one.text for one in browser.find_elements("css selector", ".sums button")]

    assert names() == []
    unfold(browser, ".rolled")
    assert names() == ["4-way stop", "p1", "p2", "J24", *(f"J{place}" for place in range(19))], "the worst first"
    assert not browser.find_elements("css selector", ".matrix")
    browser.find_element("xpath", "//button[text()='5 more junctions']").click()
    assert names()[-5:] == [f"J{place}" for place in range(19, 24)]
    worst = browser.find_element("xpath", "//button[text()='J24']")
    worst.click()
    assert browser.find_element("css selector", ".unfolded h3").text == "J24 test_x.py::test"
    browser.find_element("xpath", "//tr[@class='unfolded']//button[text()='FAIL']").click()
    assert by_id(browser, "count").text == "1 of 100 items"
    browser.find_element("xpath", "//button[text()='its items']").click()
    assert by_id(browser, "count").text == "4 of 100 items"
    worst.click()
    assert not browser.find_elements("css selector", ".unfolded")
    browser.find_element("xpath", "//button[text()='p2']").click()
    assert by_id(browser, "count").text == "50 of 100 items"
    browser.find_element("xpath", "//button[text()='4-way stop']").click()
    assert by_id(browser, "count").text == "100 of 100 items"


def test_row_of_recordings_links_to_every_recording(open_page: Open) -> None:
    """Its label names three of nine; what is unsure has the mark of a doubt."""

    def recorded(name: str, status: str) -> Record:
        keys = {"junction": "stop4", "recording": name, "rule": "p3"}
        found = planned_record(f"test_x.py::test[{name}-p3]", 3, "test", keys, 4)
        return conclude(
            found, [Verdict("", Status(status), "", reason="0.02 s apart")], "call", "skipped", text=f"{status}: 0.02 s apart"
        )

    records = [recorded(f"d{number}", "UNSURE" if number == 5 else "NA") for number in range(10)]
    browser = open_page(page(Report(in_order(records)), Path(".rvads")), "")
    assert by_id(browser, "grouped").text == "No item failed."
    unfold(browser, ".tables")
    browser.find_element("xpath", "//table[@class='matrix']//tr[th='d0, d1, d2 and 6 more']//button[text()='NA']").click()
    assert by_id(browser, "count").text == "9 of 10 items"
    browser.find_element("xpath", "//table[@class='matrix']//tr[th='d5']//button[text()='unsure']").click()
    assert by_id(browser, "count").text == "1 of 10 items"
    assert browser.find_element("css selector", "#found .s.doubt").text == "UNSURE"
    assert [title.text for title in browser.find_elements("css selector", ".others > summary")] == [
        "unsure: another reading of what was recorded changes the verdict (1)",
        "not applicable, skipped or not run (9)",
    ]


@pytest.fixture(scope="module")
def large() -> Report:
    return large_session()


@pytest.fixture
def phone(browser: Chrome) -> Iterator[None]:
    metrics = {"width": 375, "height": 812, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    yield
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def extent(browser: Chrome) -> tuple[int, int]:
    """Width and height of the whole page [px]."""
    script = "const {scrollWidth, scrollHeight} = document.documentElement; return [scrollWidth, scrollHeight]"
    width, height = browser.execute_script(script)
    return width, height


@pytest.mark.extended
@pytest.mark.usefixtures("phone")
def test_a_large_session_keeps_to_ten_screens_of_a_phone(open_page: Open, large: Report) -> None:
    assert (len(large.records), sum(one.failed for one in large.records)) == (3000, 300)
    browser = open_page(page(large, Path(".rvads")))
    width, height = extent(browser)
    assert width == 375
    assert height < 10 * 812
    for kind in ("tables", "others", "passed"):
        unfold(browser, f".{kind}")

    def all_open() -> bool:
        browser.execute_script("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        return len(items(browser, "#grouped")) == 300

    wait(browser, all_open)
    assert extent(browser)[0] == 375, "tables scroll within their boxes"
    table, its = (browser.find_element("css selector", name).rect["width"] for name in (".matrix", ".scroll"))
    assert its < 375 < table


@pytest.mark.extended
def test_session_page_shows_the_session_then_causes_then_failures(open_page: Open, large: Report) -> None:
    browser = open_page(page(large, Path(".rvads")))
    terms = {row.find_element("tag name", "dt").text: row.find_element("tag name", "dd").text for row in heads(browser)}
    assert terms == {
        "began": "2026-11-23T12:46:18+00:00",
        "driven by": "pilots.hurried.HurriedPilot (pilots/hurried.py 3fa29c01): 600 runs",
        "simulated by": "bullet 3.2.7: 600 runs",
        "command": "pytest tests/test_pilots.py --rvads-report=verdicts.html -n 4",
        "result": "3,000 verdicts on 600 runs: 1,825 pass, 160 fail, 140 open, 875 NA",
        "exit status": "1",
    }
    assert [title.text for title in browser.find_elements("tag name", "h2")] == [
        "causes of failures",
        "failures",
        "everything else",
    ]
    first = browser.find_element("css selector", ".causes > li")
    example = "tests/test_pilots.py::test_rules[light4-class01-as1101-cfgd10.00,12.50v05.00,08.33-p1]"
    assert first.find_element("tag name", "code").text == f'pytest "{example}"'
    link = first.find_element("link text", "replay of the first")
    assert link.get_dom_attribute("href").startswith("light4-class01-as1101-cfgd10.00")
    assert len(items(browser, "#grouped")) == 10, "an example of each of the causes that are shown"
    assert example in items(browser, "#grouped")[0]
    assert {text.split()[0] for text in items(browser, "")} == {"FAIL", "OPEN"}, "neither NA nor PASS"


def heads(browser: Chrome) -> Any:
    return browser.find_elements("css selector", ".head > div")


def test_failures_without_a_replay_name_the_command_that_draws_the_replay(open_page: Open, large: Report) -> None:
    browser = open_page(page(large, Path(".rvads")))
    unfold(browser, "#grouped > .group:nth-child(2) > details")
    group = "#grouped > .group:nth-child(2)"
    assert len(items(browser, group)) == 20
    drawn = browser.find_elements("css selector", f"{group} a")
    commands = [one.text for one in browser.find_elements("css selector", f"{group} code")]
    assert (len(drawn), len(commands)) == (8, 12), "as many as the session has drawn"
    assert commands[0] == 'rvads replay "tests/test_pilots.py::test_rules[light4-class01-as1101-cfgd14.00,12.50v05.00,08.33-p2]"'
    unfold(browser, "#grouped > details")
    assert len(items(browser, "#grouped > details")) == 5


@pytest.mark.extended
def test_configurations_have_the_numbers_of_the_terminal(open_page: Open, large: Report) -> None:
    browser = open_page(page(large, Path(".rvads")))
    unfold(browser, ".tables")
    heading = browser.find_elements("css selector", ".matrix:first-of-type thead tr:first-child th")
    assert [one.text for one in heading[:20]] == [f"#{number}" for number in range(1, 21)]
    legend = [one.text for one in browser.find_elements("css selector", ".legend p")]
    assert legend[:2] == ["#1 = d10.00,12.50v05.00,08.33", "#2 = d11.00,12.50v06.00,08.33"]
    said = summary(large, colour=False, width=100, unicode=True, full=True)
    assert all(f" {line}\n" in said for line in legend)


def test_what_changed_since_a_baseline_is_marked_and_can_be_searched(open_page: Open) -> None:
    records = [structs.replace(record(cls, "p1", "PASS"), change="ERODED" if cls == 3 else "UNCHANGED") for cls in range(1, 6)]
    comparison = Comparison("main.json", tuple(Change(one.change, one.nodeid, "ttc 3.00 -> 1.00 s") for one in records))
    browser = open_page(page(Report(tuple(records), comparison=comparison), Path(".rvads")))
    assert "ERODED test_x.py::test[stop4-class03-p1] ttc 3.00 -> 1.00 s" in by_text(browser)
    by_id(browser, "search").send_keys("eroded")
    (found,) = items(browser)
    assert found.startswith("PASS, ERODED test_x.py::test[stop4-class03-p1]")


def by_text(browser: Chrome) -> str:
    return str(browser.find_element("tag name", "main").text)


@pytest.mark.parametrize("label", ["toString", "__proto__", "constructor"])
def test_a_configuration_may_be_called_as_anything_in_a_script(open_page: Open, label: str) -> None:
    named = structs.replace(record(1, "p1", "FAIL"), cfg=label)
    browser = open_page(page(Report((named,)), Path(".rvads")))
    unfold(browser, ".tables")
    shown = "toString" if label == "toString" else "#1"
    assert browser.find_element("css selector", ".matrix thead th").text == shown
    browser.find_element("css selector", ".matrix button").click()
    assert by_id(browser, "count").text == "1 of 1 item"


@pytest.mark.extended
def test_a_session_page_is_worked_by_keys(open_page: Open) -> None:
    from selenium.webdriver.common.keys import Keys

    records = [record(cls, "p1", "FAIL" if cls < 3 else "PASS") for cls in range(1, 5)]
    browser = open_page(page(Report(tuple(records)), Path(".rvads")))

    def press(key: str) -> str:
        browser.switch_to.active_element.send_keys(key)
        one = browser.switch_to.active_element
        return str(one.get_dom_attribute("id") or one.get_dom_attribute("class") or one.text)

    seen = [press(Keys.TAB) for _ in range(10)]
    assert seen == [
        *("theme", "replay of the first", "2 items", "status", "rule", "search"),
        *("replay", "1 more of this cause", "verdicts in 1 table", "2 items that did not fail"),
    ]
    browser.switch_to.active_element.send_keys(Keys.SHIFT, Keys.TAB)
    browser.switch_to.active_element.send_keys(Keys.ENTER)
    wait(browser, lambda: bool(browser.find_elements("css selector", ".matrix")))
    assert press(Keys.TAB) == "scroll", "it can be scrolled by keys"
    assert press(Keys.TAB) == "bad"
    assert press(Keys.ENTER) == "count", "one is led to what was found"
    assert by_id(browser, "count").text == "2 of 4 items"


@pytest.mark.extended
def test_a_session_page_is_printed_light_and_without_what_only_a_screen_can(open_page: Open, large: Report) -> None:
    browser = open_page(page(large, Path(".rvads")))
    unfold(browser, ".tables")
    browser.execute_script("document.documentElement.dataset.theme = 'dark'")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        background = browser.execute_script("return getComputedStyle(document.documentElement).getPropertyValue('--bg')")
        assert background == "#fff"
        assert not by_id(browser, "bar").is_displayed()
        assert not by_id(browser, "theme").is_displayed()
        table, sheet = (browser.find_element("css selector", name).rect["width"] for name in (".matrix", "main"))
        assert table <= sheet, "no column is cut off where nobody can scroll"
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


HOSTILE = [
    "<script>window.owned = 1</script>",
    "</script><script>window.owned = 1</script><!--",
    "'\"><img src=x onerror='window.owned = 1'>",
    "</title></text></svg><svg onload='window.owned = 1'>",
    "javascript:window.owned=1",
    "${window.owned = 1} `",
    "\x00\x1b\x85\u202e\ud800\ufffe</pre>",
]


def untouched(browser: Chrome) -> bool:
    """Whether nothing of a text ran or became an element."""
    script = "return window.owned === undefined && !document.querySelector('img, svg svg, [onload], [onerror]')"
    return bool(browser.execute_script(script))


@pytest.mark.extended
@pytest.mark.parametrize("text", HOSTILE)
def test_a_replay_shows_hostile_names_and_plays(open_page: Open, run: Run, text: str) -> None:
    agents = tuple(replace(agent, name=f"{text}{n}") for n, agent in enumerate(run.agents))
    hostile = replace(run, agents=agents, collisions=None, label=text)
    tracks = [Track(text, ((0, "watching"), (81, "violated")))]
    browser = open_page(replay(hostile, text, text, [(0.81, text)], tracks, {agents[0].name}), "#t=1.50")
    assert clock(browser) == "1.50 s"
    by_id(browser, "play").click()
    wait(browser, lambda: clock(browser) == f"{LAST:.2f} s")
    assert untouched(browser)
    assert browser.find_element("tag name", "h1").text == printable(text)


@pytest.mark.extended
@pytest.mark.parametrize("text", HOSTILE)
def test_an_index_shows_hostile_texts_and_can_be_clicked(open_page: Open, text: str) -> None:
    one = structs.replace(record(2, text, "FAIL"), message=text, look=text, driver=text, junction=text, cfg=text, known=text)
    one = structs.replace(one, source=text, simulator=text, hash="1", nodeid=f"{text}2", variant=text)
    quiet = structs.replace(record(3, text, "PASS"), nodeid=text, message=text * 300, hash="2", variant=text)
    report = Report(
        (one, quiet),
        {4: (24, 81)},
        (),
        {text: text},
        1,
        (text,),
        comparison=Comparison(text, (Change("NEW", text),) * 12),
        began=text,
        command=text,
        kept=text,
    )
    browser = open_page(page(report, Path()))
    for kind in ("tables", "passed"):
        unfold(browser, f".{kind}")
    browser.execute_script("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    for button in browser.find_elements("css selector", ".causes button, .matrix button"):
        button.click()
        assert by_id(browser, "count").text == "1 of 2 items"
    assert {link.get_attribute("protocol") for link in browser.find_elements("tag name", "a")} <= {"file:"}
    assert untouched(browser)
    assert browser.find_element("css selector", ".note").text == printable(text)
    told = [row.find_element("tag name", "dd").get_property("textContent") for row in heads(browser)]
    assert told[:2] == [printable(text)] * 2, "the date and the command"
    assert told[4] == f"{printable(text)} ({printable(text)}): 1 run"


@pytest.mark.extended
@pytest.mark.parametrize("text", HOSTILE)
def test_sums_show_hostile_names_and_can_be_clicked(open_page: Open, text: str) -> None:
    records = [structs.replace(record(1, text, "FAIL"), junction=f"{text}{place}", control=text) for place in range(5)]
    browser = open_page(page(Report(tuple(records)), Path()))
    unfold(browser, ".rolled")
    for button in browser.find_elements("css selector", ".sums button"):
        button.click()
    assert len(browser.find_elements("css selector", ".unfolded .matrix")) == 5
    assert untouched(browser)
    kind = browser.find_element("css selector", ".sums button")
    assert kind.get_property("textContent") == printable(f"4-way {text}".rstrip())


@pytest.mark.parametrize("text", HOSTILE)
def test_a_picture_runs_nothing(open_page: Open, run: Run, text: str) -> None:
    agents = tuple(replace(agent, name=text, kind=Kind.TRUCK) for agent in run.agents)
    browser = open_page(picture(replace(run, agents=agents, collisions=None), 50, text), ending="svg")
    assert browser.execute_script("return document.documentElement.localName") == "svg"
    assert untouched(browser)
