"""When vehicles crossed the borders of their zones and lights changed, and how exactly that is known.

Times are counted in moments: as many to a tick as make one about as long as a step of a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.predicates import once
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE, itinerary
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone

__all__ = ["LONG_AGO", "Crossings", "Event", "certain", "crossings"]

FINE = 0.02
"""Of runs with steps up to this the states say enough [s]: on the runs of the paper's authors no verdict changes up to there, and
at 0.05 s some do."""
LONG_AGO = -(10**9)
"""The moment before which nobody asks: who appears at an entrance may have come to it at any time."""
_BORDERS = (Zone.ENTRANCE, Zone.JUNCTION, Zone.EXIT, Zone.GONE)
"""Each is crossed on coming to a zone."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened once: a vehicle came to a zone, a light changed."""

    agent: int | None
    """The column of the vehicle, None of a light."""
    code: int
    """Of the zone; of a light, the colour that it turned to."""
    early: int
    """The first moment at which it may have happened, in which it is so already."""
    told: int
    """At which it happened as recorded."""
    late: int
    """The last one; at the end of what was recorded of a vehicle: perhaps it never did."""
    light: int | None = None
    """The entrance of the light."""

    @property
    def exact(self) -> bool:
        """Whether it can have happened at one moment only."""
        return self.early == self.late


@dataclass(frozen=True, eq=False)
class Crossings:
    """The events of a run, which are kept with it; this value is not, as it holds the run."""

    run: Run
    moments: int
    """To a tick."""
    of_agents: tuple[tuple[Event, ...], ...]
    """Of every vehicle, when it came to the entrance, the junction, its exit, and when it was gone."""
    of_lights: tuple[tuple[Event, ...], ...]
    """Of every light, its changes."""

    @property
    def length(self) -> float:
        """Of a moment [s]."""
        return self.run.dt / self.moments

    @property
    def end(self) -> int:
        """The moment after the last state."""
        return self.run.steps * self.moments

    @cached_property
    def spans(self) -> list[tuple[int, int]]:
        """From which moment on and up to which one every vehicle is in the run."""
        return [(int(begin) * self.moments, int(end) * self.moments) for begin, end in self.run.spans]

    @cached_property
    def exact(self) -> bool:
        """Whether all is known to the step."""
        return all(e.exact for who in (*self.of_agents, *self.of_lights) for e in who)


def certain(run: Run) -> bool:
    """Return whether there is one reading of a run: its states say enough, and nothing in it was measured."""
    return run.dt <= FINE and run.spread is None and run.excerpt is None


def crossings(run: Run) -> Crossings:
    """Return the events of a run, worked out once."""
    # The run keeps the events and not what is returned, which holds the run: such a circle stays in memory for a while.
    return Crossings(run, _moments(run), *once(run, _events))


def _moments(run: Run) -> int:
    return round(run.dt / DT) if run.dt > FINE else 1


def _events(run: Run) -> tuple[tuple[tuple[Event, ...], ...], tuple[tuple[Event, ...], ...]]:
    """Return the events of every vehicle, and those of every light."""
    agents = tuple(tuple(_coming(run, agent, zone) for zone in _BORDERS) for agent in range(len(run.agents)))
    return agents, tuple(_changes(run, light) for light in range(run.lights.shape[1]))


def _changes(run: Run, light: int) -> tuple[Event, ...]:
    colours, several = run.lights[:, light], _moments(run)
    return tuple(
        Event(None, int(colours[tick]), (tick - 1) * several + 1, tick * several, tick * several, light)
        for tick in (np.flatnonzero(np.diff(colours)) + 1).tolist()
    )


def _coming(run: Run, agent: int, zone: Zone) -> Event:
    """Return when an agent came to a zone."""
    several = _moments(run)
    begin, end = (int(v) for v in run.spans[agent])
    there = run.zone[begin:end, agent] >= zone
    told = begin + (int(there.argmax()) if there.any() else end - begin)
    early = late = told
    reach = _reach(run, agent, zone)
    if reach is not None:
        farthest, nearest = reach
        early, late = min(begin + _after(farthest[begin:end]), told), max(begin + _after(nearest[begin:end]), told)
    # Between two samples it may have been at any moment after the first one.
    first = early * several if early in (begin, end) else (early - 1) * several + 1
    if early == begin < end and zone is Zone.ENTRANCE and run.excerpt is not None and run.zone[begin, agent] <= zone:
        first = LONG_AGO
    return Event(agent, int(zone), first, told * several, late * several)


def _reach(run: Run, agent: int, zone: Zone) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Return where an agent certainly has not, and where it may not have come to a zone, each of shape ``(steps,)``."""
    if run.spread is None or run.station is None:
        return None
    who = run.agents[agent]
    way = itinerary(run.junction, who.entrance, who.exit)
    border = {
        Zone.ENTRANCE: way.line - ENTRANCE_ZONE,
        Zone.JUNCTION: float(np.nextafter(0.0, 1.0)),
        Zone.EXIT: way.length,
        Zone.GONE: way.end,
    }[zone]
    station, spread = run.station[:, agent], run.spread[:, agent]
    return station + spread < border, station - spread < border


def _after(before: NDArray[np.bool_]) -> int:
    """Return the number of states up to the last one that is true."""
    return len(before) - int(before[::-1].argmax()) if before.any() else 0
