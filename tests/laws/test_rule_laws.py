"""Laws of the rules on random runs: grounding, static direction, repetition of states, symmetry, sampling."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.blocks import as_blocks, assume
from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.judging.instances import ground, simplify, unfold
from pytest_rvads.logic.judging.judge import Values
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import settle
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

LAW = settings(deadline=None, derandomize=True, max_examples=50)
PAPER = ("p1", "p2", "p3", "p4", "p5", "p6")
STEPS = 24


@st.composite
def runs(draw: Any) -> Run:
    """Short runs on a built-in junction; ties and simultaneous moves are frequent as there are few ticks."""
    place = find(draw(st.sampled_from(["stop4", "light4", "stop3", "light3"])))
    agents, zones = [], []
    entrances = sorted(draw(st.sets(st.integers(0, place.ways - 1), min_size=1)))
    for entrance in entrances:
        leaving = place.leads(entrance, draw(st.integers(1, place.ways - 1))).exit
        agents.append(Agent(f"a{entrance}", place.movements[entrance, leaving]))
        ticks = sorted(draw(st.lists(st.integers(0, STEPS + 6), min_size=3, max_size=3)))
        zones.append(np.searchsorted(ticks, np.arange(STEPS), side="right").astype(np.int8))
    lights = np.zeros((STEPS, place.ways), dtype=np.int8)
    if place.phase_groups:
        for entrance in range(place.ways):
            first, change = draw(st.sampled_from([Colour.GREEN, Colour.RED])), draw(st.integers(0, STEPS))
            lights[:, entrance] = first
            lights[change:, entrance] = Colour.RED if first is Colour.GREEN else Colour.GREEN
    return Run("random", place, tuple(agents), np.column_stack(zones), lights)


def again(run: Run, counts: list[int]) -> Run:
    """Repeat state k of a run ``counts[k]`` times, its waiting times included."""
    longer = Run(run.label, run.junction, run.agents, np.repeat(run.zone, counts, axis=0), np.repeat(run.lights, counts, axis=0))
    (block,) = as_blocks(longer, longer.steps)
    block.values[wt] = np.repeat(wt(run), counts, axis=0)
    assume(longer, block)
    return longer


@LAW
@given(runs(), st.lists(st.integers(1, 3), min_size=STEPS, max_size=STEPS))
def test_repeating_a_state_never_changes_a_verdict(run: Run, counts: list[int]) -> None:
    longer = again(run, counts)
    for name in PAPER:
        assert check(run, name).status == check(longer, name).status, name


@LAW
@given(runs())
def test_a_step_counter_is_not_stutter_invariant(run: Run) -> None:
    # The law above is about the rules, not about the machinery: a formula that counts steps does notice.
    rule = f.Next(f.Next(f.Atom("@", (f.Element(Sort.AGENT, 0, "a"), f.Element(Sort.JUNCTION, 0, "j")))))
    values = Values(run)
    doubled = Values(again(run, [2] * STEPS))
    inside = run.zone[:, 0] == Zone.JUNCTION
    assert settle(rule, values, STEPS)[0] == inside[2]
    assert settle(rule, doubled, 2 * STEPS)[0] == inside[1]


@pytest.mark.extended
@LAW
@given(runs(), st.sampled_from([*PAPER, "p6g", "red", "right_on_red", "left_yields", "first_come", "right_first"]))
def test_grounding_step_by_step_equals_grounding_at_once(run: Run, name: str) -> None:
    formula, static = get_rule(name).formula, extract(run)
    for itinerary in (True, False):
        assert simplify(unfold(formula, static), static, itinerary=itinerary) == ground(formula, static, itinerary=itinerary)


@settings(LAW, max_examples=15)
@given(runs())
def test_unfolding_and_simplifying_keep_the_meaning(run: Run) -> None:
    # Finite-trace truth of the unfolded rule, its static atoms evaluated one by one, against the simplified instances.
    static = extract(run)
    for name in ("p2", "p4"):
        formula = get_rule(name).formula
        values = _Everything(run)
        plain = all(settle(i.formula, values, STEPS)[0] for i in unfold(formula, static).instances)
        short = all(settle(i.formula, Values(run), STEPS)[0] for i in ground(formula, static, itinerary=False).instances)
        assert plain == short


class _Everything(dict):  # type: ignore[type-arg]
    """Truth values of all ground atoms, straight from the definitions and one state at a time."""

    def __init__(self, run: Run) -> None:
        self.run = run

    def __missing__(self, atom: f.Atom) -> Any:
        return np.array([self.value(atom, k) for k in range(self.run.steps)])

    def value(self, atom: f.Atom, k: int) -> bool:
        run, place = self.run, self.run.junction
        terms: tuple[Any, ...] = atom.terms
        match atom.name, terms:
            case "@", (thing, where):
                if thing.sort == "light":
                    return bool(thing.index == where.index)
                zone, agent = Zone(int(run.zone[k, thing.index])), run.agents[thing.index]
                if where.sort == "junction":
                    return zone is Zone.JUNCTION
                return zone is Zone.ENTRANCE and agent.entrance == where.index
            case "right-of", (one, two):
                return (one.index, two.index) in place.right_of
            case "take", (agent, where, direction):
                here = [self.value(f.Atom("@", (agent, where)), i) for i in range(k, run.steps)]
                inside = [run.zone[i, agent.index] == Zone.JUNCTION for i in range(k, run.steps)]
                turned = run.agents[agent.index].turn == direction.name
                return here[0] and any(inside[i] and turned and all(here[:i]) for i in range(len(here)))
            case "=", (f.Attr(f.Element() as one, "wt"), f.Attr(f.Element() as two, "wt")):
                return bool(wt(run)[k, one.index] == wt(run)[k, two.index])
            case "=", (f.Attr(f.Element() as light, "cl"), word):
                return Colour(int(run.lights[k, light.index])).name.lower() == word.name
        raise AssertionError(atom)


@LAW
@given(runs())
def test_static_direction_equals_take_on_runs_in_which_everybody_gets_in(run: Run) -> None:
    entered = [(run.zone[:, k] == Zone.JUNCTION).any() for k in range(len(run.agents))]
    if all(entered):
        for name in ("p4", "p5", "p6"):
            assert check(run, name).status == check(run, name, itinerary=False).status, name


@LAW
@given(runs())
def test_the_overall_status_is_that_of_the_worst_instance(run: Run) -> None:
    for name in PAPER:
        verdict = check(run, name)
        statuses = [i.status for i in verdict.instances]
        worst = next((s for s in ("FAIL", "OPEN", "PASS") if s in statuses), "NA")
        assert verdict.status == worst
        assert verdict.final is (verdict.status == "FAIL")
        assert sum(verdict.counts.values()) == len(statuses)


@LAW
@given(runs(), st.integers(1, STEPS - 1))
def test_a_violation_stays_one_however_the_run_goes_on(run: Run, end: int) -> None:
    cut = Run(run.label, run.junction, run.agents, run.zone[:end], run.lights[:end])
    for name in PAPER:
        early, late = check(cut, name), check(run, name)
        if early.status == "FAIL":
            assert late.status == "FAIL"
            assert early.time == late.time


@LAW
@given(runs())
def test_p1_by_its_meaning(run: Run) -> None:
    if run.junction.phase_groups:
        return
    inside = (run.zone == Zone.JUNCTION).sum(axis=1)
    wanted = "NA" if len(run.agents) < 2 or not inside.any() else "FAIL" if (inside > 1).any() else "PASS"
    assert check(run, "p1").status == wanted


@LAW
@given(runs())
def test_p3_by_its_meaning(run: Run) -> None:
    """Whoever leaves its entrance into the junction no later than somebody who waited there longer breaks the rule."""
    if run.junction.phase_groups:
        return
    at = run.zone == Zone.ENTRANCE
    inside = run.zone == Zone.JUNCTION
    found = {"NA"}
    for a in range(len(run.agents)):
        for b in range(len(run.agents)):
            met = np.flatnonzero(at[:, a] & at[:, b] & (wt(run, a) < wt(run, b)))
            if a == b or not len(met):
                continue
            left = next((k for k in range(met[0], STEPS) if not at[k, a]), None)
            went = next((k for k in range(met[0], STEPS) if inside[k, b]), None)
            if left is not None and (went is None or went >= left):
                found.add("FAIL")
            else:
                found.add("OPEN" if went is None else "PASS")
    assert check(run, "p3").status == next(s for s in ("FAIL", "OPEN", "PASS", "NA") if s in found)
