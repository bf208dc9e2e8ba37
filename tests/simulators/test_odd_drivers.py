"""Drivers that raise, answer, measure or call themselves what they should not: an ERROR of their own runs, in clean words."""

import asyncio
import itertools
import json
import math
import re
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Control, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.geometry.finder import find
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

SPEED: Any = TargetSpeed
WAY: Any = Trajectory
SCENARIO = Scenario(find("stop4"), "1231", distance=20, duration=0.1)


def answering(answer: Callable[[], Any]) -> Any:
    class Odd:
        def control(self, seen: Observation) -> Any:
            return answer() if seen.me.name == "a1" and seen.time > 0.03 else Control(brake=1.0)

    return Odd


ESCAPES: list[BaseException | type[BaseException]] = [
    asyncio.CancelledError,
    SystemExit(0),
    GeneratorExit,
    StopIteration,
    RecursionError("deep"),
    MemoryError,
    pytest.skip.Exception("skipped"),
    pytest.xfail.Exception("expected"),
    pytest.fail.Exception("failed"),
    pytest.exit.Exception("the end", 0),
]


@pytest.mark.parametrize("error", ESCAPES, ids=lambda error: getattr(error, "__name__", type(error).__name__))
@pytest.mark.parametrize("where", ["factory", "__init__", "autopilots", "control", "period"])
def test_driver_exception_stays_within_the_run(error: Any, where: str) -> None:
    def escape(*_: Any) -> NoReturn:
        raise error

    body = {"control": lambda self, seen: Control()} | {where: property(escape) if where == "period" else escape}
    run = simulate(Case(SCENARIO, escape if where == "factory" else type("Escapes", (), body)))
    assert run.fault is not None
    assert run.fault.agent == "a0"
    assert re.search(rf"(Escapes|escape).* raised {getattr(error, '__name__', type(error).__name__)}\b", run.fault.reason)
    assert Path(__file__).name in run.fault.reason


class EvilText(str):
    def __str__(self) -> NoReturn:
        raise SystemExit(0)


class Untold(Exception):
    def __str__(self) -> NoReturn:
        raise OSError("no text")


@pytest.mark.parametrize("error", [Untold(), ValueError("\x1b[2J\u202e\ud800 bell\a"), ValueError("x" * 80_000_000)])
def test_exception_text_is_printable_and_bounded(error: Exception) -> None:
    class Raises:
        def control(self, seen: Observation) -> Control:
            raise error

    fault = simulate(Case(SCENARIO, Raises)).fault
    assert fault is not None
    assert f"Raises driving a0 raised {type(error).__name__}: " in fault.reason
    assert len(fault.reason) < 1000
    assert fault.reason.isprintable()


@pytest.mark.extended
@pytest.mark.parametrize(
    ("label", "called"),
    [
        ("\x1b[31mred\x07\n", r"\x1b[31mred\x07"),
        ("x" * 80_000_000, None),
        (EvilText("evil"), "Labelled"),
        (property(lambda _: 1 / 0), "Labelled"),
        (property(lambda _: pytest.skip("no name")), "Labelled"),
    ],
    ids=["control", "long", "no text", "raises", "skips"],
)
def test_a_label_is_a_line_of_a_name_at_most(label: Any, called: str | None) -> None:
    class Labelled:
        def control(self, seen: Observation) -> Control:
            raise ValueError("it")

    Labelled.label = label  # type: ignore[attr-defined]
    run = simulate(Case(SCENARIO, Labelled))
    assert run.fault is not None
    assert run.fault.reason.isprintable()
    assert len(run.fault.reason) < 1500
    assert called is None or called in run.fault.reason
    assert len(run.provenance["autopilot"]) < 1500


class Evil(float):
    def __float__(self) -> float:
        raise KeyError("no number")

    def __le__(self, other: object) -> NoReturn:
        raise LookupError

    __lt__ = __ge__ = __gt__ = __le__


def endless() -> Any:
    yield from (Waypoint(float(k), 0.0, 0.0) for k in itertools.count())


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda: Control(10**400), "returned throttle inf, expected a finite number"),
        (lambda: SPEED(Fraction(10**400)), "returned a target speed inf, expected a finite number"),
        (lambda: SPEED(Decimal(3)), "returned a target speed of type Decimal, expected a number"),
        (lambda: SPEED(3j), "returned a target speed of type complex, expected a number"),
        (lambda: SPEED(np.array([1.0])), "returned a target speed of type ndarray, expected a number"),
        (lambda: SPEED(Evil(3)), "raised KeyError: 'no number'"),
        (lambda: tuple.__new__(Control, (1.0, 2.0)), "raised ValueError"),
        (lambda: tuple.__new__(TargetSpeed, ()), "raised IndexError"),
        (lambda: WAY(endless()), "returned a trajectory of more than 10,000 points"),
        (lambda: WAY([(0.0, 0.0, 0.0)] * 1_000_000), "comes at 0 s, not after the one before it"),
        (lambda: WAY(((0.0, 1.0), (1.0, 2.0))), "point 0 is of type tuple, expected (time, x, y)"),
        (lambda: WAY(((0.0, 1.0, 10**400), (1.0, 2.0, 3.0))), "point 0 has y inf, expected a finite number"),
        (lambda: type("\x1b[2J" * 1000, (), {})(), r"returned an object of type \x1b[2J"),
    ],
    ids=itertools.count(),
)
def test_invalid_answer_names_driver_vehicle_and_time(answer: Any, words: str) -> None:
    fault = simulate(Case(SCENARIO, answering(answer))).fault
    assert fault is not None
    assert (fault.agent, fault.time) == ("a1", pytest.approx(0.04))
    assert f"{answering(answer).__qualname__} driving a1 " in fault.reason
    assert "at 0.04 s" in fault.reason
    assert words in fault.reason
    assert fault.reason.isprintable()
    assert len(fault.reason) < 10_000


def test_a_trajectory_from_a_generator_is_driven_like_the_same_in_a_tuple() -> None:
    def points(seen: Observation) -> Any:
        return (Waypoint(seen.time + k, seen.me.x, seen.me.y) for k in range(3))

    class Lazy:
        period = 0.05

        def control(self, seen: Observation) -> Trajectory:
            return Trajectory(self.kind(points(seen)))

        kind: Any = staticmethod(lambda found: found)

    eager = type("Eager", (Lazy,), {"kind": staticmethod(tuple)})
    assert simulate(Case(SCENARIO, Lazy)).hash == simulate(Case(SCENARIO, eager)).hash


@pytest.mark.parametrize(
    ("told", "kept"),
    [
        ({"planner_ms": 1.5}, {"planner_ms": 1.5}),
        ({"stack": "mine", "decisions": 3, "compute": np.float64(0.5)}, {"stack": "mine", "decisions": 3, "compute": 0.5}),
        ({"\x1b[31m": 1, 3: 2.0, "big": "x" * 1000, "bad": math.nan, "set": {1}, "none": None}, None),
        (object(), {}),
        ({1, 2}, {}),
        (np.zeros(3), {}),
        ([("compute", 1.0)], {}),
        ({"huge": 10**400}, {}),
        ({"evil": Evil(1)}, {}),
    ],
    ids=itertools.count(),
)
def test_what_an_autopilot_measured_is_kept_as_plain_numbers_and_texts(told: Any, kept: dict[str, Any] | None) -> None:
    class Measures:
        def control(self, seen: Observation) -> Control:
            return Control(brake=1.0)

        def timing(self) -> Any:
            return told

    run = simulate(Case(SCENARIO, Measures))
    assert run.fault is None
    timing = run.provenance.get("timing", {}).get("a0", {})
    assert json.loads(json.dumps(timing, allow_nan=False)) == timing
    assert timing == kept if kept is not None else list(timing)[:3] == [r"\x1b[31m", "3", "big"] and len(timing["big"]) < 500
