"""The physics engines pybullet and MuJoCo, a world of each, and the choice of the usual engine.

A world moves the bodies of vehicles, and detects and resolves collisions. In both engines a vehicle has three joints (x, y, yaw).
No force acts in the joints, so every body moves freely in the plane. In pybullet a vehicle is a link of a multibody with a fixed
base, and two calls per step read and drive all vehicles of a multibody. In MuJoCo a vehicle is a body.

An engine is imported with its first world: the import of mujoco takes 0.2 s.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from pytest_rvads.physics.body import Motion, WorldMaker
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.support.errors import RunError, ScenarioError, needs
from pytest_rvads.support.wording import one_line

_HELPER_MASS = 1e-6
"""Mass of the two links that carry the x and the y joint [kg]; a billionth of a vehicle."""
_MOST = 40
"""Greatest number of vehicles in a multibody: the engine stores 128 coordinates, 7 for the base and 3 per vehicle."""


class BulletWorld:
    """A `World` in pybullet, see `WorldMaker`."""

    def __init__(self, vehicles: Sequence[Vehicle], starts: Sequence[Motion]) -> None:
        try:
            with _silent_stderr():  # the import prints a line
                import pybullet
        except ModuleNotFoundError:
            raise RunError(needs("the world of bullet", "pybullet", "bullet")) from None
        bullet: ModuleType = pybullet
        pid = os.getpid()
        # An engine connected before a fork belongs to the parent process, and a driver could have disconnected an engine.
        _free[:] = [entry for entry in _free if entry[0] == pid and bullet.isConnected(entry[1])]
        client = _free.pop()[1] if _free else bullet.connect(bullet.DIRECT)
        if client == 0:  # engine 0 is left to drivers that use pybullet without naming an engine
            client = bullet.connect(bullet.DIRECT)
        if client < 0:
            raise RunError("pybullet has no engine left for another world: close worlds that are no longer used")
        self._bullet, self._client, self._open = bullet, client, True
        bullet.resetSimulation(physicsClientId=client)
        # A reset also resets the settings of the solver.
        bullet.setPhysicsEngineParameter(fixedTimeStep=DT, numSubSteps=0, deterministicOverlappingPairs=1, physicsClientId=client)
        bullet.setGravity(0, 0, 0, physicsClientId=client)
        firsts = range(0, len(vehicles), _MOST)
        self._groups = [(*self._build(vehicles[k : k + _MOST]), slice(3 * k, 3 * (k + _MOST))) for k in firsts]
        """Number, joints and slice of forces of every multibody; a multibody holds at most `_MOST` vehicles."""
        self._first = {group: first for (group, _, _), first in zip(self._groups, firsts, strict=True)}
        """First vehicle of each multibody."""
        for body, start in enumerate(starts):
            group, link = self._groups[body // _MOST][0], body % _MOST * 3
            for joint, (place, velocity) in enumerate(zip(start[:3], start[3:], strict=True), start=link):
                bullet.resetJointState(group, joint, place, velocity, physicsClientId=client)
        # Vehicles that start inside each other are an error of the case, so contacts are detected before the first step, too.
        bullet.performCollisionDetection(physicsClientId=client)

    def _build(self, vehicles: Sequence[Vehicle]) -> tuple[int, list[int]]:
        """Make a multibody of at most `_MOST` vehicles; return its number and its joints."""
        bullet, client = self._bullet, self._client
        # A vehicle is a box behind the front bumper; the link is at the centre of gravity.
        boxes = {
            vehicle: bullet.createCollisionShape(
                bullet.GEOM_BOX,
                halfExtents=[vehicle.length / 2, vehicle.width / 2, vehicle.height / 2],
                collisionFramePosition=[vehicle.gravity_offset - vehicle.length / 2, 0.0, 0.0],
                physicsClientId=client,
            )
            for vehicle in dict.fromkeys(vehicles)
        }
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
        # Damping and inertia are set in separate calls: in a call with damping, other settings would apply to the base.
        for link in range(-1, links):
            bullet.changeDynamics(body, link, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client)
        for link, vehicle in zip(range(2, links, 3), vehicles, strict=True):
            inertia = [vehicle.yaw_inertia] * 3
            bullet.changeDynamics(body, link, localInertiaDiagonal=inertia, restitution=0, physicsClientId=client)
        # A new joint has a motor that holds it; a force of 0 disables the motor.
        bullet.setJointMotorControlArray(body, joints, bullet.VELOCITY_CONTROL, forces=[0.0] * links, physicsClientId=client)
        return body, joints

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order of the vehicles."""
        self._check_open()
        states = self._bullet.getJointStates
        groups = [states(group, joints, physicsClientId=self._client) for group, joints, _ in self._groups]
        return [
            Motion(x, y, yaw, vx, vy, rate)
            for joints in groups
            for (x, vx, _, _), (y, vy, _, _), (yaw, rate, _, _) in zip(*[iter(joints)] * 3, strict=True)
        ]

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step under `forces` (x [N], y [N], moment [N m] of every body, flat)."""
        self._check_open()
        drive, kind = self._bullet.setJointMotorControlArray, self._bullet.TORQUE_CONTROL
        for group, joints, part in self._groups:
            drive(group, joints, kind, forces=forces[part], physicsClientId=self._client)
        self._bullet.stepSimulation(physicsClientId=self._client)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that touched at the start of the last step.

        The engine detects contacts at the start of a step and resolves them within the step. Two bodies touch if they overlap, or
        if the engine pushed them apart across a small gap.
        """
        self._check_open()
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
        """Take `body` out of the world: the body stands still and touches nothing any more."""
        self._check_open()
        group, link = self._groups[body // _MOST][0], body % _MOST * 3
        self._bullet.setCollisionFilterGroupMask(group, link + 2, 0, 0, physicsClientId=self._client)
        for joint in range(link, link + 3):
            place = self._bullet.getJointState(group, joint, physicsClientId=self._client)[0]
            self._bullet.resetJointState(group, joint, place, 0.0, physicsClientId=self._client)

    def close(self) -> None:
        """Release the engine for the next world."""
        if self._open:
            self._open = False
            _free.append((os.getpid(), self._client))

    def _check_open(self) -> None:
        if not self._open:
            raise RunError("this world is closed: build a new one for every run")


_free: list[tuple[int, int]] = []
"""Connected engines without a world, each with its process id; a connection takes 20 ms, a reset 0.3 ms."""


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    # C code prints the line, so the file descriptor is redirected. Some processes have no standard error.
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


_NONE = 0
"""Group of shapes that collide with nothing."""


class MujocoWorld:
    """A `World` in MuJoCo, see `WorldMaker`."""

    def __init__(self, vehicles: Sequence[Vehicle], starts: Sequence[Motion]) -> None:
        try:
            import mujoco
        except ModuleNotFoundError:
            raise RunError(needs("the world of mujoco", "mujoco", "mujoco")) from None
        self._model = _model(mujoco, vehicles)
        self._data = data = mujoco.MjData(self._model)
        self._places, self._velocities, self._forces = data.qpos, data.qvel, data.qfrc_applied
        self._places[:] = [number for start in starts for number in start[:3]]
        self._velocities[:] = [number for start in starts for number in start[3:]]
        # `mj_step` calls the same two functions, with checks that write a log file into the working directory.
        self._forward, self._integrate = mujoco.mj_forward, mujoco.mj_Euler
        self._filter, self._set_filter = mujoco.get_mjcb_contactfilter, mujoco.set_mjcb_contactfilter
        # Vehicles that start inside each other are an error of the case, so contacts are detected before the first step. They are
        # not resolved, because the solver needs minutes for many contacts.
        mujoco.mj_kinematics(self._model, data)
        self._unfiltered(mujoco.mj_collision)

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order of the vehicles."""
        self._open_data()
        place, velocity = iter(self._places.tolist()), iter(self._velocities.tolist())
        return list(map(Motion, place, place, place, velocity, velocity, velocity))

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step under `forces` (x [N], y [N], moment [N m] of every body, flat)."""
        data = self._open_data()
        self._forces[:] = forces
        self._unfiltered(self._forward)
        self._integrate(self._model, data)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that overlapped at the start of the last step."""
        data = self._open_data()
        if not data.ncon:
            return []
        # Every body has one shape, and only bodies have shapes.
        return sorted({(min(pair), max(pair)) for pair in data.contact.geom.tolist()})

    def remove(self, body: int) -> None:
        """Take `body` out of the world: the body stands still and touches nothing any more."""
        self._open_data()
        self._model.geom_contype[body] = self._model.geom_conaffinity[body] = _NONE
        self._velocities[3 * body : 3 * body + 3] = 0.0

    def close(self) -> None:
        """Free the world."""
        self._model = self._data = self._places = self._velocities = self._forces = None

    def _unfiltered(self, function: Any) -> None:
        """Call a function that detects contacts, without a contact filter that a driver has set for all models."""
        foreign = self._filter()
        if foreign is None:
            function(self._model, self._data)
            return
        self._set_filter(None)
        try:
            function(self._model, self._data)
        finally:
            self._set_filter(foreign)

    def _open_data(self) -> Any:
        if self._data is None:
            raise RunError("this world is closed: build a new one for every run")
        return self._data


def _model(mujoco: Any, vehicles: Sequence[Vehicle]) -> Any:
    """Return a model with the vehicles, for one world only, because `remove` changes the model."""
    spec = mujoco.MjSpec()
    spec.option.timestep = DT
    off = mujoco.mjtDisableBit
    # No gravity, because nothing moves vertically. No warm start, so that a step depends on the state alone. Without actuators,
    # springs and dampers, MuJoCo calls no callbacks that a driver has set for all models.
    callbacks = off.mjDSBL_ACTUATION | off.mjDSBL_SPRING | off.mjDSBL_DAMPER
    spec.option.disableflags = int(off.mjDSBL_GRAVITY | off.mjDSBL_WARMSTART | callbacks)
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for vehicle in vehicles:
        inertia = [vehicle.yaw_inertia] * 3
        body = spec.worldbody.add_body(mass=vehicle.mass, inertia=inertia, explicitinertial=True)
        for kind, axis in ((slide, [1, 0, 0]), (slide, [0, 1, 0]), (hinge, [0, 0, 1])):
            body.add_joint(type=kind, axis=axis)
        # A box behind the front bumper; the joints are at the centre of gravity. Bodies have no friction with each other.
        size = [vehicle.length / 2, vehicle.width / 2, vehicle.height / 2]
        place = [vehicle.gravity_offset - vehicle.length / 2, 0, 0]
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=place, condim=1)
    try:
        return spec.compile()
    except ValueError as error:
        reason = one_line(str(error), 200)
        raise ScenarioError(f"MuJoCo can't move these vehicles: {reason}; give them masses and sizes of vehicles") from None


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
