"""The map on the page of a town works in a browser: with a mouse, by keyboard, on a phone, and with names that mean harm."""

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.satellites.campaigns.town import MarkedJunction, town_picture
from pytest_rvads.satellites.pages.page import page

Chrome = Any  # of selenium.webdriver, which not everybody has
HARM = "<img src=x onerror=alert(1)></script>"
LINES = (((10, -10), (390, -10)), ((390, -10), (390, -390)))
ROADS = {number: SimpleNamespace(points=np.array(line), width=3.5) for number, line in enumerate(LINES)}
TOWN = cast(RoadMap, SimpleNamespace(graph=SimpleNamespace(edges=ROADS)))


def site(id: str, x: float, y: float, *outcomes: Outcome, note: str = "", incomplete: bool = False) -> MarkedJunction:
    """A junction with two arms around a place of the picture, where y points down."""
    arms = [SimpleNamespace(x=x - 10, y=-y), SimpleNamespace(x=x + 10, y=-y)]
    report = cast(Any, SimpleNamespace(id=id, arms=arms))
    return MarkedJunction(f"town.{id}", report, Counter(outcomes), incomplete, note)


def record(junction: str, status: Status) -> Record:
    keys = {"junction": junction, "rule": "no_collision", "run": f"{junction}-class01"}
    start = planned_record(f"{junction}-class01-no_collision", 0, "", keys, 4)
    return conclude(start, [Verdict("", status, "")], "call", "failed" if status is Status.FAIL else "passed", text=HARM)


SITES = [
    site("1", 100, 100, Outcome.PASS, Outcome.PASS),
    site("2", 300, 100, Outcome.PASS, Outcome.FAIL),
    site("3", 300, 300, Outcome.PASS, incomplete=True),
    site(HARM, 100, 300, note=f"refused: it has 2 arms {HARM}"),
    site("j_1676908203_24", 110, 100, Outcome.ERROR),
]


@pytest.fixture
def opened(browser: Chrome, tmp_path: Path) -> Iterator[Callable[..., Chrome]]:
    """Open the page of a town with a junction of every mark, one of them with a hostile id, one with a long id."""
    path = tmp_path / "town.html"
    records = (record("town.1", Status.PASS), record("town.2", Status.FAIL), record("town.3", Status.PASS))
    path.write_text(page(Report(records, notes=(HARM,)), tmp_path, "town", [town_picture("town", TOWN, SITES)]), encoding="utf-8")

    def shown(fragment: str = "", width: int = 1280) -> Chrome:
        browser.set_window_size(width, 1000)
        browser.get("about:blank")
        browser.get(f"file://{path}{fragment}")
        return browser

    yield shown
    assert browser.get_log("browser") == []


def all_of(browser: Chrome, selector: str) -> list[Any]:
    return list(browser.find_elements("css selector", selector))


def marks(browser: Chrome) -> dict[str, Any]:
    return {mark.get_attribute("data-name"): mark for mark in all_of(browser, "svg.map a")}


def found(browser: Chrome) -> list[str]:
    """The ids of the items that were chosen."""
    return [item.text for item in all_of(browser, "#found .id")]


def wait(browser: Chrome, until: Callable[[], bool]) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, 10, poll_frequency=0.05).until(lambda _: until())


def view_box(browser: Chrome) -> list[float]:
    return [float(number) for number in browser.find_element("css selector", "svg.map").get_dom_attribute("viewBox").split()]


def test_junctions_are_marked_by_more_than_colour(opened: Callable[..., Chrome]) -> None:
    browser = opened()
    kinds = {name: mark.get_attribute("class").split()[1] for name, mark in marks(browser).items()}
    assert kinds == {
        "town.1": "good",
        "town.2": "bad",
        "town.3": "doubt",
        f"town.{HARM}": "none",
        "town.j_1676908203_24": "error",
    }
    assert list(kinds)[-1] == "town.2", "the mark of the worst junction lies on top"
    discs = [disc.get_attribute("class").split()[1] for disc in all_of(browser, "svg.map .area")]
    assert sorted(discs) == ["bad", "doubt", "error", "good"], "nothing covers the map where a junction is refused"
    for part in (".body", ".sign"):
        assert len({mark.find_element("css selector", part).get_attribute("d") for mark in marks(browser).values()}) == 5
    assert "5 junctions: 1 ✗ failed; 1 E no verdict (ERROR); 1 ! open, " in browser.find_element("css selector", "main").text


def test_names_on_the_map_are_short_and_cover_neither_marks_nor_names(opened: Callable[..., Chrome]) -> None:
    browser = opened()
    texts = {name: mark.find_element("css selector", "text") for name, mark in marks(browser).items()}
    shown = {name: text.text for name, text in texts.items() if text.is_displayed()}
    assert shown["town.2"] == "2"
    assert shown["town.j_1676908203_24"] == "j_16…03_24"
    assert "town.1" not in shown, "it lies beside the junction with the long id"


def test_a_failed_junction_has_the_colour_of_failed_items_in_both_themes(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.2")
    grounds = set()
    for _ in range(2):
        script = "return getComputedStyle(document.querySelector('#found .s.bad'), '::before').backgroundColor"
        text = browser.execute_script(script)
        assert marks(browser)["town.2"].find_element("css selector", ".body").value_of_css_property("fill") == text
        grounds.add(browser.find_element("css selector", "body").value_of_css_property("color"))
        browser.find_element("id", "theme").click()
    assert len(grounds) == 2, "both themes were seen"


def test_an_address_chooses_the_items_of_a_junction(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.2")
    assert found(browser) == ["town.2-class01-no_collision"]
    browser.execute_script("location.hash = '#town.3'")
    wait(browser, lambda: found(browser) == ["town.3-class01-no_collision"])
    assert "chosen" in marks(browser)["town.3"].get_attribute("class")


@pytest.mark.extended
def test_a_click_chooses_a_junction_and_a_drag_moves_the_map(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser = opened()
    ActionChains(browser).move_to_element(marks(browser)["town.3"]).click().perform()
    wait(browser, lambda: found(browser) == ["town.3-class01-no_collision"])
    x, y, *size = view_box(browser)
    view = browser.find_element("css selector", "svg.map")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", view)
    ActionChains(browser).move_to_element(view).click_and_hold().move_by_offset(60, 40).release().perform()
    u, v, *now = view_box(browser)
    assert now == pytest.approx(size)
    assert (x - u) / (y - v) == pytest.approx(60 / 40, rel=0.2)
    assert found(browser) == ["town.3-class01-no_collision"], "a drag chooses nothing"


def test_wheel_and_keys_zoom(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
    from selenium.webdriver.common.keys import Keys

    browser = opened()
    view = browser.find_element("css selector", "svg.map")
    left, _, whole, _ = view_box(browser)
    view.send_keys("+")
    assert view_box(browser)[2] == pytest.approx(0.7 * whole)
    left = view_box(browser)[0]
    view.send_keys(Keys.ARROW_RIGHT)
    assert view_box(browser)[0] > left
    view.send_keys("0")
    assert view_box(browser)[2] == pytest.approx(whole)
    ActionChains(browser).scroll_from_origin(ScrollOrigin.from_element(view), 0, -120).perform()
    wait(browser, lambda: view_box(browser)[2] < whole)


def test_by_keyboard_a_mark_is_a_link(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.keys import Keys

    browser = opened()
    browser.execute_script("arguments[0].focus()", marks(browser)["town.1"])
    browser.switch_to.active_element.send_keys(Keys.ENTER)
    wait(browser, lambda: found(browser) == ["town.1-class01-no_collision"])


def test_names_that_mean_harm_are_texts(opened: Callable[..., Chrome]) -> None:
    browser = opened()
    assert not all_of(browser, "img")
    assert marks(browser)[f"town.{HARM}"].get_attribute("aria-label") == f"town.{HARM}: refused: it has 2 arms {HARM}"
    assert HARM in browser.find_element("css selector", ".note").text


def test_a_phone_scrolls_in_one_direction_only(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.2", width=500)  # the narrowest window that a headless browser has
    wide, inner = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    assert wide <= inner
