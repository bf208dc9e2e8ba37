"""The six rules of the paper, each on runs that keep it, break it alone, leave it open, or never ask for it.

Ticks below are the story of each vehicle: when it arrives at its entrance, enters the junction, leaves it.
Directions in an X: 1 right, 2 straight, 3 left.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.judging.attribution import find_cycle
from pytest_rvads.logic.judging.instances import prepare
from pytest_rvads.logic.judging.judge import Values
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Fault, Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import RunError

G, R = Colour.GREEN, Colour.RED
Make = Callable[..., Run]
CROSS = {0: [(0, G), (500, R)], 2: [(0, G), (500, R)], 1: [(0, R), (500, G)], 3: [(0, R), (500, G)]}

STORIES: list[tuple[str, str, dict[int, Any], dict[str, str]]] = [
    ("one after the other", "stop4", {0: (2, 10, 50, 200), 1: (2, 30, 250, 400)}, {"p1": "PASS", "p2": "NA", "p3": "PASS"}),
    ("both inside", "stop4", {0: (2, 10, 50, 200), 1: (2, 30, 199, 400)}, {"p1": "FAIL", "p2": "NA", "p3": "PASS"}),
    ("the next enters as the first leaves", "stop4", {0: (2, 10, 50, 200), 1: (2, 30, 200, 400)}, {"p1": "PASS"}),
    ("the later one first", "stop4", {0: (2, 10, 250, 300), 1: (2, 30, 50, 200)}, {"p1": "PASS", "p2": "NA", "p3": "FAIL"}),
    ("entering in the same tick", "stop4", {0: (2, 10, 50, 200), 1: (2, 30, 50, 200)}, {"p1": "FAIL", "p3": "FAIL"}),
    (
        "a tie, the right one first",
        "stop4",
        {0: (2, 10, 250, 300), 1: (2, 10, 50, 200)},
        {"p1": "PASS", "p2": "PASS", "p3": "NA"},
    ),
    ("a tie, the left one first", "stop4", {0: (2, 10, 50, 200), 1: (2, 10, 250, 300)}, {"p1": "PASS", "p2": "FAIL", "p3": "NA"}),
    ("a tie, opposite", "stop4", {0: (2, 10, 50, 200), 2: (2, 10, 250, 300)}, {"p1": "PASS", "p2": "NA", "p3": "NA"}),
    ("a tie, together", "stop4", {0: (2, 10, 50, 200), 1: (2, 10, 50, 200)}, {"p1": "FAIL", "p2": "FAIL", "p3": "NA"}),
    ("a tie, nobody moves", "stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, {"p1": "NA", "p2": "OPEN", "p3": "NA"}),
    ("first in time, nobody moves", "stop4", {0: (2, 10, None, None), 1: (2, 20, None, None)}, {"p2": "NA", "p3": "OPEN"}),
    ("alone", "stop4", {0: (2, 10, 50, 200)}, {"p1": "NA", "p2": "NA", "p3": "NA"}),
    ("waits for green", "light4", {1: (2, 10, 501, 700)}, {"p4": "PASS", "p5": "NA", "p6": "NA"}),
    ("leaves in the tick of green", "light4", {1: (2, 10, 500, 700)}, {"p4": "PASS"}),
    ("leaves one tick early", "light4", {1: (2, 10, 499, 700)}, {"p4": "FAIL"}),
    ("right on red", "light4", {1: (1, 10, 100, 300)}, {"p4": "NA", "p5": "NA"}),
    ("still red at the end", "light4", {0: (2, 600, None, None)}, {"p4": "OPEN"}),
    ("right on red after the left one", "light4", {1: (1, 10, 100, 300), 0: (2, 20, 60, 200)}, {"p4": "NA", "p5": "PASS"}),
    ("right on red before the left one", "light4", {1: (1, 10, 100, 300), 0: (2, 20, 160, 300)}, {"p4": "NA", "p5": "FAIL"}),
    ("left after opposite", "light4", {0: (3, 10, 100, 300), 2: (2, 20, 60, 200)}, {"p4": "NA", "p6": "PASS"}),
    ("left before opposite", "light4", {0: (3, 10, 100, 300), 2: (2, 20, 160, 300)}, {"p4": "NA", "p6": "FAIL", "p6g": "FAIL"}),
    ("left with opposite left", "light4", {0: (3, 10, 100, 300), 2: (3, 20, 160, 300)}, {"p6": "NA"}),
    ("left in front of right", "light4", {0: (3, 10, 100, 300), 2: (1, 20, 160, 300)}, {"p6": "FAIL"}),
    ("p6 asks for no green, p6g does", "light4", {1: (3, 10, 100, 300), 3: (2, 20, 160, 300)}, {"p6": "FAIL", "p6g": "NA"}),
]


@pytest.mark.parametrize(("junction", "vehicles", "wanted"), [s[1:] for s in STORIES], ids=[s[0] for s in STORIES])
def test_stories(make: Make, junction: str, vehicles: dict[int, Any], wanted: dict[str, str]) -> None:
    run = make(junction, vehicles, 800, CROSS if junction == "light4" else None)
    assert {name: check(run, name).status for name in wanted} == wanted
    assert {name: check(run, name, itinerary=False).status for name in wanted} == wanted, "take as the paper defines it"


def test_message_is_one_line_with_vehicle_time_and_event(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 120, 400)}, 800)
    assert check(run, "p1").message == "p1 at t=1.20 s: a0, a1 both in junction"
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 250, 300)}, 800)
    assert check(run, "p2").message == "p2 at t=0.50 s: a0 left entrance 0 before a1 was in the junction"
    run = make("light4", {1: (2, 10, 100, 300)}, 800, CROSS)
    assert check(run, "p4").message == "p4 at t=1.00 s: a1 left entrance 1 before light 1 was green"
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, 301)
    assert check(run, "p2").message == (
        "p2 open: a0 is still at entrance 0 and waits until a1 is in the junction, since t=0.10 s when the run ended at 3.00 s: "
        "deadlock, or too short a run"
    )


def test_the_explanation_shows_who_yields_since_when_and_the_states_around_the_break(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 250, 300)}, 800)
    text = check(run, "p2").explanation.splitlines()
    assert text[0].startswith("rule      p2  right-of-way:  forall j.en")
    assert text[1] == "instance  j.en=entrance 1, j.en'=entrance 0, a=a1, a'=a0   (1 instance: 1 fail)"
    assert text[2] == "yields    a0 @ entrance 0, straight   arrived 0.10 s, waited 0.40 s"
    assert text[3] == "priority  a1 @ entrance 1, straight   arrived 0.10 s, waited 0.41 s   entrance 1 is right of 0"
    assert text[4] == "obligation since 0.10 s: a0 stays at entrance 0 until a1 is in the junction"
    assert text[5] == "broken at 0.50 s: a0 in the junction while a1 is still at entrance 1; 2.00 s too early"
    assert [line.split()[0] for line in text[7:]] == ["0.10", "0.49", "0.50"]
    assert text[-1].endswith("<- violated, no continuation can repair it")


def test_explanation_of_p1_shows_entries_and_the_acting_vehicle(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (1, 30, 120, 400)}, 800)
    assert check(run, "p1").explanation.splitlines()[1:] == [
        "instance  a=a0, a'=a1   (1 instance: 1 fail)",
        "vehicle   a0 from entrance 0, straight   entered 0.50 s",
        "vehicle   a1 from entrance 1, right   entered 1.20 s   <- acts",
        "broken at 1.20 s: a0, a1 both in junction; broken for 0.80 s of the run",
        " t [s]  a0        a1          a0@j  a1@j",
        "  1.19  junction  entrance 1   x     .",
        "  1.20  junction  junction     x     x   <- violated, no continuation can repair it",
    ]
    for second, shown in ((1, ["0.00", "0.01"]), (0, ["0.00"])):
        run = make("stop4", {0: (2, -50, 0, 200), 1: (1, -50, second, 400)}, 800)
        assert [line.split()[0] for line in check(run, "p1").explanation.splitlines()[6:]] == shown, "nothing is before the run"


def test_the_explanation_of_an_open_obligation_ends_where_the_run_ends(make: Make) -> None:
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, 301)
    text = check(run, "p2").explanation.splitlines()
    assert text[4:6] == [
        "obligation since 0.10 s: a0 stays at entrance 0 until a1 is in the junction",
        "open at   3.00 s: a0 at entrance 0 while a1 is still at entrance 1",
    ]
    assert text[-1].endswith("<- the run ends")
    assert [line.split()[0] for line in text[7:]] == ["0.10", "2.99", "3.00"]


def test_where_traffic_keeps_left_the_priority_is_on_the_left(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 250, 300)}, 800)
    mirrored = replace(run.junction, left_hand=True, right_of=frozenset((b, a) for a, b in run.junction.right_of))
    verdict = check(replace(run, junction=mirrored), "p2")
    assert verdict.status == "PASS"
    late = make("stop4", {0: (2, 10, 250, 300), 1: (2, 10, 50, 200)}, 800)
    verdict = check(replace(late, junction=mirrored), "p2")
    assert verdict.responsible == ("a1",)
    assert "entrance 0 is left of 1" in verdict.explanation


def test_instances_carry_binding_blame_ticks_and_margins(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 120, 400), 2: (2, 60, 600, 700)}, 800)
    p1, p3 = check(run, "p1"), check(run, "p3")
    worst = p1.instances[0]
    assert (dict(worst.binding), worst.responsible, worst.failed, worst.margin) == ({"a": "a0", "a'": "a1"}, ("a1",), 120, 0.8)
    assert p1.counts == {"fail": 1, "pass": 2}
    assert (p1.time, p1.final, p1.responsible) == (1.2, True, ("a1",))
    # a1 left 0.7 s after a0 had entered, a2 after a1; a0 and a2 never met at the entrances.
    assert p3.counts == {"pass": 2, "not triggered": 4}
    kept = p3.instances[0]
    assert (dict(kept.binding)["a"], dict(kept.binding)["a'"], kept.trigger, kept.margin) == ("a1", "a0", 30, -0.7)
    both = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 50, 400)}, 800)
    assert check(both, "p1").responsible == ("a0", "a1"), "both, as they enter in the same tick"


def test_the_earliest_violation_comes_first(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 100, 400), 1: (2, 20, 300, 500), 2: (2, 30, 200, 600)}, 800)
    verdict = check(run, "p1")
    assert verdict.message == "p1 at t=2.00 s: a0, a2 both in junction (the first of 3 instances)"
    assert [i.failed for i in verdict.instances] == [200, 300, 300]


def test_four_at_once_cannot_pass_and_the_text_says_why(make: Make) -> None:
    # Whoever goes first breaks it; then a3, whose right it was to wait for a0, then a2, then a1.
    moved = make("stop4", {e: (2, 10, 50 + 200 * (-e % 4), 200 + 200 * (-e % 4)) for e in range(4)}, 900)
    stuck = make("stop4", dict.fromkeys(range(4), (2, 10, None, None)), 900)
    for run, status, unavoidable in ((moved, Status.FAIL, True), (stuck, Status.OPEN, False)):
        verdict = check(run, "p2")
        assert (verdict.status, verdict.unavoidable) == (status, unavoidable)
        assert "4 vehicles arrived together and each must wait for the vehicle on its right" in verdict.message
        assert "(a0 -> a1 -> a2 -> a3 -> a0)" in verdict.notes[0]
        assert "each must wait for the vehicle on its right" in verdict.explanation
    at_once = make("stop4", {e: (2, 10, 11 + 200 * (-e % 4), 200 + 200 * (-e % 4)) for e in range(4)}, 900)
    assert check(at_once, "p2").unavoidable, "one state in which all four stand is enough"
    three = make("stop4", {e: (2, 10, 50 + 200 * e, 200 + 200 * e) for e in range(3)}, 900)
    assert check(three, "p2").status is Status.FAIL
    assert not check(three, "p2").notes, "three of four have an order"


@pytest.mark.parametrize("entries", [(50, 250, 450, 650), (50, 50, 450, 250), (50, 400, 50, 200)])
def test_cycle_excuses_only_the_vehicle_that_breaks_the_cycle(make: Make, entries: tuple[int, ...]) -> None:
    """In turn around the junction the wrong way; two at once; two that face each other at once."""
    run = make("stop4", {e: (2, 10, entry, entry + 100) for e, entry in enumerate(entries)}, 900)
    verdict = check(run, "p2")
    assert (verdict.status, verdict.unavoidable) == (Status.FAIL, False)
    assert "each must wait" not in verdict.explanation


def test_a_cycle_exists_from_its_last_arrival_until_somebody_moves(make: Make) -> None:
    def cycle(first: int | None) -> Any:
        run = make("stop4", {e: (2, 10, first if e == 0 else 60 + e, None) for e in range(4)}, 100)
        return find_cycle(prepare(get_rule("p2").formula, extract(run)).templates, Values(run))

    assert (cycle(None).tick, cycle(None).agents, cycle(None).alone) == (10, ("a0", "a1", "a2", "a3"), True)
    assert cycle(11).tick == 10
    late = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 150, 300), 2: (2, 80, None, None), 3: (2, 80, None, None)}, 400)
    assert find_cycle(prepare(get_rule("p2").formula, extract(late)).templates, Values(late)) is None


def test_a_cycle_is_found_among_instances_of_other_forms(make: Make) -> None:
    """A rule that also limits how long who goes first may wait: what it says of the order contradicts itself as in p2."""
    first = "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt = a'.wt & j.en right-of j.en' ->"
    both = Rule("both", f"{first} !a.wt > 100 & ((N a'@j.en') U a@j))", bound=("a'",))
    stuck = make("stop4", dict.fromkeys(range(4), (2, 10, None, None)), 900)
    found = find_cycle(prepare(both.formula, extract(stuck)).templates, Values(stuck))
    assert (found.tick, found.agents, found.alone) == (10, ("a0", "a1", "a2", "a3"), True)


def test_a_tie_window_says_where_it_decides(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 40, 250, 300)}, 800)
    assert (check(run, "p2").status, check(run, "p3").status) == ("NA", "PASS")
    wide = check(run, "p2", tie=0.3)
    assert wide.status is Status.FAIL
    assert "the tie window of 0.3 s decides: without it the verdict would be NA" in wide.notes
    other = check(run, "p3", tie=0.3)
    assert (other.status, other.notes) == (
        Status.NA,
        ("the tie window of 0.3 s decides: without it the verdict would be PASS",),
    )
    assert other.notes[0] in other.explanation
    assert not check(run, "p1", tie=0.3).notes
    assert check(run, "p2", tie=0.29).status is Status.NA, "30 ticks apart is outside 29"


MIRRORED = {"<": ">", ">": "<", "<=": ">=", ">=": "<="}


@pytest.mark.parametrize(
    ("sign", "inside", "outside"),
    [("=", True, False), ("!=", False, True), ("<", False, True), ("<=", True, True), (">", False, False), (">=", True, False)],
)
def test_comparisons_of_waiting_times_up_to_a_tie(make: Make, sign: str, inside: bool, outside: bool) -> None:
    # a0 has waited 30 ticks longer than a1: equal within 0.3 s, longer beyond.
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 40, None, None)}, 100)
    one, two = (f.Attr(e, "wt") for e in (f.Element(Sort.AGENT, 1, "a1"), f.Element(Sort.AGENT, 0, "a0")))
    atom = f.Atom(sign, (one, two))
    assert bool(Values(run, 0.30)[atom][-1]) is inside
    assert bool(Values(run, 0.29)[atom][-1]) is outside
    mirrored = f.Atom(MIRRORED.get(sign, sign), (two, one))
    assert bool(Values(run, 0.30)[mirrored][-1]) is inside
    assert bool(Values(run, 0.29)[mirrored][-1]) is outside


def test_a_tie_window_can_be_unsatisfiable_in_a_triple(make: Make) -> None:
    # 0 and 1 tie, 1 and 2 tie, but 2 came clearly after 0: 0 yields to 1, 1 yields to 2, 2 yields to 0.
    run = make("stop4", {0: (2, 10, 500, 600), 1: (2, 50, 200, 300), 2: (3, 90, 350, 400)}, 800)
    verdict = check(run, "right_first")
    assert verdict.status is Status.FAIL
    assert verdict.notes[0].startswith("3 vehicles must each wait for another of the 3 (a0 -> a1 -> a2 -> a0)")


def test_reasons_of_na_are_constant_and_the_nearest_miss_is_told(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 250, 400)}, 800)
    other = check(run, "p4")
    assert other.reason == "p4 is about junctions with lights at all entrances, and this junction has stop signs at all entrances"
    never = check(run, "p2")
    assert never.reason == "never triggered: the premise of the rule never holds on the run"
    assert never.near
    assert (never.near.tick, never.near.missing, never.near.steps) == (30, ("a0 and a1 arrived at the same time",), 20)
    assert "nearest   at 0.30 s" in never.explanation
    lone = check(make("light4", {0: (2, 10, 50, 200)}, 800, CROSS), "p6")
    assert lone.reason.startswith("no vehicle is in a position that the rule is about")
    assert lone.collapsed == 4 * 4 * 1 * 1


def test_na_and_error_have_no_truth_value(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 800)
    with pytest.raises(RunError, match=r"NA .*ask for verdict\.status"):
        bool(check(run, "p4"))
    empty = make("stop4", {0: (2, 0, 0, 0)}, 800)
    empty = Run("empty", empty.junction, empty.agents, empty.zone[:0], empty.lights[:0])
    verdict = check(empty, "p1")
    assert (verdict.status, verdict.reason) == (Status.ERROR, "the run is empty: it has no states")
    with pytest.raises(RunError, match="could not be judged"):
        bool(verdict)
    broken = Run("fault", run.junction, run.agents, run.zone, run.lights, fault=Fault(1.0, "a0", "autopilot Mine raised"))
    assert check(broken, "p1").message == "p1 ERROR: autopilot Mine raised"


def test_records_are_builtins(make: Make) -> None:
    def plain(value: Any) -> bool:
        if isinstance(value, dict):
            return all(type(k) is str and plain(v) for k, v in value.items())
        if isinstance(value, list):
            return all(map(plain, value))
        return value is None or type(value) in (str, int, float, bool)

    runs = (
        make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 120, 400)}, 800),
        make("stop4", {0: (2, 10, None, None), 1: (2, 10, None, None)}, 800),
    )
    for run in runs:
        for name in ("p1", "p2", "p3", "p4"):
            assert plain(check(run, name).record())


def test_causes_are_the_same_for_all_rotations(make: Make) -> None:
    causes = set()
    for r in range(4):
        run = make("stop4", {r: (2, 10, 50, 200), (r + 1) % 4: (1, 10, 250, 300)}, 800)
        causes.add(check(run, "p2").cause)
    assert causes == {
        "a' left its entrance before a was in the junction (a right from entrance +0, a' straight from entrance +3)"
    }
