"""A world in MuJoCo, which also detects and resolves collisions.

A vehicle is a body on three joints (x, y, yaw). No force acts in the joints, so every body moves freely in the plane.

mujoco is imported with the first simulation, because the import takes 0.2 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.support.errors import RunError, ScenarioError, needs
from pytest_rvads.support.wording import one_line

__all__ = ["MujocoWorld"]

_NONE = 0
"""Group of shapes that collide with nothing."""


class MujocoWorld:
    """A `World` in MuJoCo.

    Args:
        vehicles: mass, inertia and body of every vehicle.
        starts: initial motion of every body, in the same order.
    """

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
        # Two vehicles may start inside each other. Contacts are not resolved, because the solver needs minutes for many contacts.
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
        """Take `body` out of the world: it stands still and touches nothing any more."""
        self._open_data()
        self._model.geom_contype[body] = self._model.geom_conaffinity[body] = _NONE
        self._velocities[3 * body : 3 * body + 3] = 0.0

    def close(self) -> None:
        """Free the world."""
        self._model = self._data = self._places = self._velocities = self._forces = None

    def _unfiltered(self, function: Any) -> None:
        """Call a function that detects contacts, without the contact filter that a driver may have set for all models."""
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
    # springs and dampers, MuJoCo calls no callbacks that a driver may have set for all models.
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
