"""Runs: the sequence of states that a simulation or a recording yields (paper, section 4.2).

Runs are values. A verdict depends on what the hash of a run covers, and on nothing else: the states with their accuracy, the
name, route, kind and size of every agent, collisions, `Facts`, fault, excerpt and junction. `Run.provenance` tells where a run
comes from, and no code that judges reads it. ``collisions=None`` means that nothing watched for collisions.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any, get_type_hints

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.displayed import shown
from pytest_rvads.support.errors import RunError

__all__ = ["ARRAYS", "DT", "FAULT", "LATE", "Collision", "Excerpt", "Facts", "Fault", "Halt", "Positive", "Run"]

DT = 0.01
"""Time between two states, and the physics step [s]."""
ARRAYS = ("zone", "lights", "station", "speed", "pose", "controls")
"""The states."""
FAULT, LATE = "fault", "late"
"""Ends of runs in their provenance: a fault, and a fault because a limit of real time was exceeded."""
Positive = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]
"""A number above 0, finite; as run files have it."""


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
    """The reason why a run ended early: the verdict of every rule is then ERROR."""

    time: float
    """[s]."""
    agent: str
    """The vehicle concerned."""
    reason: str
    """One sentence naming autopilot or plant and what went wrong."""
    detail: str = field(default="", compare=False)
    """What a stack in another process last wrote to its standard error; not part of the run's hash."""


class Halt(RunError):
    """Ends a run with a fault; raised and caught within a simulation.

    Args:
        agent: the vehicle concerned.
        reason: one sentence, see `Fault.reason`.
        detail: see `Fault.detail`.
        end: what the run's provenance calls its end, `FAULT` or `LATE`.
    """

    def __init__(self, agent: str, reason: str, detail: str = "", end: str = FAULT) -> None:
        super().__init__(reason)
        self.end = end
        self.agent = agent
        self.reason = reason
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Facts:
    """The facts beside the states on which a verdict can depend; part of a run's hash. An unknown fact is None.

    Raises:
        RunError: a value is not of the type of its fact.
    """

    subject: str | None = None
    """Name of the vehicle under test in a run with traffic; None if every vehicle is under test."""
    speed_limit: Positive | None = None
    """Speed limit on roads for which the map states no limit [m/s]."""
    strayed: tuple[str, ...] = ()
    """Names of the vehicles that left their routes, which ended the run."""
    turning: tuple[tuple[str, Positive], ...] = ()
    """Names of vehicles that steer otherwise than a usual car of their length, each with the radius of the smallest circle that
    its rear axle drives [m]."""

    def __post_init__(self) -> None:
        for name, kind in _FACTS.items():
            value = getattr(self, name)
            plain = float(value) if isinstance(value, float) else value  # numpy's are a class of their own
            object.__setattr__(self, name, typed(plain, kind, f"{name} of facts", RunError))


_FACTS = get_type_hints(Facts, include_extras=True)


@dataclass(frozen=True, slots=True)
class Excerpt:
    """Which part of a recording a run is, and how exact that is; part of a run's hash."""

    start: float = 0.0
    """Time of the first state on the clock of the recording [s]."""
    judged: tuple[str, ...] | None = None
    """Names of the vehicles that are judged in this excerpt; None if all are. An instance of a rule is judged if the vehicle that
    appeared last among the vehicles of the instance is a judged vehicle. Another excerpt judges the remaining vehicles."""
    position_accuracy: float = 0.0
    """Standard deviation of a position beside the way [m]; along the way see `Run.spread`."""
    speed_accuracy: float = 0.0
    """Standard deviation of a speed [m/s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run of the system: states every `dt` seconds, as arrays with one row per state.

    A run holds copies of its arrays; the arrays and the keys of the provenance are read-only. A field that a recording does not
    hold is None.
    """

    label: str
    """Names the scenario or the recording, as in test ids."""
    junction: Junction
    agents: tuple[Agent, ...]
    """In the order of the columns; simulated runs list them by entrance."""
    zone: NDArray[np.int8]
    """`Zone` of every agent, shape ``(steps, agents)``."""
    lights: NDArray[np.int8]
    """`Colour` at every start of a way, see `Junction.starts`, shape ``(steps, starts)``."""
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
    collisions: tuple[Collision, ...] | None = None
    """None if collisions were not recorded; they are then computed from poses and sizes."""
    fault: Fault | None = None
    facts: Facts = Facts()
    excerpt: Excerpt | None = None
    """The part of a recording that this run is; None if the run is the whole recording."""
    spread: NDArray[np.float64] | None = None
    """Largest error of the stations, shape ``(steps, agents)`` [m]; None if the stations are exact."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Origin of the run, as builtins: the scenario's fields, the drivers, versions. No verdict depends on the provenance."""

    def __post_init__(self) -> None:
        for name in (*ARRAYS, "spread"):
            array = getattr(self, name)
            if array is not None:
                own = array.copy()
                own.flags.writeable = False
                object.__setattr__(self, name, own)
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Run, tuple(getattr(self, item.name) for item in fields(self))  # numpy unpickles arrays that can be written to

    def __eq__(self, other: object) -> bool:
        """Tell whether two runs are the same bit for bit."""
        return self.hash == other.hash if isinstance(other, Run) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.hash)

    def __repr__(self) -> str:
        return f"<Run {self.label}: {len(self.agents)} vehicles, {self.duration:.2f} s>"

    def _repr_html_(self) -> str:
        return shown(self)

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
        """Time of every state since the first, shape ``(steps,)`` [s]."""
        return np.arange(self.steps, dtype=np.float64) * np.float64(self.dt)

    @cached_property
    def wt(self) -> NDArray[np.int32]:
        """Waiting time of every agent in ticks, shape ``(steps, agents)``.

        Zero in the first state and outside the entrance zone, one more for every further state spent in
        it; it does not restart when the vehicle starts to move inside the zone.
        """
        tick = np.arange(self.steps, dtype=np.int32)[:, None]
        restart = np.where(self.zone == Zone.ENTRANCE, 0, tick)
        waited = tick - np.maximum.accumulate(restart, axis=0)
        waited.flags.writeable = False
        return waited

    @cached_property
    def entered(self) -> NDArray[np.int64]:
        """First tick in the junction or beyond, shape ``(agents,)``; the number of states for an agent that never enters."""
        beyond = self.zone >= Zone.JUNCTION
        ticks = np.where(beyond.any(axis=0), beyond.argmax(axis=0), self.steps)
        ticks.flags.writeable = False
        return ticks

    @cached_property
    def facing(self) -> NDArray[np.int8]:
        """Colour of the light at each agent's entrance, shape ``(steps, agents)``; after the entry, the colour at the entry."""
        colours = self.lights[:, [agent.entrance for agent in self.agents]]
        tick = np.minimum(np.arange(self.steps)[:, None], self.entered)
        faced: NDArray[np.int8] = np.take_along_axis(colours, tick, axis=0)
        faced.flags.writeable = False
        return faced

    @cached_property
    def advance(self) -> NDArray[np.float64]:
        """Speed of every agent along its itinerary, shape ``(steps, agents)`` [m/s]; negative when the agent reverses.

        The value in the first state of an agent is the agent's recorded speed.

        Raises:
            RunError: the run does not record positions and speeds.
        """
        station = self.need("station")
        rate = np.vstack((self.need("speed")[:1], np.diff(station, axis=0) / self.dt))
        begin = self.spans[:, 0]
        late = np.flatnonzero(begin)
        rate[begin[late], late] = self.need("speed")[begin[late], late]
        rate.flags.writeable = False
        return rate

    @cached_property
    def hash(self) -> str:
        """SHA-256 over states, collisions, fault, agents, facts and junction: equal hashes mean runs that are judged alike."""
        sha = hashlib.sha256()
        agents = [[a.name, a.way.key, a.kind, a.size] for a in self.agents]
        # Facts about steering enter the hash only if a vehicle has them, so that runs of usual cars keep their hashes.
        facts = astuple(self.facts) if self.facts.turning else astuple(self.facts)[:-1]
        head = [self.label, self.dt, agents, facts, self.junction.digest]
        tail = None if self.collisions is None else [[c.time, *c.agents, c.speed] for c in self.collisions]
        fault = self.fault and [self.fault.time, self.fault.agent, self.fault.reason]
        sha.update(json.dumps([head, tail, fault]).encode())
        for array in (getattr(self, name) for name in ARRAYS):
            sha.update(b"-" if array is None else str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
        if self.excerpt is not None:
            sha.update(json.dumps(astuple(self.excerpt)).encode())
        if self.spread is not None:
            sha.update(np.ascontiguousarray(self.spread).tobytes())
        return sha.hexdigest()

    @property
    def start(self) -> float:
        """Time of the first state on the clock of the recording that the run is an excerpt of, else 0 [s]."""
        return 0.0 if self.excerpt is None else self.excerpt.start

    @cached_property
    def here(self) -> NDArray[np.bool_]:
        """Whether every agent is in the run, neither absent nor gone, shape ``(steps, agents)``."""
        present: NDArray[np.bool_] = (self.zone != Zone.GONE) & (self.zone != Zone.ABSENT)
        present.flags.writeable = False
        return present

    @cached_property
    def spans(self) -> NDArray[np.int64]:
        """First tick of every agent and the tick after its last, shape ``(agents, 2)``; both 0 if the agent never appears."""
        present = self.zone != Zone.ABSENT
        ends = np.where(present.any(axis=0), self.steps - present[::-1].argmax(axis=0), 0)
        spans = np.stack((present.argmax(axis=0), ends), axis=1) if self.steps else np.zeros((len(self.agents), 2), np.int64)
        spans.flags.writeable = False
        return spans

    @property
    def subject(self) -> str | None:
        """Name of the vehicle under test in a run with traffic; None if every vehicle is under test."""
        return self.facts.subject

    def need(self, name: str) -> NDArray[np.float64]:
        """Return ``station``, ``speed`` or ``pose``.

        Raises:
            RunError: the run does not record it.
        """
        array: NDArray[np.float64] | None = getattr(self, name)
        if array is None:
            raise RunError(f"the run holds no {'speeds' if name == 'speed' else 'positions'}")
        return array

    def size(self, agent: int) -> tuple[float, float]:
        """Return length and width of the agent in column `agent` [m].

        Raises:
            RunError: the run does not record them.
        """
        size = self.agents[agent].size
        if size is None:
            raise RunError("the run holds no size of its vehicles")
        return size

    def entry(self, agent: int) -> float | None:
        """Return the time at which the agent in column `agent` enters the junction [s]; None if the agent never enters."""
        inside = np.flatnonzero(self.zone[:, agent] == Zone.JUNCTION)
        return float(inside[0]) * self.dt if len(inside) else None
