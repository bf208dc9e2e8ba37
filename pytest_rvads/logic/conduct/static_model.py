"""The static model of a run (what stays the same during the run), and the pairs of agents and readings that rules are judged on.

`Static` is the paper's model S^s. The paper's right-of and opposite are relations of arms, extended to the lanes of the arms.
Only the paper's rules and the two rules of the all-way stop use right-of and opposite; all other rules use `Junction.yields`.

Instances of rules (rules for certain vehicles and entrances) are about vehicles that are `together`: near the junction at the
same time, or anywhere so close to each other that their bodies can touch. Two vehicles that are not together can't violate a
shipped rule, for these reasons:

- p1, p2, p3, p5, p6, p6g, first_come, right_first are about two vehicles in their stop places or in the junction at the same
  time, and such vehicles are near the junction. The obligations of these rules end while both vehicles are present, see `window`.
- no_conflict: a vehicle that meets another vehicle is on a stretch of its movement, so part of its body is in the junction.
- left_yields, yield_sign, priority, right_before_left, merge, right_on_red: a vehicle owes the way while it is at its entrance or
  in the junction. It owes the way to a vehicle at its entrance or in the junction, or to a vehicle that reaches a stretch after
  the entrance within `rights.DUE`, 4 s, which is shorter than `NEAR_TIME`.
- crosswalk, crosswalk_turning, crosswalk_waiting: a vehicle is asked while it is at most `rights.DUE` or a few metres before the
  crosswalk, and the pedestrian is on the crosswalk or in the last metre before it.
- no_collision: vehicles whose bodies can touch are together wherever they are.
- p4, red, full_stop, keep_clear, crosswalk_clear, progress, keep_lane, on_lane_allowed, on_route and speed_limit are about a
  single vehicle. The vehicles that this vehicle waits for, or that follow this vehicle, are looked up on the run, not among
  instances.

Because only vehicles that are together have instances about pairs, the cost of judging grows with the number of vehicles, and not
with the square of this number.

`without_jumps` prepares coarse recordings by filling in the zones that vehicles pass between two states. `colourings` fills in
colours of lights that a recording lacks. `on_each_way` puts vehicles whose way is not decided on each of their possible ways.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.bodies import close
from pytest_rvads.logic.conduct.rights import Ground, ground_of, in_turn, lit, may_owe
from pytest_rvads.runs.itineraries import LEAVE, itinerary
from pytest_rvads.runs.recording import near_junction, zones
from pytest_rvads.runs.run import DT, Run, once
from pytest_rvads.runs.states import Agent, Colour, Zone


@dataclass(frozen=True, slots=True)
class Static:
    """The part of the paper's model that is constant in a run: junction, lights and itineraries (Algorithm 1)."""

    junction: Junction
    entrances: int
    exits: int
    lights: tuple[int, ...]
    """Entrances with a light."""
    signs: tuple[int, ...]
    """Entrances with a stop sign."""
    agents: tuple[Agent, ...]
    grounds: frozenset[tuple[int, int, Ground]] | None = frozenset()
    """Triples of a first agent, a second agent (both by column), and the ground on which the first has to give way to the second.

    Lights are no ground. None if the geometry is unknown.
    """
    owing: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column, of which the first can owe the way to the second; None if only states of the run decide."""
    by_arrival: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column, that go in the order of arrival; None if the junction is no all-way stop."""
    together: frozenset[tuple[int, int]] | None = None
    """Pairs of agents, by column and in both orders, that were present together; rules about two agents are judged for these
    pairs only. None: for all pairs."""
    judged: frozenset[int] | None = None
    """Agents, by column, for which rules are judged in this run, see `Excerpt.judged`; None: all agents."""
    further: frozenset[int] = frozenset()
    """Agents, by column, on ways that are no movements of vehicles, such as crossings."""
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
        turn = {"near": self.junction.near, "far": self.junction.far}.get(direction, direction)
        return self.agents[agent].turn == turn

    def __str__(self) -> str:
        junction = self.junction
        pairs = ", ".join(f"{a} right-of {b}" for a, b in sorted(junction.right_of))
        facing = ", ".join(f"{a} opposite {b}" for a, b in sorted(junction.opposite) if a < b)
        agents = ", ".join(f"{a.name}: {a.entrance} -> {a.exit} ({a.turn})" for a in self.agents)
        kinds = (("lights", self.lights), ("stop signs", self.signs))
        objects = ", ".join(f"{kind} at {list(places)}" for kind, places in kinds if places) or "no lights or stop signs"
        return f"{self.entrances} entrances, {objects}; {pairs or 'no right-of'}; {facing or 'no opposite'}; {agents}"


def extract(run: Run) -> Static:
    """Return the static model of a run: everything that stays the same during the run (Algorithm 1 of the paper)."""
    junction, ways = run.junction, [agent.way.key for agent in run.agents]
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
        junction,
        len(junction.entrances),
        len(junction.exits),
        tuple(k for k in range(len(junction.entrances)) if lit(junction, k) or run.lights[:, k].any()),
        tuple(k for k, entrance in enumerate(junction.entrances) if entrance.sign is Sign.STOP),
        run.agents,
        grounds,
        owing,
        by_arrival,
        together(run),
        judged(run),
        frozenset(k for k, who in enumerate(run.agents) if who.way.key not in junction.movements),
    )


def judged(run: Run) -> frozenset[int] | None:
    """Return the columns of the agents that rules are judged for in this run; None if rules are judged for all agents."""
    if run.excerpt is None or run.excerpt.judged is None:
        return None
    names = set(run.excerpt.judged)
    return frozenset(column for column, agent in enumerate(run.agents) if agent.name in names)


def together(run: Run) -> frozenset[tuple[int, int]] | None:
    """Return the pairs of agents that rules are judged for, by column and in both orders; None for all pairs."""
    if not (run.zone == Zone.ABSENT).any():
        return None
    begin, end = run.spans.T if run.station is None else near(run).T
    pairs = np.minimum(end[:, None], end) > np.maximum(begin[:, None], begin)
    if run.pose is not None:
        pairs |= close(run)
    return frozenset((agent, other) for agent, other in np.argwhere(pairs).tolist() if agent != other)


def near(run: Run) -> NDArray[np.int64]:
    """Return the first tick and the tick after the last tick in which every agent is near the junction, shape ``(agents, 2)``.

    An agent is near, see `near_junction`, until its whole body has left the junction.
    """
    spans = np.zeros((len(run.agents), 2), dtype=np.int64)
    for column, agent in enumerate(run.agents):
        begin, end = run.spans[column]
        station = run.need("station")[begin:end, column]
        speed = np.zeros_like(station) if run.speed is None else run.speed[begin:end, column]
        leave = agent.way.length + max(LEAVE, agent.size[0] if agent.size else 0.0)
        close_by = near_junction(station, speed, -run.junction.setbacks[agent.entrance], leave)
        ticks = np.flatnonzero(close_by & run.here[begin:end, column])
        if len(ticks):
            spans[column] = begin + ticks[0], begin + ticks[-1] + 1
    return spans


def last_seen(run: Run, columns: Iterable[int]) -> tuple[str, int] | None:
    """Return the name and the last tick of the given agent that vanishes first; None if all stay until the run ends."""
    column = min(columns, key=lambda k: int(run.spans[k, 1]), default=None)
    if column is None or run.spans[column, 1] >= run.steps:
        return None
    return run.agents[column].name, int(run.spans[column, 1]) - 1


def cut_off(run: Run) -> bool:
    """Return whether a simulated run was too short for its subject (the vehicle under test) to cross the junction.

    The run was too short if its duration ended it before the rear of the subject had left the junction. Runs without a subject,
    recordings, and runs that a collision, a fault or a vehicle off its route ended are not cut off.
    """
    if run.subject is None or run.excerpt is not None or run.fault or run.collisions or run.facts.strayed:
        return False
    column = next(k for k, agent in enumerate(run.agents) if agent.name == run.subject)
    agent, zones = run.agents[column], run.zone[:, column]
    if (zones == Zone.GONE).any():
        return False
    if run.station is None or agent.size is None:
        return not (zones == Zone.EXIT).any()
    return bool(run.station[:, column].max() - agent.size[0] <= agent.way.length)


def crossed(run: Run) -> bool:
    """Return whether the run shows a crossing: a vehicle entered the junction, and the run is not `cut_off`."""
    return bool((run.zone >= Zone.JUNCTION).any()) and not cut_off(run)


def without_jumps(run: Run) -> Run:
    """Return a run in which no vehicle skips a zone of its way, although a vehicle can pass a zone between two recorded states.

    The first of the two states is put into a skipped entrance zone, the second into a skipped junction. Runs as dense as
    simulated runs are returned unchanged, because a vehicle that skips a zone in such a run jumps, and does not drive.
    """
    return once(run, _filled) or run


def _filled(run: Run) -> Run | None:
    if run.dt <= DT or run.steps < 2:
        return None
    before, after = run.zone[:-1], run.zone[1:]
    over_entrance = (before == Zone.APPROACH) & (after >= Zone.JUNCTION)
    over_junction = (before != Zone.ABSENT) & (before <= Zone.ENTRANCE) & (after == Zone.EXIT)
    if not (over_entrance.any() or over_junction.any()):
        return None
    zone = run.zone.copy()
    zone[:-1][over_entrance] = Zone.ENTRANCE
    zone[1:][over_junction] = Zone.JUNCTION
    return replace(run, zone=zone)


def colourings(run: Run) -> tuple[Run, ...]:
    """Return the runs in which every light for vehicles whose colour the recording lacks shows one; no runs if none is lacking.

    All these lights show the same colour, or each is green or red. For any two of these lights, there are runs in which the first
    is green and the second red, and the other way round. A recorded colour stays as it is.
    """
    entrances = sorted({agent.entrance for agent in run.agents if agent.way.key in run.junction.movements})
    unknown = (run.lights == Colour.NONE).any(axis=0)
    starts = [k for k in entrances if unknown[k] and lit(run.junction, k)] if run.excerpt is not None else []
    if not starts:
        return ()
    numbers = np.arange(len(starts))
    shown = [np.full(len(starts), colour) for colour in (Colour.GREEN, Colour.RED, Colour.YELLOW)]
    for bit in range((len(starts) - 1).bit_length()):
        odd = (numbers >> bit & 1).astype(np.bool_)
        shown += [np.where(odd, Colour.GREEN, Colour.RED), np.where(odd, Colour.RED, Colour.GREEN)]
    runs = []
    for colours in shown:
        lights = run.lights.copy()
        lights[:, starts] = np.where(lights[:, starts] == Colour.NONE, colours, lights[:, starts])
        runs.append(replace(run, lights=lights))
    return tuple(runs)


def on_each_way(run: Run) -> Iterator[Run]:
    """Yield the runs in which every vehicle is on one of its possible ways; no runs if all ways are decided.

    In the first run, all vehicles are on the ways of `run`. For any two vehicles whose ways are not decided, there are runs with
    all combinations of their ways. The runs are not cached, because together they can be larger than memory.
    """
    doubtful = [column for column, agent in enumerate(run.agents) if agent.other_exits]
    counts = [1 + len(run.agents[column].other_exits) for column in doubtful]
    most, bits = max(counts, default=0), range(max((len(doubtful) - 1).bit_length(), 1))
    pairs = product(bits, product(range(most), repeat=2))
    choices = dict.fromkeys(tuple(two[k >> bit & 1] % count for k, count in enumerate(counts)) for bit, two in pairs)
    for choice in choices:
        agents, zone = list(run.agents), run.zone.copy()
        for column, number in zip(doubtful, choice, strict=True):
            agent = agents[column]
            key = agent.entrance, (agent.exit, *agent.other_exits)[number]
            agents[column] = replace(agent, way=run.junction.movements[key], other_exits=())
            begin, end = run.spans[column]
            if number and run.station is not None:
                spread = 0.0 if run.spread is None else run.spread[begin:end, column]
                zone[begin:end, column] = zones(itinerary(run.junction, *key).borders, run.station[begin:end, column], spread)
        yield replace(run, agents=tuple(agents), zone=zone)
