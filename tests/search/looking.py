"""A search for a counterexample, as the mark ``@rvads.falsify`` makes it."""

from typing import Any

import pytest_rvads as rvads
from pytest_rvads.search.falsify import Counterexample, Search


def look_for(
    junction: Any, autopilot: Any, rule: Any, *, traffic: Any = None, budget: int = 200, seed: int = 0, **more: Any
) -> Counterexample | None:
    """Return the counterexample of a search; `more` holds bounds of the space and arguments of `Search.begin`."""
    begin = {"fleet": rvads.Fleet(), "simulator": None, "name": None, "searches": 1, "executor": None}
    begin |= {name: more.pop(name) for name in begin if name in more}
    return Search.of(junction, rule, traffic, budget, seed, more).begin(autopilot, **begin)
