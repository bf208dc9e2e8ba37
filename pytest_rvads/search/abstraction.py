"""The discrete model of a scenario: each vehicle is on the approach, at the entrance, in the junction or at the exit.

A configuration of the model consists of the place of every vehicle (one of these four) and the phase of the lights. All
configurations of a model are the states of a single run, so that the predicates of rules are evaluated as on any run. The model
has no time: the order of arrival decides comparisons of waiting times, and no vehicle waives its right of way. If a configuration
does not determine the value of an atom (a condition in the formula of a rule), the value is open.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.predicates import Static, extract
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.vocabulary import FromZones
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import GREEN, SLOT, YELLOW, Agent, SignalPlan, Zone

__all__ = ["Model", "weak_orders"]

_PLACES = 4
"""Number of places of a vehicle: approach, entrance, junction, exit. The number of a configuration has two bits per vehicle."""
_LONG_WAIT = 3600.0
"""Waiting time of the vehicle that arrived first [s]; it is longer than any difference between two arrivals."""


def weak_orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield every possible order of arrival of vehicles, with ties, as a rank per vehicle; rank 0 arrives first.

    For 1 to 5 vehicles, there are 1, 3, 13, 75 and 541 orders (the ordered Bell numbers).
    """
    for ranks in product(range(count), repeat=count):
        if set(ranks) == set(range(max(ranks) + 1)):
            yield ranks


class Model:
    """All sequences of configurations through which the vehicles of an abstract scenario can go, for one order of arrival.

    Args:
        junction: the junction.
        agents: the vehicles with their ways.
        arrivals: time of each vehicle's arrival at its entrance [s]; only the differences matter.
        stop: least time that a vehicle stays at its entrance [s]. A vehicle does not enter before another vehicle arrives that
            arrives within this time after it.
    """

    def __init__(self, junction: Junction, agents: tuple[Agent, ...], arrivals: Sequence[float], stop: float = 0.0) -> None:
        self.junction = junction
        self.agents = agents
        self.arrivals = tuple(arrivals)
        self._stop = stop
        zone, lights = _all_configurations(len(agents), junction)
        self.run = Run("abstraction", junction, agents, zone, lights)
        """A run with two states per configuration: as the first state of a run, with waiting times of 0, and as a later state."""
        self._phases = max(3 * len(junction.phase_groups), 1)
        self._size: int = _PLACES ** len(agents)

    @property
    def size(self) -> int:
        """Number of states of `run`, twice the number of configurations."""
        return self.run.steps

    @cached_property
    def static(self) -> Static:
        """The facts that are equal in all configurations, such as signs and ways, which rules can be simplified by."""
        return extract(self.run)

    def starts(self) -> list[int]:
        """Return the initial configurations: all vehicles are on the approach, or the vehicles that arrive first have arrived."""
        first = sum(Zone.ENTRANCE * _PLACES**i for i, time in enumerate(self.arrivals) if time == min(self.arrivals))
        return [3 * group * self._size + places for group in range(len(self.junction.phase_groups) or 1) for places in (0, first)]

    def through(self, configuration: int) -> bool:
        """Return whether all vehicles have passed the junction in a configuration."""
        return (configuration + 1) % self._size == 0

    def after(self, configuration: int) -> list[int]:
        """Return the configurations that can follow a configuration, including the configuration itself.

        Any set of vehicles that are at an entrance or in the junction can move on to their next place. Of the vehicles on the
        approach, either all vehicles with the earliest arrival time arrive, or none. The lights stay, or change to the next
        phase.
        """
        places, phase = configuration % self._size, configuration // self._size % self._phases
        phases = (phase,) if self._phases == 1 else (phase, (phase + 1) % self._phases)
        later = self._phases * self._size
        return [later + p * self._size + moved for moved in self._moves(places) for p in phases]

    def _moves(self, places: int) -> list[int]:
        moves = _advances(places, len(self.agents))
        coming = [time for i, time in enumerate(self.arrivals) if _zone_of(places, i) == Zone.APPROACH]
        if coming:
            at_entrance = (i for i in range(len(self.agents)) if _zone_of(places, i) == Zone.ENTRANCE)
            stopping = [i for i in at_entrance if min(coming) - self.arrivals[i] < self._stop]
            moves = [moved for moved in moves if all(_zone_of(moved, i) == Zone.ENTRANCE for i in stopping)]
            step = sum(
                _PLACES**i for i, time in enumerate(self.arrivals) if time == min(coming) and _zone_of(places, i) == Zone.APPROACH
            )
            return [*moves, *[moved + step for moved in moves]]
        return moves

    def values(self, tie: float) -> Abstracted:
        """Return the values of atoms (conditions of rules) in all configurations, with waiting times within `tie` [s] equal."""
        return Abstracted(self, tie)


class Abstracted(Values):
    """The values of atoms (conditions of rules) in the configurations of a model; `open` tells where a value is not known."""

    def __init__(self, model: Model, tie: float) -> None:
        super().__init__(model.run, tie)
        for name in (name for name, attribute in ATTRIBUTES.items() if attribute.waited):
            self._readers[name] = lambda _, agent: self._wt(agent)
        self._arrivals = model.arrivals
        self._window = tie

    def open(self, atom: f.Atom) -> NDArray[np.bool_] | bool:
        """Return in which configurations the value of `atom` is open.

        Returns:
            True for all configurations, False for none, or an array with a truth value per state of the run, shape ``(size,)``.
        """
        word = word_of(atom)
        if word is not None:
            return word.from_zones is FromZones.NEVER
        match atom.terms:
            case (f.Attr(f.Element(_, first), left), f.Attr(f.Element(_, second), right)) if all(
                ATTRIBUTES[name].waited for name in (left, right)
            ):
                if not self._window:
                    return False
                # A vehicle that has just arrived has a waiting time within the window of the waiting time 0 of a vehicle that
                # is not at its entrance, so the order of the two waiting times is open.
                zone = self.run.zone
                uncertain: NDArray[np.bool_] = (zone[:, first] == Zone.ENTRANCE) != (zone[:, second] == Zone.ENTRANCE)
                return uncertain
            case terms if all(isinstance(t, f.Value) or (isinstance(t, f.Attr) and ATTRIBUTES[t.name].codes) for t in terms):
                return False
        return True

    def _wt(self, agent: int) -> NDArray[np.int32]:
        waited = round((_LONG_WAIT - self._arrivals[agent] + min(self._arrivals)) / DT)
        tick = np.where(self.run.zone[:, agent] == Zone.ENTRANCE, waited, 0).astype(np.int32)
        tick[: len(tick) // 2] = 0
        return tick


def _zone_of(places: int, agent: int) -> int:
    return places >> 2 * agent & 3


@lru_cache(maxsize=4096)
def _advances(places: int, agents: int) -> list[int]:
    """Return the places of the vehicles after each possible set of vehicles has moved on from entrance or junction.

    Places are encoded with two bits per vehicle. Moves of a single vehicle come first.
    """
    steps = [_PLACES**i for i in range(agents) if _zone_of(places, i) in (Zone.ENTRANCE, Zone.JUNCTION)]
    movers = sorted(product((0, 1), repeat=len(steps)), key=lambda moving: (sum(moving) != 1, sum(moving)))
    return [places + sum(step for step, moves in zip(steps, moving, strict=True) if moves) for moving in movers]


@lru_cache(maxsize=64)
def _all_configurations(agents: int, junction: Junction) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return zones, shape ``(size, agents)``, and colours, shape ``(size, entrances)``, of all configurations, twice."""
    plan = SignalPlan(junction.phase_groups)
    slots = [g * SLOT + t for g in range(len(plan.groups)) for t in (0.0, GREEN, GREEN + YELLOW)]
    colours = np.array([plan.colours(time, len(junction.entrances)) for time in slots or [0.0]], dtype=np.int8)
    places = np.arange(_PLACES**agents)
    zones = np.stack([places // _PLACES**i % _PLACES for i in range(agents)], axis=1).astype(np.int8)
    return np.tile(zones, (2 * len(colours), 1)), np.tile(np.repeat(colours, len(places), axis=0), (2, 1))
