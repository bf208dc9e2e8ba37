"""Judges rules about the order of events in every order of the events that the accuracy of the run allows.

The events are that vehicles came to new zones and that lights changed. Their times are counted in moments. A moment is a step of
the run. In a run with long steps, a moment is a part of a step, about as long as a step of a simulation.

The atoms of such a rule are about zones of vehicles, comparisons of waiting times, and colours of lights. Such a rule doesn't
count states. Therefore a run with a single state per event gets the same judgement as the whole run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations, pairwise, product

import numpy as np

from pytest_rvads.logic.conduct.blocks import as_blocks, assume
from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.judging.judge import Values, judge, unsure
from pytest_rvads.logic.judging.judgement import Happening, Hinge, Judgement
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.rule import agents_of
from pytest_rvads.logic.rules.vocabulary import FromZones, Sort
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


_Moments = dict[int, int]
"""Maps the id() of an event to a moment at which the event is taken to happen."""
MOST = 1024
"""Largest number of choices of moments that are tried for an instance. If there are more choices, only the first, last and
recorded moments of the events are tried, or only the first and last moments."""


def about_order(template: Template, run: Run) -> bool:
    """Return whether all atoms of an instance are about zones of vehicles, comparisons of waiting times, or colours of lights.

    If a run holds no positions or no speeds, the arrivals of vehicles are derived from zones alone.
    """
    by_zone = run.station is None or run.speed is None
    sources = (FromZones.ALWAYS, FromZones.BLIND) if by_zone else (FromZones.ALWAYS,)
    for atom in template.atoms:
        word = word_of(atom)
        if word is not None:
            ordered = word.from_zones in sources
        else:
            match atom.name, atom.terms:
                case _, (f.Attr(_, one), f.Attr(_, two)) if one == two and ATTRIBUTES[one].waited:
                    ordered = ATTRIBUTES[one].from_zones in sources
                case (("=" | "!="), (f.Attr(_, one), _)):
                    ordered = ATTRIBUTES[one].codes is not None
                case _:
                    ordered = False
        if not ordered:
            return False
    return True


def reordered(recorded: Judgement, crossings: Crossings, values: Values) -> Judgement:
    """Return the judgement of an instance: UNSURE if another possible order of events would give another status."""
    template = recorded.template
    agents = [e.index for e in agents_of(template.formula)]
    elements = [t.of if isinstance(t, f.Attr) else t for atom in template.atoms for t in atom.terms]
    lights = sorted({e.index for e in elements if isinstance(e, f.Element) and e.sort == Sort.LIGHT})
    events = [e for agent in agents for e in crossings.of_agents[agent]]
    changes = [e for light in lights for e in crossings.of_lights[light]]
    tie = round(values.tie / crossings.length)
    loose = _loose(events, changes, crossings, tie)
    # An agent that passes a whole zone between two samples is in this zone in no sample.
    run = crossings.run
    zones = (run.zone[slice(*run.spans[agent]), agent].astype(int) for agent in agents)
    if not loose and not any((np.diff(zone) > 1).any() for zone in zones):
        return recorded
    all_events = [*events, *changes]
    recorded_moments = {id(e): e.told for e in all_events}
    best: dict[Status, tuple[int, _Moments, Judgement]] = {}
    keys = set()
    for moments in chain(({},), _choices(loose)):
        chosen = _followed({**recorded_moments, **moments}, agents, crossings)
        if chosen is None:
            continue
        word = _Word(crossings, agents, lights, chosen)
        key = word.key(tie)
        if key in keys:
            continue
        keys.add(key)
        judgement = word.judged(template, values)
        moved = sum(chosen[id(e)] != e.told for e in all_events)
        status = plain(judgement.status)
        if status not in best or moved < best[status][0]:
            best[status] = moved, chosen, judgement
    different = [b for status, b in best.items() if status is not plain(recorded.status)]
    if not different:
        return recorded
    if len(best) == 1:
        return different[0][2]
    nearest = min(different, key=lambda b: b[0])
    hinge = _hinge(all_events, nearest[1], crossings, tie)
    return unsure(recorded, hinge)


def plain(status: Status) -> Status:
    """Return a status with NA replaced by PASS: a change between a kept rule and an untriggered rule makes nothing unsure."""
    return Status.PASS if status is Status.NA else status


def _loose(events: Sequence[Event], changes: Sequence[Event], crossings: Crossings, tie: int) -> list[Event]:
    """Return the events whose order with some other event is uncertain, and the events that possibly did not happen."""
    loose: dict[int, Event] = {}
    for event, other in chain(combinations(events, 2), product(events, changes), combinations(changes, 2)):
        if (event.exact and other.exact) or (event.agent, event.light) == (other.agent, other.light):
            continue
        meets = event.early <= other.late and other.early <= event.late
        if not meets and event.code == other.code == Zone.ENTRANCE and None not in (event.agent, other.agent):
            meets = len({_compare(d, tie) for d in (event.early - other.late, event.late - other.early)}) > 1
        if meets:
            loose |= {id(e): e for e in (event, other) if not e.exact}
    for e in events:
        if not e.exact and e.agent is not None and e.late >= crossings.spans[e.agent][1] > e.early:
            loose[id(e)] = e
    return list(loose.values())


def _compare(difference: int, tie: int) -> int:
    """Return -1 for a difference of moments below `-tie`, 1 for a difference above `tie`, and 0 for a tie."""
    return 0 if abs(difference) <= tie else 1 if difference > 0 else -1


def _choices(loose: Sequence[Event]) -> Iterator[_Moments]:
    """Yield choices of a moment per event: its recorded, first or last possible moment, or a possible one of these of another."""
    ends = {id(e): (e.told, e.early, e.late) for e in loose}
    shared = [{*ends[id(e)], *(t for o in loose for t in ends[id(o)] if e.early <= t <= e.late)} for e in loose]
    if np.prod([float(len(s)) for s in shared]) > MOST:
        shared = [{e.early, e.told, e.late} for e in loose] if 3 ** len(loose) <= MOST else [{e.early, e.late} for e in loose]
    for moments in product(*(sorted(choice) for choice in shared)):
        yield {id(e): t for e, t in zip(loose, moments, strict=True)}


def _followed(moments: _Moments, agents: Sequence[int], crossings: Crossings) -> _Moments | None:
    """Return the moments, some of them made earlier, at which every agent comes to its zones in order; None if impossible.

    An agent that passes a zone between two samples is taken to come to this zone one moment before it leaves the zone.
    """
    chosen = dict(moments)
    for agent in agents:
        events, end = crossings.of_agents[agent], crossings.spans[agent][1]
        for event, after in reversed(list(pairwise(events))):
            latest = chosen[id(after)] - (chosen[id(after)] < end)
            if chosen[id(event)] > latest:
                if latest < min(event.early, event.told - 1):
                    return None
                chosen[id(event)] = latest
    return chosen


class _Word:
    """A short run with a single state per event, in which every event happens at a chosen moment.

    Agents that are not in `agents` (columns) are absent, and lights that are not in `lights` (entrances) do not change.
    """

    def __init__(self, crossings: Crossings, agents: Sequence[int], lights: Sequence[int], moments: _Moments) -> None:
        run, self._crossings = crossings.run, crossings
        events = [e for agent in agents for e in crossings.of_agents[agent]]
        changes = [e for light in lights for e in crossings.of_lights[light]]
        times = {0, *(moments[id(e)] for e in (*events, *changes)), *(t for agent in agents for t in crossings.spans[agent])}
        self._times = np.array(sorted(t for t in times if 0 <= t < crossings.end), dtype=np.int64)
        self._zone = np.full((len(self._times), len(run.agents)), Zone.ABSENT, dtype=np.int8)
        self._waited = np.zeros(self._zone.shape, dtype=np.int32)
        self._arrived = []
        for agent in agents:
            crossed = [moments[id(e)] for e in crossings.of_agents[agent]]
            begin, end = crossings.spans[agent]
            present = (self._times >= begin) & (self._times < end)
            self._zone[present, agent] = np.searchsorted(crossed, self._times[present], side="right")
            at = self._zone[:, agent] == Zone.ENTRANCE
            # As in `wt`, the waiting time is 1 in the first state at the entrance, but 0 in the first state of the run.
            arrived = crossed[0] or 1
            self._waited[at, agent] = self._times[at] - arrived + 1
            self._arrived.append(arrived)
        self._lights = np.repeat(run.lights[:1], len(self._times), axis=0)
        for light in lights:
            for change in sorted(crossings.of_lights[light], key=lambda e: moments[id(e)]):
                self._lights[self._times >= moments[id(change)], light] = change.code

    def key(self, tie: int) -> object:
        """Return a key that is equal for two such runs if every rule about the order of events judges both alike."""
        arrivals = tuple(_compare(arrival - other, tie) for arrival, other in combinations(self._arrived, 2))
        return self._zone.tobytes(), self._lights.tobytes(), arrivals

    def judged(self, template: Template, values: Values) -> Judgement:
        """Return the judgement of an instance of a rule on this short run, with ticks of the whole recorded run."""
        crossings = self._crossings
        run = crossings.run
        word = Run(run.label, run.junction, run.agents, self._zone, self._lights, crossings.length)
        (block,) = as_blocks(word, word.steps)
        block.values[wt] = self._waited
        assume(word, block)
        (judgement,) = judge((template,), Values(word, values.tie))
        ticks = np.minimum(-(-self._times // crossings.moments), run.steps - 1).tolist()
        trigger, failed = (None if k is None else int(ticks[k]) for k in (judgement.trigger, judgement.failed))
        return replace(judgement, trigger=trigger, failed=failed, margin=None)


def _hinge(events: Sequence[Event], moments: _Moments, crossings: Crossings, tie: int) -> Hinge:
    """Return the doubt behind a verdict: the two events nearest to the opposite order of the chosen moments, or one event."""
    turned = []
    for event, other in combinations(events, 2):
        if (event.agent, event.light) == (other.agent, other.light):
            continue
        window = tie if event.code == other.code == Zone.ENTRANCE and None not in (event.agent, other.agent) else 0
        if _compare(event.told - other.told, window) != _compare(moments[id(event)] - moments[id(other)], window):
            turned.append((abs(abs(event.told - other.told) - window), window, event, other))
    if turned:
        _, window, event, other = min(turned, key=lambda pair: pair[0])
        first, second = sorted((event, other), key=lambda e: e.told)
        width = first.late - first.early + second.late - second.early
    else:
        first = second = max(events, key=lambda e: (moments[id(e)] != e.told, not e.exact))
        window, width = 0, first.late - first.early
    what: dict[Happening, None] = {}
    for event in (first, second):
        ended = event.agent is not None and event.told >= crossings.spans[event.agent][1]
        what[Happening(event.agent, event.light, event.code, None if ended else event.told * crossings.length)] = None
    return Hinge(tuple(what), math.inf if width >= -LONG_AGO else width / 2 * crossings.length, window * crossings.length)
