"""States of vehicles, which live monitors read one after the other.

`RuleMonitor.see` reads values `Seen` and returns values `Decided`. `Stream` makes blocks of one or more states, and passes the
carries of signals (the values that quantities per state keep for later states) from block to block.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Block, Cast, Signal, assume
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import RunError


class Seen(NamedTuple):
    """The state of a vehicle at an instant; see `RuleMonitor.see`."""

    agent: Agent
    """Name, way and size of the vehicle, the same in every state; no other vehicle present has the same name."""
    station: float
    """Station of the reference point along the itinerary, 0 at the entrance vertex [m]."""
    speed: float
    """Forward speed [m/s]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    spread: float = 0.0
    """Three standard deviations of the measured station [m]."""


@dataclass(frozen=True, slots=True)
class Decided:
    """The final verdict of an instance of a rule (the rule for certain vehicles and entrances)."""

    rule: str
    """Name of the rule."""
    binding: Mapping[str, str]
    """Variables of the rule, with the names of the vehicles and entrances that the variables stand for."""
    verdict: Truth
    """``F``: the instance was violated at `time`; ``T``: no continuation violates the instance; ``?``: a vehicle of the instance
    left, and the instance can't be violated any more."""
    time: float
    """Time of the decision since the first state [s]."""


def sizes_of(vehicle_size: tuple[float, float] | Sequence[tuple[float, float]], count: int) -> tuple[tuple[float, float], ...]:
    """Return the length and width of every vehicle [m], given a pair of numbers for all vehicles or a pair per vehicle."""
    sizes = np.asarray(vehicle_size, dtype=np.float64)
    if sizes.shape not in ((2,), (count, 2)) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise RunError(
            f"vehicle_size must be a length and width [m], for all {count} vehicles or for each, got {vehicle_size!r:.60}"
        )
    return tuple((float(length), float(width)) for length, width in np.broadcast_to(sizes, (count, 2)))


def row_of(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the values of an array of a state, after a check of their shape."""
    row = np.asarray(values, dtype=np.float64)
    if row.shape != shape or not np.isfinite(row).all():
        what = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
        raise RunError(f"{name} of a state must be {what}, got {values!r:.60}")
    return row


class State(NamedTuple):
    """The values of all vehicles in a state, by column; None for values that are not given."""

    zone: NDArray[Any]
    lights: NDArray[Any]
    station: NDArray[np.float64] | None
    speed: NDArray[np.float64] | None
    pose: NDArray[np.float64] | None
    touching: frozenset[frozenset[str]] | None = None
    """Pairs of names of vehicles that touch for the first time; None if no simulator recorded contacts."""

    @property
    def given(self) -> tuple[bool, ...]:
        """Per field of the state, whether the field is given."""
        return tuple(value is not None for value in self)


class Stream:
    """Makes blocks of states as the states come, and passes the carries of signals from block to block."""

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.dt, self._facts = dt, facts
        self.cast = Cast(junction, (), facts)
        self.tick = 0
        """Tick of the next state."""
        self._kept: Sequence[int | None] | None = None
        self._last: Block | None = None

    def recast(self, agents: Sequence[Agent], columns: Sequence[int | None]) -> None:
        """Replace the vehicles of the stream, each with its column in the last block, or None if it has just come."""
        self.cast, self._kept = Cast(self.cast.junction, agents, self._facts), columns

    def feed(self, signals: Iterable[Signal[Any]], zone: NDArray[np.int8], lights: NDArray[np.int8], **arrays: Any) -> Block:
        """Return the next n states as a block on which the given signals are evaluated."""
        block = Block(self.cast, zone, lights, self.dt, **arrays, tick=self.tick, previous=self._last, kept=self._kept)
        for signal in signals:
            try:
                signal(block)
            except RunError as error:
                block.unknown[signal] = str(error)
        block.previous = None
        self._last, self._kept, self.tick = block, None, self.tick + len(zone)
        return block

    def read(self, signals: Iterable[Signal[Any]], states: Sequence[State]) -> Block:
        """Return the next states, all with the same fields given, as a block on which the given signals are evaluated."""
        arrays: dict[str, Any] = {}
        for name in ("station", "speed", "pose"):
            rows = [getattr(state, name) for state in states]
            arrays[name] = None if rows[0] is None else np.array(rows)
        hits = [(pair, row) for row, state in enumerate(states) for pair in state.touching or ()]
        arrays["touching"] = None if states[0].touching is None else hits
        zone, lights = (np.array(rows, dtype=np.int8) for rows in zip(*(state[:2] for state in states), strict=True))
        return self.feed(signals, zone, lights, **arrays)


def alone(block: Block, row: int) -> Run:
    """Return the state in a row of a block as a run of one state, whose signals have the values of the block."""
    state = block.only(row)
    pairs = None if state.touching is None else [sorted(pair) for pair, _ in state.touching]
    run = Run(
        "live",
        block.junction,
        block.cast.agents,
        state.zone,
        state.lights,
        block.dt,
        station=state.station,
        speed=state.speed,
        pose=state.pose,
        collisions=None if pairs is None else tuple(Collision(0.0, (first, second), 0.0) for first, second in pairs),
        facts=block.cast.facts,
    )
    assume(run, state)
    return run
