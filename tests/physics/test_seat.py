"""Autopilots at the edge: faults become faults of the run, periods are held, subjects and traffic have seats."""

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Acceleration, Autopilot, Control, Observation, TrafficSystem
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.lane import MAX_OFFSET, off_route
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import AutopilotError, ScenarioError

SCENARIO = Scenario(find("stop4"), "1231", distance=20, duration=0.1)


def answering(answer: Any, after: float = 0.03, who: str = "a1") -> Any:
    class Odd:
        def control(self, seen: Observation) -> Any:
            return answer if seen.me.name == who and seen.time > after else Control(brake=1.0)

    return Odd


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "of type NoneType, expected a Control or TargetSpeed or Acceleration or Trajectory"),
        ((0.0, 0.0, 0.0), "of type tuple, expected a Control"),
        (Control(math.nan), "returned throttle nan, expected a finite number"),
        (Control(0.0, math.inf), "returned brake inf, expected a finite number"),
        (Control(0.0, 0.0, "left"), "returned a steering of type str, expected a number"),  # type: ignore[arg-type]
        (Control(1.2), "returned throttle 1.2, expected 0..1"),
        (Control(0.0, -0.1), "returned brake -0.1, expected 0..1"),
        (Control(0.0, 0.0, 30.0), "returned steering 30, expected radians"),
    ],
)
def test_an_answer_that_is_no_control_ends_the_run(answer: Any, words: str) -> None:
    run = simulate(Case(SCENARIO, answering(answer)))
    assert run.fault is not None
    assert run.fault.agent == "a1"
    assert run.fault.time == pytest.approx(0.04)
    assert run.fault.reason.startswith(f"{answering(answer).__qualname__} driving a1 at 0.04 s ")
    assert words in run.fault.reason
    assert run.steps == 5, "the states up to there are kept"
    assert run.provenance["end"] == "fault"


@pytest.mark.parametrize(
    "answer",
    [
        Control(1, 0, 0),
        Control(np.float32(0.5), np.float64(0.0), np.int64(0)),  # type: ignore[arg-type]
        Control(1.0 + 1e-9, -1e-9, 1.5),
        Control(0.0, True),
    ],
)
def test_numbers_of_any_kind_are_fine(answer: Control) -> None:
    run = simulate(Case(SCENARIO, answering(answer)))
    assert run.fault is None
    assert ((run.controls[..., :2] >= 0) & (run.controls[..., :2] <= 1)).all()


def test_driver_exception_becomes_a_fault_with_file_and_time() -> None:
    class Broken:
        def control(self, seen: Observation) -> Control:
            if seen.me.name == "a2" and seen.time > 0.015:
                raise ZeroDivisionError("no\nway")
            return Control()

    run = simulate(Case(SCENARIO, Broken))
    assert run.fault.agent == "a2"
    assert run.fault.time == pytest.approx(0.02)
    assert f"{Broken.__qualname__} driving a2 raised ZeroDivisionError: no way ({Path(__file__).name}:" in run.fault.reason
    assert run.fault.reason.endswith("at 0.02 s")


@pytest.mark.parametrize(
    ("told", "detail"),
    [
        (lambda: 3, "3"),
        (lambda: None, ""),
        (lambda: 10_000 * "x" + "end", 4093 * "x" + "end"),
        (lambda: 1 / 0, "abandon raised ZeroDivisionError: division by zero"),
        (lambda: pytest.skip("not today"), "abandon raised Skipped: not today"),
    ],
)
def test_errors_of_abandon_become_the_detail_of_the_fault(told: Any, detail: str) -> None:
    class Odd(answering(3)):  # type: ignore[misc]
        def abandon(self) -> Any:
            return told()

    fault = simulate(Case(SCENARIO, Odd)).fault
    assert fault is not None
    assert "returned an object of type int, expected a Control" in fault.reason
    assert fault.detail.partition(" (")[0] == detail, "but for the place"


def test_interrupts_pass() -> None:
    class Interrupted:
        def control(self, seen: Observation) -> Control:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(Case(SCENARIO, Interrupted))
    assert simulate(Case(SCENARIO, answering(Control()))).fault is None, "the next run is not disturbed"


def test_driver_without_control_is_a_fault_at_the_start() -> None:
    def broken() -> NoReturn:
        raise OSError("no such model")

    factories: list[tuple[Any, str]] = [(broken, "raised OSError: no such model"), (object, "needs a method control")]
    for factory, words in factories:
        run = simulate(Case(SCENARIO, factory))
        assert run.fault.time == 0.0
        assert run.fault.agent == "a0"
        assert words in run.fault.reason
        assert run.steps == 1


def test_an_instance_is_refused() -> None:
    with pytest.raises(AutopilotError, match="pass the class, not an instance"):
        simulate(Case(SCENARIO, answering(Control())()))


def test_autopilots_are_made_once_per_vehicle_in_creation_order() -> None:
    made: list[tuple[str, Any]] = []

    class Counted:
        def __init__(self, label: str) -> None:
            self.number = len(made)
            made.append((label, self))

        def control(self, seen: Observation) -> Control:
            assert made[self.number][1] is self
            order.setdefault(seen.me.name, self.number)
            return Control(brake=1.0)

    order: dict[str, int] = {}
    run = simulate(Case(Scenario(find("stop4"), "1231", rotation=1, duration=0.05), functools.partial(Counted, "x")))
    assert order == {"a1": 0, "a2": 1, "a3": 2, "a0": 3}
    assert run.provenance["autopilot"].endswith("Counted")


def test_a_period_holds_the_last_answer() -> None:
    class Slow:
        period = 0.03

        def __init__(self) -> None:
            self.calls = 0

        def control(self, seen: Observation) -> Control:
            self.calls += 1
            return Control(self.calls / 100)

    run = simulate(Case(SCENARIO, Slow))
    assert run.controls[:10, 0, 0] == pytest.approx([0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.03, 0.03, 0.03, 0.04])


@pytest.mark.parametrize("period", [0.0, 0.015, -0.01, math.nan, "0.1", True])
def test_period_must_be_a_multiple_of_the_time_step(period: Any) -> None:
    slow = type("Slow", (), {"period": period, "control": lambda self, seen: Control()})
    run = simulate(Case(SCENARIO, slow))
    assert "its period must be a whole multiple of 0.01 s" in run.fault.reason


def test_a_traffic_system_is_made_once_and_coordinates_all() -> None:
    systems = []

    class Convoy(TrafficSystem):
        def __init__(self) -> None:
            systems.append(self)
            self.asked: list[str] = []

        def autopilots(self, agents: Sequence[Agent]) -> list[Any]:
            self.agents = [a.name for a in agents]
            convoy = self

            class Member:
                def control(self, seen: Observation) -> Control:
                    convoy.asked.append(seen.me.name)
                    return Control()

            return [Member() for _ in agents]

    run = simulate(Case(Scenario(find("stop4"), "1231", rotation=3, duration=0.02), Convoy))
    assert run.fault is None
    assert len(systems) == 1
    assert systems[0].agents == ["a3", "a0", "a1", "a2"]
    assert systems[0].asked == systems[0].agents * 2


def test_traffic_system_gets_the_junction_before_it_makes_autopilots() -> None:
    calls: list[Any] = []

    class Mapped(TrafficSystem):
        def prepare(self, junction: Junction) -> None:
            calls.append(junction)

        def autopilots(self, agents: Sequence[Agent]) -> list[Any]:
            calls.append(len(agents))
            return [answering(Control())() for _ in agents]

    class Lost(Mapped):
        def prepare(self, junction: Junction) -> None:
            raise KeyError(junction.name)

    assert simulate(Case(SCENARIO, Mapped)).fault is None
    assert calls == [SCENARIO.place, 4]
    run = simulate(Case(SCENARIO, Lost))
    assert "Lost.prepare raised KeyError: 'stop4'" in run.fault.reason


def test_acceleration_beyond_the_limits_saturates_and_is_counted() -> None:
    """The usual vehicle accelerates with 3 m/s^2, and brakes with 4 m/s^2 at aggression 1 and 8 m/s^2 at aggression 3."""

    def drive(*accelerations: float, aggression: int = 1) -> Run:
        class Rough:
            def __init__(self) -> None:
                self.wanted = iter(accelerations)

            def control(self, seen: Observation) -> Acceleration:
                return Acceleration(next(self.wanted))

        scenario = Scenario(find("stop4"), "2000", distance=60, speed=8, duration=0.04, aggression=aggression)
        return simulate(Case(scenario, Rough))

    fast, hard = drive(3.5, 3.5, 3.5, 3.5), drive(1e9, 1e9, 1e9, 1e9)
    assert hard.fault is None
    assert fast.hash == hard.hash, "full throttle is full throttle"
    assert fast.provenance["excess"] == {"a0": {"requests": 4, "largest": 3.5}}
    mixed = drive(3.0, 5.0, -4.0, -7.0)
    assert mixed.provenance["excess"] == {"a0": {"requests": 2, "largest": -7.0}}
    assert "excess" not in drive(3.0, 0.0, -4.0, -8.0, aggression=3).provenance
    assert "excess" not in simulate(Case(SCENARIO, answering(Control()))).provenance


def test_traffic_system_with_missing_autopilots_is_a_fault() -> None:
    class Forgetful:
        def autopilots(self, agents: Sequence[Agent], /) -> list[Autopilot]:
            return []

    run = simulate(Case(SCENARIO, Forgetful))
    assert "returned 0 autopilots, expected one for each of 4 agents" in run.fault.reason
    assert run.fault.agent == "a0"


def test_autopilot_drives_the_subject_and_traffic_the_other_vehicles() -> None:
    seats: dict[str, str] = {}

    class Mine:
        def control(self, seen: Observation) -> Control:
            seats[seen.me.name] = type(self).__name__
            return Control()

    class Theirs(Mine):
        pass

    run = simulate(Case(Scenario(find("stop4"), "1231", subject=2, duration=0.02), Mine, traffic=Theirs))
    assert seats == {"a0": "Theirs", "a1": "Theirs", "a2": "Mine", "a3": "Theirs"}
    assert run.provenance["autopilot"].endswith("Mine")
    assert run.provenance["traffic"].endswith("Theirs")


def test_traffic_needs_a_subject() -> None:
    drive = answering(Control())
    with pytest.raises(ScenarioError, match="give the scenario a subject"):
        simulate(Case(SCENARIO, drive, traffic=drive))


@pytest.mark.parametrize("side", [1, -1])
def test_leaving_the_route_ends_the_run_and_is_driving(side: int) -> None:
    class Lost:
        def control(self, seen: Observation) -> Control:
            return Control(1.0, 0.0, 0.3 * side)

    run = simulate(Case(Scenario(find("stop4"), "2000", distance=60, speed=8), Lost))
    assert (run.fault, run.provenance["end"], run.facts.strayed) == (None, "route", ("a0",))
    assert run.steps > 50
    off = off_route(run, 0)
    assert off[-1]
    assert not off[:-1].any(), "it ends with the first state off the route"
    way = itinerary(run.junction, 0, 2)
    x, y, _ = run.pose[-1, 0]
    assert way.project(x, y, run.station[-1, 0])[1] * side > MAX_OFFSET
