"""A replay page works in a browser: zoom, pan, follow, an earlier run, what stands beside it, an impact; also on a phone."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.report.animated import animated
from pytest_rvads.report.failures import Beside
from pytest_rvads.runs.run import Collision, Run
from pytest_rvads.satellites.pages.replay import replay
from pytest_rvads.scenarios.scenario import Scenario

from ..run_builders import gliding

Chrome = Any  # of selenium.webdriver, which not everybody has
Open = Callable[..., Chrome]
HARM = "</script><img src=x onerror='window.owned = 1'>"
IMPACT = 3.5


def driven(speed: float) -> Run:
    """Return a run of 4 s in which a0 drives at some speed and the others at 6 m/s, from 10 m before the junction."""
    run = gliding(Scenario(find("stop4"), "2222", distance=10), [speed, 6.0, 6.0, 6.0], 401, collisions=())
    return replace(run, agents=tuple(replace(agent, size=(4.6, 1.86)) for agent in run.agents))


BESIDE = Beside(
    facts=(("scenario", "stop4-class24"), ("driven by", HARM), ("rerun", f"pytest 'test_x.py::test[{HARM}]'")),
    others=(
        ("p2", "FAIL", f"p2 at t=1.00 s: {HARM}"),
        ("p3", "PROVOKED", "p3 at t=2.00 s: a1 went first"),
        ("p4", "PASS", "p4 PASS: kept in 3 of 3 instances"),
        ("p5", "NA", "p5 NA: no lights here"),
        ("p6", "NA", "p6 NA: no lights here"),
    ),
    back="up/index.html",
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = driven(5.0)
    beside = replace(BESIDE, ghost=driven(4.0), ghost_name=f"main{HARM}.json")
    made = {
        "page": replay(run, "p1 at t=2.50 s", "notes", [(2.5, "p1 is violated")], responsible={"a0"}, beside=beside),
        "bare": replay(run, "p1 at t=2.50 s"),
        "same": replay(run, "same", beside=Beside(ghost=driven(5.0), ghost_name="main.json")),
        "script": replay(run, "back", beside=Beside(back="javascript:window.owned=1")),
        "impact": replay(replace(run, collisions=(Collision(IMPACT, ("a0", "a2"), 11.0),)), "crash"),
        "touch": replay(replace(run, collisions=None, pose=np.repeat(run.need("pose")[:, :1], 4, axis=1)), "touch"),
    }
    folder = tmp_path_factory.mktemp("replays")
    for name, text in made.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    (folder / "frame.html").write_text('<iframe src="page.html#t=2.5" width="700" height="520"></iframe>', encoding="utf-8")
    moving = animated(run, title=f"t = 2.50 s {HARM}", responsible={"a0"}, around=2.5)
    (folder / "moving.svg").write_text(moving, encoding="utf-8")
    (folder / "image.html").write_text('<img src="moving.svg">', encoding="utf-8")
    return folder


@pytest.fixture
def opened(browser: Chrome, pages: Path) -> Iterator[Open]:
    def shown(name: str = "page", fragment: str = "#t=2.5", wide: int = 1280, high: int = 800, ending: str = "html") -> Chrome:
        size = {"width": wide, "height": high, "deviceScaleFactor": 1, "mobile": wide < 600}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": wide < 600})
        browser.get("about:blank")
        browser.get(f"file://{pages}/{name}.{ending}{fragment}")
        return browser

    yield shown
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    assert browser.get_log("browser") == []


def one(browser: Chrome, selector: str) -> Any:
    return browser.find_element("css selector", selector)


def every(browser: Chrome, selector: str) -> list[Any]:
    return list(browser.find_elements("css selector", selector))


def box(browser: Chrome, selector: str) -> list[float]:
    """Return the middle of an element on the screen, and its width and height [px]."""
    script = """const box = document.querySelector(arguments[0]).getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2, box.width, box.height]"""
    return list(browser.execute_script(script, selector))


def car(browser: Chrome, name: str) -> list[float]:
    return box(browser, f'.vehicle[data-agent="{name}"] rect')


def long(browser: Chrome) -> float:
    """Return how long a car is drawn [px]."""
    return max(car(browser, "a0")[2:])


def press(browser: Chrome, keys: str) -> None:
    one(browser, "body").send_keys(keys)


def go(browser: Chrome, time: float) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    browser.execute_script("location.hash = `#t=${arguments[0]}`", time)
    WebDriverWait(browser, 10, poll_frequency=0.05).until(lambda _: one(browser, "#clock").text == f"{time:.2f} s")


def test_buttons_keys_and_the_wheel_zoom(opened: Open) -> None:
    browser = opened()
    first = long(browser)
    one(browser, "#closer").click()
    assert long(browser) == pytest.approx(1.4 * first, rel=0.02)
    one(browser, "#farther").click()
    assert long(browser) == pytest.approx(first, rel=0.02)
    press(browser, "+")
    press(browser, "+")
    assert long(browser) == pytest.approx(1.96 * first, rel=0.02)
    press(browser, "-0")
    assert long(browser) == pytest.approx(first, rel=0.02)
    x, y, *_ = car(browser, "a1")
    for turns in (-100, -100, 100):
        wheel = {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": turns}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", wheel)
    assert long(browser) == pytest.approx(np.exp(0.3) * first, rel=0.02)
    assert car(browser, "a1")[:2] == pytest.approx([x, y], abs=1.5), "what is under the pointer stays there"
    assert browser.execute_script("return scrollY") == 0


def test_zoom_has_limits(opened: Open) -> None:
    browser = opened()
    press(browser, "+" * 40)
    assert long(browser) < box(browser, "#stage")[2], "a car fits"
    press(browser, "-" * 60)
    assert long(browser) > 3, "a car is still to be seen"


def drag(browser: Chrome, begin: list[float], by: tuple[float, float]) -> None:
    x, y = begin
    moves = [("mousePressed", 0.0), ("mouseMoved", 0.5), ("mouseMoved", 1.0), ("mouseReleased", 1.0)]
    for kind, share in moves:
        place = {"x": x + share * by[0], "y": y + share * by[1]}
        held = {"button": "left", "buttons": int(kind != "mouseReleased"), "clickCount": 1}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": kind, **place, **held})


def test_dragging_moves_the_view_and_follows_nobody(opened: Open) -> None:
    browser = opened()
    before, on_car = car(browser, "a1"), car(browser, "a0")[:2]
    drag(browser, on_car, (60, -40))
    assert car(browser, "a1") == pytest.approx([before[0] + 60, before[1] - 40, *before[2:]], abs=1)
    assert not every(browser, ".followed")
    one(browser, "#home").click()
    assert car(browser, "a1") == pytest.approx(before, abs=0.5)


def test_a_page_opens_at_the_violation_and_fit_shows_all_vehicles(opened: Open) -> None:
    browser = opened("page", "")
    assert one(browser, "#clock").text == "2.50 s"
    go(browser, 0.0)
    press(browser, "+++")
    one(browser, "#home").click()
    x, y, wide, high = box(browser, "#stage")
    for name in ("a0", "a1", "a2", "a3"):
        u, v, long, broad = car(browser, name)
        assert abs(u - x) + long / 2 < wide / 2
        assert abs(v - y) + broad / 2 < high / 2


def centred(browser: Chrome, name: str) -> bool:
    return car(browser, name)[:2] == pytest.approx(box(browser, "#stage")[:2], abs=2)


def test_a_vehicle_is_followed(opened: Open) -> None:
    browser = opened()
    drag(browser, car(browser, "a2")[:2], (0, 0))  # a click
    assert every(browser, ".followed")[0].get_attribute("data-agent") == "a2"
    for time in (2.5, 1.0, 3.5):
        go(browser, time)
        assert centred(browser, "a2")
    press(browser, "+")
    assert centred(browser, "a2"), "zooming keeps it there"
    a1 = one(browser, "#states tbody tr:nth-child(2) button")
    a1.click()
    assert centred(browser, "a1")
    assert [b.get_attribute("aria-pressed") for b in every(browser, "#states button")] == ["false", "true", "false", "false"]
    a1.click()
    assert not every(browser, ".followed")
    press(browser, "f")
    assert centred(browser, "a0"), "whom the page is about comes first"
    assert one(browser, "#follow").text == "following a0"
    press(browser, "f")
    assert centred(browser, "a1")
    press(browser, "0")
    assert not every(browser, ".followed")


def test_an_earlier_run_is_shown_where_it_differs_and_can_be_switched_off(opened: Open) -> None:
    browser = opened()

    def shown() -> list[bool]:
        script = """return [...document.querySelectorAll('.ghost')].map(one => getComputedStyle(one))
            .map(style => style.display !== 'none' && style.visibility !== 'hidden')"""
        return list(browser.execute_script(script))

    assert shown() == [True, False, False, False], "only a0 drives otherwise"
    scale = long(browser) / 4.6
    apart = np.hypot(*np.subtract(box(browser, ".ghost rect")[:2], car(browser, "a0")[:2]))
    assert apart == pytest.approx(2.5 * scale, rel=0.05), "2.5 s at 5 m/s instead of 4"
    ghost = one(browser, "#ghost")
    assert ghost.text == f"earlier run: main{HARM}.json"
    ghost.click()
    assert not any(shown())
    press(browser, "g")
    assert shown()[0]
    said = one(browser, "#parted")
    assert "part at t = 0.00 s: speed of a0 is 5 here, 4 there" in said.text
    said.find_element("xpath", "button[contains(., 'apart')]").click()
    # It is 0.1 m ahead after 0.1 s, more than that in the state after.
    assert one(browser, "#clock").text == "0.11 s"


def test_earlier_run_with_equal_states_is_called_the_same(opened: Open) -> None:
    browser = opened("same")
    assert "are the same, state for state" in one(browser, "#parted").text
    assert not [ghost for ghost in every(browser, ".ghost") if ghost.is_displayed()]
    bare = opened("bare")
    assert not any(one(bare, f"#{name}").is_displayed() for name in ("ghost", "parted", "about", "verdicts", "back", "impact"))


def test_facts_and_other_verdicts_stand_beside_it_as_text(opened: Open) -> None:
    browser = opened()
    assert [e.text for e in every(browser, "#facts dt")] == ["scenario", "driven by", "rerun"]
    assert [e.text for e in every(browser, "#facts dd > :first-child")] == [text for _, text in BESIDE.facts]
    badges = [(b.text, b.get_attribute("class")) for b in every(browser, "#others .badge")]
    assert badges == [
        ("\u2717 FAIL", "badge bad"),
        ("! PROVOKED", "badge doubt"),
        ("\u2713 PASS", "badge good"),
        ("\u2013 NA", "badge none"),
    ]
    assert "p4: kept in 3 of 3 instances" in one(browser, "#others").text
    one(browser, "#others summary").click()
    assert [p.text for p in every(browser, "#others p")] == ["p5 NA: no lights here", "p6 NA: no lights here"]
    assert browser.execute_script("return window.owned === undefined && !document.querySelector('img')")


def test_the_line_to_run_it_again_is_copied(opened: Open) -> None:
    browser = opened()
    one(browser, "#copy").click()
    assert one(browser, "#copy").text in ("copied", "selected")
    assert browser.execute_script("return getSelection().toString()") == BESIDE.facts[-1][1]


def test_a_link_leads_back_and_runs_nothing(opened: Open, pages: Path) -> None:
    back = one(opened(), "#back")
    assert back.is_displayed()
    assert back.get_attribute("href") == f"file://{pages}/up/index.html"
    browser = opened("script")
    assert not one(browser, "#back").is_displayed()
    browser.execute_script("document.getElementById('back').click()")
    assert browser.execute_script("return window.owned === undefined")
    browser.get_log("browser")  # the policy says that it refused


def test_page_says_after_an_impact_that_no_vehicle_is_driven(opened: Open) -> None:
    browser = opened("impact", "#t=3.4")
    note = one(browser, "#impact")
    assert not note.is_displayed()
    go(browser, IMPACT)
    assert note.text == "impact at 3.50 s: a0, a2. What follows is no driving."
    assert not every(browser, ".after")
    go(browser, 3.6)
    assert [cell.text for cell in every(browser, ".after")] == ["5.00 m/s", "6.00 m/s"], "of the two that touched"
    strip, grey = box(browser, ".strip"), box(browser, ".strip s")
    assert grey[2] == pytest.approx(strip[2] * 0.5 / 4.0, abs=1)
    assert grey[0] + grey[2] / 2 == pytest.approx(strip[0] + strip[2] / 2, abs=1), "up to the end"


def test_touching_bodies_of_a_recording_are_a_possible_impact(opened: Open) -> None:
    browser = opened("touch", "#t=1")
    assert one(browser, "#impact").text == (
        "by their places and sizes, bodies touch at 0.00 s: a0, a1, a2, a3. What follows may be no driving of theirs."
    )
    assert not every(browser, ".after, .strip s")


def touch(browser: Chrome, kind: str, *points: tuple[float, float]) -> None:
    browser.execute_cdp_cmd(
        "Input.dispatchTouchEvent",
        {"type": kind, "touchPoints": [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]},
    )


def test_on_a_phone_the_picture_comes_first_and_two_fingers_zoom(opened: Open) -> None:
    browser = opened(wide=375, high=667)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 375
    x, y, wide, high = box(browser, "#stage")
    assert wide * high > 0.5 * 375 * 667, "most of the first screen"
    assert y + high / 2 < 667
    assert box(browser, "#clock")[0] + box(browser, "#clock")[2] / 2 <= box(browser, "#scrub")[0] - box(browser, "#scrub")[2] / 2
    first = long(browser)
    assert first > 25, "large enough to see"
    assert not one(browser, "#facts").is_displayed(), "folded"
    touch(browser, "touchStart", (x - 20, y), (x + 20, y))
    for apart in (30, 40):
        touch(browser, "touchMove", (x - apart, y), (x + apart, y))
    touch(browser, "touchEnd")
    assert long(browser) == pytest.approx(2.0 * first, rel=0.1)
    before = car(browser, "a1")
    touch(browser, "touchStart", (x, y))
    for moved in (30, 60):
        touch(browser, "touchMove", (x - moved, y - moved))
    touch(browser, "touchEnd")
    assert car(browser, "a1")[:2] == pytest.approx([before[0] - 60, before[1] - 60], abs=16)
    assert browser.execute_script("return scrollY") == 0


def test_player_fits_into_a_frame(opened: Open) -> None:
    browser = opened("frame", "")
    browser.switch_to.frame(one(browser, "iframe"))
    try:
        assert one(browser, "#clock").text == "2.50 s"
        x, y, wide, high = box(browser, "#tools")
        assert y + high / 2 <= 520
        assert x + wide / 2 <= 700
        assert box(browser, "#stage")[3] > 0.6 * 520
    finally:
        browser.switch_to.default_content()


def test_an_animated_picture_moves_holds_and_tells_when_it_happens(opened: Open) -> None:
    browser = opened("moving", "", ending="svg")

    def at(time: float) -> tuple[list[float], bool]:
        script = "document.getAnimations().forEach(one => { one.pause(); one.currentTime = 1000 * arguments[0]; })"
        browser.execute_script(script, time)
        told = [float(e.value_of_css_property("opacity")) for e in every(browser, ".told")]
        assert len(set(told)) == 1, "the text, and what points the vehicle out"
        return box(browser, '[data-agent="a0"] > rect')[:2], told[0] == 1.0

    # At 5 m/s, a0 comes to its line at 1.8 s, so the film begins at 0.8 s.
    # 1.7 s to the instant, 2 s of standing still, 1.5 s to the end.
    (start, early), (instant, told), (held, still), (end, late) = at(0.2), at(1.71), at(3.6), at(5.2)
    assert (early, told, still, late) == (False, True, True, True)
    assert held == pytest.approx(instant, abs=1.5)
    one_second = np.subtract(instant, start) / 1.5
    assert np.hypot(*one_second) > 30
    assert np.subtract(end, instant) == pytest.approx(1.5 * one_second, abs=2.0)
    assert browser.execute_script("return document.querySelector('img, script') === null && window.owned === undefined")


def test_an_animated_picture_is_shown_as_an_image(opened: Open) -> None:
    browser = opened("image", "")
    assert browser.execute_script("const one = document.querySelector('img'); return one.complete && one.naturalWidth") == 640


def test_who_asks_for_less_motion_sees_the_instant(opened: Open) -> None:
    browser = opened("moving", "", ending="svg")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]})
    try:
        assert browser.execute_script("return document.getAnimations().length") == 0
        shown = float(one(browser, ".told").value_of_css_property("opacity"))
        place = one(browser, '[data-agent="a0"]').get_attribute("transform")
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert shown == 1.0
    x, y = driven(5.0).need("pose")[250, 0, :2]
    assert place.startswith(f"translate({x:.3f} {-y:.3f})")
