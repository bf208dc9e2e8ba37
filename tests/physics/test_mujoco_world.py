"""What MuJoCo needs beside the laws of a world: silence, no files, many bodies, drivers that use it themselves."""

import math
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.conduct.bodies import overlap
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine, MujocoWorld
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Vehicle, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import mujoco
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import ScenarioError
from studies.contact_cases import CYCLIST, TRUCK, contact_cases

library = pytest.importorskip("mujoco")
CAR = Vehicle()
CASE = Case(Scenario(find("stop4"), "1231", distance=5, duration=0.5), Reference)


def test_it_is_imported_late_in_silence_and_writes_no_file(tmp_path: Path) -> None:
    code = (
        "import sys, pytest_rvads.simulators.loop\n"
        "from pytest_rvads.physics.engines import MujocoWorld\n"
        "from pytest_rvads.physics.body import Motion\n"
        "from pytest_rvads.runs.states import Vehicle\n"
        "print('mujoco' in sys.modules)\n"
        "spot = [Motion(0.01 * k, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(80)]\n"
        "print(len(MujocoWorld([Vehicle()] * 80, spot).contacts()))\n"
        "world = MujocoWorld([Vehicle()], spot[:1])\n"
        "world.step([float('nan')] * 3)\n"
        "world.step([1e300] * 3)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path, timeout=60)
    assert (done.stdout, done.stderr) == (f"False\n{80 * 79 // 2}\n", "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("engine", [BULLET, MUJOCO], ids=lambda engine: engine.name)
def test_bodies_of_all_sizes_touch_where_their_outlines_overlap(engine: Engine) -> None:
    """Held against outlines worked out from poses, where that is clear to 0.1 mm; heights decide nothing."""
    pytest.importorskip(engine.library)
    draw = random.Random(7)
    touching = 0
    for _ in range(120):
        vehicles = [draw.choice((CAR, TRUCK, CYCLIST)) for _ in range(2)]
        angle, far = draw.uniform(0.0, 2 * math.pi), draw.uniform(0.5, 9.0)
        turned = draw.choice((0.0, 0.01, math.pi / 2, math.pi, draw.uniform(-4.0, 4.0)))
        starts = [
            Motion(0.0, 0.0, 0.3, 0.0, 0.0, 0.0),
            Motion(far * math.cos(angle), far * math.sin(angle), turned, 0.0, 0.0, 0.0),
        ]
        surely, maybe = (overlapping(vehicles, starts, by) for by in (-1e-4, 1e-4))
        if surely != maybe:
            continue
        world = engine.world(vehicles, starts)
        assert bool(world.contacts()) == surely
        world.step([0.0] * 6)
        assert bool(world.contacts()) == surely
        world.close()
        touching += surely
    assert 30 < touching < 90


def overlapping(vehicles: list[Vehicle], starts: list[Motion], by: float) -> bool:
    """Tell whether outlines overlap that are larger by so much all around [m]; without any engine."""
    place = find("stop4")
    sizes = [(v.length + 2 * by, v.width + 2 * by) for v in vehicles]
    agents = tuple(Agent(f"a{k}", place.movements[k, (k + 2) % 4], size=size) for k, size in enumerate(sizes))
    fronts = [(s, v.gravity_offset + by) for s, v in zip(starts, vehicles, strict=True)]
    pose = np.array([[(s.x + a * math.cos(s.yaw), s.y + a * math.sin(s.yaw), s.yaw) for s, a in fronts]])
    zone = np.full((1, 2), Zone.APPROACH, dtype=np.int8)
    return bool(overlap(Run("placed", place, agents, zone, np.zeros((1, 4), dtype=np.int8), pose=pose), 0, 1)[0])


def test_a_truck_that_hits_a_cyclist_hardly_slows_down() -> None:
    truck = Motion(0.0, 0.0, 0.0, 10.0, 0.0, 0.0)
    ahead = TRUCK.gravity_offset + CYCLIST.length - CYCLIST.gravity_offset
    world = MujocoWorld([TRUCK, CYCLIST], [truck, Motion(ahead + 0.05, 0.0, 0.0, 0.0, 0.0, 0.0)])
    for _ in range(50):
        world.step([0.0] * 6)
    one, two = world.motions()
    assert TRUCK.mass * one.vx + CYCLIST.mass * two.vx == pytest.approx(TRUCK.mass * 10.0, rel=1e-9)
    assert 10.0 * (1 - 2 * CYCLIST.mass / TRUCK.mass) < one.vx < 10.0 < two.vx


def test_eighty_bodies_in_one_pile_are_pushed_apart_in_no_time() -> None:
    starts = [Motion(4.55 * k, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(80)]
    world = MujocoWorld([CAR] * 80, starts)
    assert world.contacts() == [(k, k + 1) for k in range(79)]
    for _ in range(20):
        world.step([0.0] * 240)
    ends = world.motions()
    assert ends[0].x < starts[0].x
    assert ends[-1].x > starts[-1].x
    assert math.fsum(motion.vx for motion in ends) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("wrong", [Vehicle(mass=1e-16), Vehicle(yaw_inertia=1e-20)], ids=["mass", "inertia"])
def test_mujoco_refuses_vehicles_without_mass(wrong: Vehicle) -> None:
    with pytest.raises(
        ScenarioError, match=r"MuJoCo can't move these vehicles: .*mass and inertia.*; give them masses and sizes"
    ):
        MujocoWorld([wrong], [Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)])


@pytest.mark.extended
def test_a_run_is_the_same_after_others_in_threads_and_in_another_process() -> None:
    hit = contact_cases()["crossing"]
    alone = mujoco(hit).hash
    mujoco(CASE)
    with ThreadPoolExecutor(2) as pool:
        assert {run.hash for run in pool.map(mujoco, [hit] * 2)} == {alone}
    code = (
        "from pytest_rvads.simulators.loop import mujoco\n"
        "from studies.contact_cases import contact_cases\n"
        "print(mujoco(contact_cases()['crossing']).hash)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == alone


@pytest.fixture
def callbacks() -> Iterator[Callable[..., None]]:
    """Sets callbacks for all models, as a driver that uses MuJoCo may; they are taken away at the end."""
    names = ("control", "passive", "contactfilter")

    def put(**wanted: Any) -> None:
        for name, function in wanted.items():
            getattr(library, f"set_mjcb_{name}")(function)

    yield put
    put(**dict.fromkeys(names))


@pytest.mark.parametrize("name", ["crossing", "rear-end"])
def test_a_driver_may_use_mujoco_itself(callbacks: Callable[..., None], name: str) -> None:
    case = contact_cases()[name]
    alone = mujoco(case)
    called: list[str] = []

    def throws(model: Any, data: Any) -> None:
        called.append("callback")
        data.qfrc_applied[:] = 1e6

    def never(*_: Any) -> int:
        called.append("filter")
        return 1

    callbacks(control=throws, passive=throws, contactfilter=never)
    assert mujoco(case).hash == alone.hash
    assert called == []
    assert library.get_mjcb_contactfilter() is never, "what the driver set stays set"


def test_a_driver_may_simulate_in_mujoco_while_it_decides() -> None:
    class Simulates(Reference):
        def control(self, seen: Observation) -> Control:
            model = library.MjModel.from_xml_string(
                "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
            )
            library.mj_step(model, library.MjData(model))
            return super().control(seen)

    beside = simulate(replace(CASE, driver=Simulates), mujoco)
    assert beside.fault is None
    assert beside.hash == simulate(CASE, mujoco).hash
