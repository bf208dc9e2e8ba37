"""A search with a smaller budget simulates the first scenarios of a search with a greater budget."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import settings
from hypothesis.database import DirectoryBasedExampleDatabase

import pytest_rvads as rvads
from pytest_rvads.search import falsify

from .looking import look_for

Simulated = Callable[..., list[rvads.Scenario]]


def _passes(scenario: rvads.Scenario, _rule: object) -> SimpleNamespace:
    """Return a verdict whose margin guides a search away from equal distances."""
    instance = SimpleNamespace(margin=max(scenario.distances) - min(scenario.distances))
    return SimpleNamespace(status=rvads.Status.PASS, provoked=False, unavoidable=False, instances=[instance])


@pytest.fixture(scope="module")
def simulated() -> Iterator[Simulated]:
    """Return the scenarios of a search in the order of their simulation, where every run passes."""
    scenarios: list[rvads.Scenario] = []

    def simulate(case: rvads.Case, _simulator: object) -> rvads.Scenario:
        scenarios.append(case.scenario)
        return case.scenario

    def scenarios_of(budget: int, *, junction: str = "stop4", **bounds: Any) -> list[rvads.Scenario]:
        scenarios.clear()
        assert look_for(junction, rvads.Reference, "no_collision", budget=budget, **bounds) is None
        return scenarios.copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(falsify, "simulate", simulate)
        patch.setattr(falsify, "check", _passes)
        patch.setattr(falsify, "crossed", lambda _scenario: True)
        patch.setattr(falsify, "_apart", lambda _scenario, _subject: 0.0)
        scenarios_of(1)  # loads modules: Hypothesis tries constants of loaded modules
        yield scenarios_of


@pytest.mark.parametrize("subject", [None, 0])
@pytest.mark.parametrize("seed", range(3))
def test_search_begins_with_the_scenarios_of_a_smaller_budget(simulated: Simulated, seed: int, subject: int | None) -> None:
    """The budget of 50 takes two blocks, because a block repeats some scenarios."""
    more = simulated(50, seed=seed, subject=subject)
    assert len(set(more)) == 50
    assert simulated(20, seed=seed, subject=subject) == more[:20]


@pytest.mark.extended
def test_several_searches_are_the_searches_with_consecutive_seeds(simulated: Simulated) -> None:
    """Two searches with a budget of 20 are the searches with the seeds 0 and 1 and budgets of 10."""
    several = simulated(20, searches=2, executor=1)
    assert several == simulated(10, seed=0) + simulated(10, seed=1)
    assert several[1:10] != several[11:]


def test_space_without_further_scenarios_ends_a_search(simulated: Simulated) -> None:
    """Three arms, each empty or with one of two turns, and one possible start: 3^3 - 1 scenarios."""
    scenarios = simulated(100, junction="stop3", near=1.0, far=1.05, pace=0.0, wait=(1.0, 1.0))
    assert len(scenarios) == len(set(scenarios)) <= 26


@pytest.mark.extended
def test_scenarios_stored_by_an_earlier_search_change_no_later_search(simulated: Simulated, tmp_path: Path) -> None:
    """Hypothesis stores scenarios with a great margin, and a later search tries at most one of these before it begins."""
    before = settings.get_current_profile_name()
    settings.register_profile("stored", database=DirectoryBasedExampleDatabase(tmp_path))
    settings.load_profile("stored")
    try:
        first, second = simulated(30, name="stored"), simulated(10, name="stored")
    finally:
        settings.load_profile(before)
    assert any(tmp_path.rglob("*"))
    assert second[-10:] == first[:10]
    assert len(second) <= 11
