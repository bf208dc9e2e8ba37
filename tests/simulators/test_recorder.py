"""The recorder: what it hands over, and that it keeps nothing for the garbage collector to look through."""

import gc

from pytest_rvads.drivers.interface import Control
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Agent, Colour, VehicleState, Zone
from pytest_rvads.simulators.loop import Recorder

PLACE = find("stop4")
AGENTS = tuple(Agent(f"a{k}", PLACE.leads(k, 2)) for k in range(2))
LIGHTS = (Colour.NONE,) * 4


def state(column: int, tick: int) -> VehicleState:
    along = 100.0 * column + tick
    zone = Zone(min(tick, Zone.EXIT))
    motion = along, along + 0.1, along + 0.2, along + 0.3, along + 0.4
    return VehicleState(f"a{column}", column, Turn.STRAIGHT, zone, *motion, acceleration=9.0, length=4.0, width=2.0)


def recorded(recorder: Recorder) -> Run:
    return recorder.run("by hand", PLACE, (), None, Facts(), {})


def test_every_number_comes_back_in_its_row_and_column() -> None:
    recorder = Recorder(AGENTS)
    for tick in range(5):
        recorder.state([state(column, tick) for column in range(2)], LIGHTS)
        if tick < 4:
            recorder.control([Control(0.1 * column, 0.01 * tick, 0.5) for column in range(2)])
    run = recorded(recorder)
    for tick in range(5):
        for column in range(2):
            along = 100.0 * column + tick
            assert run.zone[tick, column] == min(tick, 3)
            assert run.need("station")[tick, column] == along
            assert run.need("pose")[tick, column].tolist() == [along + 0.1, along + 0.2, along + 0.3]
            assert run.need("speed")[tick, column] == along + 0.4
            assert run.controls is not None
            held = 0.01 * min(tick, 3)  # nobody is asked in the last state: what was commanded before it stands there again
            assert run.controls[tick, column].tolist() == [0.1 * column, held, 0.5]


def test_a_run_that_ends_in_its_first_state_has_no_controls_but_idle_ones() -> None:
    recorder = Recorder(AGENTS)
    recorder.state([state(column, 0) for column in range(2)], LIGHTS)
    run = recorded(recorder)
    assert run.controls is not None
    assert run.steps == 1
    assert not run.controls.any()


def test_a_run_that_ends_before_its_first_state_is_empty() -> None:
    run = recorded(Recorder(AGENTS))
    assert run.steps == 0
    assert run.zone.shape == (0, 2)
    assert run.lights.shape == (0, 4)


def test_recorded_states_are_untracked_by_the_garbage_collector() -> None:
    recorder = Recorder(AGENTS)
    before = len(gc.get_objects())
    for tick in range(2000):
        recorder.state([state(column, tick) for column in range(2)], LIGHTS)
        recorder.control([Control(0.5, 0.0, 0.0) for _ in AGENTS])
    assert len(gc.get_objects()) < before + 1000
