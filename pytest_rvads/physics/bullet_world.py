"""A world in pybullet, which also detects and resolves collisions.

Vehicles are links of multibodies on fixed bases, each on three joints of its own (x, y, yaw). The joints carry nothing,
so every body moves as a free body in the plane, and two calls per step read and drive all that share a multibody.

pybullet is imported with the first simulation.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from types import ModuleType

from pytest_rvads.errors import RunError, needs
from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["BulletWorld"]

_HELPER_MASS = 1e-6
"""Mass of the two links that carry the x and the y joint [kg]; a billionth of a vehicle."""
_MOST = 40
"""Vehicles in one multibody: the engine keeps 128 numbers for where it is, 7 of them for its base, and a vehicle needs 3."""


class BulletWorld:
    """A `World` in pybullet.

    The engine's state is built anew for every world, so that a run does not depend on the runs before it.

    Args:
        vehicles: mass, inertia and body of every vehicle.
        starts: initial motion of every body, in the same order.
    """

    def __init__(self, vehicles: Sequence[Vehicle], starts: Sequence[Motion]) -> None:
        self._bullet, self._client = _acquire()
        self._open = True
        bullet, client = self._bullet, self._client
        bullet.resetSimulation(physicsClientId=client)
        # A reset also resets the solver, so its settings are given again.
        bullet.setPhysicsEngineParameter(fixedTimeStep=DT, numSubSteps=0, deterministicOverlappingPairs=1, physicsClientId=client)
        bullet.setGravity(0, 0, 0, physicsClientId=client)
        firsts = range(0, len(vehicles), _MOST)
        self._groups = [(*self._build(vehicles[k : k + _MOST]), slice(3 * k, 3 * (k + _MOST))) for k in firsts]
        """Per multibody its number, its joints, and which forces are theirs; it holds the next `_MOST` vehicles."""
        self._first = {group: first for (group, _, _), first in zip(self._groups, firsts, strict=True)}
        """First vehicle of each multibody."""
        for body, start in enumerate(starts):
            group, link = self._link(body)
            for joint, (place, velocity) in enumerate(zip(start[:3], start[3:], strict=True), start=link):
                bullet.resetJointState(group, joint, place, velocity, physicsClientId=client)
        # Contacts are looked up before the first step too: two vehicles may stand inside each other.
        bullet.performCollisionDetection(physicsClientId=client)

    def _link(self, body: int) -> tuple[int, int]:
        """Return the number of the multibody that holds `body`, and the number of the first of the three joints of `body`."""
        return self._groups[body // _MOST][0], body % _MOST * 3

    def _build(self, vehicles: Sequence[Vehicle]) -> tuple[int, list[int]]:
        """Make a multibody of at most `_MOST` vehicles; return its number and its joints."""
        bullet, client = self._bullet, self._client
        boxes = {vehicle: self._box(vehicle) for vehicle in dict.fromkeys(vehicles)}
        count = len(vehicles)
        links = 3 * count
        joints = list(range(links))
        body: int = bullet.createMultiBody(
            baseMass=0,
            baseCollisionShapeIndex=-1,
            linkMasses=[mass for vehicle in vehicles for mass in (_HELPER_MASS, _HELPER_MASS, vehicle.mass)],
            linkCollisionShapeIndices=[shape for vehicle in vehicles for shape in (-1, -1, boxes[vehicle])],
            linkVisualShapeIndices=[-1] * links,
            linkPositions=[[0, 0, 0]] * links,
            linkOrientations=[[0, 0, 0, 1]] * links,
            linkInertialFramePositions=[[0, 0, 0]] * links,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * links,
            # Parent 0 is the base, parent k the link k - 1.
            linkParentIndices=[parent for k in range(0, links, 3) for parent in (0, k + 1, k + 2)],
            linkJointTypes=[bullet.JOINT_PRISMATIC, bullet.JOINT_PRISMATIC, bullet.JOINT_REVOLUTE] * count,
            linkJointAxis=[[1, 0, 0], [0, 1, 0], [0, 0, 1]] * count,
            flags=bullet.URDF_USE_SELF_COLLISION,
            physicsClientId=client,
        )
        # Calls of their own: damping in the same call as other settings redirects those to the base.
        for link in range(-1, links):
            bullet.changeDynamics(body, link, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client)
        for link, vehicle in zip(range(2, links, 3), vehicles, strict=True):
            inertia = [vehicle.yaw_inertia] * 3
            bullet.changeDynamics(body, link, localInertiaDiagonal=inertia, restitution=0, physicsClientId=client)
        # Joints are born with a motor that holds them; without force it is gone.
        bullet.setJointMotorControlArray(body, joints, bullet.VELOCITY_CONTROL, forces=[0.0] * links, physicsClientId=client)
        return body, joints

    def _box(self, vehicle: Vehicle) -> int:
        """Return a shape: the body reaches from the front bumper backwards, its link sits in the centre of gravity."""
        shape: int = self._bullet.createCollisionShape(
            self._bullet.GEOM_BOX,
            halfExtents=[vehicle.length / 2, vehicle.width / 2, vehicle.height / 2],
            collisionFramePosition=[vehicle.gravity_offset - vehicle.length / 2, 0.0, 0.0],
            physicsClientId=self._client,
        )
        return shape

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order in which they were given."""
        self._check()
        states = self._bullet.getJointStates
        found = [states(group, joints, physicsClientId=self._client) for group, joints, _ in self._groups]
        return [
            Motion(x, y, yaw, vx, vy, rate)
            for joints in found
            for (x, vx, _, _), (y, vy, _, _), (yaw, rate, _, _) in zip(*[iter(joints)] * 3, strict=True)
        ]

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step under `forces` (x [N], y [N], moment [N m] of every body, flat)."""
        self._check()
        drive, kind = self._bullet.setJointMotorControlArray, self._bullet.TORQUE_CONTROL
        for group, joints, theirs in self._groups:
            drive(group, joints, kind, forces=forces[theirs], physicsClientId=self._client)
        self._bullet.stepSimulation(physicsClientId=self._client)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that touched at the start of the last step.

        The engine detects contacts at the start of a step and resolves them within it. Two bodies count as touching
        when they overlap there, or when the step pushed them apart although a sliver of air was left between them.
        """
        self._check()
        points = self._bullet.getContactPoints(physicsClientId=self._client)
        if not points:
            return []
        first = self._first
        touching = {
            (first[point[1]] + point[3] // 3, first[point[2]] + point[4] // 3)
            for point in points
            if point[8] <= 0.0 or point[9] > 0.0
        }
        return sorted({(min(pair), max(pair)) for pair in touching})

    def remove(self, body: int) -> None:
        """Take `body` out of the world: it stands still and touches nothing any more."""
        self._check()
        group, link = self._link(body)
        self._bullet.setCollisionFilterGroupMask(group, link + 2, 0, 0, physicsClientId=self._client)
        for joint in range(link, link + 3):
            place = self._bullet.getJointState(group, joint, physicsClientId=self._client)[0]
            self._bullet.resetJointState(group, joint, place, 0.0, physicsClientId=self._client)

    def close(self) -> None:
        """Give the engine back for the next world."""
        if self._open:
            self._open = False
            _free.append((os.getpid(), self._client))

    def _check(self) -> None:
        if not self._open:
            raise RunError("this world is closed: build a new one for every run")


_free: list[tuple[int, int]] = []
"""Connected engines without a world, by the process that connected them: connecting takes 20 ms, resetting 0.3 ms."""


def _acquire() -> tuple[ModuleType, int]:
    """Return pybullet and an engine that no open world uses."""
    bullet = _load()
    pid = os.getpid()
    # An engine connected before a fork belongs to the parent, and a driver may have disconnected one.
    _free[:] = [entry for entry in _free if entry[0] == pid and bullet.isConnected(entry[1])]
    client = _free.pop()[1] if _free else bullet.connect(bullet.DIRECT)
    if client == 0:  # a driver that uses pybullet and names no engine works on this one: it stays idle
        client = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise RunError("pybullet has no engine left for another world: close worlds that are no longer used")
    return bullet, client


def _load() -> ModuleType:
    """Import pybullet without the line that it prints on standard error."""
    try:
        with _silent_stderr():
            import pybullet
    except ModuleNotFoundError:
        raise RunError(needs("the world of bullet", "pybullet", "bullet")) from None
    module: ModuleType = pybullet
    return module


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    # The line comes from C code, so the file descriptor is redirected; a process may also have none.
    try:
        saved = os.dup(2)
    except OSError:
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(sink)
