"""The predicates of the paper's table of semantics, evaluated on a run: a truth value per state.

Predicates that change during a run are signals, which are computed for every state. Static relations (right-of, opposite, turn,
the entrance of an agent, the light of an entrance) are gathered in `Static`, the paper's model S^s.

The paper's right-of and opposite are relations of arms, extended to the lanes of the arms. Only the paper's rules and the two
rules of the all-way stop use right-of and opposite; all other rules use `Junction.yields`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.conduct.blocks import APPROACH, ENTRANCE, EXIT, JUNCTION, Block, signal
from pytest_rvads.logic.conduct.cast import Ground, ground_of, in_turn, lit, may_owe
from pytest_rvads.logic.conduct.lane import wrong_lanes
from pytest_rvads.logic.conduct.presence import judged, together
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent


@dataclass(frozen=True, slots=True)
class Static:
    """The part of the paper's model that is constant in a run: junction, signs, lights and itineraries (Algorithm 1)."""

    entrances: int
    exits: int
    control: JunctionControl
    right_of: frozenset[tuple[int, int]]
    opposite: frozenset[tuple[int, int]]
    entex: frozenset[tuple[int, int]]
    """Pairs of an entrance and an exit of the same arm."""
    beside: frozenset[tuple[int, int]]
    """Pairs of different entrances of the same arm."""
    lights: tuple[int, ...]
    """Entrances with a light."""
    signs: tuple[int, ...]
    """Entrances with a stop sign."""
    agents: tuple[Agent, ...]
    conflicts: frozenset[tuple[tuple[int, int], tuple[int, int]]] | None = None
    """Pairs of conflicting ways; None if the geometry is unknown."""
    near: Turn = Turn.RIGHT
    """The turn that crosses no other way."""
    far: Turn = Turn.LEFT
    """The turn across oncoming traffic."""
    grounds: frozenset[tuple[int, int, Ground]] | None = frozenset()
    """Triples of a first agent, a second agent (both by column), and the ground on which the first has to give way to the second.

    Lights are no ground. None if the geometry is unknown.
    """
    owing: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column, of which the first can owe the way to the second; None if only states of the run decide."""
    by_arrival: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column, that go in the order of arrival; None if the junction is no all-way stop."""
    choosing: frozenset[int] = frozenset()
    """Agents, by column, whose entrance arm has a lane that does not lead to the agent's exit arm."""
    together: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column and in both orders, that were present together; rules about two agents are judged for these
    pairs only. None: for all pairs."""
    judged: frozenset[int] | None = None
    """Agents, by column, for which rules are judged in this run, see `Excerpt.judged`; None: all agents."""
    further: frozenset[int] = frozenset()
    """Agents, by column, on ways that are no movements of vehicles, such as crossings."""
    walk_lights: frozenset[int] = frozenset()
    """Agents, by column, on crossings with a light."""
    turning_on_red: frozenset[int] = frozenset()
    """Agents, by column, that may turn on red, see `Junction.turns_on_red`."""
    _hash: int = field(init=False, repr=False, compare=False)
    """The hash of the model, stored because caches use the model as a key for every rule."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "_hash", hash(tuple(getattr(self, item.name) for item in fields(self) if item.compare)))

    def __hash__(self) -> int:
        return self._hash

    def judges(self, agents: Sequence[int]) -> bool:
        """Return whether rules for the given agents are judged in this run; the agent that appeared last decides for all."""
        return self.judged is None or not agents or max(agents) in self.judged

    def turns(self, agent: int, direction: str) -> bool:
        """Return whether an agent turns ``left``, ``straight``, ``right``, or to the ``near`` or ``far`` side."""
        turn = {"near": self.near, "far": self.far}.get(direction, direction)
        return self.agents[agent].turn == turn

    def __str__(self) -> str:
        pairs = ", ".join(f"{a} right-of {b}" for a, b in sorted(self.right_of))
        facing = ", ".join(f"{a} opposite {b}" for a, b in sorted(self.opposite) if a < b)
        agents = ", ".join(f"{a.name}: {a.entrance} -> {a.exit} ({a.turn})" for a in self.agents)
        kinds = (("lights", self.lights), ("stop signs", self.signs))
        objects = ", ".join(f"{kind} at {list(places)}" for kind, places in kinds if places) or "no lights or stop signs"
        return f"{self.entrances} entrances, {objects}; {pairs or 'no right-of'}; {facing or 'no opposite'}; {agents}"


def extract(run: Run) -> Static:
    """Return the static model of a run: everything that stays the same during the run (Algorithm 1 of the paper)."""
    junction, ways = run.junction, [agent.way.key for agent in run.agents]
    numbers = range(len(junction.entrances))
    grounds: frozenset[tuple[int, int, Ground]] | None = frozenset()
    owing: frozenset[tuple[int, int]] | None = None
    by_arrival: frozenset[tuple[int, int]] | None = None
    if junction.control is JunctionControl.STOP:
        present_pairs = together(run)
        candidates = permutations(range(len(ways)), 2) if present_pairs is None else present_pairs
        by_arrival = frozenset((one, two) for one, two in candidates if in_turn(junction, ways[one], ways[two]))
    elif junction.yields is None and junction.control is not JunctionControl.LIGHTS:
        grounds = None
    elif junction.control is not JunctionControl.LIGHTS:  # which only states of the run decide
        pairs, conflicts = list(permutations(range(len(ways)), 2)), junction.conflicts or ()
        reasons = ((one, two, ground_of(junction, ways[one], ways[two])) for one, two in pairs)
        grounds = frozenset((one, two, ground) for one, two, ground in reasons if ground is not None)
        owing = frozenset((one, two) for one, two in pairs if (ways[one], ways[two]) in conflicts and may_owe(run, one, two))
    return Static(
        len(junction.entrances),
        len(junction.exits),
        junction.control,
        junction.right_of,
        junction.opposite,
        junction.entex,
        frozenset((a, b) for arm in junction.arms for a, b in permutations(arm.entrances, 2)),
        tuple(k for k in numbers if lit(junction, k) or run.lights[:, k].any()),
        tuple(k for k in numbers if junction.entrances[k].sign is Sign.STOP),
        run.agents,
        junction.conflicts,
        junction.near,
        junction.far,
        grounds,
        owing,
        by_arrival,
        frozenset(k for k, who in enumerate(run.agents) if wrong_lanes(junction, *who.way.key)),
        together(run),
        judged(run),
        frozenset(k for k, who in enumerate(run.agents) if who.way.key not in junction.movements),
        frozenset(k for k, who in enumerate(run.agents) if isinstance(who.way, Crossing) and lit(junction, who.entrance)),
        frozenset(k for k, who in enumerate(run.agents) if junction.turns_on_red(who.entrance, who.turn)),
    )


@signal
def in_junction(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is in the junction (``a@j``), with its reference point on a movement of the junction."""
    inside: NDArray[np.bool_] = block.zone == JUNCTION
    return inside


@signal
def at_entrance(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is at its entrance (``a@j.en``)."""
    waiting: NDArray[np.bool_] = block.zone == ENTRANCE
    return waiting


@signal
def on_approach(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is on the road to its entrance (``a@r``); the entrance zone is part of the road."""
    approaching: NDArray[np.bool_] = (block.zone == APPROACH) | (block.zone == ENTRANCE)
    return approaching


@signal
def on_exit(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is on its exit road (``a@j.ex`` and ``a@r``), which begins with the exit vertex."""
    leaving: NDArray[np.bool_] = block.zone == EXIT
    return leaving


def ticks(run: Run, seconds: float) -> int:
    """Return a duration as a number of steps of the run, rounded."""
    return round(seconds / run.dt)


@signal(otherwise=np.nan)
def speed(block: Block) -> NDArray[np.float64]:
    """Return the speed of each vehicle, ``a.sp`` [m/s]."""
    return block.need("speed")


@signal(of_entrances=True)
def colour(block: Block) -> NDArray[np.int8]:
    """Return the colour of the light at every entrance, ``lt.cl``."""
    return block.lights
