"""Consistency of rules, against simulation, against judged witnesses, and against what can be worked out by hand."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.scenarios.classes import classes, members
from pytest_rvads.search import consistency
from pytest_rvads.search.abstraction import Model, weak_orders
from pytest_rvads.search.consistency import core, decide, survey
from pytest_rvads.support.errors import FormulaError

PAPER = rules_for("paper")


def model(junction: str, directions: str | Sequence[int], arrivals: Sequence[float]) -> Model:
    scenario = rvads.Scenario(rvads.find(junction), directions)
    return Model(scenario.place, scenario.agents(), arrivals)


def drawn(model: Model, configurations: Sequence[int]) -> Run:
    """Return the run with these configurations as its states."""
    zone, lights = model.run.zone[list(configurations)], model.run.lights[list(configurations)]
    return Run("witness", model.junction, model.agents, zone, lights)


def test_orders_of_arrival_are_the_ordered_bell_numbers() -> None:
    assert [len(list(weak_orders(n))) for n in range(1, 6)] == [1, 3, 13, 75, 541]
    assert set(weak_orders(2)) == {(0, 0), (0, 1), (1, 0)}


@pytest.mark.parametrize("directions", ["1111", "1133", "2222", "3333"])
def test_four_vehicles_that_arrive_together_can_not_obey_p2(directions: str) -> None:
    """Right-of is a 4-cycle: whoever enters first has somebody to the right."""
    four = model("stop4", directions, (0, 0, 0, 0))
    assert not decide(four, PAPER).possible
    assert [rule.name for rule in core(four, PAPER)] == ["p2"]


def test_three_vehicles_that_arrive_together_can_obey_p2() -> None:
    assert decide(model("stop4", "1133", (0, 0, 0, 60)), PAPER).possible
    assert decide(model("stop4", "1130", (0, 0, 0)), PAPER).possible


@pytest.mark.parametrize(("junction", "rules"), [("stop4", "paper"), ("light4", "paper")])
def test_witness_obeys_the_rules_as_judged_by_the_monitors(junction: str, rules: str) -> None:
    """The search and `check` treat the end of a run by different automata, and must agree."""
    rules_checked = rules_for(rules, rvads.find(junction).control)
    for code, ranks in [
        ((1, 1, 3, 3), (0, 0, 1, 1)),
        ((3, 1, 3, 2), (2, 0, 1, 0)),
        ((2, 3, 2, 3), (0, 1, 2, 3)),
        ((1, 2, 1, 2), (0, 1, 0, 2)),
    ]:
        abstraction = model(junction, code, [60.0 * rank for rank in ranks])
        answer = decide(abstraction, rules_checked)
        assert answer.possible
        run = drawn(abstraction, answer.witness)
        assert (run.zone[-1] == rvads.Zone.EXIT).all()
        statuses = {rule.name: rvads.check(run, rule).status for rule in rules_checked}
        assert set(statuses.values()) <= {rvads.Status.PASS, rvads.Status.NA}, statuses


def arrivals(run: Run) -> tuple[float, ...]:
    """When each vehicle of a run is first at its entrance [s]."""
    return tuple(float(np.argmax(run.zone[:, k] == rvads.Zone.ENTRANCE)) * DT for k in range(len(run.agents)))


def agrees(run: Run, rules: Sequence[Rule]) -> bool:
    """Whether the run is no counterexample to what is said about its scenario and order of arrival."""
    obeyed = (run.zone[-1] >= rvads.Zone.EXIT).all() and all(
        rvads.check(run, rule).status in (rvads.Status.PASS, rvads.Status.NA) for rule in rules
    )
    return decide(Model(run.junction, run.agents, arrivals(run)), rules).possible or not obeyed


@pytest.mark.extended
@pytest.mark.parametrize("autopilot", [rvads.Reference, rvads.LgsvlLike], ids=["reference", "lgsvl"])
def test_simulation_agrees_with_contradictions(autopilot: Any) -> None:
    rules = rules_for("paper", rvads.find("stop4").control)
    for code in ((1, 1, 3, 3), (2, 2, 2, 2)):
        run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), code, distance=20), autopilot))
        assert len(set(arrivals(run))) == 1
        assert not decide(Model(run.junction, run.agents, arrivals(run)), rules).possible
        assert rvads.check(run, "p2").status in (rvads.Status.FAIL, rvads.Status.OPEN)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", [rvads.Reference, rvads.LgsvlLike], ids=["reference", "lgsvl"])
def test_simulation_agrees_on_every_class(autopilot: Any) -> None:
    """No run of any class, with four orders of arrival, obeys where nobody can; the impossible ones are among them."""
    impossible = 0
    for junction, code in product(("stop4", "light4"), classes(4)):
        rules = rules_for("paper", rvads.find(junction).control)
        for distance in (20, (0.3, 0.3, 20, 20), (2, 4, 6, 8), (20, 10, 20, 10)):
            run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find(junction), code, distance=distance), autopilot))
            assert agrees(run, rules)
            impossible += not decide(Model(run.junction, run.agents, arrivals(run)), rules).possible
    assert impossible >= 24


@pytest.mark.slow
def test_all_scenarios_and_orders_of_an_x() -> None:
    """The cycle of p2 is the only contradiction among 6075 pairs at each kind of junction."""
    result = survey(rvads.find("stop4"), PAPER)
    assert (result.scenarios, result.orders) == (81, 75)
    assert {(c.arrivals, c.rules) for c in result.contradictions} == {((0.0, 0.0, 0.0, 0.0), ("p2",))}
    assert len(result.contradictions) == 81
    assert survey(rvads.find("light4"), PAPER).contradictions == ()


def test_rulebook_is_decided() -> None:
    """The abstraction does not determine many conditions of the rules, and a condition with a single sign needs no trial."""
    road = rules_for("road", rvads.find("stop4").control)
    assert not decide(model("stop4", (2, 2, 2, 2), (0, 0, 0, 0)), road).possible
    assert decide(model("stop4", (2, 2, 2, 2), (0, 0, 0, 60)), road).possible


def test_settled_predicates_change_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    suits = [get_rule(name) for name in ("full_stop", "right_first", "first_come", "keep_lane", "speed_limit")]
    never = Rule("never", "forall a. G !stopped(a)")
    cases = [
        (model("stop4", code, times), [*suits, *more])
        for code, times in (((0, 2, 0, 2), (0, 0)), ((0, 2, 3, 0), (0, 60)), ((1, 2, 3, 0), (0, 0, 0)))
        for more in ([], [never])
    ]
    settled = [decide(*case).possible for case in cases]
    assert settled == [True, False] * 3
    monkeypatch.setattr(consistency, "_values_that_suit_every_rule", lambda watched: {})
    assert [decide(*case).possible for case in cases] == settled


@pytest.mark.extended
def test_members_of_a_class_have_the_same_answer() -> None:
    """The survey decides a member per rotation, and deciding each member separately gives the same answers."""
    rules = [get_rule("p2"), Rule("left", get_rule("p2").text.replace("(N a'@j.en') U a@j", "(N a@j.en) U a'@j"))]
    result = survey(rvads.find("stop4"), rules, scenarios=members((1, 1, 2, 3)))
    contradicting = {(c.directions, c.arrivals) for c in result.contradictions}
    for code in members((1, 1, 2, 3)):
        for ranks in list(weak_orders(4))[::5]:
            times = tuple(60.0 * rank for rank in ranks)
            assert decide(model("stop4", code, times), rules).possible is ((code, times) not in contradicting)


def test_contradictory_rules_of_any_words_are_found() -> None:
    abstraction = model("stop4", "2200", (0.0, 60.0))
    stay = Rule("stay", "forall a. G !a@j")
    assert not decide(abstraction, [stay]).possible
    halt = Rule("halt", "forall a, j.en. G(a@j.en -> F stopped(a))")
    never = Rule("never", "forall a. G !stopped(a)")
    assert decide(abstraction, [halt]).possible
    assert decide(abstraction, [never]).possible
    assert [rule.name for rule in core(abstraction, [halt, get_rule("p1"), never])] == ["halt", "never"]


def test_run_may_begin_before_or_at_the_entrance() -> None:
    abstraction = model("stop4", "2000", (0.0,))
    at_entrance = "exists j.en. exists a. (a@j.en U a@j)"
    assert decide(abstraction, [Rule("there", at_entrance)]).possible
    assert decide(abstraction, [Rule("elsewhere", f"!({at_entrance})")]).possible
    assert not decide(abstraction, [Rule("there", at_entrance), Rule("elsewhere", f"!({at_entrance})")]).possible


def test_too_many_unknown_conditions_are_refused() -> None:
    text = " ^ ".join(f"a.sp > {k}" for k in range(12))
    with pytest.raises(FormulaError, match="are linked"):
        decide(model("stop4", "2000", (0.0,)), [Rule("much", f"forall a. G({text})")])


def test_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["rules", "check", "--scenario", "1133", "--control", "stop", "--arrivals", "0,0,0,0"]) == 1
    out, _ = capsys.readouterr()
    assert "in 1 of 1 no behaviour obeys" in out
    assert "p2" in out
    assert main(["rules", "check", "--scenario", "1130", "--control", "stop"]) == 0
    assert "nothing contradicts itself" in capsys.readouterr().out
    file = tmp_path / "mine.rules"
    file.write_text("[waits]\ntext = forall a. G !a@j\n", encoding="utf-8")
    assert main(["rules", "check", "--rules", str(file), "--scenario", "122", "--ways", "3"]) == 1
    assert "waits" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--arrivals", "0,0"], "one time per entrance (4), got 2"),
        (["--arrivals", "soon"], "--arrivals takes times in seconds"),
        (["--scenario", "111"], "names 3 entrances, expected 4"),
        (["--rules", "p9"], "unknown rule 'p9'"),
    ],
)
def test_command_line_misused(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "check", "--control", "stop", *arguments]) == 2
    out, err = capsys.readouterr()
    assert says in err
    assert not out


def test_stopping_vehicle_is_present_at_the_next_arrival() -> None:
    """Four that come within half a second: only who could get in before the others came would not have to wait for anybody."""
    place, agents = rvads.find("stop4"), rvads.Scenario(rvads.find("stop4"), "2222").agents()
    rules = rules_for("road", place.control)
    arrivals = (0.0, 0.3, 0.3, 0.3)
    assert decide(Model(place, agents, arrivals), rules).possible
    assert not decide(Model(place, agents, arrivals, stop=0.5), rules).possible
    assert decide(Model(place, agents, (0.0, 0.6, 0.6, 0.6), stop=0.5), rules).possible
