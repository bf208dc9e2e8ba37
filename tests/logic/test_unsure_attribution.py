"""What is UNSURE is no violation, is nobody's doing, and does not pass."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pytest_rvads import Run, Status, check
from pytest_rvads.runs.run import Facts
from pytest_rvads.support.errors import RunError

from ..run_builders import coarse


@pytest.fixture
def doubtful(make: Callable[..., Run]) -> Run:
    """Two vehicles of which one leaves between the same samples as the other enters; a third one is in nobody's way."""
    return coarse(make("stop4", {0: (2, 100, 200, 395), 1: (2, 120, 395, 600), 2: (2, 300, 700, 800)}, 900), 10)


def test_unsure_verdict_has_no_responsible_vehicle(doubtful: Run) -> None:
    verdict = check(doubtful, "p1")
    assert verdict.status is Status.UNSURE
    assert verdict.responsible == ()
    assert not any((verdict.provoked, verdict.unavoidable, verdict.final))
    assert verdict.counts == {"unsure": 1, "pass": 2}
    assert verdict.record()["instances"][0]["hangs"] == verdict.reason
    assert "unsure    a0 was through at" in verdict.explanation
    with pytest.raises(RunError, match="neither true nor false"):
        bool(verdict)


def test_a_definite_violation_counts_first(make: Callable[..., Run]) -> None:
    run = make("stop4", {0: (2, 100, 200, 395), 1: (2, 120, 395, 600), 2: (2, 300, 500, 800)}, 900)
    verdict = check(coarse(run, 10), "p1")
    assert verdict.status is Status.FAIL
    assert verdict.counts == {"fail": 1, "unsure": 1, "pass": 1}


@pytest.mark.parametrize(("subject", "status"), [("a1", Status.UNSURE), ("a2", Status.PASS)])
def test_verdict_is_unsure_only_for_the_bound_subject(doubtful: Run, subject: str, status: Status) -> None:
    assert check(replace(doubtful, facts=Facts(subject=subject)), "p1").status is status
