"""The discrete abstraction of a scenario: who is on the approach, at the entrance, in the junction, at the exit.

A configuration is a place for every vehicle and a phase of the lights; all configurations of a model are rows of one run,
so that the predicates of the rules are evaluated on them as on any other run. Time is left out but for the order of
arrival: waiting times are compared by it, and no right is waived. What a configuration does not tell is left open.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.predicates import Static, extract
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.vocabulary import FromZones
from pytest_rvads.runs.lights import CLEARANCE, GREEN, YELLOW, SignalPlan
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Agent, Zone

__all__ = ["Model", "weak_orders"]

_PLACES = 4
"""Approach, entrance, junction, exit: two bits per vehicle."""
_LONG = 3600.0
"""A waiting time longer than any difference between two arrivals [s]."""


def weak_orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield every order of arrival with ties, as the rank of each vehicle: 0 for the vehicles that arrive first.

    There are 1, 3, 13, 75, 541 of 1 to 5 vehicles (the ordered Bell numbers).
    """
    for ranks in product(range(count), repeat=count):
        if set(ranks) == set(range(max(ranks) + 1)):
            yield ranks


class Model:
    """The behaviours of the vehicles of an abstract scenario with a given order of arrival.

    Args:
        junction: where.
        agents: who, and which way.
        arrivals: when each comes to its entrance [s]; only the differences matter.
        stop: how long it takes at least from there into the junction [s]: whoever arrives sooner after somebody finds it there.
    """

    def __init__(self, junction: Junction, agents: tuple[Agent, ...], arrivals: Sequence[float], stop: float = 0.0) -> None:
        self.junction = junction
        self.agents = agents
        self.arrivals = tuple(arrivals)
        self._stop = stop
        zone, lights = _table(len(agents), junction)
        self.run = Run("abstraction", junction, agents, zone, lights)
        """Every configuration twice: at the start of a run, where waiting times are 0, and later."""
        self._phases = max(3 * len(junction.phase_groups), 1)
        self._size: int = _PLACES ** len(agents)

    @property
    def size(self) -> int:
        """Number of configurations."""
        return self.run.steps

    @cached_property
    def static(self) -> Static:
        """What does not change."""
        return extract(self.run)

    def starts(self) -> list[int]:
        """Return where a run may begin: everybody on the approach, or who comes first at the entrance already."""
        first = sum(Zone.ENTRANCE * _PLACES**i for i, time in enumerate(self.arrivals) if time == min(self.arrivals))
        return [3 * group * self._size + places for group in range(len(self.junction.phase_groups) or 1) for places in (0, first)]

    def through(self, configuration: int) -> bool:
        """Return whether everybody has passed the junction."""
        return (configuration + 1) % self._size == 0

    def after(self, configuration: int) -> list[int]:
        """Return the configurations that can follow, the one itself included.

        Any vehicles at an entrance or in the junction move on, those that arrive next arrive all at once, the lights
        change or not.
        """
        places, phase = configuration % self._size, configuration // self._size % self._phases
        phases = (phase,) if self._phases == 1 else (phase, (phase + 1) % self._phases)
        later = self._phases * self._size
        return [later + p * self._size + moved for moved in self._moves(places) for p in phases]

    def _moves(self, places: int) -> list[int]:
        found = _advances(places, len(self.agents))
        coming = [time for i, time in enumerate(self.arrivals) if _place(places, i) == Zone.APPROACH]
        if coming:
            here = (i for i in range(len(self.agents)) if _place(places, i) == Zone.ENTRANCE)
            stopping = [i for i in here if min(coming) - self.arrivals[i] < self._stop]
            found = [moved for moved in found if all(_place(moved, i) == Zone.ENTRANCE for i in stopping)]
            step = sum(
                _PLACES**i for i, time in enumerate(self.arrivals) if time == min(coming) and _place(places, i) == Zone.APPROACH
            )
            return [*found, *[moved + step for moved in found]]
        return found

    def values(self, tie: float) -> Abstracted:
        """Return the atoms' values over the configurations, with `tie` as the tie window of the rule [s]."""
        return Abstracted(self, tie)


class Abstracted(Values):
    """The atoms on the configurations of a model; `open` says where an atom's value is not known."""

    def __init__(self, model: Model, tie: float) -> None:
        super().__init__(model.run, tie)
        for name in (name for name, attribute in ATTRIBUTES.items() if attribute.waited):
            self._readers[name] = lambda _, agent: self._wt(agent)
        self._arrivals = model.arrivals
        self._window = tie

    def open(self, atom: f.Atom) -> NDArray[np.bool_] | bool:
        """Return where the configuration does not determine `atom`: everywhere (True), nowhere, or shape ``(size,)``."""
        word = word_of(atom)
        if word is not None:
            return word.from_zones is FromZones.NEVER
        match atom.terms:
            case (f.Attr(f.Element(_, one), left), f.Attr(f.Element(_, two), right)) if all(
                ATTRIBUTES[name].waited for name in (left, right)
            ):
                if not self._window:
                    return False
                # Shortly after an arrival the difference to who is not there, and waits for 0 s, is within the window.
                zone = self.run.zone
                found: NDArray[np.bool_] = (zone[:, one] == Zone.ENTRANCE) != (zone[:, two] == Zone.ENTRANCE)
                return found
            case terms if all(isinstance(t, f.Value) or (isinstance(t, f.Attr) and ATTRIBUTES[t.name].codes) for t in terms):
                return False
        return True

    def _wt(self, agent: int) -> NDArray[np.int32]:
        waited = round((_LONG - self._arrivals[agent] + min(self._arrivals)) / DT)
        tick = np.where(self.run.zone[:, agent] == Zone.ENTRANCE, waited, 0).astype(np.int32)
        tick[: len(tick) // 2] = 0
        return tick


def _place(places: int, agent: int) -> int:
    return places >> 2 * agent & 3


@lru_cache(maxsize=4096)
def _advances(places: int, agents: int) -> list[int]:
    """Return the places after any of those at an entrance or in the junction has moved on; who moves alone comes first."""
    steps = [_PLACES**i for i in range(agents) if _place(places, i) in (Zone.ENTRANCE, Zone.JUNCTION)]
    movers = sorted(product((0, 1), repeat=len(steps)), key=lambda chosen: (sum(chosen) != 1, sum(chosen)))
    return [places + sum(step for step, moves in zip(steps, chosen, strict=True) if moves) for chosen in movers]


@lru_cache(maxsize=64)
def _table(agents: int, junction: Junction) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return zones, shape ``(size, agents)``, and colours, shape ``(size, entrances)``, of all configurations."""
    plan = SignalPlan(junction.phase_groups)
    slots = [g * (GREEN + YELLOW + CLEARANCE) + t for g in range(len(plan.groups)) for t in (0.0, GREEN, GREEN + YELLOW)]
    colours = np.array([plan.colours(time, len(junction.entrances)) for time in slots or [0.0]], dtype=np.int8)
    places = np.arange(_PLACES**agents)
    zones = np.stack([places // _PLACES**i % _PLACES for i in range(agents)], axis=1).astype(np.int8)
    return np.tile(zones, (2 * len(colours), 1)), np.tile(np.repeat(colours, len(places), axis=0), (2, 1))
