"""The simulators that ship: planar vehicle dynamics in a physics engine. They are ``bullet`` and ``mujoco``.

Both are one loop over two makers of a `World`. Outcomes are the same on both, but equal bits hold within one engine only.
"""

from __future__ import annotations

from pytest_rvads.physics import braking, engines
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.versions import versions

__all__ = ["Planar", "bullet", "mujoco", "usual"]


class Planar:
    """Planar vehicle dynamics in a physics engine: ``bullet`` uses pybullet, ``mujoco`` MuJoCo.

    Which of the two makes a run decides no verdict that the tests know of, but runs are bit-identical only within one.
    """

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name = engine.name
        self.libraries = (engine.library,)

    def __call__(self, case: Case) -> Run:
        """Simulate a case, see `pytest_rvads.simulators.simulator.simulate`."""
        return Loop(case, self.name, self.engine.world, versions(self.engine.library)).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed `distance` metres before the stopping line, see `pytest_rvads.physics.braking.vmax`."""
        return braking.vmax(distance, aggression, vehicle, self.engine, braking.FASTEST)

    def __repr__(self) -> str:
        return f"rvads.{self.name}"


bullet: Planar = Planar(BULLET)
mujoco: Planar = Planar(MUJOCO)


def usual() -> Planar:
    """Return the simulator that is used where nobody names one, see `pytest_rvads.physics.engines.usual`."""
    return bullet if engines.usual() is BULLET else mujoco
