"""Scenarios that begin within the cycle of the lights: ids, records, signal plans, and programs of other tools."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.runs.states import Colour, SignalPlan
from pytest_rvads.satellites.sumo.road_network import signal_program
from pytest_rvads.scenarios.ids import from_id, recalled
from pytest_rvads.support.errors import ScenarioError

LIGHT = rvads.find("light4")
CYCLE = 40
"""Two phase groups, each with 15 s of green, 3 s of yellow and 2 s of clearance [s]."""
TWELVE = [3.0, 3.0, 2.0, 15.0, 3.0, 2.0, 12.0]
"""Durations of the phases of a cycle that begins after 12 s of the first green [s]."""

groups = st.integers(1, 4).map(lambda count: tuple(frozenset({group}) for group in range(count)))


@given(st.integers(0, CYCLE - 1), st.sampled_from((0, 2)))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_id_and_record_give_the_scenario(elapsed: int, followers: int) -> None:
    senses = rvads.Senses(delay=0.2)
    scenario = rvads.Scenario(LIGHT, "1133", distance=20, subject=1, elapsed=elapsed, followers=followers, senses=senses)
    assert (f".e{elapsed}." in scenario.name) == (elapsed > 0)
    assert from_id(scenario.name) == scenario
    assert recalled(scenario.record(), LIGHT, "here") == scenario


def test_record_of_a_cycle_from_its_beginning_is_as_it_was_without_the_field() -> None:
    assert "elapsed" not in rvads.Scenario(LIGHT, "1133").record()
    assert rvads.Scenario(LIGHT, "1133", elapsed=1).record()["elapsed"] == 1


@pytest.mark.parametrize(
    ("junction", "elapsed", "cycle"),
    [("light4", 40, 40), ("light4", -1, 40), ("light4", 1.5, 40), ("light4", True, 40), ("stop4", 1, 0)],
)
def test_time_outside_the_cycle_is_refused(junction: str, elapsed: int, cycle: int) -> None:
    message = f"elapsed must be a whole number of seconds below the cycle of the lights, {cycle} s, got {elapsed}"
    with pytest.raises(ScenarioError, match=re.escape(message)):
        rvads.Scenario(rvads.find(junction), "1133", elapsed=elapsed)


@given(groups, st.integers(0, 79), st.integers(0, 20_000))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_plan_shows_the_colours_of_a_later_time(groups: tuple[frozenset[int], ...], elapsed: int, tick: int) -> None:
    whole, begun = SignalPlan(groups), SignalPlan(groups, elapsed=elapsed)
    assert begun.colours(tick / 100, len(groups)) == whole.colours(tick / 100 + elapsed, len(groups))


@given(groups, st.data())
@settings(derandomize=True, deadline=None, max_examples=60)
def test_phases_fill_the_cycle_and_colours_change_only_between_them(
    groups: tuple[frozenset[int], ...], data: st.DataObject
) -> None:
    cycle, count = 20 * len(groups), len(groups)
    plan = SignalPlan(groups, elapsed=data.draw(st.integers(0, cycle - 1)))
    phases = plan.phases()
    assert phases[0][0] == 0.0
    assert [begin for begin, _ in phases[1:]] == [begin + duration for begin, duration in phases[:-1]]
    assert sum(duration for _, duration in phases) == cycle
    for begin, duration in phases:
        assert duration > 0.0
        assert len({plan.colours(begin + part * (duration - 0.01), count) for part in (0.0, 0.5, 1.0)}) == 1
    for (begin, _), (after, _) in pairwise(phases):
        assert plan.colours(begin, count) != plan.colours(after, count)


def test_plan_without_lights_has_no_phases() -> None:
    assert rvads.Scenario(rvads.find("stop4"), "1133").signals().phases() == []


def test_lights_of_a_run_begin_at_the_elapsed_time() -> None:
    """After 12 s of 15 s of green, entrances 0 and 2 turn yellow at 3 s, and red at 6 s."""
    scenario = rvads.Scenario(LIGHT, "2000", distance=100, elapsed=12, duration=6.1)
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
    colours = [Colour(value) for value in run.lights[:, 0]]
    assert [tick for tick in range(1, len(colours)) if colours[tick] != colours[tick - 1]] == [300, 600]
    assert [colours[tick] for tick in (0, 300, 600)] == [Colour.GREEN, Colour.YELLOW, Colour.RED]
    assert {Colour(value) for value in np.unique(run.lights[:, 1])} == {Colour.RED}


def test_program_for_sumo_begins_at_the_elapsed_phase() -> None:
    plan = rvads.Scenario(LIGHT, "2200", elapsed=12).signals()
    phases = list(signal_program(LIGHT, plan, [(0, 2), (1, 3)]))
    assert [float(phase.attrib["duration"]) for phase in phases] == TWELVE
    assert [phase.attrib["state"] for phase in phases] == ["Gr", "yr", "rr", "rG", "ry", "rr", "Gr"]


def test_openscenario_begins_at_the_elapsed_phase(tmp_path: Path) -> None:
    pytest.importorskip("scenariogeneration")  # the extra openscenario, which `dev` brings
    rvads.files.save_scenario(rvads.Scenario(LIGHT, "2200", elapsed=12), tmp_path / "s.xosc")
    text = (tmp_path / "s.xosc").read_text("utf-8")
    assert [float(duration) for duration in re.findall(r'<Phase name="[^"]*" duration="([\d.]+)"', text)] == TWELVE
