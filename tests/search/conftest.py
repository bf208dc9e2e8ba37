"""What the tests of the searches share."""

from functools import lru_cache
from typing import Any

import pytest

import pytest_rvads as rvads


@lru_cache(maxsize=256)
def simulated(scenario: rvads.Scenario, autopilot: Any) -> rvads.Run:
    """Simulate once per process."""
    return rvads.simulate(rvads.Case(scenario, autopilot))


@pytest.fixture(autouse=True)
def _with_hypothesis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who searches has the plugin of Hypothesis at work as well."""
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
