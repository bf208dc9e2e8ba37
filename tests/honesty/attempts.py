"""A file of tests that is to get a green that it does not deserve, and what an honest session says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from textwrap import dedent

import pytest

from tests.inner_sessions import records_of

__all__ = ["CHECKED", "FAILED", "NOTHING", "STOPPED", "Attempt", "Session", "statuses"]

Session = Callable[..., pytest.RunResult]
FAILED, STOPPED, NOTHING = pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.INTERRUPTED, pytest.ExitCode.NO_TESTS_COLLECTED


@dataclass(frozen=True, slots=True)
class Attempt:
    """A file of tests, and what an honest session says of it."""

    tests: str
    statuses: tuple[str, ...] = ()
    """Of the records, with ``|`` between those that will do; none where nothing was collected."""
    outcomes: dict[str, int] = field(default_factory=lambda: {"failed": 1})
    says: str = "*"
    """A line of the output."""
    driver: str | None = "racer"
    options: tuple[str, ...] = ()
    exits: int = FAILED

    def hold(self, session: Session, pytester: pytest.Pytester) -> None:
        """Run the session and compare."""
        result = session(dedent(self.tests), *self.options, driver=self.driver)
        result.assert_outcomes(**self.outcomes)
        pytest.LineMatcher(result.outlines + result.errlines).fnmatch_lines([self.says])
        found = statuses(pytester) if self.statuses else []
        told = [wanted if status in wanted.split("|") else status for status, wanted in zip(found, self.statuses, strict=True)]
        assert told == list(self.statuses)
        assert result.ret == self.exits


def statuses(pytester: pytest.Pytester) -> list[str]:
    """Return the statuses of the records that a session left, in order."""
    return [r["status"] for r in records_of(pytester.path)]


CHECKED = """
@here({})
def test_it(run, rule, monitor):
    monitor.check(rule)
"""
