"""Pedestrians in simulations: what each behaviour does, contacts with vehicles, and the same run everywhere."""

import subprocess
import sys
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.drivers.walking import BEHAVIOURS
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from tests.zebras import zebra

ZEBRA, LIT = zebra(), zebra("light4", lit=True)
ENGINES = [name for name in ("mujoco", "bullet") if find_spec(getattr(rvads, name).engine.library)]
"""The simulators whose engine is installed; pybullet has no wheels for Python 3.12 and later."""
LENGTH = 7.0
"""Length of every crosswalk [m]: two lanes of 3.5 m."""


class Stands:
    """Stands where it starts."""

    def control(self, seen: Observation) -> Command:
        return rvads.Control(brake=1.0)


class Drives:
    """Drives at 8 m/s whoever is in the way."""

    def control(self, seen: Observation) -> Command:
        return rvads.TargetSpeed(8.0)


class Yields:
    """Drives at 5 m/s and stops before its line."""

    def control(self, seen: Observation) -> Command:
        left = -3.0 - seen.me.station
        return rvads.TargetSpeed(min(5.0, (2.0 * 2.0 * left) ** 0.5) if left > 0.0 else 0.0)


def walk(behaviour: str, driver: Any = Stands, side: str = "near", simulator: Any = rvads.mujoco, **more: Any) -> Run:
    """Return a run in which p0 crosses before the vehicle from entrance 1; by default, the vehicle stands."""
    start: dict[str, Any] = {"distance": 20.0, "speed": 0.0, "subject": 1, "duration": 60.0, "place": ZEBRA, "difference": 2.0}
    start |= more
    place, difference, sound = start.pop("place"), start.pop("difference"), start.pop("sound", True)
    scenario = rvads.Scenario(place, "0200", pedestrians=[rvads.Pedestrian(1, side, behaviour, difference)], **start)
    run = rvads.simulate(rvads.Case(scenario, driver), simulator)
    assert run.fault is None
    assert not sound or validate(run) == ()
    return run


def column(run: Run, name: str, agent: str = "p0") -> Any:
    return run.need(name)[:, [one.name for one in run.agents].index(agent)]


def entered(run: Run, agent: str = "p0") -> int:
    """Return the tick of the first state in which a pedestrian is on the crosswalk."""
    on = np.flatnonzero(column(run, "station", agent) > 0.0)
    assert len(on)
    return int(on[0])


@pytest.mark.parametrize("side", ["near", "far"])
def test_steady_pedestrian_walks_over_the_crosswalk_at_1_4_m_s(side: str) -> None:
    run = walk("steady", side=side)
    on = run.zone[:, 1] == Zone.JUNCTION
    assert np.abs(column(run, "speed")[on] - 1.4).max() < 1e-9
    assert on.sum() * run.dt == pytest.approx(LENGTH / 1.4, abs=0.02)
    assert run.zone[-1, 1] == Zone.GONE
    x, y, _ = column(run, "pose")[entered(run)]
    crosswalk = run.junction.crossings[1]
    kerb = crosswalk.path.points[0 if side == "near" else -1]
    assert np.hypot(x - kerb[0], y - kerb[1]) < 0.02


def test_darting_pedestrian_runs_at_2_5_m_s() -> None:
    run = walk("darts")
    on = run.zone[:, 1] == Zone.JUNCTION
    assert np.abs(column(run, "speed")[on] - 2.5).max() < 1e-9


def test_pedestrian_stops_in_the_middle_for_4_s() -> None:
    run = walk("stops")
    station, speed = column(run, "station"), column(run, "speed")
    stood = np.flatnonzero((speed == 0.0) & (station > 0.0) & (run.zone[:, 1] == Zone.JUNCTION))
    assert np.ptp(station[stood]) == 0.0
    # Stopping from 1.4 m/s at 5 m/s^2 takes 0.28 s and 0.2 m behind the middle.
    assert LENGTH / 2 + 0.19 <= station[stood[0]] <= LENGTH / 2 + 0.22
    assert len(stood) * run.dt == pytest.approx(4.0 - 0.28, abs=0.03)
    assert run.zone[-1, 1] == Zone.GONE


def test_pedestrian_returns_to_its_own_sidewalk() -> None:
    run = walk("returns")
    station = column(run, "station")
    assert LENGTH / 2 + 0.19 <= station.max() <= LENGTH / 2 + 0.22
    assert column(run, "speed").min() == pytest.approx(-1.4)
    assert -3.0 <= station[-1] <= -2.9
    assert column(run, "speed")[-1] == 0.0
    assert run.zone[-1, 1] == Zone.APPROACH


def test_waiting_pedestrian_never_steps_on_the_crosswalk() -> None:
    run = walk("waits")
    station = column(run, "station")
    assert -0.8 <= station[-1] < 0.0
    assert (np.diff(station) >= 0.0).all()


def test_yielding_pedestrian_goes_when_the_vehicle_stands() -> None:
    """The vehicle comes at 5 m/s and stops 3 m before its line, where it stands for the rest of the run."""
    run = walk("yields", Yields, distance=60.0, speed=5.0, difference=0.0)
    speed, station = column(run, "speed", "a1"), column(run, "station", "a1")
    tick = entered(run)
    stood = int(np.flatnonzero(speed < 0.5)[0])
    waited = (column(run, "speed") == 0.0) & (column(run, "station") > -0.8) & (np.arange(run.steps) < stood)
    assert waited.sum() * run.dt > 2.0, "it stood at the kerb while the vehicle came"
    assert 0.0 <= (tick - stood) * run.dt < 1.5, "it went when the vehicle was slow"
    assert -4.0 < station[tick] < 0.0
    assert run.zone[-1, 1] == Zone.GONE


def test_yielding_pedestrian_goes_before_a_vehicle_that_is_far_away() -> None:
    """From 90 m away at 8 m/s, the vehicle takes 11 s: more than the 5 s that the pedestrian needs, and 1 s to spare."""
    run = walk("yields", Drives, distance=90.0, speed=8.0, difference=-8.0)
    tick = entered(run)
    assert column(run, "station", "a1")[tick] < -8.0 * 6.0
    assert column(run, "speed")[column(run, "station") > -2.0].min() > 0.0, "it did not stop at the kerb"


def test_three_pedestrians_walk_behind_each_other() -> None:
    for place in (ZEBRA, LIT):  # at the light the group waits at the kerb
        run = walk("group", place=place)
        assert [agent.name for agent in run.agents] == ["a1", "p0", "p0+1", "p0+2"]
        station = run.need("station")[:, 1:]
        here = (run.zone[:, 1:] != Zone.GONE).all(axis=1)
        assert here.any()
        assert -np.diff(station[here], axis=1) == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("name", BEHAVIOURS)
def test_lawful_pedestrian_starts_on_walk_only(name: str) -> None:
    """The run begins with the green of entrance 1, and WALK begins with the green of the other group, 20 s later."""
    run = walk(name, place=LIT, difference=1.0, elapsed=20)
    light = run.lights[:, run.agents[1].entrance]
    assert {Colour(int(colour)) for colour in light} == {Colour.GREEN, Colour.YELLOW, Colour.RED}
    crossing = [agent.name for agent in run.agents if agent.name.startswith("p0")]
    if name == "waits":
        assert column(run, "station").max() < 0.0
        return
    for agent in crossing:
        tick = entered(run, agent)
        assert (light[tick] == Colour.GREEN) == BEHAVIOURS[name].lawful
        assert (tick * run.dt > 15.0) == BEHAVIOURS[name].lawful


def test_pedestrian_finishes_on_flashing_dont_walk() -> None:
    """WALK lasts 15 s less the 6.5 s that 7 m take at 1.07 m/s: 8 s. A pedestrian who starts after 7 s goes on."""
    run = walk("steady", place=LIT, difference=2.6)  # the vehicle would arrive after 4.7 s
    light = run.lights[:, run.agents[1].entrance]
    on = run.zone[:, 1] == Zone.JUNCTION
    assert 6.5 < entered(run) * run.dt < 7.5
    assert light[on][0] == Colour.GREEN
    assert light[on][-1] == Colour.YELLOW
    assert column(run, "speed")[on] == pytest.approx(1.4)


@pytest.mark.parametrize("simulator", ENGINES)
def test_contact_ends_the_run_and_pushes_nobody(simulator: str) -> None:
    """The vehicle drives on at 8 m/s while p0 stands in the middle of its lane."""
    run = walk("steady", Drives, simulator=getattr(rvads, simulator), speed=8.0, difference=0.0)
    (hit,) = run.collisions or ()
    assert run.provenance["end"] == "collision"
    assert hit.agents == ("a1", "p0")
    # p0 walks across the way of the vehicle.
    assert hit.speed == pytest.approx(np.hypot(8.0, 1.4), abs=0.05)
    assert run.duration == pytest.approx(hit.time, abs=0.011)
    front, back = column(run, "pose", "a1")[-2:, :2], column(run, "pose")[-2:, :2]
    for car, person in zip(front, back, strict=True):
        apart = np.abs(car - person)
        assert max(apart) < 4.6 + 0.6
    assert np.abs(np.diff(column(run, "speed", "a1"))).max() < 0.05, "half a second's worth of the engine's impact"
    assert np.abs(np.diff(column(run, "speed"))).max() < 0.051, "pedestrians accelerate by at most 5 m/s^2"


def test_vehicle_that_drives_into_a_parked_vehicle_ends_the_run() -> None:
    """The parked vehicle stands 0.3 m beside the lane, so a vehicle that keeps to the right hits it."""

    class Swerves:
        def control(self, seen: Observation) -> Command:
            return rvads.Control(steering=-0.08)

    run = walk("hidden", Swerves, speed=8.0, distance=12.0, difference=5.0, sound=False)
    (hit,) = run.collisions or ()
    assert hit.agents == ("a1", "parked0")
    assert column(run, "speed", "parked0").tolist() == [0.0] * run.steps


CODE = """
import pytest_rvads as rvads
from tests.zebras import zebra
walkers = [rvads.Pedestrian(1, "near", "hidden", 0.5), rvads.Pedestrian(3, "far", "yields"), rvads.Pedestrian(1, "far", "group")]
case = rvads.Scenario(zebra("light4", lit=True), "1231", distance=15, speed=5, subject=1, pedestrians=walkers, duration=12)
print(rvads.simulate(rvads.Case(case, rvads.Reference, traffic=rvads.Reference), rvads.{}).hash)
"""


@pytest.mark.extended
@pytest.mark.parametrize("simulator", ENGINES)
def test_same_case_gives_the_same_run_in_another_process(simulator: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = CODE.format(simulator)
    exec(code, {})
    here = capsys.readouterr().out
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout == here
