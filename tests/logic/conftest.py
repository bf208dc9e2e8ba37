"""Rules and monitors that no other test has left behind."""

import pytest

from pytest_rvads.logic.judging.prepare import forget
from pytest_rvads.logic.ltl.ltl3 import synthesize


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests() -> None:
    """Every test builds its own monitors, so that it finds what it is there to find."""
    forget()
    synthesize.cache_clear()
