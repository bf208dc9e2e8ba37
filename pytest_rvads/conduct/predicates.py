"""The predicates of the paper's table of semantics, evaluated on a run: one truth value per state.

Dynamic predicates return arrays of shape ``(steps,)``. What is static (right-of, opposite, turn, which entrance an
agent comes to, which light controls it) is gathered in `Static`, the paper's model S^s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone

__all__ = ["Static", "at_entrance", "extract", "in_junction", "on_approach", "on_exit", "once", "speed", "ticks"]

_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Static:
    """What does not change during a run: the junction, its signs and lights, the itineraries (Algorithm 1, ``extract``)."""

    entrances: int
    """How many there are."""
    exits: int
    control: JunctionControl
    right_of: frozenset[tuple[int, int]]
    opposite: frozenset[tuple[int, int]]
    entex: frozenset[tuple[int, int]]
    """Pairs of an entrance and an exit of one arm."""
    lights: tuple[int, ...]
    """Entrances with a light."""
    signs: tuple[int, ...]
    """Entrances with a stop sign."""
    agents: tuple[Agent, ...]
    conflicts: frozenset[tuple[tuple[int, int], tuple[int, int]]] | None = None
    """Pairs of movements that get in each other's way; None where the geometry is not known."""
    near: Turn = Turn.RIGHT
    """The turn that crosses nobody's way."""
    far: Turn = Turn.LEFT
    """The turn across oncoming traffic."""

    def turns(self, agent: int, direction: str) -> bool:
        """Return whether an agent turns ``left``, ``straight``, ``right``, or to the ``near`` or ``far`` side."""
        wanted = {"near": self.near, "far": self.far}.get(direction, direction)
        return self.agents[agent].turn == wanted

    def __str__(self) -> str:
        pairs = ", ".join(f"{a} right-of {b}" for a, b in sorted(self.right_of))
        facing = ", ".join(f"{a} opposite {b}" for a, b in sorted(self.opposite) if a < b)
        agents = ", ".join(f"{a.name}: {a.entrance} -> {a.exit} ({a.turn})" for a in self.agents)
        objects = f"lights at {list(self.lights)}" if self.lights else f"stop signs at {list(self.signs)}"
        return f"{self.entrances} entrances, {objects}; {pairs or 'no right-of'}; {facing or 'no opposite'}; {agents}"


def extract(run: Run) -> Static:
    """Return the static model of a run (Algorithm 1 of the paper)."""
    return once(run, _extract)


def _extract(run: Run) -> Static:
    junction = run.junction
    entrances = len(junction.entrances)
    everywhere = tuple(range(entrances))
    return Static(
        entrances,
        len(junction.exits),
        junction.control,
        junction.right_of,
        junction.opposite,
        junction.entex,
        everywhere if junction.control is JunctionControl.LIGHTS else tuple(np.flatnonzero(run.lights.any(axis=0)).tolist()),
        everywhere if junction.control is JunctionControl.STOP else (),
        run.agents,
        junction.conflicts,
        junction.near,
        junction.far,
    )


def once(run: Run, work: Callable[[Run], _Result]) -> _Result:
    """Return what `work` finds out about a run, which is then known: a run is judged by many rules, and never changes."""
    known = run.__dict__.setdefault("found", {})
    if work not in known:
        known[work] = work(run)
    result: _Result = known[work]
    return result


def in_junction(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return ``a@j``: the reference point is on a movement of the junction."""
    found: NDArray[np.bool_] = run.zone[:, agent] == Zone.JUNCTION
    return found


def at_entrance(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return ``a@j.en`` for the entrance the agent comes to."""
    found: NDArray[np.bool_] = run.zone[:, agent] == Zone.ENTRANCE
    return found


def on_approach(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return ``a@r`` for the road that leads to the agent's entrance; the entrance zone is part of it."""
    found: NDArray[np.bool_] = run.zone[:, agent] <= Zone.ENTRANCE
    return found


def on_exit(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return ``a@j.ex`` and ``a@r`` for the road the agent leaves by; it begins with the exit vertex."""
    found: NDArray[np.bool_] = run.zone[:, agent] == Zone.EXIT
    return found


def ticks(run: Run, seconds: float) -> int:
    """Return a duration as a number of steps of the run, rounded."""
    return round(seconds / run.dt)


def speed(run: Run, agent: int) -> NDArray[np.float64]:
    """Return ``a.sp`` [m/s].

    Raises:
        RunError: the run does not record speeds.
    """
    return run.need("speed")[:, agent]
