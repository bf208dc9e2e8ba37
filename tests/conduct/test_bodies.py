"""Bodies that touch, worked out from poses and sizes: against corners by hand, and against what the engine says."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.bodies import collide, contacts, overlap
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

Make = Callable[..., Run]
Box = tuple[float, float, float, float, float]
"""x, y, heading of the front, length, width."""


def placed(*boxes: Box, **facts: object) -> Run:
    """A run of one state with these bodies, recorded without collisions."""
    place = find("stop4")
    agents = tuple(Agent(f"a{k}", place.movements[k, (k + 2) % 4], size=box[3:]) for k, box in enumerate(boxes))
    pose = np.array([[box[:3] for box in boxes]])
    zone = np.full((1, len(boxes)), Zone.APPROACH, dtype=np.int8)
    return Run("placed", place, agents, zone, np.zeros((1, 4), dtype=np.int8), pose=pose)


def inside(point: np.ndarray, box: Box) -> bool:
    """Tell whether a point lies in a body, by more than numbers are rounded."""
    x, y, heading, length, width = box
    dx, dy = point[0] - x, point[1] - y
    along, across = dx * math.cos(heading) + dy * math.sin(heading), dy * math.cos(heading) - dx * math.sin(heading)
    return -length + 1e-9 < along < -1e-9 and abs(across) < width / 2 - 1e-9


def border(box: Box) -> np.ndarray:
    """Points along the edges of a body, a few centimetres apart."""
    x, y, heading, length, width = box
    shares = np.linspace(0, 1, 60)
    around = [(-s * length, w) for s in shares for w in (-width / 2, width / 2)]
    around += [(b, (s - 0.5) * width) for s in shares for b in (0.0, -length)]
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([(x + a * cos - c * sin, y + a * sin + c * cos) for a, c in around])


numbers = st.floats(-6, 6)
boxes = st.tuples(numbers, numbers, st.floats(-4, 4), st.floats(1, 8), st.floats(0.5, 3))


@pytest.mark.extended
@given(boxes, boxes)
@settings(derandomize=True, deadline=None, max_examples=300)
def test_bodies_overlap_where_a_border_point_of_one_lies_in_the_other(one: Box, two: Box) -> None:
    touching = any(inside(p, two) for p in border(one)) or any(inside(p, one) for p in border(two))
    grown = (*two[:3], two[3] + 0.3, two[4] + 0.3)
    near = touching or any(inside(p, grown) for p in border(one))
    found = bool(overlap(placed(one, two), 0, 1)[0])
    assert found or not touching
    assert near or not found


def test_two_recorded_bodies_in_one_place_collide(drive: Make) -> None:
    still = {0: (2, -30.0, [(0, 1.0)]), 2: (2, -30.0, [(0, 0.0)])}
    run = drive("stop4", still, 50)
    assert check(run, "no_collision").status == "PASS", "a simulator recorded that there was none"
    pose = run.need("pose").copy()
    pose[:, 1] = pose[:, 0]
    same = replace(run, collisions=None, pose=pose)
    assert (check(same, "no_collision").status, contacts(same)[0].time) == ("FAIL", 0.0)
    assert collide(same, 0, 1).all()
    apart = replace(run, collisions=None)
    assert (check(apart, "no_collision").status, contacts(apart)) == ("PASS", ())
    assert check(replace(apart, pose=None), "no_collision").reason == "not recorded: the run holds no positions"
    with pytest.raises(RunError, match="no size"):
        contacts(replace(apart, agents=tuple(replace(agent, size=None) for agent in apart.agents)))


@pytest.mark.parametrize(("tick", "hit"), [(0, 0), (30, 30), (49, 49), (50, 49)])
def test_what_was_recorded_counts_in_its_state(drive: Make, tick: int, hit: int) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 0.0)]), 2: (2, -30.0, [(0, 0.0)])}, 50, None, [(tick, "a0", "a2")])
    assert np.flatnonzero(collide(run, 0, 1)).tolist() == [hit], "the last step ends in the last state"


def test_vehicle_out_of_the_run_has_no_body(drive: Make) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 0.0)]), 2: (2, -30.0, [(0, 0.0)])}, 10)
    pose = run.need("pose").copy()
    pose[:, 1] = pose[:, 0]
    zone = run.zone.copy()
    zone[4:, 1] = Zone.GONE
    gone = replace(run, collisions=None, pose=pose, zone=zone)
    assert collide(gone, 0, 1).tolist() == [True] * 4 + [False] * 6


class Blind(Follower):
    """Drives on whoever is in the way."""

    def target_speed(self, seen: object) -> float:
        return 8.0


@pytest.mark.parametrize("code", ["2222", "2200", "2030", "1301"])
def test_the_engine_and_the_rectangles_agree_on_the_first_contact(code: str) -> None:
    run = simulate(Case(Scenario(find("stop4"), code, distance=20, speed=8, duration=8), Blind))
    assert run.collisions
    first, (other, *_) = run.collisions[0], contacts(replace(run, collisions=None))
    # The engine's bodies touch when their margins do, a few centimetres early: two steps at most at this speed.
    assert set(other.agents) == set(first.agents)
    assert other.time == pytest.approx(first.time, abs=0.021)
    if set(code) <= {"0", "2"}:  # the speed that a run holds is the forward one, which is all of it on straight ways only
        assert other.speed == pytest.approx(first.speed, rel=0.02)
