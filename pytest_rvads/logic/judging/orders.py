"""Rules about the order of events, judged in every order in which the events of an instance may have happened.

The atoms of an instance about order are about zones of vehicles, comparisons of waiting times, and colours of lights. The rules
don't count states, so a word with one state per event gives the same judgement as the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, combinations, pairwise, product

import numpy as np

from pytest_rvads.logic.conduct.blocks import as_blocks, assume
from pytest_rvads.logic.conduct.motion import wt
from pytest_rvads.logic.judging.crossings import LONG_AGO, Crossings, Event
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import Happening, Hinge, Judgement, judge, unsure
from pytest_rvads.logic.judging.prepare import Template
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.shape import agents_of
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import FromZones
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["about_order", "plain", "reordered"]

_Moments = dict[int, int]
"""Per event, given by its id(), the moment of the event."""
MOST = 1024
"""Most choices of moments that are tried for an instance; beyond, only the first and last moments of the events are tried."""


def about_order(template: Template, run: Run) -> bool:
    """Return whether the atoms of an instance are only about zones, comparisons of waiting times, and colours.

    If a run holds no positions or no speeds, arrivals are derived from zones alone.
    """
    by_zone = run.station is None or run.speed is None
    return all(_ordered(atom, by_zone) for atom in template.atoms)


def _ordered(atom: f.Atom, by_zone: bool) -> bool:
    known = (FromZones.ALWAYS, FromZones.BLIND) if by_zone else (FromZones.ALWAYS,)
    word = word_of(atom)
    if word is not None:
        return word.from_zones in known
    match atom.name, atom.terms:
        case _, (f.Attr(_, one), f.Attr(_, two)) if one == two and ATTRIBUTES[one].waited:
            return ATTRIBUTES[one].from_zones in known
        case (("=" | "!="), (f.Attr(_, asked), _)) if ATTRIBUTES[asked].codes:
            return True
    return False


def reordered(found: Judgement, known: Crossings, values: Values) -> Judgement:
    """Return the judgement of an instance about order, UNSURE if its events may have happened in an order with another status.

    Args:
        found: the judgement of the run as recorded.
        known: the events of the run.
        values: the truth values of the run.
    """
    template = found.template
    agents = [e.index for e in agents_of(template.formula)]
    lights = sorted({e.index for atom in template.atoms for t in atom.terms for e in _lights(t)})
    events = [e for agent in agents for e in known.of_agents[agent]]
    changes = [e for light in lights for e in known.of_lights[light]]
    tie = round(values.tie / known.length)
    loose, skipped = _loose(events, changes, known, tie), any(_skips(known.run, agent) for agent in agents)
    if not loose and not skipped:
        return found
    everything = [*events, *changes]
    told = {id(e): e.told for e in everything}
    best: dict[Status, tuple[int, _Moments, Judgement]] = {}
    seen = set()
    for moments in chain(({},), _choices(loose)):
        chosen = _followed({**told, **moments}, agents, known)
        if chosen is None:
            continue
        word = _Word(known, agents, lights, chosen)
        key = word.key(tie)
        if key in seen:
            continue
        seen.add(key)
        judgement = word.judged(template, values)
        moved = sum(chosen[id(e)] != e.told for e in everything)
        status = plain(judgement.status)
        if status not in best or moved < best[status][0]:
            best[status] = moved, chosen, judgement
    others = [b for status, b in best.items() if status is not plain(found.status)]
    if not others:
        return found
    if len(best) == 1:
        return others[0][2]
    other = min(others, key=lambda b: b[0])
    hinge = _hinge(everything, other[1], known, tie)
    return unsure(found, hinge)


def plain(status: Status) -> Status:
    """Return a status with NA replaced by PASS: readings need not distinguish a kept rule from an untriggered rule."""
    return Status.PASS if status is Status.NA else status


def _lights(term: f.Term) -> Iterator[f.Element]:
    element = term.of if isinstance(term, f.Attr) else term
    if isinstance(element, f.Element) and element.sort == Sort.LIGHT:
        yield element


def _skips(run: Run, agent: int) -> bool:
    """Return whether an agent skips a zone between two samples; the agent was in that zone nevertheless."""
    begin, end = run.spans[agent]
    return bool((np.diff(run.zone[begin:end, agent].astype(int)) > 1).any())


def _loose(events: Sequence[Event], changes: Sequence[Event], known: Crossings, tie: int) -> list[Event]:
    """Return the events whose place in the order of events is uncertain."""
    found: dict[int, Event] = {}
    for one, two in chain(combinations(events, 2), product(events, changes), combinations(changes, 2)):
        if (one.exact and two.exact) or (one.agent, one.light) == (two.agent, two.light):
            continue
        meets = one.early <= two.late and two.early <= one.late
        if not meets and one.code == two.code == Zone.ENTRANCE and None not in (one.agent, two.agent):
            meets = len({_compare(d, tie) for d in (one.early - two.late, one.late - two.early)}) > 1
        if meets:
            found |= {id(e): e for e in (one, two) if not e.exact}
    for e in events:
        if not e.exact and e.agent is not None and e.late >= known.spans[e.agent][1] > e.early:
            found[id(e)] = e
    return list(found.values())


def _compare(difference: int, tie: int) -> int:
    """Return -1, 0 or 1 for before, at about the same time, after."""
    return 0 if abs(difference) <= tie else 1 if difference > 0 else -1


def _choices(loose: Sequence[Event]) -> Iterator[_Moments]:
    """Yield moments for the events: per event its recorded, first and last moment, and those of other events within its range."""
    ends = {id(e): (e.told, e.early, e.late) for e in loose}
    shared = [{*ends[id(e)], *(t for o in loose for t in ends[id(o)] if e.early <= t <= e.late)} for e in loose]
    if np.prod([float(len(s)) for s in shared]) > MOST:
        shared = [{e.early, e.told, e.late} for e in loose] if 3 ** len(loose) <= MOST else [{e.early, e.late} for e in loose]
    for moments in product(*(sorted(choice) for choice in shared)):
        yield {id(e): t for e, t in zip(loose, moments, strict=True)}


def _followed(moments: _Moments, agents: Sequence[int], known: Crossings) -> _Moments | None:
    """Return moments in which every agent comes to its zones in order; None if the given moments allow no such order.

    An agent that skips a zone between two samples was in the zone just before the agent left the zone.
    """
    found = dict(moments)
    for agent in agents:
        events, end = known.of_agents[agent], known.spans[agent][1]
        for one, after in reversed(list(pairwise(events))):
            latest = found[id(after)] - (found[id(after)] < end)
            if found[id(one)] > latest:
                if latest < min(one.early, one.told - 1):
                    return None
                found[id(one)] = latest
    return found


class _Word:
    """A run with one state per event, in which every event happens at a chosen moment.

    Args:
        known: the events of the whole run.
        agents: the columns of the agents of the instance; other agents are absent.
        lights: the entrances of the lights whose changes count.
        moments: the moments of the events.
    """

    def __init__(self, known: Crossings, agents: Sequence[int], lights: Sequence[int], moments: _Moments) -> None:
        run, self._known = known.run, known
        events = [e for agent in agents for e in known.of_agents[agent]]
        changes = [e for light in lights for e in known.of_lights[light]]
        times = {0, *(moments[id(e)] for e in (*events, *changes)), *(t for agent in agents for t in known.spans[agent])}
        self._times = np.array(sorted(t for t in times if 0 <= t < known.end), dtype=np.int64)
        self._zone = np.full((len(self._times), len(run.agents)), Zone.ABSENT, dtype=np.int8)
        self._waited = np.zeros(self._zone.shape, dtype=np.int32)
        self._arrived = []
        for agent in agents:
            crossed = [moments[id(e)] for e in known.of_agents[agent]]
            begin, end = known.spans[agent]
            there = (self._times >= begin) & (self._times < end)
            self._zone[there, agent] = np.searchsorted(crossed, self._times[there], side="right")
            at = self._zone[:, agent] == Zone.ENTRANCE
            # As in `Run.wt`, the first state at the entrance counts 1, but the first state of the run counts 0.
            arrived = crossed[0] or 1
            self._waited[at, agent] = self._times[at] - arrived + 1
            self._arrived.append(arrived)
        self._lights = np.repeat(run.lights[:1], len(self._times), axis=0)
        for light in lights:
            for change in sorted(known.of_lights[light], key=lambda e: moments[id(e)]):
                self._lights[self._times >= moments[id(change)], light] = change.code

    def key(self, tie: int) -> object:
        """Return a key that is equal for words that no rule about order distinguishes."""
        arrivals = tuple(_compare(one - two, tie) for one, two in combinations(self._arrived, 2))
        return self._zone.tobytes(), self._lights.tobytes(), arrivals

    def judged(self, template: Template, values: Values) -> Judgement:
        """Return the judgement of an instance on this word, with ticks of the whole run."""
        known = self._known
        run = known.run
        word = Run(run.label, run.junction, run.agents, self._zone, self._lights, known.length)
        (block,) = as_blocks(word, word.steps)
        block.values[wt] = self._waited
        assume(word, block)
        (found,) = judge((template,), Values(word, values.tie))
        ticks = np.minimum(-(-self._times // known.moments), run.steps - 1).tolist()
        trigger, failed = (None if k is None else int(ticks[k]) for k in (found.trigger, found.failed))
        return replace(found, trigger=trigger, failed=failed, margin=None)


def _hinge(events: Sequence[Event], moments: _Moments, known: Crossings, tie: int) -> Hinge:
    """Return as the hinge the nearest two events whose order another reading changes, or the single uncertain event."""
    turned = []
    for one, two in combinations(events, 2):
        if (one.agent, one.light) == (two.agent, two.light):
            continue
        window = tie if one.code == two.code == Zone.ENTRANCE and None not in (one.agent, two.agent) else 0
        if _compare(one.told - two.told, window) != _compare(moments[id(one)] - moments[id(two)], window):
            turned.append((abs(abs(one.told - two.told) - window), window, one, two))
    if turned:
        _, window, one, two = min(turned, key=lambda pair: pair[0])
        first, second = sorted((one, two), key=lambda e: e.told)
        width = first.late - first.early + second.late - second.early
    else:
        first = second = max(events, key=lambda e: (moments[id(e)] != e.told, not e.exact))
        window, width = 0, first.late - first.early
    what = tuple(dict.fromkeys((_happening(first, known), _happening(second, known))))
    return Hinge(what, math.inf if width >= -LONG_AGO else width / 2 * known.length, window * known.length)


def _happening(event: Event, known: Crossings) -> Happening:
    ended = event.agent is not None and event.told >= known.spans[event.agent][1]
    return Happening(event.agent, event.light, event.code, None if ended else event.told * known.length)
