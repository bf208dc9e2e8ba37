"""Limits of real time: what takes too long ends its own run, wherever it hangs, and disturbs nothing else."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.simulators import patience
from pytest_rvads.simulators.patience import USUAL, Watch
from pytest_rvads.simulators.simulator import Choice, simulate

SCENARIO = rvads.Scenario(rvads.find("stop4"), "1231", distance=20, duration=0.1)
FILE = __file__.rpartition("/")[2]


def brakes(_seen: rvads.Observation) -> rvads.Control:
    return rvads.Control(brake=1.0)


def pilot(**abilities: Any) -> Any:
    """Return a class of autopilots that brake, with abilities of one's own: properties, or functions of what they are given."""
    own = {name: done if isinstance(done, property) else staticmethod(done) for name, done in abilities.items()}
    return type("Pilot", (), {"control": staticmethod(brakes)} | own)


def hanging(wait: Callable[[], Any], when: float = 0.03) -> Any:
    class Hangs:
        def control(self, seen: rvads.Observation) -> rvads.Control:
            if seen.time > when and seen.me.name == "a1":
                wait()
            return rvads.Control(brake=1.0)

    return Hangs


def run(driver: Any, decision: float = 0.2, longest: float = 0.0, scenario: rvads.Scenario = SCENARIO) -> rvads.Run:
    return simulate(rvads.Case(scenario, driver), rvads.limits(decision, longest))


def loops() -> None:
    while True:
        pass


def sleeps() -> None:
    time.sleep(600)


def deadlocks() -> None:
    lock = threading.Lock()
    with lock:
        lock.acquire()


def waits_for_a_thread() -> None:
    threading.Event().wait()


def catches_everything() -> None:
    with suppress(BaseException):
        sleeps()


def catches_everything_a_few_times() -> None:
    for _ in range(3):
        catches_everything()


@pytest.mark.parametrize(
    "wait", [loops, sleeps, deadlocks, waits_for_a_thread, catches_everything, catches_everything_a_few_times]
)
def test_hanging_driver_is_a_fault_with_vehicle_time_and_line(wait: Any) -> None:
    found = run(hanging(wait))
    assert found.fault is not None
    assert (found.fault.agent, found.fault.time, found.provenance["end"]) == ("a1", pytest.approx(0.04), "late")
    assert found.fault.reason.startswith(
        "hanging.<locals>.Hangs driving a1 at 0.04 s: no answer within 0.2 s of real time (setting rvads_decision_limit), "
        f"it was at {FILE}:"
    )
    assert found.steps == 5, "what was sampled is kept"


def test_fault_names_the_line_of_the_driver_and_not_of_a_library() -> None:
    line = waits_for_a_thread.__code__.co_firstlineno + 1
    fault = run(hanging(waits_for_a_thread)).fault
    assert fault is not None
    assert fault.reason.endswith(f"{FILE}:{line}")


@pytest.mark.parametrize(
    ("driver", "doing"),
    [
        pytest.param(sleeps, "making sleeps for a0", id="factory"),
        pytest.param(type("Pilot", (pilot(),), {"__init__": lambda _: sleeps()}), "making Pilot for a0", id="class"),
        pytest.param(pilot(period=property(lambda _: sleeps())), "making Pilot for a0", id="period"),
        pytest.param(pilot(label=property(lambda _: sleeps())), "making Pilot for a0", id="label"),
        pytest.param(pilot(autopilots=lambda _: sleeps()), "Pilot.autopilots", id="system"),
    ],
)
def test_every_other_call_into_a_driver_has_the_same_limit(driver: Any, doing: str) -> None:
    fault = run(driver).fault
    assert fault is not None
    assert fault.reason.startswith(f"{doing}: no answer within 0.2 s of real time")


def test_hanging_timing_loses_only_the_timing() -> None:
    found = run(pilot(timing=sleeps))
    assert found.fault is None
    assert "timing" not in found.provenance


def test_hanging_abandon_does_not_delay_the_fault() -> None:
    fault = run(pilot(control=lambda _: None, abandon=sleeps)).fault
    assert fault is not None
    assert "returned an object of type NoneType" in fault.reason
    assert fault.detail.startswith("abandon raised TooLate")


def test_a_run_has_a_limit_too_however_quick_its_decisions_are() -> None:
    found = run(hanging(lambda: time.sleep(0.02), 0.0), 0.0, 0.3, SCENARIO.but(duration=60))
    assert found.fault is not None
    assert "the run took longer than 0.3 s of real time (setting rvads_run_limit), it was at " in found.fault.reason
    assert found.provenance["end"] == "late"


def test_limit_of_zero_is_no_limit() -> None:
    found = run(hanging(lambda: time.sleep(0.1)), 0.0, 0.0)
    assert found.fault is None


def test_slow_decision_within_the_limit_changes_no_run() -> None:
    assert run(hanging(lambda: time.sleep(0.1)), 2.0).hash == run(pilot(), 0.0).hash


def test_limits_belong_to_a_simulator() -> None:
    quick = rvads.limits(decision=60.0, simulator=rvads.mujoco)
    assert quick == Choice(rvads.mujoco, USUAL._replace(decision=60.0))
    assert Choice.of(quick, USUAL._replace(run=1.0)) == quick, "a session's limits are for simulators without limits"
    assert Choice.of(rvads.mujoco) == Choice(rvads.mujoco, USUAL)
    assert rvads.limits(run=0.0, simulator=Choice(rvads.mujoco, USUAL._replace(dump=7))).limits == (15.0, 0.0, 7)
    for wrong in (-1.0, float("nan"), float("inf"), "1"):
        with pytest.raises(rvads.errors.ScenarioError, match="takes a number of seconds, 0 for no limit"):
            rvads.limits(decision=wrong)  # type: ignore[arg-type]


def test_file_descriptor_of_a_choice_stays_in_its_process() -> None:
    for dump, there in ((7, None), (None, None), (patience.NEVER, patience.NEVER)):
        sent = pickle.loads(pickle.dumps(Choice(rvads.limits().simulator, USUAL._replace(dump=dump))))
        assert sent.limits == USUAL._replace(dump=there)


def test_hanging_simulator_is_an_error() -> None:
    class Stuck:
        name = "stuck"

        def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
            time.sleep(600)
            raise AssertionError

        def vmax(self, distance: float, aggression: int = 1, vehicle: Any = None) -> float | None:
            return None

    with pytest.raises(rvads.errors.RunError, match=r"'stuck' at stop4-.*: the run took longer than 0.3 s"):
        simulate(rvads.Case(SCENARIO, pilot()), rvads.limits(run=0.3, simulator=Stuck()))


def test_simulating_driver_is_interrupted_by_its_own_limit() -> None:
    def dreams() -> None:
        simulate(rvads.Case(SCENARIO, hanging(sleeps)), rvads.limits(0.0, 0.0))

    found = run(hanging(dreams))
    assert found.fault is not None
    assert "driving a1 at 0.04 s: no answer within 0.2 s" in found.fault.reason


def test_limits_hold_in_other_threads() -> None:
    found: list[rvads.Run] = []
    thread = threading.Thread(target=lambda: found.append(run(hanging(loops))))
    thread.start()
    thread.join(30)
    assert found
    assert found[0].provenance["end"] == "late"


@pytest.mark.extended
def test_an_alarm_of_somebody_else_rings_in_time_and_stays_set() -> None:
    """As that of pytest-timeout."""
    rung: list[float] = []
    began = time.monotonic()
    before = signal.signal(signal.SIGALRM, lambda number, frame: rung.append(time.monotonic() - began))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        run(hanging(sleeps), 0.5)
        assert len(rung) == 1
        assert 0.1 <= rung[0] < 0.4
        signal.setitimer(signal.ITIMER_REAL, 100)
        run(hanging(sleeps))
        assert 90 < signal.getitimer(signal.ITIMER_REAL)[0] < 100
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_a_driver_may_have_an_alarm_of_its_own() -> None:
    def times_itself_and_sleeps() -> None:
        before = signal.signal(signal.SIGALRM, lambda *_: None)
        signal.setitimer(signal.ITIMER_REAL, 0.01)
        time.sleep(0.02)
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        sleeps()

    found = run(hanging(times_itself_and_sleeps))
    assert found.provenance["end"] == "late"


def test_ctrl_c_ends_a_driver_that_hangs_at_once() -> None:
    def interrupted() -> None:
        threading.Timer(0.1, lambda: signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)).start()
        sleeps()

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background, shells have it ignored
    try:
        with pytest.raises(KeyboardInterrupt):
            run(hanging(interrupted), 60.0)
    finally:
        signal.signal(signal.SIGINT, before)
    assert run(pilot()).fault is None, "the next run is not disturbed"


def test_who_debugs_may_take_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "_DEBUGGERS", {__name__.partition(".")[0]})
    assert run(hanging(lambda: time.sleep(0.6), 0.085)).fault is None


def test_nothing_is_left_behind() -> None:
    before = signal.getsignal(signal.SIGURG)
    run(hanging(sleeps))
    assert signal.getsignal(signal.SIGURG) is before
    for _ in range(100):
        if not any(thread.name == "rvads limits" for thread in threading.enumerate()):
            break
        time.sleep(0.05)
    else:
        pytest.fail("the thread that looks at runs outlives them")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no process can be forked")
def test_process_forked_in_a_run_does_not_wait_for_the_timer_of_its_parent() -> None:
    choice = Choice(rvads.limits().simulator, USUAL._replace(dump=2))
    statuses: list[int] = []

    def nests() -> None:
        simulate(rvads.Case(SCENARIO, pilot()), choice)

    def forks() -> None:
        if (child := os.fork()) == 0:
            os._exit(7 if simulate(rvads.Case(SCENARIO, hanging(nests, when=0.085)), choice).fault is None else 8)
        for _ in range(1000):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                statuses.append(os.waitstatus_to_exitcode(status))
                return
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)

    simulate(rvads.Case(SCENARIO, hanging(forks, when=0.085)), choice)
    assert statuses == [7]


@pytest.mark.extended
def test_a_late_thread_leaves_nothing_pending_in_the_interpreter() -> None:
    """Under 3.11 a traced call never returns while an exception waits for a thread that does not take it."""
    program = """
import sys, threading
import pytest_rvads as rvads

class Loops:
    def control(self, seen):
        while True:
            pass

def run():
    case = rvads.Case(rvads.Scenario(rvads.find("stop4"), "1231", duration=0.1), Loops)
    assert rvads.simulate(case, rvads.limits(decision=0.3)).fault

thread = threading.Thread(target=run)
thread.start()
thread.join()
sys.settrace(lambda *_: None)
(lambda: None)()
"""
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)
