"""What pybullet needs beside the laws of a world: quiet imports, engines that others may take."""

import subprocess
import sys
from dataclasses import replace

import pytest

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics import engines
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.engines import BulletWorld
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import bullet
from pytest_rvads.simulators.simulator import simulate

pybullet = pytest.importorskip("pybullet")
AT_REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_pybullet_is_imported_late_and_in_silence() -> None:
    code = (
        "import sys, pytest_rvads.simulators.loop\n"
        "from pytest_rvads.physics.engines import BulletWorld\n"
        "from pytest_rvads.physics.body import Motion\n"
        "from pytest_rvads.runs.states import Vehicle\n"
        "print('pybullet' in sys.modules)\n"
        "BulletWorld([Vehicle()], [Motion(0, 0, 0, 0, 0, 0)]).close()\n"
        "print('after', file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    assert done.stderr == "after\n"


def test_a_driver_may_use_the_engine_itself_without_saying_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "_free", [])
    if pybullet.isConnected():
        pybullet.disconnect()  # so that the next one to connect gets the number that stands for none

    class Simulates(Reference):
        def control(self, seen: Observation) -> Control:
            if pybullet.isConnected():
                pybullet.disconnect()
            pybullet.connect(pybullet.DIRECT)
            pybullet.resetSimulation()
            pybullet.setTimeStep(0.5)
            pybullet.setGravity(0, 0, -9.81)
            pybullet.createMultiBody(1.0, basePosition=[0, 0, 100])
            pybullet.stepSimulation()
            return super().control(seen)

    case = Case(Scenario(find("stop4"), "1231", distance=5, duration=0.3), Reference)
    alone = simulate(case, bullet)
    beside = simulate(replace(case, driver=Simulates), bullet)
    assert beside.fault is None
    assert simulate(case, bullet).hash == beside.hash == alone.hash


def test_an_engine_that_a_driver_disconnected_is_not_used_again() -> None:
    world = BulletWorld([Vehicle()], [AT_REST])
    world.close()
    _, client = engines._free[-1]
    pybullet.disconnect(client)
    again = BulletWorld([Vehicle()], [AT_REST])
    assert again.motions() == [AT_REST]
    again.close()
