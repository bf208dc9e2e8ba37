"""Runs in SUMO start as the case says, are reproducible, and end with a fault if SUMO fails."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from math import ceil
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.logic.conduct.bodies import overlap
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.sumo import sumo_process, sumo_simulator
from pytest_rvads.satellites.sumo.sumo_process import SumoProcess
from pytest_rvads.simulators.loop import usual
from pytest_rvads.support.errors import ScenarioError

from .with_sumo import needs_sumo, simulated

pytestmark = needs_sumo

PRINT = """
import pytest_rvads as rvads
scenario = rvads.Scenario(rvads.find("stop4"), "1133", distance=20.0, speed=10.0)
print(rvads.simulate(rvads.Case(scenario, rvads.traffic("sumo")), rvads.sumo).hash)
"""


class Rammer(rvads.Follower):
    """Follows its way and ignores all other vehicles."""

    def target_speed(self, _seen: rvads.Observation) -> float:
        return 8.0


class Stuck(Rammer):
    """Stops in the middle of the junction."""

    def target_speed(self, seen: rvads.Observation) -> float:
        return 8.0 if seen.me.station < 8.0 else 0.0


def among(directions: str, driver: Any, traffic: Any, simulator: rvads.Simulator = rvads.sumo, **more: Any) -> rvads.Run:
    scenario = rvads.Scenario(rvads.find("stop4"), directions, **{"subject": 0, "distance": 20.0, **more})
    return rvads.simulate(rvads.Case(scenario, driver, traffic=traffic), simulator)


def entered(run: rvads.Run) -> list[int]:
    """Return per agent the tick at which it enters the junction."""
    return [int(np.argmax(run.zone[:, k] == rvads.Zone.JUNCTION)) for k in range(len(run.agents))]


@pytest.mark.extended
@pytest.mark.parametrize("place", ["stop4", "lanes4", "roundabout4"])
def test_first_state_is_the_start_of_the_case(place: str) -> None:
    junction = rvads.find(place)
    codes = [junction.directions(entrance)[-1] for entrance in range(len(junction.entrances))]
    run = simulated(junction, codes, distance=[3.0 + k for k in range(len(codes))], speed=0.5)
    lines = np.array([-junction.setbacks[agent.entrance] for agent in run.agents])
    assert run.station[0] == pytest.approx(lines - [3.0 + agent.entrance for agent in run.agents], abs=1e-5)
    assert run.need("speed")[0] == pytest.approx(0.5, abs=1e-9)


def test_too_fast_start_of_a_sumo_driver_is_refused() -> None:
    with pytest.raises(
        rvads.errors.RunError, match=r"^SUMO lets a0 depart at \(1.75, -75.00\) with 11.18 m/s, expected .* with 15.00 m/s"
    ):
        simulated("stop4", "2000", distance=60.0, speed=15.0)
    run = among("2020", rvads.Reference, rvads.traffic("sumo"), distance=60.0, speed=[15.0, 0.0, 5.0, 0.0])
    assert run.fault is None
    assert run.need("speed")[0] == pytest.approx([15.0, 5.0])


def test_vehicle_keeps_its_lane_stops_at_the_line_and_leaves() -> None:
    run = simulated("stop4", "1233")
    assert (run.provenance["end"], run.fault, run.collisions) == ("left", None, ())
    assert rvads.check(run, "full_stop").status == "PASS"
    assert rvads.check(run, "keep_lane").status == "PASS"
    assert not [finding for finding in rvads.validate(run) if "station" in str(finding)]
    step = np.diff(run.station, axis=0) / 0.01
    assert step == pytest.approx(run.need("speed")[1:], abs=1e-4), "it gets as far as it is fast"


def test_lights_are_obeyed() -> None:
    run = simulated("light4", "2222")
    assert run.provenance["end"] == "left"
    assert {run.lights[tick, agent.entrance] for tick, agent in zip(entered(run), run.agents, strict=True)} == {Colour.GREEN}
    assert max(entered(run)) > 2000, "the second group waited"


@pytest.mark.extended
def test_sumo_run_is_equal_in_any_order_and_process() -> None:
    first = simulated("stop4", "1133").hash
    simulated("light4", "3020")
    assert simulated("stop4", "1133").hash == first
    path = Path(rvads.__file__).parents[1]
    command = [sys.executable, "-c", PRINT]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": str(path)})
    assert done.stdout.split() == [first]


@pytest.mark.extended
def test_forked_process_has_its_own_sumo() -> None:
    first = simulated("stop4", "1133").hash
    with ProcessPoolExecutor(1, get_context("fork"), signal.alarm, (60,)) as pool:
        assert pool.submit(_hash).result() == first
    (ours,) = sumo_process._FREE
    assert ours.usable
    assert simulated("stop4", "1133").hash == first


def _hash() -> str:
    return simulated("stop4", "1133").hash


def test_number_of_steps_per_call_does_not_change_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    first = simulated("right4", "1233").hash
    monkeypatch.setattr(sumo_simulator, "_AHEAD", 7)
    assert simulated("right4", "1233").hash == first


def test_seed_of_the_senses_seeds_sumo() -> None:
    runs = [simulated("stop4", "1133", senses=rvads.Senses(seed=seed)) for seed in (0, 1)]
    assert runs[0].hash != runs[1].hash
    assert [run.provenance["sumo"]["seed"] for run in runs] == [23423, 23424]
    still = [simulated("stop4", "1133", rvads.Sumo(sigma=0), senses=rvads.Senses(seed=seed)) for seed in (0, 1)]
    assert np.array_equal(still[0].station[:300], still[1].station[:300]), "they come alike; who goes first in a tie is drawn"
    assert not np.array_equal(runs[0].station[:300], runs[1].station[:300])
    assert still[0].provenance["sumo"]["attributes"] == {"sigma": "0"}


def test_provenance_names_the_simulator_and_its_versions() -> None:
    run = simulated("stop4", "2000")
    assert (run.provenance["simulator"], run.provenance["autopilot"]) == ("sumo", "sumo")
    assert {"libsumo", "eclipse-sumo"} <= set(run.provenance["versions"])


@pytest.mark.extended
@pytest.mark.parametrize(
    ("driver", "traffic"), [(rvads.Reference, rvads.traffic("sumo")), (rvads.traffic("sumo"), rvads.Reference)]
)
def test_drivers_of_the_package_and_of_sumo_share_a_run(driver: Any, traffic: Any) -> None:
    run = among("2222", driver, traffic)
    assert (run.fault, run.collisions, run.provenance["end"]) == (None, (), "left")
    assert rvads.check(run, "no_conflict").status == "PASS", "each saw the other"
    assert among("2222", driver, traffic).hash == run.hash


def test_vehicle_of_sumo_waits_for_a_vehicle_in_the_junction() -> None:
    """A standing vehicle blocks a vehicle of SUMO, which alone would pass the junction within ten seconds."""
    alone = simulated("stop4", "0200", speed=0.0)
    assert (alone.provenance["end"], alone.steps < 1300) == ("left", True)
    run = among("2200", Stuck, rvads.traffic("sumo"), duration=20.0)
    assert (run.provenance["end"], run.collisions) == ("duration", ())
    ours, theirs = run.station[-1]
    assert ours == pytest.approx(16.75, abs=1.5), "the ways cross there"
    assert theirs < rvads.find("stop4").stretches[(1, 3), (0, 2)].mine.start


def test_overlapping_boxes_end_the_run_with_a_collision() -> None:
    """A vehicle of SUMO stops at the line, and its follower drives into it."""
    run = among("2000", rvads.traffic("sumo"), Rammer, followers=1, speed=5.0)
    assert run.provenance["end"] == "collision"
    assert run.collisions[0].agents == ("a0", "a0+1")
    assert run.collisions[0].speed == pytest.approx(8.0, abs=0.6)
    ticks = np.flatnonzero(overlap(run, 0, 1))
    assert ticks[0] == round(run.collisions[0].time / 0.01)


def test_driver_of_sumo_is_refused_in_other_simulators() -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2000")
    run = rvads.simulate(rvads.Case(scenario, rvads.traffic("sumo")), usual())
    assert "SUMO's driver drives in the simulator sumo alone" in run.fault.reason
    assert "add --rvads-simulator sumo" in run.fault.reason
    assert rvads.check(run, "no_collision").status == "ERROR"


def test_sumo_without_a_sumo_driver_is_not_started() -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2000")
    case = rvads.Case(scenario, rvads.Reference)
    run, default = rvads.simulate(case, rvads.sumo), rvads.simulate(case)
    assert run.hash == default.hash
    assert run.provenance["simulator"] == usual().name


def test_senses_that_are_not_ideal_are_refused_for_the_driver_of_sumo() -> None:
    blurred = rvads.Senses(delay=0.2)
    with pytest.raises(ScenarioError, match=r"^SUMO's driver has ideal senses .*got senses with delay00.20 in stop4"):
        simulated("stop4", "2000", senses=blurred)
    assert among("2020", rvads.Reference, rvads.traffic("sumo"), senses=blurred).fault is None


def test_missing_libsumo_names_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sumo_simulator, "find_spec", lambda _name: None)
    says = r"^simulator 'sumo' needs the package libsumo, which is not installed: pip install 'pytest-rvads\[sumo\]'$"
    for call in (lambda: simulated("stop4", "2000"), lambda: rvads.sumo.vmax(1.0)):
        with pytest.raises(ScenarioError, match=says):
            call()


def braked(speed: float, decel: float) -> float:
    """Return the braking distance of a vehicle with steps of 0.01 s, each driven at the reduced speed [m]."""
    speeds = [max(speed - k * decel * 0.01, 0.0) for k in range(1, ceil(speed / decel / 0.01) + 1)]
    return sum(speeds) * 0.01


@pytest.mark.parametrize(("aggression", "decel"), [(1, 4.0), (3, 8.0)])
def test_safe_speed_without_a_lag_is_the_safe_speed_of_sumo(aggression: int, decel: float) -> None:
    quick = rvads.Vehicle(brake_lag=1e-6)  # whose resistances stop it sooner by our dynamics
    for distance in (0.3, 3.0, 5.0):
        speed = rvads.vmax(distance, aggression, quick, simulator=rvads.sumo)
        assert braked(speed - 0.005, decel) <= distance
        assert braked(speed + 0.015, decel) > distance
    assert rvads.vmax(30.0, aggression, simulator=rvads.sumo) == pytest.approx(11.176)
    with pytest.raises(ScenarioError, match="must be 0 m or more"):
        rvads.vmax(-1.0, simulator=rvads.sumo)


@pytest.mark.parametrize("distance", [0.3, 5.0, 12.0])
def test_vmax_with_a_brake_lag_equals_the_default_simulator(distance: float) -> None:
    assert rvads.vmax(distance, simulator=rvads.sumo) == rvads.vmax(distance, simulator=usual())


@pytest.mark.extended
def test_vmax_of_feeble_brakes_follows_from_the_deceleration() -> None:
    feeble = rvads.Vehicle(brake=(0.01, 0.01, 0.01))
    speed = rvads.vmax(50.0, 1, feeble, simulator=rvads.sumo)
    assert speed == pytest.approx((2 * 0.01 * 50.0) ** 0.5, abs=0.02), "v squared over twice the deceleration"


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[SumoProcess]]:
    """The processes that simulate within the test, in the order of their start."""
    seen: list[SumoProcess] = []
    load = SumoProcess.load

    def noted(self: SumoProcess, *arguments: Any) -> Any:
        seen.append(self)
        return load(self, *arguments)

    monkeypatch.setattr(SumoProcess, "load", noted)
    yield seen
    assert simulated("stop4", "1133").fault is None


def signalling(processes: list[SumoProcess], number: int) -> Callable[[], rvads.Reference]:
    """Return the reference autopilot, which sends SUMO a signal after one second."""

    class Signalling(rvads.Reference):
        def control(self, seen: rvads.Observation) -> rvads.Control:
            if seen.time == 1.0:
                os.kill(processes[-1].pid, number)
            return super().control(seen)

    return Signalling


@pytest.mark.parametrize("times", [1, 2])
def test_killed_sumo_is_a_fault(processes: list[SumoProcess], times: int) -> None:
    for _ in range(times):
        run = among("2020", signalling(processes, signal.SIGKILL), rvads.traffic("sumo"))
        assert run.fault.time == pytest.approx(1.0)
        assert "SUMO (libsumo): it was killed by signal SIGKILL" in run.fault.reason
        verdict = rvads.check(run, "no_collision")
        assert verdict.status == "ERROR"
        assert "SUMO" in verdict.message


@pytest.mark.extended
def test_hanging_sumo_is_a_fault(processes: list[SumoProcess]) -> None:
    hasty = rvads.limits(decision=0.5, simulator=rvads.sumo)
    run = among("2020", signalling(processes, signal.SIGSTOP), rvads.traffic("sumo"), hasty)
    assert "SUMO (libsumo): " in run.fault.reason
    assert "no answer within 0.5 s of real time (setting rvads_decision_limit)" in run.fault.reason
    with pytest.raises(ProcessLookupError):
        os.kill(processes[-1].pid, 0)


def test_sumo_killed_between_runs_is_replaced(processes: list[SumoProcess]) -> None:
    assert simulated("stop4", "2000").fault is None
    os.kill(processes[-1].pid, signal.SIGKILL)
    until = time.monotonic() + 5.0
    while processes[-1].usable and time.monotonic() < until:
        time.sleep(0.01)
    assert simulated("stop4", "2000").fault is None
    assert processes[-1] is not processes[0]


def test_sumo_with_a_removed_folder_is_replaced(processes: list[SumoProcess]) -> None:
    first = simulated("stop4", "2000").hash
    shutil.rmtree(processes[-1]._folder)
    with pytest.raises(
        rvads.errors.RunError, match=r"^SUMO \(libsumo\): its files can't be written to .*: No such file or directory$"
    ):
        simulated("stop4", "2000")
    assert simulated("stop4", "2000").hash == first


@pytest.mark.extended
def test_folders_may_have_any_name(tmp_path: Path) -> None:
    """SUMO reads lists of files with commas, and so a comma in the name of a folder must not reach SUMO."""
    odd = tmp_path / "a, b;c & d"
    odd.mkdir()
    environment = os.environ | {"PYTHONPATH": str(Path(rvads.__file__).parents[1]), "TMPDIR": str(odd)}
    done = subprocess.run([sys.executable, "-c", PRINT], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == [_hash()]
    assert not list(odd.iterdir())


@pytest.mark.parametrize(
    ("attributes", "says"),
    [
        (
            {"length": 12.0},
            r"^rvads.Sumo takes attributes of a vType .*, got 'length': sizes are those of the vehicles",
        ),
        ({"id": "mine"}, "other than id, length, width, height, .* got 'id'"),
        ({"a b": 1}, "got 'a b'"),
        ({"sigma": None}, r"^rvads.Sumo\(sigma=\) takes a number or a text, got None$"),
    ],
)
def test_wrong_attribute_of_vehicles_is_refused(attributes: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        rvads.Sumo(**attributes)


def test_every_seed_of_the_senses_gives_a_seed_of_sumo() -> None:
    run = simulated("stop4", "2000", senses=rvads.Senses(seed=2**31 - 23423 + 5), duration=1.0)
    assert run.provenance["sumo"]["seed"] == 5


def test_refusal_of_sumo_is_quoted() -> None:
    with pytest.raises(rvads.errors.RunError, match=r"^SUMO \(libsumo\): .*"):
        simulated("stop4", "2000", rvads.Sumo(carFollowModel="none such"))
    assert not [process for process in sumo_process._FREE if not process.usable]
    assert simulated("stop4", "2000").fault is None
