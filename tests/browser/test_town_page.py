"""The page of a town works in a browser: with a mouse, by keyboard, on a phone, and with names that mean harm."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import Notes
from pytest_rvads.satellites.campaigns.town_page import Site, Spot, TownMap, TownPicture, town_page
from pytest_rvads.satellites.campaigns.town_tally import CauseTally, Tally

Chrome = Any  # of selenium.webdriver, which not everybody has
HARM = "<img src=x onerror=alert(1)></script>"
ROAD = TownPicture((0.0, 0.0, 400.0, 400.0), ((3.5, "M10 10l380 0l0 380"), (2.0, "M10 10l0 380")))


def tally(*outcomes: Outcome) -> Tally:
    found = Tally(runs=len(outcomes))
    for outcome in outcomes:
        found.table["no_collision", "A", outcome] += 1
    return found


@pytest.fixture
def town(tmp_path: Path) -> Path:
    """A town of two maps: a junction of every mark, one of them with a hostile id, one with a long id, and one on another map."""
    sites = [
        Site("town.1", "1", 0, Spot(100, 100, 10), "4-way stop", 2),
        Site("town.2", "2", 0, Spot(300, 100, 10), "4-way stop", 2),
        Site("town.3", "3", 0, Spot(300, 300, 10), "3-way lights", 3),
        Site("town.4", HARM, 0, Spot(100, 300, 10), "2-way", 0, f"it has 2 arms {HARM}"),
        Site("town.5", "j_1676908203_24", 0, Spot(110, 100, 10), "3-way none", 1),
        Site("other.1", "1", 1, Spot(200, 200, 10), "3-way lights", 1),
    ]
    bad = tally(Outcome.PASS, Outcome.FAIL)
    bad.causes["causes of failures", HARM] = CauseTally("causes of failures", HARM, ("r",), "town.2-as1", "r", None, 1)
    tallies = {
        "town.1": tally(Outcome.PASS, Outcome.PASS),
        "town.2": bad,
        "town.3": tally(Outcome.PASS),
        "town.5": tally(Outcome.ERROR),
        "other.1": tally(Outcome.NA),
    }
    maps = [TownMap("town", ROAD), TownMap("other", ROAD)]
    page = town_page(
        "towns", [Notes((HARM,))], maps, sites, tallies, {("town.2-as1", "r"): "replays/one.html#t=1.00"}, "rvads town --only"
    )
    path = tmp_path / "town.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture
def opened(browser: Chrome, town: Path) -> Iterator[Callable[..., Chrome]]:
    def shown(fragment: str = "", width: int = 1280) -> Chrome:
        browser.set_window_size(width, 1000)
        browser.get("about:blank")
        browser.get(f"file://{town}{fragment}")
        return browser

    yield shown
    assert browser.get_log("browser") == []


def all_of(browser: Chrome, selector: str) -> list[Any]:
    return list(browser.find_elements("css selector", selector))


def text(browser: Chrome, name: str) -> str:
    return str(browser.find_element("id", name).text)


def wait(browser: Chrome, until: Callable[[], bool]) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, 10, poll_frequency=0.05).until(lambda _: until())


def test_junctions_are_listed_worst_first_and_marked_by_more_than_colour(opened: Callable[..., Chrome]) -> None:
    browser = opened()
    assert [line.get_attribute("data-name") for line in all_of(browser, "#list a")] == [
        "town.2",  # failed
        "town.5",  # its run has no verdict
        "town.3",  # 2 of its 3 runs are missing
        "town.1",  # passed
        "town.4",  # refused
        "other.1",  # nothing judged
    ]
    marks = {mark.get_attribute("data-name"): mark for mark in all_of(browser, "#marks a")}
    kinds = {name: mark.get_attribute("class").split()[1] for name, mark in marks.items()}
    assert kinds == {"town.1": "good", "town.2": "bad", "town.3": "doubt", "town.4": "none", "town.5": "error"}
    discs = [disc.get_attribute("class") for disc in all_of(browser, "#areas circle")]
    assert sorted(discs) == ["bad", "doubt", "error", "good"], "nothing covers the map where a junction is refused"
    bodies = {mark.find_element("css selector", ".body").get_attribute("d") for mark in marks.values()}
    signs = {mark.find_element("css selector", ".sign").get_attribute("d") for mark in marks.values()}
    assert len(bodies) == len(signs) == 5
    assert (
        text(browser, "said")
        == "6 junctions: 1 failed; 1 no verdict (ERROR); 1 open, provoked, unavoidable, unsure or incomplete; 1 passed; "
        "2 refused or not judged"
    )


def test_the_page_opens_on_the_map_of_the_worst_junction(browser: Chrome, tmp_path: Path) -> None:
    sites = [Site(f"{name}.1", "1", number, Spot(100, 100, 10), "4-way stop", 1) for number, name in enumerate(("good", "bad"))]
    tallies = {"good.1": tally(Outcome.PASS), "bad.1": tally(Outcome.FAIL)}
    page = town_page("towns", [], [TownMap("good", ROAD), TownMap("bad", ROAD)], sites, tallies, {}, "rvads town --only")
    (tmp_path / "town.html").write_text(page, encoding="utf-8")
    browser.get(f"file://{tmp_path / 'town.html'}")
    assert [mark.get_attribute("data-name") for mark in all_of(browser, "#marks a")] == ["bad.1"]
    assert browser.find_element("id", "map").get_property("value") == "1"


def test_names_on_the_map_do_not_lie_on_marks(browser: Chrome, tmp_path: Path) -> None:
    spots = {"above": Spot(200, 200, 10), "below": Spot(200, 210, 10), "far": Spot(300, 300, 10)}  # y points down
    sites = [Site(name, name, 0, spot, "4-way stop", 1) for name, spot in spots.items()]
    page = town_page("town", [], [TownMap("town", ROAD)], sites, {name: tally(Outcome.PASS) for name in spots}, {}, "rvads town")
    (tmp_path / "town.html").write_text(page, encoding="utf-8")
    browser.set_window_size(1280, 1000)
    browser.get(f"file://{tmp_path / 'town.html'}")
    marks = all_of(browser, "#marks a")
    bodies = {mark.get_attribute("data-name"): mark.find_element("css selector", ".body").rect for mark in marks}
    texts = {mark.get_attribute("data-name"): mark.find_element("css selector", "text") for mark in marks}
    shown = {name: text.rect for name, text in texts.items() if text.is_displayed()}
    assert {"below", "far"} == set(shown), "the mark below would lie under the name of the mark above"
    below = texts["above"].get_attribute("style")
    assert "none" in below
    assert all(shown[name]["y"] >= bodies[name]["y"] + bodies[name]["height"] - 4 for name in shown), "names stand below marks"


def test_names_on_the_map_are_short_and_do_not_cover_each_other(opened: Callable[..., Chrome]) -> None:
    browser = opened()
    names = {mark.get_attribute("data-name"): mark.find_element("css selector", "text") for mark in all_of(browser, "#marks a")}
    shown = {name: text.text for name, text in names.items() if text.is_displayed()}
    assert shown == {"town.2": "2", "town.3": "3", "town.5": "j_16\u202603_24"}, "town.1 lies beside town.5, town.4 is refused"
    browser.execute_script("location.hash = '#town.1'")
    wait(browser, lambda: names["town.1"].is_displayed() and not names["town.5"].is_displayed())


def test_failed_junctions_and_failed_rules_have_one_colour_in_both_themes(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.2")
    colours = set()
    for _ in range(2):
        cell = browser.find_element("css selector", "td.bad").value_of_css_property("color")
        mark = browser.find_element("css selector", ".mark.bad .body").value_of_css_property("fill")
        assert cell.replace("rgba", "rgb").replace(", 1)", ")") == mark
        colours.add(browser.find_element("css selector", "body").value_of_css_property("color"))
        browser.find_element("id", "theme").click()
    assert len(colours) == 2, "both themes were seen"


def test_a_link_shows_a_junction_also_on_another_map(opened: Callable[..., Chrome]) -> None:
    browser = opened("#other.1")
    assert "other.1: 1 NA" in text(browser, "one")
    assert [mark.get_attribute("data-name") for mark in all_of(browser, "#marks a")] == ["other.1"]
    browser.execute_script("location.hash = '#town.2'")
    wait(browser, lambda: "town.2: 1 pass, 1 fail" in text(browser, "one"))
    told = text(browser, "one")
    assert "1/2 fail" in told
    assert 'rvads town --only "town.2-as1-r"' in told
    assert all_of(browser, "#one a")[0].get_attribute("href").endswith("/replays/one.html#t=1.00")


@pytest.mark.extended
def test_a_click_chooses_the_nearest_junction_and_a_drag_moves_the_map(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser = opened()
    view = browser.find_element("id", "view")
    mark = next(mark for mark in all_of(browser, "#marks a") if mark.get_attribute("data-name") == "town.3")
    ActionChains(browser).move_to_element_with_offset(mark, 12, 0).click().perform()
    wait(browser, lambda: "town.3" in text(browser, "one"))
    before = view.get_dom_attribute("viewBox")
    ActionChains(browser).move_to_element(view).click_and_hold().move_by_offset(60, 40).release().perform()
    x, y, *size = map(float, before.split())
    u, v, *now = map(float, view.get_dom_attribute("viewBox").split())
    assert now == pytest.approx(size)
    assert (x - u) / (y - v) == pytest.approx(60 / 40, rel=0.2)
    assert "town.3" in text(browser, "one"), "a drag chooses nothing"


def test_wheel_buttons_and_keys_zoom(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    browser = opened()
    view = browser.find_element("id", "view")

    def width() -> float:
        return float(view.get_dom_attribute("viewBox").split()[2])

    whole = width()
    browser.find_element("id", "in").click()
    assert width() == pytest.approx(0.7 * whole)
    view.send_keys("+")
    assert width() == pytest.approx(0.49 * whole)
    left = float(view.get_dom_attribute("viewBox").split()[0])
    view.send_keys(Keys.ARROW_RIGHT)
    assert float(view.get_dom_attribute("viewBox").split()[0]) > left
    view.send_keys("0")
    assert width() == pytest.approx(whole)
    ActionChains(browser).scroll_from_origin(_origin(view), 0, -120).perform()
    wait(browser, lambda: width() < whole)


def _origin(view: Any) -> Any:
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

    return ScrollOrigin.from_element(view)


def test_by_keyboard_a_mark_is_a_link(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.common.keys import Keys

    browser = opened()
    mark = next(mark for mark in all_of(browser, "#marks a") if mark.get_attribute("data-name") == "town.1")
    browser.execute_script("arguments[0].focus()", mark)
    browser.switch_to.active_element.send_keys(Keys.ENTER)
    wait(browser, lambda: "town.1: 2 pass" in text(browser, "one"))


def test_names_that_mean_harm_are_texts(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.4")
    assert not all_of(browser, "img")
    assert f"refused: it has 2 arms {HARM}" in text(browser, "one")
    assert HARM in browser.find_element("css selector", ".note").text


def test_the_list_is_searched_and_maps_are_chosen(opened: Callable[..., Chrome]) -> None:
    from selenium.webdriver.support.select import Select

    browser = opened()
    browser.find_element("id", "search").send_keys("lights")
    assert [line.get_attribute("data-name") for line in all_of(browser, "#list a")] == ["town.3", "other.1"]
    Select(browser.find_element("id", "map")).select_by_visible_text("other")
    assert [mark.get_attribute("data-name") for mark in all_of(browser, "#marks a")] == ["other.1"]


def test_a_phone_scrolls_in_one_direction_only(opened: Callable[..., Chrome]) -> None:
    browser = opened("#town.2", width=500)  # the narrowest window that a headless browser has
    wide, inner = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    assert wide <= inner
    view, aside = (browser.find_element("css selector", part).rect for part in ("#view", "aside"))
    assert aside["y"] > view["y"] + view["height"], "the list is below the map"
