"""Every deficiency alone is found by a search, with two vehicles at most; autopilots without it survive the same search."""

from functools import partial
from typing import Any

import pytest

import pytest_rvads as rvads

from .looking import look_for

NONE: dict[str, Any] = {"i1": False, "i2": False, "i3": False, "i4": False, "i5": False}
SEARCHES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "i1": ("light4", "p4", {"near": 0.01}),
    "i2": ("paper_stop4", "p1", {}),
    "i3": ("paper_stop4", "p2", {}),
    "i4": ("paper_light4", "p5", {}),
    "i5": ("paper_light4", "p6", {}),
}


def search(autopilot: Any, deficiency: str) -> Any:
    junction, rule, space = SEARCHES[deficiency]
    return look_for(junction, autopilot, rule, budget=200, **space)


@pytest.mark.slow
@pytest.mark.parametrize("deficiency", SEARCHES)
def test_each_single_deficiency_is_found_with_two_vehicles(deficiency: str) -> None:
    counterexample = search(partial(rvads.LgsvlLike, **(NONE | {deficiency: True})), deficiency)
    assert counterexample is not None
    assert sum(map(bool, counterexample.scenario.directions)) <= 2
    without = rvads.simulate(rvads.Case(counterexample.scenario, partial(rvads.LgsvlLike, **NONE)))
    assert rvads.check(without, SEARCHES[deficiency][1]).status in (rvads.Status.PASS, rvads.Status.NA)


@pytest.mark.slow
@pytest.mark.parametrize("deficiency", SEARCHES)
def test_reference_survives_the_same_search(deficiency: str) -> None:
    assert search(rvads.Reference, deficiency) is None
