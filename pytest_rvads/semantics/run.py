"""Runs: the sequence of states that a simulation or a recording yields (paper, section 4.2)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.junction import Junction
from pytest_rvads.semantics.states import Agent, Zone

if TYPE_CHECKING:
    from pytest_rvads.semantics.validate import Finding

__all__ = ["DT", "Collision", "Fault", "Run"]

DT = 0.01
"""Time between two states, and the physics step [s]."""


@dataclass(frozen=True, slots=True)
class Collision:
    """Two bodies touching for the first time."""

    time: float
    """[s]."""
    agents: tuple[str, str]
    speed: float
    """Relative speed of the two bodies at impact [m/s]."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Why a run ended before its time: the verdict of every rule is then ERROR."""

    time: float
    """[s]."""
    agent: str
    """The vehicle concerned."""
    reason: str
    """One sentence naming autopilot or plant and what went wrong."""
    detail: str = field(default="", compare=False)
    """What a stack in another process last wrote to its standard error; not part of the run's hash."""


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run of the system: states every `dt` seconds, as arrays with one row per state.

    What a recording does not hold is None, never guessed.
    """

    label: str
    """Names the scenario or the recording, as in test ids."""
    junction: Junction
    agents: tuple[Agent, ...]
    """In the order of the columns; simulated runs list them by entrance."""
    zone: NDArray[np.int8]
    """`Zone` of every agent, shape ``(steps, agents)``."""
    lights: NDArray[np.int8]
    """`Colour` at every entrance, shape ``(steps, entrances)``."""
    dt: float = DT
    """Time between two states [s]."""
    station: NDArray[np.float64] | None = None
    """Reference point along the itinerary, 0 at the entrance vertex, shape ``(steps, agents)`` [m]."""
    speed: NDArray[np.float64] | None = None
    """Forward speed, shape ``(steps, agents)`` [m/s]."""
    pose: NDArray[np.float64] | None = None
    """x [m], y [m], heading [rad] of the reference point, shape ``(steps, agents, 3)``."""
    controls: NDArray[np.float64] | None = None
    """Throttle, brake, steering commanded in each step, shape ``(steps, agents, 3)``."""
    collisions: tuple[Collision, ...] = ()
    fault: Fault | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    """Where the run comes from, as builtins: the scenario's fields, autopilot, versions."""

    def __eq__(self, other: object) -> bool:
        """Tell whether two runs are the same bit for bit."""
        return self.hash == other.hash if isinstance(other, Run) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.hash)

    def __repr__(self) -> str:
        return f"<Run {self.label}: {len(self.agents)} vehicles, {self.duration:.2f} s>"

    @property
    def steps(self) -> int:
        """Number of states."""
        return len(self.zone)

    @property
    def duration(self) -> float:
        """Time of the last state [s]."""
        return max(self.steps - 1, 0) * self.dt

    @property
    def times(self) -> NDArray[np.float64]:
        """Time of every state, shape ``(steps,)`` [s]."""
        return np.arange(self.steps, dtype=np.float64) * np.float64(self.dt)

    @cached_property
    def wt(self) -> NDArray[np.int32]:
        """Waiting time of every agent in ticks, shape ``(steps, agents)``.

        Zero in the first state and outside the entrance zone, one more for every further state spent in
        it; it does not restart when the vehicle starts to move inside the zone.
        """
        tick = np.arange(self.steps, dtype=np.int32)[:, None]
        restart = np.where(self.zone == Zone.ENTRANCE, 0, tick)
        return tick - np.maximum.accumulate(restart, axis=0)

    @cached_property
    def hash(self) -> str:
        """SHA-256 over every state, collision and fault: equal hashes mean bit-identical runs."""
        digest = hashlib.sha256()
        head = [self.label, self.dt, [[a.name, a.entrance, a.exit] for a in self.agents]]
        tail = [[c.time, *c.agents, c.speed] for c in self.collisions]
        fault = self.fault and [self.fault.time, self.fault.agent, self.fault.reason]
        digest.update(json.dumps([head, tail, fault]).encode())
        for array in (self.zone, self.lights, self.station, self.speed, self.pose, self.controls):
            digest.update(b"-" if array is None else str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @property
    def subject(self) -> str | None:
        """Name of the vehicle under test where the others are traffic, else None."""
        seat = (self.meta.get("scenario") or {}).get("subject")
        return next((a.name for a in self.agents if seat is not None and a.entrance == seat), None)

    def validate(self) -> tuple[Finding, ...]:
        """Return what breaks the semantic model in this run, see `pytest_rvads.semantics.validate.validate`."""
        from pytest_rvads.semantics.validate import validate

        return validate(self)

    def entry(self, agent: int) -> float | None:
        """Return when the agent in column `agent` enters the junction [s], or None."""
        inside = np.flatnonzero(self.zone[:, agent] == Zone.JUNCTION)
        return float(inside[0]) * self.dt if len(inside) else None
