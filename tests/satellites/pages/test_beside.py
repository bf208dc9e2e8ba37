"""What stands beside a replay: facts, other verdicts, an earlier run and where the two part."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check, other_verdicts
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.failures import Beside, summed
from pytest_rvads.runs.run import Collision, Excerpt, Facts, Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.satellites.pages.replay import failure_pages, replay
from pytest_rvads.scenarios.scenario import Scenario

from ...run_builders import gliding

Make = Callable[..., Run]


def driven(speed: float = 5.0, **changes: Any) -> Run:
    """Return a run of 6 s through stop4 without a stop: a0 at some speed, a2 at 5 m/s, from 10 m before the junction."""
    run = gliding(Scenario(find("stop4"), "2020", distance=10), [speed, 5.0], 601, collisions=())
    sized = replace(run, agents=tuple(replace(agent, size=(4.6, 1.86)) for agent in run.agents))
    return replace(sized, **changes)


def data(page: str) -> dict[str, Any]:
    """What the script of a page is given, which JSON has to hold: a browser reads no NaN."""
    (text,) = re.findall('<script type="application/json" id="data">(.*)</script>', page)
    found: dict[str, Any] = json.loads(text, parse_constant=pytest.fail)
    return found


def page(run: Run, rule: str | Rule = "full_stop", beside: Beside | None = None) -> dict[str, Any]:
    return data(next(failure_pages(run, check(run, "full_stop"), rule, "", beside)).html)


def test_a_page_tells_what_run_and_rule_say_of_themselves() -> None:
    told = {"autopilot": "mine.Pilot", "traffic": "reference", "simulator": "bullet"}
    run = driven(provenance=told, facts=Facts(subject="a0", speed_limit=11.176))
    rule = get_rule("full_stop")
    assert page(run, beside=Beside((("rerun", "pytest 'x'"),)))["facts"] == [
        ["scenario", run.label],
        ["driven by", "mine.Pilot, a0 alone; the others by reference"],
        ["simulated by", "bullet"],
        ["rule", f"full_stop: {rule.title}"],
        ["formula", rule.text],
        ["rerun", "pytest 'x'"],
    ]
    bare = page(driven(), "unheard_of")
    assert bare["facts"] == [["scenario", run.label], ["rule", "unheard_of"]]


def test_given_facts_replace_the_facts_of_the_run() -> None:
    run = driven(provenance={"autopilot": "mine.Pilot", "simulator": "bullet"})
    given = Beside((("driven by", "mine.Pilot 1.2"), ("map", "town.xodr"), ("simulated by", "")))
    facts = page(run, beside=given)["facts"]
    assert ["driven by", "mine.Pilot 1.2"] in facts
    assert facts[-1] == ["map", "town.xodr"]
    assert not [word for word, _ in facts if word == "simulated by"], "what says nothing is left out"


def test_other_verdicts_come_worst_first() -> None:
    run = driven(facts=Facts(speed_limit=11.176))
    found = summed(other_verdicts(run, ["no_collision", "full_stop", "red", get_rule("speed_limit"), "progress"], "progress"))
    assert [(rule, status) for rule, status, _ in found] == [
        ("full_stop", "FAIL"),
        ("no_collision", "PASS"),
        ("speed_limit", "PASS"),
        ("red", "NA"),
    ]
    assert found[0][2] == check(run, "full_stop").message


def test_rule_that_cannot_judge_the_run_is_an_error_beside_the_other_verdicts() -> None:
    found = summed(other_verdicts(driven(), ["no_collision", "unheard_of"]))
    assert [(rule, status) for rule, status, _ in found] == [("unheard_of", "ERROR"), ("no_collision", "PASS")]
    assert "unheard_of" in found[0][2]
    assert "\n" not in found[0][2]
    speeds = driven().need("speed").copy()
    speeds[7, 0] = np.nan
    broken = summed(other_verdicts(replace(driven(), speed=speeds), ["no_collision"]))
    assert [status for _, status, _ in broken] == ["ERROR"]


def test_provoked_and_unavoidable_verdicts_are_no_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts = {
        "a": Verdict("a", Status.FAIL, "a", provoked=True),
        "b": Verdict("b", Status.FAIL, "b", unavoidable=True),
        "c": Verdict("c", Status.OPEN, "c"),
    }
    monkeypatch.setattr("pytest_rvads.logic.check.check", lambda _, rule: verdicts[rule])
    assert [status for _, status, _ in summed(other_verdicts(driven(), "abc"))] == ["OPEN", "UNAVOIDABLE", "PROVOKED"]


def ghost(run: Run, earlier: Run) -> dict[str, Any]:
    found: dict[str, Any] = data(replay(run, "", beside=Beside(ghost=earlier, ghost_name="main")))["ghost"]
    return found


def test_an_earlier_run_is_where_it_was() -> None:
    earlier = driven(4.0)
    held = ghost(driven(), earlier)
    assert held["agents"] == ["a0", "a2"]
    assert np.array(held["motion"])[:, :, :2] == pytest.approx(earlier.need("pose")[::5, :, :2], abs=6e-4)
    assert held["said"] == "This run and main part at t = 0.00 s: speed of a0 is 5 here, 4 there."
    assert [time for time, _ in held["times"]] == [0.0, 0.11], "1 m/s slower, so more than 0.1 m behind after 0.1 s"


def test_numbers_are_told_with_as_many_digits_as_tell_them_apart() -> None:
    run = driven()
    close = replace(run, speed=run.need("speed") + 1e-6)
    held = ghost(run, close)
    assert "speed of a0 is 5 here, 5.000001 there" in held["said"]
    assert len(held["times"]) == 1, "nothing of that is to be seen"


def test_ghost_names_differences_outside_of_the_states() -> None:
    other = replace(driven(), facts=Facts(speed_limit=9.0))
    assert ghost(driven(), other)["said"].startswith("This run and main differ in facts: ")
    assert ghost(driven(), driven())["said"] == "This run and main are the same, state for state."
    assert ghost(driven(), driven(dt=0.02))["times"] == []


def test_an_earlier_run_without_positions_is_told_but_not_drawn() -> None:
    html = replay(driven(), "", beside=Beside(ghost=driven(pose=None), ghost_name="main"))
    assert 'class="ghost"' not in html
    held = data(html)["ghost"]
    assert held["said"].endswith("Positions of main are not recorded, so it is not shown.")
    assert held["motion"] == []


def test_replay_of_recorded_traffic_has_facts_and_no_ghost() -> None:
    run = driven(excerpt=Excerpt(start=100.0))
    beside = Beside((("map", "town"),), (("p1", "PASS", "p1"),), "index.html", driven(4.0), "main")
    held = page(run, beside=beside)
    assert held["ghost"] is None
    assert (held["facts"][-1], held["others"], held["back"]) == (["map", "town"], [["p1", "PASS", "p1"]], "index.html")
    assert held["start"] == 100.0


def test_a_page_opens_at_the_violation_or_before_the_first_vehicle_enters() -> None:
    run = driven()
    first = min(np.flatnonzero(run.zone[:, column] == Zone.JUNCTION)[0] for column in range(2)) * run.dt
    assert first > 1.0
    assert data(replay(run, ""))["opened"] == pytest.approx(first - 1.0)
    assert data(replay(run, "", marked=[(2.5, "here"), (1.5, "first")]))["opened"] == 1.5
    assert data(replay(run, "", marked=[(2.5, "here")], opened=0.5))["opened"] == 0.5
    assert data(replay(replace(run, zone=np.zeros_like(run.zone)), ""))["opened"] == 0.0, "nobody enters"
    passed = Verdict("p1", Status.PASS, "kept")
    (shown,) = failure_pages(run, passed, "p1", "")
    assert shown.time == pytest.approx(first - 1.0)
    assert data(shown.html)["marked"] == []


def test_an_impact_is_on_the_page_recorded_or_not() -> None:
    known = driven(collisions=(Collision(2.0, ("a0", "a2"), 9.0), Collision(1.0, ("a0", "a2"), 9.0)))
    assert data(replay(known, ""))["impacts"] == [[100, [0, 1]], [200, [0, 1]]]
    head_on = driven().need("pose").copy()
    head_on[300:, 1] = head_on[300:, 0]
    held = data(replay(driven(pose=head_on, collisions=None), ""))
    assert held["impacts"] == [[300, [0, 1]]]
    assert "a0 and a2 touch, by their places and sizes, at 0.0 m/s" in [text for _, text, _ in held["events"]]
    sizeless = driven(collisions=None)
    sizeless = replace(sizeless, agents=tuple(replace(agent, size=None) for agent in sizeless.agents))
    assert data(replay(sizeless, ""))["impacts"] == []


def test_first_view_shows_the_junction_and_near_vehicles() -> None:
    run = driven()
    left, top, right, bottom = data(replay(run, "", marked=[(2.5, "here")], responsible={"a0"}))["home"]
    x, y = run.need("pose")[250, 0, :2]
    assert left < x < right
    assert top < -y < bottom
    assert max(right - left, bottom - top) < 60.0, "so that a car of 4.6 m is no dot"
    away = run.need("pose") + np.array([300.0, 0.0, 0.0]) * np.array([[[0.0], [1.0]]])
    assert data(replay(replace(run, pose=away), ""))["home"][2] < 60.0, "who is far is not"


def test_table_of_the_notes_scrolls_as_one_and_prose_wraps() -> None:
    html = replay(driven(), "title", "rule p1 <b>\n t [s]  a0\n  1.00  x\nrerun pytest")
    block = html[html.index("<pre>") : html.index("</pre>")]
    assert block == '<pre>rule p1 &lt;b&gt;\n<span class="table" tabindex="0"> t [s]  a0\n  1.00  x</span>\nrerun pytest'
