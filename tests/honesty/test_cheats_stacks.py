"""Controllers that attack the tool instead of the junction: raise at the right moment, change what they see, know the test."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

import pytest_rvads as rvads

from .attempts import Session, statuses
from .cases import Case, at, told, verdicts
from .drivers import beside, paced
from .shown import shows, shows_each

ALONE = at("stop4", "2000", distance=5.0, duration=12)
Racer = paced(lambda _: 8.0)


class RaisesLater(Racer):  # type: ignore[misc,valid-type]
    """Runs the sign, and breaks down when it is through."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        if seen.me.station > 5.0:
            raise RuntimeError("nothing to see here")
        return super().control(seen)


class NanLater(Racer):  # type: ignore[misc,valid-type]
    """Likewise with a command that is none."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        return rvads.Control(math.nan) if seen.me.station > 5.0 else super().control(seen)


@shows_each({"raise_after_the_violation": RaisesLater, "nan_after_the_violation": NanLater})
def test_what_was_broken_stays_broken(case: Callable[[], Any]) -> None:
    """The sign was run before the fault; of all else nobody knows what would have come."""
    run = Case(ALONE, case, {}).run()
    assert run.fault is not None
    found = verdicts(run)
    assert found.pop("full_stop") == "FAIL a0"
    assert set(found.values()) == {"ERROR"}


def changes(seen: rvads.Observation, what: str) -> None:
    """Change what a controller is shown, by all means that Python has."""
    with contextlib.suppress(Exception):
        if what == "junction":
            seen.junction.movements.clear()  # type: ignore[attr-defined]
        elif what == "vehicle":
            object.__setattr__(seen.vehicle, "width", 0.1)
            object.__setattr__(seen.vehicle, "length", 3.0)
        else:
            points = seen.itinerary.path.points
            points.setflags(write=True)
            points += 4.0


@dataclass(frozen=True, slots=True)
class Change:
    """What is changed, the driving that it is to hide, and the rule that forbids this."""

    what: str
    driver: Callable[[], Any]
    rule: str


@shows_each(
    {
        "clear_the_junction": Change("junction", Racer, "full_stop"),
        "bend_the_itinerary": Change("itinerary", Racer, "full_stop"),
        "shrink_the_vehicle": Change("vehicle", beside(1.5), "keep_lane"),
    }
)
def test_changing_what_is_shown_changes_no_verdict(case: Change) -> None:
    honest = case.driver

    class Changes(honest):  # type: ignore[misc,valid-type]
        def control(self, seen: rvads.Observation) -> rvads.Control:
            changes(seen, case.what)
            answer: rvads.Control = super().control(seen)
            return answer

    for driver in (honest, Changes, honest):
        assert told(rvads.check(Case(ALONE, driver, {}).run(), case.rule)) == "FAIL a0"


INSIDE = """
class Quits(rvads.Reference):
    def control(self, seen):
        if seen.time > 0.2:
            {quits}
        return super().control(seen)

@pytest.fixture
def rvads_autopilot(request):
    return Quits if "quits" in request.function.__name__ else rvads.Reference

@here()
def test_quits(run, rule, monitor):
    monitor.check(rule)

@here(duration=15)
def test_stays(run, rule, monitor):
    monitor.check(rule)
"""


@shows_each(
    {"skip_inside": "pytest.skip('not now')", "xfail_inside": "pytest.xfail('known')", "exit_inside": "raise SystemExit(0)"}
)
def test_a_controller_can_t_end_its_test(case: str, session: Session, pytester: pytest.Pytester) -> None:
    """Two tests: what the controller of one raises is an error of it, and the other one passes."""
    result = session(INSIDE.format(quits=case))
    result.assert_outcomes(errors=1, passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert statuses(pytester) == ["ERROR", "PASS"]


NAMED = """
class KnowsItsPlace(rvads.Reference):
    def control(self, seen):
        if seen.me.name == "a0":
            return super().control(seen)
        return self.drive(seen, self.towards(seen, 8.0))

@pytest.fixture
def rvads_autopilot():
    return KnowsItsPlace

@here(classes=None, scenarios="1111", subject={seats}, rules="full_stop", grid="C", duration=15)
def test_it(run, rule, monitor):
    monitor.check(rule)
"""


@shows("behave_in_seat_0_only")
def test_every_seat_is_tried(session: Session, pytester: pytest.Pytester) -> None:
    """It behaves where it is called a0, the seat of most examples; a scenario where it starts at another entrance tells."""
    session(NAMED.format(seats=0))
    assert statuses(pytester) == ["PASS"]
    result = session(NAMED.format(seats=1))
    result.assert_outcomes(failed=1)
    assert statuses(pytester) == ["FAIL"]


MOODY = """
class Moody(rvads.Follower):
    runs = 0

    def __init__(self):
        Moody.runs += 1
        if Moody.runs > 4:
            {again}

    def target_speed(self, seen):
        return 8.0 if Moody.runs <= 4 else 4.0

    def broken(self):
        raise {error}("asked again")

@pytest.fixture
def rvads_autopilot(request):
    return Moody if "moody" in request.function.__name__ else rvads.Reference

@here()
def test_moody(run, rule, monitor):
    monitor.check(rule)

@here(duration=15)
def test_steady(run, rule, monitor):
    monitor.check(rule)
"""


@shows_each(
    {
        "drive_otherwise_every_time": ("pass", "OSError"),
        "break_the_diagnosis": ("self.timing = self.broken", "OSError"),
        "exit_in_the_diagnosis": ("self.timing = self.broken", "SystemExit"),
    }
)
def test_a_run_that_can_t_be_repeated_stays_failed(case: tuple[str, str], session: Session, pytester: pytest.Pytester) -> None:
    """The run of a failed item is simulated once more: that it comes out otherwise, or not at all, costs no verdict."""
    again, error = case
    result = session(MOODY.format(again=again, error=error))
    assert statuses(pytester) == ["FLAKY", "PASS"]
    result.assert_outcomes(failed=1, passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED


TIMED = """
from conftest import Racer

class Timed(Racer):
    def timing(self):
        return {what}

@pytest.fixture
def rvads_autopilot():
    return Timed

@here()
def test_it(run, rule, monitor):
    monitor.check(rule)
"""


@shows("hand_in_nonsense_for_the_report")
def test_nonsense_for_the_report_costs_no_verdict(session: Session, pytester: pytest.Pytester) -> None:
    """What a controller says of its computing times is for a table of the report, which is written all the same."""
    result = session(TIMED.format(what="{'none': 'of your business'}"))
    assert statuses(pytester) == ["FAIL"]
    assert result.ret == pytest.ExitCode.TESTS_FAILED


ENDS = """
import os

class Ends(rvads.Reference):
    def control(self, seen):
        if seen.time > 0.2:
            os._exit(0)
        return super().control(seen)

@pytest.fixture
def rvads_autopilot():
    return Ends

@here()
def test_it(run, rule, monitor):
    monitor.check(rule)

def test_plain(): ...
"""


@pytest.mark.extended
@shows("end_the_process")
def test_a_process_that_ended_is_an_error(session: Session, pytester: pytest.Pytester) -> None:
    """The exit status of a worker of pytest-xdist is 0, as if all had been well."""
    result = session(ENDS, "-n", "1")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert statuses(pytester) == ["ERROR"]
