"""The world, in every engine: free bodies move exactly, collisions are seen in time and keep momentum, worlds do not meet."""

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics import engines
from pytest_rvads.physics.body import Motion, WorldMaker
from pytest_rvads.physics.engines import BULLET, MUJOCO
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import Planar, bullet, mujoco
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

CAR = Vehicle()


@pytest.fixture(params=[BULLET, MUJOCO], ids=lambda engine: engine.name)
def make(request: pytest.FixtureRequest) -> WorldMaker:
    pytest.importorskip(request.param.library)
    world: WorldMaker = request.param.world
    return world


def at(x: float, y: float = 0.0, vx: float = 0.0, yaw: float = 0.0) -> Motion:
    return Motion(x, y, yaw, vx, 0.0, 0.0)


def test_free_bodies_neither_slow_down_nor_fall(make: WorldMaker) -> None:
    world = make([CAR] * 2, [at(0, 0, 10.0), at(0, 50, 3.0, yaw=1.0)])
    for _ in range(1000):
        world.step([0.0] * 6)
    one, two = world.motions()
    world.close()
    assert one == pytest.approx((100.0, 0.0, 0.0, 10.0, 0.0, 0.0), abs=1e-9)
    assert two == pytest.approx((30.0, 50.0, 1.0, 3.0, 0.0, 0.0), abs=1e-9)


def test_forces_accelerate_by_mass_and_moments_by_inertia(make: WorldMaker) -> None:
    world = make([CAR] * 2, [at(0, 0), at(0, 50)])
    for _ in range(100):
        world.step([0.0, CAR.mass, 0.0, 0.0, 0.0, CAR.yaw_inertia])
    pushed, turned = world.motions()
    world.close()
    # After n steps of semi-implicit integration x = a dt^2 n (n + 1) / 2.
    assert (pushed.vy, pushed.y) == pytest.approx((1.0, 0.505), rel=1e-6)
    assert (turned.yaw_rate, turned.yaw) == pytest.approx((1.0, 0.505), rel=1e-6)
    assert (turned.x, turned.y) == (0.0, 50.0)


def test_a_rear_end_hit_is_seen_when_it_happens_and_keeps_momentum(make: WorldMaker) -> None:
    gap = 7.03
    world = make([CAR] * 2, [at(0, 0, 10.0), at(gap + CAR.length)])
    step = 0
    while not world.contacts():
        before = world.motions()
        world.step([0.0] * 6)
        touched = world.contacts()
        step += 1
    one, two = world.motions()
    world.close()
    assert touched == [(0, 1)]
    assert gap / 10.0 <= (step - 1) * DT < gap / 10.0 + DT, "in the first state in which the bodies overlap"
    assert (before[0].vx, before[1].vx) == (10.0, 0.0), "reported in the step in which it begins"
    assert one.vx + two.vx == pytest.approx(10.0, rel=1e-6)


def test_contacts_name_touching_bodies(make: WorldMaker) -> None:
    world = make([CAR] * 4, [at(0, 0), at(0, 50), at(0, 100), at(1.0, 51.0)])
    world.step([0.0] * 12)
    touched = world.contacts()
    world.close()
    assert touched == [(1, 3)]


def test_more_bodies_than_the_engine_moves_at_once_are_bodies_like_any_other(make: WorldMaker) -> None:
    count = 48
    assert count > engines._MOST
    starts = [Motion(8.0 * k, 0.0, 0.01 * k, 0.0, 1.0 + k, 0.0) for k in range(count)]
    starts[47] = Motion(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    world = make([CAR] * count, starts)
    assert world.motions() == starts
    assert world.contacts() == [(0, 47)], "of the first lot and the last"
    world.remove(0)
    world.step([CAR.mass, 0.0, CAR.yaw_inertia] * count)
    moved, touched = world.motions(), world.contacts()
    world.close()
    assert touched == []
    for k, (motion, start) in enumerate(zip(moved, starts, strict=True)):
        if k:  # one step of 1 m/s^2 and 1 rad/s^2
            assert (motion.vx, motion.vy, motion.yaw_rate) == pytest.approx((DT, start.vy, DT), rel=1e-6)
            assert motion.yaw == pytest.approx(start.yaw + DT * DT, rel=1e-6)


@pytest.mark.parametrize("simulator", [bullet, mujoco], ids=str)
def test_ten_vehicles_on_each_of_eight_lanes_are_simulated(simulator: Planar) -> None:
    pytest.importorskip(simulator.engine.library)
    place = find("lanes4")
    code = [place.directions(entrance)[0] for entrance in range(8)]
    run = simulate(Case(Scenario(place, code, distance=3, followers=9, duration=1.0), Reference), simulator)
    assert (len(run.agents), run.fault, run.collisions, run.duration) == (80, None, (), 1.0)


def test_the_body_reaches_from_the_front_bumper_backwards(make: WorldMaker) -> None:
    reach = CAR.gravity_offset
    for gap, expected in ((0.01, []), (-0.01, [(0, 1)])):
        # Nose to nose: the reference points are `gap` apart.
        world = make([CAR] * 2, [at(-reach), Motion(gap + reach, 0.0, 3.141592653589793, 0.0, 0.0, 0.0)])
        assert world.contacts() == expected
        world.close()
    back = CAR.length - reach
    for gap, expected in ((0.01, []), (-0.01, [(0, 1)])):
        world = make([CAR] * 2, [at(back), Motion(-gap - back, 0.0, 3.141592653589793, 0.0, 0.0, 0.0)])
        assert world.contacts() == expected
        world.close()


def test_a_removed_body_touches_nothing_and_stands(make: WorldMaker) -> None:
    world = make([CAR] * 2, [at(0, 0, 10.0), at(10)])
    world.remove(1)
    for _ in range(200):
        world.step([0.0] * 6)
        assert world.contacts() == []
    one, two = world.motions()
    world.close()
    assert one.x == pytest.approx(20.0)
    assert two.x == 10.0


def test_worlds_may_be_open_side_by_side(make: WorldMaker) -> None:
    one = make([CAR], [at(0, 0, 1.0)])
    two = make([CAR], [at(0, 0, 2.0)])
    for _ in range(100):
        one.step([0.0] * 3)
        two.step([0.0] * 3)
    assert (one.motions()[0].x, two.motions()[0].x) == pytest.approx((1.0, 2.0))
    one.close()
    two.close()


def test_a_closed_world_says_so(make: WorldMaker) -> None:
    world = make([CAR], [at(0)])
    world.close()
    with pytest.raises(RunError, match="closed"):
        world.motions()
