"""The discrete abstraction of a scenario: each vehicle is on the approach, at the entrance, in the junction or at the exit.

A configuration is the place of every vehicle and the phase of the lights. All configurations of a model are the states of a
single run, so that the predicates of rules are evaluated as on any run. Of time, only the order of arrival remains: the order
decides comparisons of waiting times, and no right of way is waived. The value of an atom that a configuration does not determine
is open.
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
from pytest_rvads.runs.states import CLEARANCE, GREEN, YELLOW, Agent, SignalPlan, Zone

__all__ = ["Model", "weak_orders"]

_PLACES = 4
"""Number of places: approach, entrance, junction, exit. A configuration has two bits per vehicle."""
_LONG_WAIT = 3600.0
"""A waiting time longer than any difference between two arrivals [s]."""


def weak_orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield every order of arrival with ties, as the rank of each vehicle: 0 for the vehicles that arrive first.

    For 1 to 5 vehicles, there are 1, 3, 13, 75 and 541 orders (the ordered Bell numbers).
    """
    for ranks in product(range(count), repeat=count):
        if set(ranks) == set(range(max(ranks) + 1)):
            yield ranks


class Model:
    """The behaviours of the vehicles of an abstract scenario with a given order of arrival.

    Args:
        junction: the junction.
        agents: the vehicles with their routes.
        arrivals: time of each vehicle's arrival at its entrance [s]; only the differences matter.
        stop: least time of a vehicle from its arrival to its entry [s]. A vehicle that arrives within this time after another
            vehicle meets the other vehicle at its entrance.
    """

    def __init__(self, junction: Junction, agents: tuple[Agent, ...], arrivals: Sequence[float], stop: float = 0.0) -> None:
        self.junction = junction
        self.agents = agents
        self.arrivals = tuple(arrivals)
        self._stop = stop
        zone, lights = _all_configurations(len(agents), junction)
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
        """Facts about the run that are the same in all configurations."""
        return extract(self.run)

    def starts(self) -> list[int]:
        """Return the initial configurations: all vehicles on the approach, or the first to arrive already at their entrances."""
        first = sum(Zone.ENTRANCE * _PLACES**i for i, time in enumerate(self.arrivals) if time == min(self.arrivals))
        return [3 * group * self._size + places for group in range(len(self.junction.phase_groups) or 1) for places in (0, first)]

    def through(self, configuration: int) -> bool:
        """Return whether all vehicles have passed the junction."""
        return (configuration + 1) % self._size == 0

    def after(self, configuration: int) -> list[int]:
        """Return the configurations that can follow a configuration, including the configuration itself.

        Any vehicles at an entrance or in the junction move on. The next vehicles to arrive may arrive, all at the same time. The
        lights may change.
        """
        places, phase = configuration % self._size, configuration // self._size % self._phases
        phases = (phase,) if self._phases == 1 else (phase, (phase + 1) % self._phases)
        later = self._phases * self._size
        return [later + p * self._size + moved for moved in self._moves(places) for p in phases]

    def _moves(self, places: int) -> list[int]:
        moves = _advances(places, len(self.agents))
        coming = [time for i, time in enumerate(self.arrivals) if _place(places, i) == Zone.APPROACH]
        if coming:
            at_entrance = (i for i in range(len(self.agents)) if _place(places, i) == Zone.ENTRANCE)
            stopping = [i for i in at_entrance if min(coming) - self.arrivals[i] < self._stop]
            moves = [moved for moved in moves if all(_place(moved, i) == Zone.ENTRANCE for i in stopping)]
            step = sum(
                _PLACES**i for i, time in enumerate(self.arrivals) if time == min(coming) and _place(places, i) == Zone.APPROACH
            )
            return [*moves, *[moved + step for moved in moves]]
        return moves

    def values(self, tie: float) -> Abstracted:
        """Return the values of atoms in the configurations, with `tie` as the tie window of the rule [s]."""
        return Abstracted(self, tie)


class Abstracted(Values):
    """The values of atoms in the configurations of a model; `open` returns the configurations in which a value is not known."""

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
            case (f.Attr(f.Element(_, first), left), f.Attr(f.Element(_, second), right)) if all(
                ATTRIBUTES[name].waited for name in (left, right)
            ):
                if not self._window:
                    return False
                # Shortly after an arrival, the difference to the waiting time 0 of an absent vehicle is within the window.
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


def _place(places: int, agent: int) -> int:
    return places >> 2 * agent & 3


@lru_cache(maxsize=4096)
def _advances(places: int, agents: int) -> list[int]:
    """Return the places after any vehicles at an entrance or in the junction move on; moves of a single vehicle come first."""
    steps = [_PLACES**i for i in range(agents) if _place(places, i) in (Zone.ENTRANCE, Zone.JUNCTION)]
    movers = sorted(product((0, 1), repeat=len(steps)), key=lambda moving: (sum(moving) != 1, sum(moving)))
    return [places + sum(step for step, moves in zip(steps, moving, strict=True) if moves) for moving in movers]


@lru_cache(maxsize=64)
def _all_configurations(agents: int, junction: Junction) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return zones, shape ``(size, agents)``, and colours, shape ``(size, entrances)``, of all configurations."""
    plan = SignalPlan(junction.phase_groups)
    slots = [g * (GREEN + YELLOW + CLEARANCE) + t for g in range(len(plan.groups)) for t in (0.0, GREEN, GREEN + YELLOW)]
    colours = np.array([plan.colours(time, len(junction.entrances)) for time in slots or [0.0]], dtype=np.int8)
    places = np.arange(_PLACES**agents)
    zones = np.stack([places // _PLACES**i % _PLACES for i in range(agents)], axis=1).astype(np.int8)
    return np.tile(zones, (2 * len(colours), 1)), np.tile(np.repeat(colours, len(places), axis=0), (2, 1))
