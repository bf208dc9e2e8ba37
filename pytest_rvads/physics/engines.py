"""The physics engines, and the choice of the usual engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec

from pytest_rvads.physics.bullet_world import BulletWorld
from pytest_rvads.physics.mujoco_world import MujocoWorld
from pytest_rvads.physics.world import WorldMaker

__all__ = ["BULLET", "MUJOCO", "Engine", "usual"]


@dataclass(frozen=True, slots=True)
class Engine:
    """A physics engine that moves bodies in the plane."""

    name: str
    """Name of the engine and of the simulators that use it."""
    library: str
    """Package of the engine, imported with the first world."""
    world: WorldMaker


BULLET = Engine("bullet", "pybullet", BulletWorld)
MUJOCO = Engine("mujoco", "mujoco", MujocoWorld)


@lru_cache(maxsize=1)
def usual() -> Engine:
    """Return the default engine: pybullet, or MuJoCo if pybullet is not installed.

    The dependencies of the package install pybullet on platforms for which pybullet has wheels, and MuJoCo on all others.
    """
    return BULLET if find_spec(BULLET.library) else MUJOCO
