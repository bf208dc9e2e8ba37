"""Rules and monitors that no other test has left behind."""

import pytest

from pytest_rvads.logic.judging.ground import ground
from pytest_rvads.logic.judging.prepare import prepare
from pytest_rvads.logic.ltl.ltl3 import synthesize


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test registers its own rules and builds its own monitors, so that it finds what it is there to find."""
    for registry in ("rules.rule._USER", "rules.vocabulary._PREDICATES"):
        monkeypatch.setattr(f"pytest_rvads.logic.{registry}.things", {})
    for cache in (ground, prepare, synthesize):
        cache.cache_clear()
