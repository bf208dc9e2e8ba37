"""Runs: the sequence of states that a simulation or a recording yields (paper, section 4.2).

Runs are values. A verdict depends on what the hash of a run covers, and on nothing else: label and time step, the states with
their accuracy, the name, way, kind and size of every agent, collisions, `Facts`, fault, excerpt and junction. `Run.provenance`
tells where a run comes from, and no code that judges reads the provenance. ``collisions=None`` means that collisions were not
recorded.

A run keeps the results of functions that are called by `once`, so that all rules that judge the run share the results. Such a
result must not hold the run, because the circle of references would keep the run in memory until the next garbage collection.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any, TypeVar, get_type_hints

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.runs.states import Agent, Colour, Zone, crowd
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import shown

DT = 0.01
"""Time between two states, and the physics step [s]."""
ARRAYS = ("zone", "lights", "station", "speed", "pose", "controls")
"""Names of the arrays of a run that hold its states."""
PARTS = {"pose": ("x", "y", "heading"), "controls": ("throttle", "brake", "steering")}
"""Per array with several numbers for each state and agent, the names of these numbers."""
FAULT, LATE = "fault", "late"
"""Reasons for the end of a run, as its provenance holds them: a fault, and a fault because a limit of real time was exceeded."""
RAISED: dict[str, Any] = {}
"""The last fault of this process: its reason, and the exception that caused it. A run is stored, and can't hold an exception."""
Positive = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]
"""A finite number above 0, as run files hold it."""


@dataclass(frozen=True, slots=True)
class Collision:
    """The moment at which two bodies touch for the first time."""

    time: float
    """Time of the first touch since the start of the run [s]."""
    agents: tuple[str, str]
    """Names of the two agents."""
    speed: float
    """Relative speed of the two bodies at impact [m/s]."""


@dataclass(frozen=True, slots=True)
class Fault:
    """The reason why a run ended early. A rule that was violated before the end stays FAIL; every other verdict is ERROR."""

    time: float
    """Time of the fault since the start of the run [s]."""
    agent: str
    """Name of the vehicle whose autopilot or body caused the fault."""
    reason: str
    """One sentence that names the autopilot or the body and says what went wrong."""
    detail: str = field(default="", compare=False)
    """The last text that a driver in another process wrote to its standard error; not part of the run's hash."""


class Halt(RunError):
    """The exception that ends a run with a `Fault`; raised and caught within a simulation.

    The run's provenance calls its end `end`, which is `FAULT` or `LATE`.
    """

    def __init__(self, agent: str, reason: str, detail: str = "", end: str = FAULT) -> None:
        super().__init__(reason)
        self.end = end
        self.agent = agent
        self.reason = reason
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Facts:
    """The facts beside the states of a run on which a verdict can depend; part of the run's hash. An unknown fact is None.

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
    """Names of the vehicles whose turning circle is not that of a usual car of their length, each with the radius of the smallest
    circle that its rear axle drives [m]."""

    def __post_init__(self) -> None:
        for name, kind in _FACTS.items():
            value = getattr(self, name)
            plain = float(value) if isinstance(value, float) else value  # numpy's floats are of a subclass
            object.__setattr__(self, name, typed(plain, kind, f"{name} of facts", RunError))


_FACTS = get_type_hints(Facts, include_extras=True)


@dataclass(frozen=True, slots=True)
class Excerpt:
    """The part of a recording that a run holds, and the accuracy of the recording; part of the run's hash."""

    start: float = 0.0
    """Time of the first state on the clock of the recording [s]."""
    judged: tuple[str, ...] | None = None
    """Names of the vehicles that are judged in this excerpt; None if all vehicles are judged. An instance of a rule (the rule for
    certain vehicles) is judged if the vehicle that appeared last among these vehicles is a judged vehicle. Other excerpts judge
    the other vehicles."""
    position_accuracy: float = 0.0
    """Standard deviation of a position across the way of the vehicle [m]; for the accuracy along the way see `Run.spread`."""
    speed_accuracy: float = 0.0
    """Standard deviation of a speed [m/s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A simulated or recorded run: the states every `dt` seconds, as arrays with one row per state.

    A run holds copies of its arrays; the arrays and the keys of the provenance are read-only. A field that a recording does not
    hold is None.
    """

    label: str
    """Name of the scenario or the recording, as in the ids of tests."""
    junction: Junction
    """The junction on which the agents move."""
    agents: tuple[Agent, ...]
    """The agents in the order of the columns of the arrays; simulated runs list the agents by entrance."""
    zone: NDArray[np.int8]
    """`Zone` of every agent, shape ``(steps, agents)``."""
    lights: NDArray[np.int8]
    """`Colour` at every start of a way, see `Junction.starts`, shape ``(steps, starts)``."""
    dt: float = DT
    """Time between two states [s]."""
    station: NDArray[np.float64] | None = None
    """Station of the reference point along the itinerary, 0 at the entrance vertex, shape ``(steps, agents)`` [m]."""
    speed: NDArray[np.float64] | None = None
    """Forward speed, shape ``(steps, agents)`` [m/s]."""
    pose: NDArray[np.float64] | None = None
    """x [m], y [m], heading [rad] of the reference point, shape ``(steps, agents, 3)``."""
    controls: NDArray[np.float64] | None = None
    """Throttle, brake, steering commanded in each step, shape ``(steps, agents, 3)``."""
    collisions: tuple[Collision, ...] | None = None
    """Collisions; None if collisions were not recorded, so that they are computed from poses and sizes."""
    fault: Fault | None = None
    """The reason why the run ended early; None for a run without a fault."""
    facts: Facts = Facts()
    """The facts on which verdicts depend beside the states, such as the vehicle under test."""
    excerpt: Excerpt | None = None
    """The part of a recording that this run is; None for a simulated run, and for a run that is a whole recording."""
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
        """Return whether two runs are the same bit for bit, apart from their provenance."""
        return self.hash == other.hash if isinstance(other, Run) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.hash)

    def __repr__(self) -> str:
        return f"<Run {self.label}: {crowd(self.agents)}, {self.duration:.2f} s>"

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
    def hash(self) -> str:
        """SHA-256 over label, time step, states, spread, collisions, fault, agents, facts, excerpt and junction.

        Equal hashes mean equal verdicts.
        """
        sha = hashlib.sha256()
        # Only a vehicle whose way is not decided has other exits in the hash, so that all other runs keep their hashes.
        agents = [[a.name, a.way.key, a.kind, a.size, *([a.other_exits] if a.other_exits else [])] for a in self.agents]
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

    @cached_property
    def _results(self) -> dict[object, Any]:
        """The results of functions of this run, see `once`."""
        return {}

    @property
    def start(self) -> float:
        """Time of the first state on the clock of the recording [s]; 0 for a run that is no excerpt of a recording."""
        return 0.0 if self.excerpt is None else self.excerpt.start

    @cached_property
    def here(self) -> NDArray[np.bool_]:
        """Whether every agent is in the run, neither absent nor gone, shape ``(steps, agents)``."""
        present: NDArray[np.bool_] = (self.zone != Zone.GONE) & (self.zone != Zone.ABSENT)
        present.flags.writeable = False
        return present

    @cached_property
    def spans(self) -> NDArray[np.int64]:
        """First tick of every agent, and the tick after its last tick, shape ``(agents, 2)``; both 0 if it never appears."""
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
        """Return the array ``station``, ``speed`` or ``pose`` of the run.

        Raises:
            RunError: the run does not record this array.
        """
        array: NDArray[np.float64] | None = getattr(self, name)
        if array is None:
            raise RunError(f"the run holds no {'speeds' if name == 'speed' else 'positions'}")
        return array

    def size(self, agent: int) -> tuple[float, float]:
        """Return length and width of the agent in column `agent` [m].

        Raises:
            RunError: the run does not record the size of this agent.
        """
        size = self.agents[agent].size
        if size is None:
            raise RunError("the run holds no size of its vehicles")
        return size

    def entry(self, agent: int) -> float | None:
        """Return the time at which the agent in column `agent` enters the junction [s]; None if the agent never enters."""
        inside = np.flatnonzero(self.zone[:, agent] == Zone.JUNCTION)
        return float(inside[0]) * self.dt if len(inside) else None


_Result = TypeVar("_Result")


def once(run: Run, work: Callable[..., _Result], *columns: int) -> _Result:
    """Return the result of `work` on a run, or on agents of the run, given by column; the result is cached with the run."""
    key = work, columns
    if key not in run._results:
        run._results[key] = work(run, *columns)
    result: _Result = run._results[key]
    return result


def given(run: Run, work: Callable[[Run], _Result], result: _Result) -> None:
    """Store a result of `work` on a run, so that `once` returns this result instead of calling `work`."""
    run._results[work, ()] = result


def diverge(one: Run, other: Run) -> Divergence | None:
    """Return the first difference between two runs; None if the runs have the same hash.

    The comparison begins with the properties of the runs (label, time step, vehicles, facts, junction), goes on with the states
    in order of time, and ends with length, fault and collisions.
    """
    properties: dict[str, tuple[object, ...]] = {
        "label": (one.label, other.label),
        "step": (one.dt, other.dt),
        "vehicles": tuple(" ".join(f"{a.name}:{a.entrance}->{a.exit}" for a in run.agents) for run in (one, other)),
        "facts": (one.facts, other.facts),
        "junction": (one.junction.digest[:12], other.junction.digest[:12]),
    }
    for what, (a, b) in properties.items():
        if a != b:
            return Divergence(what, str(a), str(b))
    states = [d for field in ARRAYS if (d := _first_difference(one, other, field))]
    if states:
        return min(states, key=lambda d: -1 if d.tick is None else d.tick)
    ending: dict[str, tuple[object, ...]] = {
        "length": (one.steps, other.steps),
        "fault": (one.fault, other.fault),
        "collisions": (one.collisions, other.collisions),
    }
    for what, (a, b) in ending.items():
        if a != b:
            return Divergence(what, str(a), str(b))
    return None


_ENUMS = {"zone": Zone, "lights": Colour}


def _first_difference(one: Run, other: Run, field: str) -> Divergence | None:
    """Return the first difference between the arrays `field` of two runs, in order of time; None if the arrays are equal."""
    a: NDArray[Any] | None = getattr(one, field)
    b: NDArray[Any] | None = getattr(other, field)
    if a is None or b is None:
        own, others = ("not recorded" if values is None else "recorded" for values in (a, b))
        return None if a is b else Divergence(field, own, others)
    parts = (np.ascontiguousarray(values[: min(len(a), len(b))]) for values in (a, b))
    # Floats are compared as integers, which are equal where the floats are the same bit for bit, NaN included.
    bits, other_bits = (values.view(np.int64) if values.dtype == np.float64 else values for values in parts)
    differs = bits != other_bits
    if not differs.any():
        return None
    tick, column, *part = (int(i) for i in np.argwhere(differs)[0])
    name = PARTS[field][part[0]] if part else field
    where = f"light of entrance {column}" if field == "lights" else f"{name} of {one.agents[column].name}"
    differing, kind = [values[(tick, column, *part)] for values in (a, b)], _ENUMS.get(field)
    own, others = (kind(int(value)).name.lower() if kind else repr(float(value)) for value in differing)
    return Divergence(where, own, others, tick, round(tick * one.dt, 9))
