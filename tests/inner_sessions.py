"""Files of tests for sessions of pytest inside pytest, and the records that such sessions leave."""

import json
from pathlib import Path
from textwrap import dedent
from typing import Any

_RACER = """
import pytest
import pytest_rvads as rvads

class Racer(rvads.Follower):
    def target_speed(self, seen):
        return 8.0

@pytest.fixture{params}
def rvads_autopilot(request):
    return {driver}
"""

FAILING = """
import pytest
import pytest_rvads as rvads

@pytest.fixture
def rvads_autopilot():
    return rvads.RollingStop

@rvads.scenario("stop4", classes=7, distances=(10, 11, 12, 13), rules=("p1", "p3"))
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""
"""Tests of a driver to which it does not matter who came first."""


def driven_by(driver: str, tests: str = "", *, params: str = "") -> str:
    """Return a file whose vehicles are driven by an autopilot that breaks rules within a second, or by another one.

    Args:
        driver: the expression of the autopilot; ``Racer`` drives at 8 m/s and waits for nobody.
        tests: the rest of the file.
        params: the expression of the parameters of the autopilot, if any.
    """
    return _RACER.replace("{params}", f"(params={params})" if params else "").replace("{driver}", driver) + dedent(tests)


def records_of(folder: Path, name: str = "out.json") -> list[dict[str, Any]]:
    """Return the records of the report that a session left in a folder."""
    found: list[dict[str, Any]] = json.loads((folder / name).read_text(encoding="utf-8"))["records"]
    return found
