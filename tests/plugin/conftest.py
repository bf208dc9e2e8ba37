"""Helpers to run pytest inside pytest, with the project's own configuration out of the way."""

from collections.abc import Callable

import pytest

Lines = Callable[[pytest.RunResult], list[str]]


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the developer's environment reaches the inner session."""
    for name in ("RVADS_MAP", "GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def reference(pytester: pytest.Pytester) -> None:
    """The inner session asks for the reference autopilot, so that a test need not bring one of its own."""
    pytester.makeini("[pytest]\nrvads_autopilot = reference\n")


@pytest.fixture
def ids() -> Lines:
    """Return a function giving the ids of the items that ``--collect-only -q`` lists."""
    return lambda result: [line for line in result.outlines if "::" in line and not line.startswith(("ERROR", "E "))]


@pytest.fixture
def brackets(ids: Lines) -> Lines:
    """Return a function giving what stands in brackets of each collected item."""
    return lambda result: [line.partition("[")[2].rstrip("]") for line in ids(result)]
