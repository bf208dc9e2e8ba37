"""The protocol of worlds: rigid bodies in the plane, moved by an engine that detects and resolves collisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["Motion", "World", "WorldMaker"]


class Motion(NamedTuple):
    """Place and velocity of a body's centre of gravity, in the frame of the map."""

    x: float
    """[m]."""
    y: float
    """[m]."""
    yaw: float
    """Counter-clockwise from east, not wrapped [rad]."""
    vx: float
    """[m/s]."""
    vy: float
    """[m/s]."""
    yaw_rate: float
    """[rad/s]."""


class World(Protocol):
    """Rigid bodies in the plane: the part of a physics engine that a simulation uses."""

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order of the vehicles given to the `WorldMaker`."""

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step of `DT`.

        Args:
            forces: force along x [N], along y [N] and moment about the vertical [N m] per body, in one flat sequence.
        """

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that touched at the start of the last step."""

    def remove(self, body: int) -> None:
        """Take `body` out of the world: it stands still and touches nothing any more."""

    def close(self) -> None:
        """Free the resources of the world, which can't be used afterwards."""


WorldMaker = Callable[[Sequence[Vehicle], Sequence[Motion]], World]
"""Makes a world from vehicles (mass, inertia, body) and their initial motions, in the same order.

The state of the engine is built anew for every world, so that a run does not depend on earlier runs.
"""
