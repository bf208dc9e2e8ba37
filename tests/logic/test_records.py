"""Verdicts as records, atoms as words: every key and every sentence that programs and people read, written out by hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import literal, say
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

Make = Callable[..., Run]


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_the_record_of_a_violation(make: Make, dt: float) -> None:
    # Both arrive in tick 10; a1, on the right, enters in tick 150, a0 already in tick 50.
    run = replace(make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 150, 300)}, 400), dt=dt)
    verdict = check(run, "p2")
    assert verdict.record() == {
        "rule": "p2",
        "title": "right-of-way",
        "status": "FAIL",
        "message": f"p2 at t={50 * dt:.2f} s: a0 left entrance 0 before a1 was in the junction",
        "final": True,
        "time": 50 * dt,
        "counts": {"fail": 1},
        "collapsed": 4 * 4 * 2 * 2 - 1,
        "responsible": ["a0"],
        "instances": [
            {
                "binding": [["j.en", "entrance 1"], ["j.en'", "entrance 0"], ["a", "a1"], ["a'", "a0"]],
                "status": "FAIL",
                "responsible": ["a0"],
                "trigger": 10,
                "failed": 50,
                "broken": ["a0 is not at entrance 0"],
                "margin": 100 * dt,
            },
        ],
        "violated": "a' left its entrance before a was in the junction",
        "roles": "a straight from entrance +0, a' straight from entrance +3",
        "explanation": verdict.explanation,
        "dt": dt,
        "start": 0.0,
    }
    assert verdict.cause == f"{verdict.violated} ({verdict.roles})"


def test_the_record_of_what_never_applied(make: Make) -> None:
    # Two vehicles at green: a1 at its entrance for 40 ticks, a3 for 80; all that lacks is a red light.
    lights = {e: [(0, Colour.GREEN if e % 2 else Colour.RED)] for e in range(4)}
    run = make("light4", {1: (3, 10, 50, 200), 3: (2, 10, 90, 300)}, 400, lights)
    bindings = [[["j.en", f"entrance {e}"], ["a", f"a{e}"], ["lt", f"light {e}"]] for e in (1, 3)]
    reason = "never triggered: the premise of the rule never holds on the run"
    verdict = check(run, "p4")
    assert verdict.record() == {
        "rule": "p4",
        "title": "red light",
        "status": "NA",
        "message": f"p4 NA: {reason}",
        "reason": reason,
        "counts": {"not triggered": 2},
        "collapsed": 4 * 4 * 2 - 2,
        "instances": [{"binding": binding, "status": "NA"} for binding in bindings],
        "near": {"binding": bindings[0], "tick": 10, "missing": ["light 1 is red"], "steps": 40},
        "violated": reason,
        "asked": False,
        "explanation": verdict.explanation,
        "dt": 0.01,
        "start": 0.0,
    }
    assert check(run, "p4").explanation.splitlines()[1:] == [
        f"na        {reason}",
        "instances 2 instances: 2 not triggered",
        "nearest   at 0.10 s for j.en=entrance 1, a=a1, lt=light 1; false: light 1 is red",
    ]


def test_two_in_the_junction_share_a_margin(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 150, 300)}, 400)
    (instance,) = check(run, "p1").instances
    assert instance == InstanceVerdict(
        binding=(("a", "a0"), ("a'", "a1")),
        status=Status.FAIL,
        responsible=("a1",),
        trigger=150,
        failed=150,
        broken=("a1 is in the junction",),
        margin=0.5,
    )


def test_explanation_places_a_vehicle_that_turned_back(make: Make) -> None:
    # a0 leaves its entrance backwards, which no vehicle of ours does, and a recording might.
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 10, 150, 300)}, 400)
    zone = run.zone.copy()
    zone[50:, 0] = 0
    verdict = check(replace(run, zone=zone), "p2")
    assert "broken at 0.50 s: a0 on the approach while a1 is still at entrance 1; " in verdict.explanation


def test_who_waited_longer_may_stand_on_the_left(make: Make) -> None:
    # a0 came first; a1, on its right, does not wait for it.
    run = make("stop4", {0: (2, 10, 150, 200), 1: (2, 30, 50, 300)}, 400)
    text = check(run, "p3").explanation
    assert "\nyields    a1 @ entrance 1, straight   arrived 0.30 s, waited 0.20 s\n" in text
    assert "\npriority  a0 @ entrance 0, straight   arrived 0.10 s, waited 0.41 s   entrance 1 is right of 0\n" in text


def test_waiting_vehicle_is_responsible_for_an_open_verdict(make: Make) -> None:
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, 400)
    verdict = check(run, "p2")
    assert (verdict.status, verdict.responsible, verdict.time) == ("OPEN", ("a0",), 0.1)
    assert check(make("stop4", {0: (2, 10, 50, 90)}, 400), "p3").time is None


def test_open_cause_names_roles(make: Make) -> None:
    verdict = check(make("stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, 400), "p2")
    assert verdict.cause.startswith("open: a' is at its entrance until a is in the junction (a straight from entrance +0, ")


def test_a_pass_tells_how_many_instances_were_asked(make: Make) -> None:
    # One after the other: p1 is asked of the only pair, p3 of one of the two orders.
    run = make("stop4", {0: (2, 10, 50, 100), 1: (2, 30, 150, 300)}, 400)
    assert check(run, "p1").message == "p1 PASS: kept in 1 of 1 instances"
    assert check(run, "p3").message == "p3 PASS: kept in 1 of 2 instances, the others were not triggered"


def test_explanation_tells_the_duration_of_a_triggered_violation(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 400)
    for text, told in (("G !a@j", ""), ("G(a.wt < 9 -> !a@j)", "; broken for 1.50 s of the run")):
        assert f"\nbroken at 0.50 s: a0 is in the junction{told}\n" in check(run, Rule("out", f"forall a. {text}")).explanation


def test_a_light_is_told_by_its_colour(make: Make) -> None:
    lights = {e: [(0, Colour.RED)] for e in range(4)}
    run = make("light4", {0: (2, 10, 50, 200)}, 400, lights)
    assert "a0 is in the junction while light 0 is red\n" in check(run, "p4").explanation
    same = Rule("same", "forall lt, lt'. G lt.cl = lt'.cl")
    assert check(run, same).status == "PASS"
    assert check(make("light4", {0: (2, 10, 50, 200)}, 400, {**lights, 1: [(0, Colour.GREEN)]}), same).status == "FAIL"


A, B = f.Element(Sort.AGENT, 0, "a0"), f.Element(Sort.AGENT, 1, "a1")
HERE, IN, OUT = f.Element(Sort.ENTRANCE, 2, "j.en2"), f.Element(Sort.JUNCTION, 0, "j"), f.Element(Sort.EXIT, 3, "j.ex3")
LIGHT, ROAD = f.Element(Sort.LIGHT, 2, "lt2"), f.Element(Sort.ROAD, 5, "r5")
WORDS: list[tuple[f.Atom, str, str]] = [
    (f.Atom("@", (A, HERE)), "a0 is at entrance 2", "a0 is not at entrance 2"),
    (f.Atom("@", (A, IN)), "a0 is in the junction", "a0 is not in the junction"),
    (f.Atom("@", (A, OUT)), "a0 is on exit 3", "a0 is not on exit 3"),
    (f.Atom("@", (A, ROAD)), "a0 is on road 5", "a0 is not on road 5"),
    (f.Atom("=", (f.Attr(LIGHT, "cl"), f.Value("red"))), "light 2 is red", "light 2 is not red"),
    (f.Atom("!=", (f.Attr(LIGHT, "cl"), f.Value("red"))), "light 2 is not red", "light 2 is red"),
    (
        f.Atom("=", (f.Attr(A, "wt"), f.Attr(B, "wt"))),
        "a0 and a1 arrived at the same time",
        "a0 and a1 did not arrive at the same time",
    ),
    (f.Atom("<", (f.Attr(A, "wt"), f.Attr(B, "wt"))), "a0 arrived after a1", "a0 did not arrive after a1"),
    (f.Atom("<=", (f.Attr(A, "wt"), f.Attr(B, "wt"))), "a0.wt <= a1.wt", "not a0.wt <= a1.wt"),
    (f.Atom("stopped", (A,)), "a0 has stopped at the line", "a0 has not stopped at the line"),
    (f.Atom("blocks", (A,)), "a0 blocks the junction", "a0 does not block the junction"),
    (f.Atom("speeding", (A,)), "a0 is over the speed limit", "a0 is within the speed limit"),
    (f.Atom("collide", (A, B)), "a0 and a1 collide", "a0 and a1 do not collide"),
    (f.Atom("conflict", (A, B)), "a0 and a1 are on conflicting movements", "a0 and a1 are not on conflicting movements"),
    (f.Atom("meet", (A, B)), "a0 and a1 meet where their ways cross or join", "a0 and a1 do not meet"),
    (f.Atom("owes", (A, B)), "a0 has to let a1 pass", "a0 need not let a1 pass"),
    (f.Atom("obstructs", (A, B)), "a0 gets in the way of a1", "a0 does not get in the way of a1"),
    (f.Atom("inside", (A,)), "a0 is partly in the junction", "a0 is out of the junction"),
    (f.Atom("may_go", (A,)), "a0 could go", "a0 could not go"),
    (f.Atom("idles", (A,)), "a0 could have gone and has not", "a0 has gone when it could"),
    (f.Atom("off_lane", (A,)), "a0 is outside its lane", "a0 is in its lane"),
    (f.Atom("off_route", (A,)), "a0 is off its route", "a0 is on its route"),
    (f.Atom(">=", (f.Attr(A, "sp"), f.Number(3.0))), "a0.sp >= 3", "not a0.sp >= 3"),
    (f.Atom("<", (f.Number(3.5), f.Attr(A, "wt"))), "3.5 < a0.wt", "not 3.5 < a0.wt"),
    (f.Atom("crowded", (IN,)), "crowded(the junction)", "not crowded(the junction)"),
    (f.Atom("near", (A, B)), "near(a0, a1)", "not near(a0, a1)"),
]


@pytest.mark.parametrize(("atom", "yes", "no"), WORDS, ids=[w[1] for w in WORDS])
def test_atoms_in_words(atom: f.Atom, yes: str, no: str) -> None:
    assert literal(atom, True) == say(atom) == yes
    assert literal(atom, False) == say(f.Not(atom)) == no


def test_formulas_in_words() -> None:
    here, inside, red = (WORDS[k][0] for k in (0, 1, 4))
    cases: list[tuple[Any, str]] = [
        (f.And((here, f.Not(red))), "a0 is at entrance 2 and light 2 is not red"),
        (f.Or((here, inside)), "a0 is at entrance 2 or a0 is in the junction"),
        (f.Eventually(inside), "eventually a0 is in the junction"),
        (f.Always(f.Not(red)), "always light 2 is not red"),
        (f.Until(here, inside), "a0 is at entrance 2 until a0 is in the junction"),
        (f.Eventually(f.Always(inside)), str(f.Eventually(f.Always(inside)))),
        (f.Next(inside), str(f.Next(inside))),
    ]
    for formula, words in cases:
        assert say(formula) == words
    assert say(inside, be="was") == "a0 was in the junction"
    assert say(WORDS[9][0], be="was") == "a0 had stopped at the line"
    assert literal(here, True, be="stays") == "a0 stays at entrance 2"
    assert literal(inside, False, be="stays") == "a0 stays out of the junction"
    assert literal(red, True, lambda e: f"<{e.name}>") == "<lt2> is red"
