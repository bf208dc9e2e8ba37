"""The times at which vehicles came to new zones and lights changed, and how exactly these times are known.

The times are counted in moments. A moment is a step of the run. In a run with long steps, a moment is a part of a step, about as
long as a step of a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import DT, Run, once
from pytest_rvads.runs.states import Zone

FINE = 0.02
"""Longest step of a run whose states alone say in which order vehicles came to zones and lights changed [s].

On the runs of the paper's authors no verdict changes up to this step, and some verdicts change at 0.05 s.
"""
LONG_AGO = -(10**9)
"""Moment that stands for an unknown past: a vehicle that appears at an entrance may have arrived there at any earlier time."""
_BORDERS = (Zone.ENTRANCE, Zone.JUNCTION, Zone.EXIT, Zone.GONE)
"""Zones that a vehicle comes to by crossing a border, in the order of the itinerary."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event that happened once: a vehicle came to a zone, or a light changed."""

    agent: int | None
    """Column of the vehicle; None for a light."""
    code: int
    """The zone that the vehicle came to, or the new colour of the light."""
    early: int
    """First moment at which the event is possible; at the moment of an event, the vehicle is in the new zone already."""
    told: int
    """Moment of the event in the run as recorded."""
    late: int
    """Last moment at which the event is possible; the end of the vehicle's recording if it is possible that it never happened."""
    light: int | None = None
    """Entrance of the light; None for a vehicle."""

    @property
    def exact(self) -> bool:
        """Whether only a single moment is possible for the event."""
        return self.early == self.late


@dataclass(frozen=True, eq=False)
class Crossings:
    """The events of a run: vehicles came to zones, and lights changed."""

    run: Run
    moments: int
    """Number of moments per step of the run."""
    of_agents: tuple[tuple[Event, ...], ...]
    """Per vehicle, the events of coming to the entrance, to the junction, to the exit, and of leaving."""
    of_lights: tuple[tuple[Event, ...], ...]
    """Per light, its changes."""

    @property
    def length(self) -> float:
        """Duration of a moment [s]."""
        return self.run.dt / self.moments

    @property
    def end(self) -> int:
        """The moment after the last state of the run."""
        return self.run.steps * self.moments

    @cached_property
    def spans(self) -> list[tuple[int, int]]:
        """Per vehicle, the first moment and the moment after the last moment in which the run holds the vehicle."""
        return [(int(begin) * self.moments, int(end) * self.moments) for begin, end in self.run.spans]

    @cached_property
    def exact(self) -> bool:
        """Whether only a single moment is possible for every event."""
        return all(e.exact for who in (*self.of_agents, *self.of_lights) for e in who)


def certain(run: Run) -> bool:
    """Return whether the order of events in a run is certain: its steps are at most `FINE`, and it is no recording."""
    return run.dt <= FINE and run.spread is None and run.excerpt is None


def crossings(run: Run) -> Crossings:
    """Return when vehicles came to zones and lights changed in a run, computed once per run."""
    # The run caches the events and not the `Crossings`: a `Crossings` holds the run, and a run that also holds the `Crossings`
    # would stay in memory until the next garbage collection.
    return Crossings(run, *once(run, _events))


def _events(run: Run) -> tuple[int, tuple[tuple[Event, ...], ...], tuple[tuple[Event, ...], ...]]:
    """Return the moments per step, the events of every vehicle (coming to a zone), and the events of every light (changing)."""
    agents, lights, moments = [], [], round(run.dt / DT) if run.dt > FINE else 1
    for agent, who in enumerate(run.agents):
        begin, end = (int(tick) for tick in run.spans[agent])
        zones, events = run.zone[begin:end, agent], []
        for number, zone in enumerate(_BORDERS):
            arrived = zones >= zone
            early = late = recorded = begin + (int(arrived.argmax()) if arrived.any() else end - begin)
            if run.spread is not None and run.station is not None:
                border = itinerary(run.junction, *who.way.key).borders[number]
                station, spread = run.station[begin:end, agent], run.spread[begin:end, agent]
                certainly, possibly = np.flatnonzero(station + spread < border), np.flatnonzero(station - spread < border)
                early = min(begin + int(certainly[-1]) + 1 if len(certainly) else begin, recorded)
                late = max(begin + int(possibly[-1]) + 1 if len(possibly) else begin, recorded)
            # An event between two samples is possible at every moment after the first of the two samples.
            earliest = early * moments if early in (begin, end) else (early - 1) * moments + 1
            if early == begin < end and zone is Zone.ENTRANCE and run.excerpt is not None and zones[0] <= zone:
                earliest = LONG_AGO
            events.append(Event(agent, int(zone), earliest, recorded * moments, late * moments))
        agents.append(tuple(events))
    for light, colours in enumerate(run.lights.T):
        ticks = (np.flatnonzero(np.diff(colours)) + 1).tolist()
        changes = ((int(colours[t]), (t - 1) * moments + 1, t * moments) for t in ticks)
        lights.append(tuple(Event(None, colour, early, late, late, light) for colour, early, late in changes))
    return moments, tuple(agents), tuple(lights)
