"""The world: rigid bodies in the plane, which an engine moves and keeps from passing through each other."""

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
    """Rigid bodies in the plane; the only thing the simulation asks of a physics engine."""

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order in which they were given."""

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step of `DT`.

        Args:
            forces: force along x [N], along y [N] and moment about the vertical [N m] per body, in one flat sequence.
        """

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that touched at the start of the last step, before it was resolved."""

    def remove(self, body: int) -> None:
        """Take `body` out of the world: it stands still and touches nothing any more."""

    def close(self) -> None:
        """Free the world; it can't be used afterwards."""


WorldMaker = Callable[[Sequence[Vehicle], Sequence[Motion]], World]
"""Makes a world of bodies: mass, inertia and body of every vehicle, and their initial motions in the same order. The state of the
engine is built anew for every world, so that a run does not depend on the runs before it."""
