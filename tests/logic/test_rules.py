"""Rules by name, rules and predicates of users, files of rules."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.judging.instances import domain, ground, prepare, simplify, unfold
from pytest_rvads.logic.judging.judge import Values
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.book import get_rule, load_rules, predicate, rule, rulebook, rules_for
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.rule import Rule, parse
from pytest_rvads.logic.rules.vocabulary import Sort, Vocabulary, Word
from pytest_rvads.runs.run import Facts, Fault, Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import FormulaError

Make = Callable[..., Run]
RESERVED = ("G", "F", "N", "X", "U", "W", "R", "true", "false")
"""What formulas read as an operator or a constant."""


def test_rulebooks_hold_the_rules_of_the_plan() -> None:
    assert [r.name for r in rulebook("paper")] == ["p1", "p2", "p3", "p4", "p5", "p6"]
    assert {r.name for r in rulebook("road")} >= {
        *("full_stop", "first_come", "right_first", "red", "right_on_red", "left_yields"),
        *("yield_sign", "priority", "right_before_left", "merge", "on_lane_allowed"),
        *("no_collision", "no_conflict", "keep_clear", "progress", "keep_lane", "on_route", "speed_limit"),
    }
    assert {r.tie for r in rulebook("paper")} == {0.0}
    assert {r.name: r.tie for r in rulebook("road") if r.tie} == {"first_come": 0.5, "right_first": 0.5}
    for name in ("paper", "road", "variants"):
        for r in rulebook(name):
            assert r.title
            assert r.meaning.endswith(".")
            assert r.source
            assert r.responsible
            assert r.bound


def test_a_specification_is_a_rulebook_a_rule_or_a_mixture() -> None:
    def names(*args: object) -> list[str]:
        return [r.name for r in rules_for(*args)]  # type: ignore[arg-type]

    assert names("paper", JunctionControl.STOP) == ["p1", "p2", "p3"]
    assert names("paper", JunctionControl.LIGHTS) == ["p4", "p5", "p6"]
    assert names("paper", JunctionControl.NONE) == []
    assert names("road", JunctionControl.LIGHTS)[:3] == ["red", "right_on_red", "left_yields"]
    assert names("p4", JunctionControl.STOP) == ["p4"], "named outright, it always runs"
    assert names(["p3", "paper", "p3"], JunctionControl.STOP) == ["p3", "p1", "p2"]
    assert names((get_rule("p6g"), "p1")) == ["p6g", "p1"]
    assert names(["paper", "road"]) == [*names("paper"), *names("road")]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: get_rule("p7"), "unknown rule 'p7', there are p1, p2, "),
        (lambda: get_rule("no_colision"), "did you mean 'no_collision'"),
        (lambda: rulebook("papers"), "unknown rulebook 'papers', there are paper, road, variants; did you mean 'paper'"),
        (lambda: rule("p1", "forall a. G a@j"), "'p1' is a shipped rule or rulebook"),
        (lambda: rule("road", "forall a. G a@j"), "'road' is a shipped rule or rulebook"),
        (lambda: rule("a b", "forall a. G a@j"), "the name of a rule goes into test ids"),
        (lambda: rule("mine", "forall a. G a@"), "rule 'mine': unexpected the end"),
        (lambda: rule("mine", "forall a. G a@j", about="stopp"), "must be one of .*; did you mean 'stop'"),
        (lambda: rule("mine", "forall a. G a@j", tie=float("nan")), "the tie window must be a number of seconds"),
        (lambda: rule("mine", "forall a. G a@j", tie="soon"), "from 0 to 3,600, got 'soon'"),  # type: ignore[arg-type]
        (lambda: rule("m" * 101, "forall a. G a@j"), "at most 100 of them, got 'mmm"),
        (lambda: predicate("take", "agent"), r"'take' is a shipped word, not to be changed at .*test_rules.py:\d+: choose"),
        (lambda: predicate("x y", "agent"), "free identifier as its name, got 'x y'"),
        *((lambda name=name: predicate(name, "agent"), f"free identifier as its name, got '{name}'") for name in RESERVED),
        (lambda: predicate("close", "agnet"), "unknown sort 'agnet'; did you mean 'agent'"),
        (lambda: Word("G", ("agent",)), "a predicate needs a free identifier as its name, got 'G'"),
        (lambda: Word("a b", ("agent",)), "free identifier as its name, got 'a b'"),
        (lambda: Word("close", ("agnet",)), "predicate 'close': unknown sort 'agnet'"),
        (lambda: Word("close", ("agent",), says="{1} is close"), "words name its 1 arguments by number"),
    ],
)
def test_wrong_use_is_told(call: Callable[[], object], message: str) -> None:
    with pytest.raises(FormulaError, match=message):
        call()


@pytest.mark.parametrize(
    ("text", "momentary"),
    [
        ("forall a. a@j", "a@j"),
        ("exists a. F a@j & !stopped(a)", "stopped(a)"),
        ("forall a, j.en. a@j.en -> F a@j", "a@j.en"),
        ("forall lt. lt.cl = red", "lt.cl = red"),
        ("forall a. turn(a, right) & a.wt < 3", "a.wt < 3"),
        ("forall a. G(a@j -> F !a@j)", None),
        ("forall a, j.en. turn(a, right) -> F a@j.en", None),
        ("forall j.en, lt. lt@j.en -> G lt.cl = red", None),
        ("exists a, a'. a != a' & F a@j", None),
        ("forall j.en. (exists j.en'. j.en right-of j.en') | (exists a. a@j U a@j.en)", None),
    ],
)
def test_only_what_never_changes_stands_outside_every_temporal_operator(text: str, momentary: str | None) -> None:
    if momentary is None:
        assert Rule("x", text).text == text
        return
    with pytest.raises(FormulaError) as caught:
        Rule("x", text)
    assert f"rule 'x' asks for {momentary} in the first state only" in str(caught.value)


def test_no_rule_takes_the_place_of_another_of_its_name() -> None:
    mine = Rule("p1", "forall a. F a@j", "all get in")
    with pytest.raises(
        FormulaError, match="'p1' is a shipped rule and <Rule p1: all get in> says something else: choose another"
    ):
        rules_for(["paper", mine])
    with pytest.raises(FormulaError, match="'p1' is a shipped rule"):
        rules_for(mine)
    one = Rule("mine", "forall a. F a@j")
    two = Rule("mine", "forall a. G a@j")
    where = [re.escape(f"{__file__}:{rule.place.rpartition(':')[2]}") for rule in (one, two)]
    assert int(two.place.rpartition(":")[2]) == int(one.place.rpartition(":")[2]) + 1
    with pytest.raises(FormulaError, match=f"two different rules are called 'mine', at {where[0]} and at {where[1]}: choose"):
        rules_for([one, two])
    assert rules_for([one, one, get_rule("p1"), "paper"])[:2] == (one, get_rule("p1"))
    assert repr(one) == "<Rule mine: forall a. F a@j>"
    assert repr(BUILT_IN["stopped"]) == "<Word stopped>"
    assert repr(Vocabulary.of(BUILT_IN["stopped"], BUILT_IN["take"])) == "<Vocabulary of 2 words>"


def test_the_verdict_of_a_rulebook_is_the_worst_of_its_rules(make: Make) -> None:
    together = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 150, 300)}, 400)
    verdict = check(together, "paper")
    assert (verdict.rule, verdict.status) == ("p1", "FAIL")
    assert verdict.message.startswith("paper: 1 pass, 1 fail, 4 NA; p1 at t=1.50 s")
    assert not verdict


def test_a_rule_of_ones_own(make: Make) -> None:
    made = rule("gets_in", "forall a, j.en. G(a@j.en -> F a@j)", title="nobody waits forever", requirement="REQ-7")
    assert get_rule("gets_in") is made
    assert rule("plain", made.text) == Rule("plain", made.text)
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300)
    verdict = check(run, "gets_in")
    assert (verdict.status, verdict.responsible) == ("OPEN", ("a1",))
    assert verdict.record()["requirement"] == "REQ-7"
    assert "traces to REQ-7" in verdict.explanation
    assert "still owed: eventually a1 is in the junction, since t=0.20 s" in verdict.message
    assert check(make("stop4", {0: (2, 10, 50, 200)}, 300), made).status == "PASS"
    assert check(make("stop4", {0: (2, None, None, None)}, 300), made).status == "NA"
    assert rules_for("gets_in") == (made,)


def test_titles_and_requirements_steer_no_terminal(make: Make) -> None:
    hostile = "\x1b[2Jred\n::error::boom\u202e"
    mine = rule("mine", "forall a. G !(a@j & stopped(a))", title=hostile, requirement=hostile)
    told = check(make("stop4", {0: (2, 10, 50, 200)}, 300), mine).explanation
    for text in (told.replace("\n", ""), repr(mine)):
        assert text.isprintable()
        assert "\\x1b[2Jred ::error::boom\\u202e" in text


def test_rules_of_other_shapes_are_never_vacuous(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300)
    some = Rule("some", "exists a. F a@j")
    every = Rule("every", "forall a. F a@j")
    static = Rule("static", "forall j.en, j.en'. j.en right-of j.en' -> !(j.en opposite j.en')")
    assert check(run, some).status == "PASS"
    assert check(run, every).status == "OPEN"
    assert check(run, every).responsible == ("a1",)
    assert check(run, static).status == "PASS"
    assert check(run, Rule("none", "forall a. F (a@j & turn(a, left))")).status == "FAIL", "nobody turns left, ever"
    assert check(run, Rule("roads", "forall a. F (exists r. a@r)")).status == "PASS", "everybody starts on a road"
    objects = Rule("objects", "forall j.en. exists o. o@j.en")
    assert check(run, objects).status == "PASS", "a stop sign at every entrance"


def test_the_trigger_is_the_first_state_whose_obligation_is_not_met(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 300)

    def instance(text: str) -> tuple[object, ...]:
        worst = check(run, Rule("x", text)).instances[0]
        return worst.status, worst.trigger, worst.failed, worst.broken

    assert instance("forall a. G !a@j") == ("FAIL", 50, 50, ("a0 is in the junction",))
    assert instance("forall a. G(a@j -> F !a@j)") == ("PASS", 50, None, ())
    assert instance("forall a. G F a@j") == ("OPEN", 200, None, ())
    assert instance("forall a. F a.wt > 2") == ("OPEN", 0, None, ())
    assert instance("forall a. (!a@j) U a.wt > 2") == ("FAIL", 0, 50, ("a0 is in the junction",))
    # Either of two atoms would have saved it, and neither changed in that state: both are named.
    assert instance("forall a, j.en. N(a@j | a@j.en)") == ("FAIL", 0, 1, ("a0 is not in the junction", "a0 is not at entrance 0"))
    # In the first state everything is new: nothing went before it, least of all the last one.
    within = check(make("stop4", {0: (2, 10, 50, None)}, 100), Rule("x", "forall a, j.en. G(a@j | a@j.en)")).instances[0]
    assert (within.failed, within.broken) == (0, ("a0 is not in the junction", "a0 is not at entrance 0"))
    # It has to be in the junction two states after it arrived: only the state in between tells that from other states.
    assert instance("forall a, j.en. G(a@j.en & a.wt <= 0.01 -> N N a@j)") == ("FAIL", 10, 12, ("a0 is not in the junction",))


def test_places_and_colours(make: Make) -> None:
    lights = {0: [(0, Colour.GREEN), (100, Colour.YELLOW)], 1: [(0, Colour.RED)], 2: [(0, Colour.GREEN)], 3: [(0, Colour.RED)]}
    run = make("light4", {0: (2, 10, 50, 200)}, 300, lights)

    def holds(text: str) -> str:
        return str(check(run, Rule("x", text)).status)

    assert holds("forall a, j.ex. F a@j.ex -> N N N !a@j") == "PASS"
    assert holds("exists a, j.ex. F a@j.ex") == "PASS"
    assert holds("exists a, j.ex. a@j U a@j.ex") == "FAIL"
    assert holds("exists lt. F lt.cl = yellow") == "PASS"
    assert holds("forall lt. lt.cl != yellow W lt.cl = yellow") == "PASS"
    assert holds("exists lt, lt'. lt != lt' & G lt.cl = lt'.cl") == "PASS"
    assert holds("forall lt, lt'. F lt.cl != lt'.cl") == "FAIL"
    assert holds("exists a. F a.wt >= 0.4") == "PASS", "40 ticks at the entrance"
    assert holds("exists a. F a.wt > 0.4") == "OPEN"
    assert holds("forall a. exists r. F(!a@r & N a@r)") == "PASS", "it comes to its exit road"
    assert holds("forall a, r. F(!a@r & N a@r)") == "FAIL", "and to no other"
    assert holds("exists j.en, j.ex. j.en entex j.ex") == "PASS"


def test_what_is_static_folds_away(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300)
    static = extract(run)
    junction = f.Element(Sort.JUNCTION, 0, "j")
    inside = [f.Atom("@", (f.Element(Sort.AGENT, k, f"a{k}"), junction)) for k in range(2)]

    def instances(text: str) -> list[f.Formula]:
        return [i.formula for i in ground(parse(text), static).instances]

    assert instances("forall a. F a@j <-> turn(a, right)") == [f.Not(f.Eventually(inside[0])), f.Eventually(inside[1])]
    assert instances("forall a. turn(a, right) <-> F a@j") == [f.Not(f.Eventually(inside[0])), f.Eventually(inside[1])]
    assert instances("forall a. turn(a, right) -> a@j U turn(a, left)") == [f.FALSE]
    assert instances("forall a. turn(a, right) & F a@j | turn(a, left)") == [f.FALSE, f.Eventually(inside[1])]
    assert instances("forall a. turn(a, right) U a@j") == [inside[0], f.Eventually(inside[1])]
    assert instances("forall a. a@j W turn(a, left)") == [f.Always(inside[0]), f.Always(inside[1])]
    assert instances("forall a. turn(a, right) W a@j") == [inside[0]]
    assert instances("forall a. turn(a, right) W turn(a, left)") == [f.FALSE]
    assert instances("forall a. a@j R turn(a, right)") == [f.FALSE]
    assert instances("forall a. a@j U turn(a, right)") == [f.FALSE]
    assert instances("forall a. turn(a, right) R a@j") == [f.Always(inside[0]), inside[1]]
    assert instances("forall a. N turn(a, right) | N a@j") == [
        f.Next(inside[0]),
        f.Or((f.Next(f.TRUE), f.Next(inside[1]))),
    ], "N true is false in the last state of a run"
    at = [f.Atom("@", (f.Element(Sort.AGENT, k, f"a{k}"), f.Element(Sort.ENTRANCE, k, f"j.en{k}"))) for k in range(2)]
    assert instances("forall j.en. F exists a. a@j.en") == [f.Eventually(at[0]), f.Eventually(at[1]), f.FALSE, f.FALSE]
    assert instances("F exists a. turn(a, right) & a@j") == [f.Eventually(inside[1])]
    assert instances("forall j.en. F forall a. !a@j.en | turn(a, right)") == [f.Eventually(f.Not(at[0]))], "a1 turns right"
    assert instances("exists lt. G lt.cl = red") == [f.FALSE], "there is no light"
    assert instances("forall j.en. exists lt. lt@j.en -> G lt.cl = red") == [f.FALSE] * 4
    assert str(unfold(parse("exists lt. G lt.cl = red"), static)) == "false"
    assert str(unfold(parse("!(forall lt. G lt.cl = red)"), static)) == "!true"
    assert ground(parse("forall lt. G lt.cl = red"), static).instances == ()


@pytest.mark.parametrize(("word", "both_ways"), [("meet", False), ("collide", False), ("owes", True), ("obstructs", True)])
def test_relation_of_two_vehicles_has_no_instance_of_a_single_vehicle(make: Make, word: str, both_ways: bool) -> None:
    static = extract(make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300))
    one, two = (f.Element(Sort.AGENT, k, f"a{k}") for k in range(2))
    pairs = [(one, two), (two, one) if both_ways else (one, two)]
    found = ground(parse(f"forall a, a'. G !{word}(a, a')"), static)
    assert [i.formula for i in found.instances] == [f.Always(f.Not(f.Atom(word, pair))) for pair in pairs]
    assert found.collapsed == 2


def test_a_number_compared_with_itself_is_static(make: Make) -> None:
    static = extract(make("stop4", {0: (2, 10, 50, 200)}, 300))
    for sign, instances in (("=", ()), ("<=", ()), (">=", ()), ("!=", (f.FALSE,)), ("<", (f.FALSE,)), (">", (f.FALSE,))):
        found = ground(parse(f"forall a. G a.wt {sign} a.wt"), static)
        assert tuple(i.formula for i in found.instances) == instances, sign


def test_what_a_vehicle_takes_is_its_itinerary_unless_asked_otherwise(make: Make) -> None:
    static = extract(make("stop4", {0: (2, 10, 50, 200)}, 300))
    takes = parse("forall j.en, a. F take(a, j.en, straight)")
    left = [str(i.formula) for i in ground(takes, static).instances if i.formula != f.FALSE]
    assert left == ["F a0@j.en0"]
    assert simplify(unfold(takes, static), static) == ground(takes, static) == ground(takes, static, itinerary=True)
    future = [str(i.formula) for i in ground(takes, static, itinerary=False).instances if i.formula != f.FALSE]
    assert future == ["F(a0@j.en0 & a0@j.en0 U a0@j)"]


def test_equal_instances_of_a_pair_are_collapsed(make: Make) -> None:
    static = extract(make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300))
    # Six atoms, the most for which it is looked for.
    pair = "forall a, a'. G(a != a' & a@j & a'@j -> stopped(a) & stopped(a') | inside(a) & inside(a'))"
    (template,) = prepare(parse(pair), static).templates
    named = [[(name, e.name) for name, e in member.binding] for member in template.members]
    assert named == [[("a", "a0"), ("a'", "a1")], [("a", "a1"), ("a'", "a0")]]


def test_vertices_are_entrances_and_exits_and_each_agent_has_one_of_each(make: Make) -> None:
    static = extract(make("stop4", {0: (2, 10, 50, 200)}, 300))
    agent = f.Element(Sort.AGENT, 0, "a0")

    def places(text: str) -> list[str]:
        return [str(i.formula) for i in ground(parse(text), static).instances if i.formula != f.FALSE]

    assert [e.name for e in domain(Sort.VERTEX, static)] == [f"j.{kind}{i}" for kind in ("en", "ex") for i in range(4)]
    assert places("forall a, v. F a@v") == ["F a0@j.en0", "F a0@j.ex2"]
    assert places("forall a, j.ex. F a@j.ex") == ["F a0@j.ex2"]
    assert places("forall a, r. F a@r") == ["F a0@r0", "F a0@r6"], "roads in are 0 to 3, roads out 4 to 7"
    assert agent in {e for i in ground(parse("forall a. F a@j"), static).instances for _, e in i.binding}


@pytest.mark.parametrize(
    "text",
    [
        f"forall {', '.join(f'a{i}' for i in range(12))}. G !(a1@j & a11@j)",
        f"forall a. G exists {', '.join(f'a{i}' for i in range(12))}. a@j & a1@j | a3@j U a11@j",
    ],
    ids=["outer", "inner"],
)
def test_too_many_instances_are_refused_not_left_to_run(make: Make, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.logic.judging.instances.LIMIT", 5_000)
    run = make("stop4", dict.fromkeys(range(4), (2, 10, 50, 200)), 300)
    crowd = Rule("crowd", text)
    message = r"the formula, of size \d+, needs too many instances, one per choice .* \(more than 5,000 steps\): split it"
    with pytest.raises(FormulaError, match=message):
        check(run, crowd)
    with pytest.raises(FormulaError, match=message):
        unfold(crowd.formula, extract(run))


def test_decided_subformula_is_not_unfolded(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.logic.judging.instances.LIMIT", 5_000)
    run = make("stop4", dict.fromkeys(range(4), (2, 10, 50, 200)), 300)
    crowd = Rule("crowd", f"forall a. G (a@j | exists {', '.join(f'a{i}' for i in range(12))}. true)")
    assert check(run, crowd).status == "PASS"  # there is somebody, whoever else there is
    with pytest.raises(FormulaError, match="too many instances"):
        unfold(crowd.formula, extract(run))


def test_every_step_of_the_pipeline_prints(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, None, None)}, 300)
    static = extract(run)
    unfolded = unfold(parse("forall a, j.en. G(a@j.en -> F a@j)"), static)
    lines = str(unfolded).splitlines()
    assert len(lines) == 2 * 4
    assert lines[5] == "[a=a1, j.en=j.en1] G(a1@j.en1 -> F a1@j)"
    assert str(simplify(unfolded, static)).splitlines() == [
        "[a=a0, j.en=j.en0] G(a0@j.en0 -> F a0@j)",
        "[a=a1, j.en=j.en1] G(a1@j.en1 -> F a1@j)",
        "(6 more are true by what is static)",
    ]
    assert str(static).endswith("; a0: 0 -> 2 (straight), a1: 1 -> 2 (right)")
    assert "1 right-of 0" in str(static)
    assert "stop signs at [0, 1, 2, 3]" in str(static)


def test_a_predicate_of_ones_own(make: Make) -> None:
    @predicate("crowded", "junction")
    def crowded(run: Run, junction: int) -> np.ndarray:
        return (run.zone == 2).sum(axis=1) >= 2

    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, 150, 300)}, 300)
    verdict = check(run, Rule("calm", "G !crowded(j)"))
    assert (verdict.status, verdict.time) == ("FAIL", 1.5)

    @predicate("wrong", "agent")
    def wrong(run: Run, a: int) -> np.ndarray:
        return np.zeros(3)

    with pytest.raises(
        FormulaError, match=r"'wrong' must return one bool per state, shape \(300,\), got float64 of shape \(3,\)"
    ):
        check(run, Rule("bad", "forall a. G wrong(a)"))


def test_verdict_names_both_the_violation_and_the_later_fault(make: Make) -> None:
    """a0 goes before a1, on its right, which came at once; at the end something else fails."""
    run = replace(make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 150, 300)}, 400), fault=Fault(4.0, "a0", "its motor broke"))
    for subject in (None, "a0"):
        verdict = check(replace(run, facts=Facts(subject=subject)), "p2")
        assert (verdict.status, verdict.time) == ("FAIL", 0.5)
        assert verdict.notes == ("later, at 4.00 s, the run ended by a fault: its motor broke",)
    provoked = check(replace(run, facts=Facts(subject="a1")), "p2")
    assert (provoked.status, provoked.reason) == ("ERROR", "its motor broke"), "what traffic broke is nothing to fail by"
    assert check(run, "p3").status == "ERROR", "nothing was broken before"


def test_where_a_rule_that_looks_ahead_came_closest_to_being_triggered(make: Make) -> None:
    run = make("stop4", {1: (1, 20, None, None)}, 300)
    verdict = check(run, Rule("ahead", "forall a. G(a@j & N turn(a, right) -> F !a@j)"))
    assert verdict.status == "NA"
    assert (verdict.near.tick, verdict.near.missing, verdict.near.steps) == (0, ("a1 is in the junction",), 299)


def test_comparison_without_a_value_is_refused(make: Make) -> None:
    values = Values(make("stop4", {0: (2, 10, 50, 200)}, 300))
    with pytest.raises(FormulaError, match=r"a\.wt has no value as long as a is a variable"):
        values[f.Atom("<", (f.Attr(f.Var("a"), "wt"), f.Number(2.0)))]
    with pytest.raises(FormulaError, match="red has no value to compare"):
        values[f.Atom("=", (f.Attr(f.Element(Sort.AGENT, 0, "a0"), "wt"), f.Value("red")))]


def test_missing_quantity_of_a_recording_is_na(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, 150, 300)}, 300)
    for name in ("full_stop", "speed_limit", "keep_clear", "no_collision"):
        verdict = check(run, name)
        assert (verdict.status, verdict.reason.partition(":")[0]) == ("NA", "not recorded")


def test_a_file_of_rules(tmp_path: Path) -> None:
    file = tmp_path / "own.rules"
    file.write_text(
        "# rules of the house\n[house_1]\ntext = forall a, j.en.\n  G(a@j.en -> F a@j)\n"
        "title = gets in\nabout = stop\ntie = 0.2\n"
        "[house_2]\ntext = forall a. F a@j\nrequirement = R2\n"
    )
    one, two = load_rules(file)
    assert (one.name, one.title, one.about, one.tie) == ("house_1", "gets in", JunctionControl.STOP, 0.2)
    assert two.requirement == "R2"
    assert get_rule("house_2") is two


def test_a_file_may_tell_everything_about_a_rule(tmp_path: Path) -> None:
    told = {
        "text": "forall a, j.ex. G(a@j -> F a@j.ex)",
        "title": "50 % gets out",
        "meaning": "Who is in gets out.",
        "source": "the house",
        "responsible": "who is in",
        "about": "lights",
        "tie": 0.25,
        "requirement": "REQ-8",
    }
    file = tmp_path / "own.rules"
    file.write_text("; by hand\n# and by heart\n[told]\n" + "".join(f"{k} = {v}\n" for k, v in told.items()))
    (made,) = load_rules(file)
    assert {name: getattr(made, name) for name in told} == told
    file.write_text("[bare]\ntext = forall a. F a@j\n")
    (bare,) = load_rules(file)
    assert bare == Rule("bare", "forall a. F a@j")
    assert (bare.title, bare.meaning, bare.source, bare.responsible, bare.about, bare.tie) == ("", "", "", "", None, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[x]\ntitle = t\n", "rule 'x' has no text"),
        ("[x]\ntxt = forall a. F a@j\n", "unknown key 'txt'; did you mean 'text'"),
        ("[x]\ntext = forall a. F a@k\n", "rule 'x': unbound variable k"),
        ("[x]\ntext = forall a. F a@j\ntie = soon\n", "tie must be a number of seconds, got 'soon'"),
        ("[x]\ntext = forall a. F a@j\ntie = inf\n", "must be a number of seconds from 0 to 3,600, got inf"),
        ("[x]\ntext = forall a. F a@j\ntie = 1e400\n", "must be a number of seconds from 0 to 3,600, got inf"),
        ("[x]\ntext = forall a. F a@j\ntie = -1\n", "must be a number of seconds from 0 to 3,600, got -1.0"),
        ("".join(f"[r{k}]\ntext = forall a. F a@j\n" for k in range(1001)), "1,001 rules, at most 1,000 are read"),
        ("#" * (2**20 + 1), "it is too large, expected at most 1,048,576 bytes"),
        ("text = forall a. F a@j\n", "not a file of rules"),
        ("[x]\n[x]\n", "not a file of rules"),
    ],
)
def test_a_wrong_file_of_rules_is_told(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "own.rules"
    file.write_text(text)
    with pytest.raises(FormulaError, match=message) as caught:
        load_rules(file)
    assert str(file) in str(caught.value)
    with pytest.raises(FormulaError, match="can't be read"):
        load_rules(tmp_path / "absent.rules")
