"""Rules and monitors that no other test has left behind."""

import pytest

from pytest_rvads.logic.ground import ground
from pytest_rvads.logic.ltl3 import synthesize
from pytest_rvads.logic.prepare import prepare


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test registers its own rules and builds its own monitors, so that it finds what it is there to find."""
    for registry in ("rules._USER", "signature._PREDICATES"):
        monkeypatch.setattr(f"pytest_rvads.logic.{registry}.things", {})
    for cache in (ground, prepare, synthesize):
        cache.cache_clear()
