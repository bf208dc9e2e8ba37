"""Drivers that hang or do what no driver should: each costs its own items, as ERRORs that name it, and nobody else's."""

import json
from pathlib import Path
from typing import Any

import pytest

SESSION = """
    import collections, itertools, os, time
    import pytest
    import pytest_rvads as rvads

    class Odd(rvads.Reference):
        def control(self, seen):
            if seen.time > 0.05:
                {does}
            return super().control(seen)

    class TestOdd:
        rvads_autopilot = pytest.fixture(lambda self: Odd)

        @rvads.scenario("stop4", classes={classes}, grid="C", rules="p1", duration=2)
        def test_it(self, rule, monitor):
            monitor.check(rule)

    class TestSound:
        rvads_autopilot = pytest.fixture(lambda self: rvads.Reference)

        @rvads.scenario("stop4", classes=(1, 2), grid="C", duration=2)
        def test_it(self, run):
            assert run.duration == 2
"""


def session(pytester: pytest.Pytester, does: str, *options: str, classes: tuple[int, ...] = (1,)) -> list[dict[str, Any]]:
    """Run a session in a process of its own and return the records, those of the odd driver first."""
    pytester.makepyfile(test_it=SESSION.format(does=does, classes=classes))
    pytester.runpytest_subprocess("-p", "no:cacheprovider", "--rvads-report=out.json", *options, timeout=60)
    records: list[dict[str, Any]] = json.loads(Path(pytester.path / "out.json").read_text(encoding="utf-8"))["records"]
    return sorted(records, key=lambda record: "TestOdd" not in record["nodeid"])


def test_after_three_runs_that_were_too_late_a_driver_is_not_asked_again(pytester: pytest.Pytester) -> None:
    *odd, one, two = session(pytester, "time.sleep(600)", "--rvads-decision-limit=0.4", classes=(1, 2, 3, 4, 5))
    assert [record["status"] for record in odd] == ["ERROR"] * 5
    says = "Odd driving a0 at 0.06 s: no answer within 0.4 s of real time (--rvads-decision-limit), it was at test_it.py:8"
    assert [record["message"] for record in odd[:3]] == [f"ERROR: {says}"] * 3
    assert {record["message"] for record in odd[3:]} == {
        "test_it.Odd is not asked again: 3 runs in a row were too late, the last one because of this: " + says
    }
    assert (one["status"], two["status"]) == ("PASS", "PASS")


@pytest.mark.parametrize(
    "does",
    [
        pytest.param(
            "while True:\n                    try: time.sleep(1)\n                    except BaseException: pass", id="catches"
        ),
        pytest.param("collections.deque(itertools.repeat(0), maxlen=0)", id="in C"),
    ],
)
def test_what_nothing_stops_costs_its_worker_and_that_is_accounted_for(pytester: pytest.Pytester, does: str) -> None:
    odd, one, two = session(pytester, does, "--rvads-decision-limit=0.4", "-n1")
    assert (odd["status"], odd["outcome"]) == ("ERROR", "failed")
    assert "the worker process crashed" in odd["message"]
    assert (one["status"], two["status"]) == ("PASS", "PASS")


def test_pytests_own_timer_is_left_alone(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import faulthandler
        import pytest_rvads as rvads
        from pytest_rvads.simulators.choice import choice

        def test_it():
            assert choice().limits == (15.0, 7.0, None)
    """)
    result = pytester.runpytest("-o", "faulthandler_timeout=100", "--rvads-run-limit=7", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=1)
