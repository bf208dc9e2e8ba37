"""The simulators ``bullet`` and ``mujoco``: planar vehicle dynamics in a physics engine.

Both use the same loop with different worlds. Verdicts agree between the two, but runs are bit-identical within one engine only.
"""

from __future__ import annotations

from pytest_rvads.physics import braking, engines
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.support.versions import versions

__all__ = ["Planar", "bullet", "mujoco", "usual"]


class Planar:
    """A simulator with planar vehicle dynamics in a physics engine: pybullet or MuJoCo.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name = engine.name
        self.libraries = (engine.library,)

    def __call__(self, case: Case) -> Run:
        """Return the run of a case, see `pytest_rvads.simulators.simulator.simulate`."""
        return Loop(case, self.name, self.engine.world, versions(self.engine.library)).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed `distance` metres before the stopping line, see `pytest_rvads.physics.braking.vmax`."""
        return braking.vmax(distance, aggression, vehicle, self.engine, braking.FASTEST)

    def __repr__(self) -> str:
        return f"rvads.{self.name}"


bullet: Planar = Planar(BULLET)
mujoco: Planar = Planar(MUJOCO)


def usual() -> Planar:
    """Return the default simulator, see `pytest_rvads.physics.engines.usual`."""
    return bullet if engines.usual() is BULLET else mujoco
