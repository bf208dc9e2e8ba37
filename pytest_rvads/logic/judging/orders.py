"""Rules about the order of events, judged in every order in which the events of an instance may have happened.

All that such an instance speaks of is who is in which zone, who waited longer, and what the lights show. The rules don't
count states, so a run is as good as the word of one state per event.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, combinations, pairwise, product

import numpy as np

from pytest_rvads.conduct.blocks import as_blocks, assume
from pytest_rvads.conduct.motion import wt
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
"""Per event, given by its id, when it happened."""
MOST = 1024
"""Choices of moments that are looked at for one instance, before only the first and the last ones are."""


def about_order(template: Template, run: Run) -> bool:
    """Return whether an instance speaks of nothing but zones, compared waiting times and colours.

    Arrivals are known from zones alone where a run holds no positions or no speeds.
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
    """Return what an instance about order says when its events may have happened in another one.

    Args:
        found: what it says of the run as it was recorded.
        known: the events of the run.
        values: of the run.
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
    """Return a status without the difference that nobody asks for: whether what was kept had been asked."""
    return Status.PASS if status is Status.NA else status


def _lights(term: f.Term) -> Iterator[f.Element]:
    element = term.of if isinstance(term, f.Attr) else term
    if isinstance(element, f.Element) and element.sort == Sort.LIGHT:
        yield element


def _skips(run: Run, agent: int) -> bool:
    """Return whether an agent steps over a zone between two samples: it was there all the same."""
    begin, end = run.spans[agent]
    return bool((np.diff(run.zone[begin:end, agent].astype(int)) > 1).any())


def _loose(events: Sequence[Event], changes: Sequence[Event], known: Crossings, tie: int) -> list[Event]:
    """Return the events whose place in the order is open."""
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
    """Return -1, 0 or 1: before, at about the same time, after."""
    return 0 if abs(difference) <= tie else 1 if difference > 0 else -1


def _choices(loose: Sequence[Event]) -> Iterator[_Moments]:
    """Return moments for events: of every one its own ends and middle, and those of the others that it can share."""
    ends = {id(e): (e.told, e.early, e.late) for e in loose}
    shared = [{*ends[id(e)], *(t for o in loose for t in ends[id(o)] if e.early <= t <= e.late)} for e in loose]
    if np.prod([float(len(s)) for s in shared]) > MOST:
        shared = [{e.early, e.told, e.late} for e in loose] if 3 ** len(loose) <= MOST else [{e.early, e.late} for e in loose]
    for moments in product(*(sorted(choice) for choice in shared)):
        yield {id(e): t for e, t in zip(loose, moments, strict=True)}


def _followed(moments: _Moments, agents: Sequence[int], known: Crossings) -> _Moments | None:
    """Return moments in which every agent comes to one zone after the other; None where it can't have at these.

    Who steps over a zone between two samples was in it just before it left it.
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
    """A run of one state per event, in which every event happens at a moment that was chosen.

    Args:
        known: the events of the whole run.
        agents: the columns of those that it is about; the others are absent.
        lights: whose changes count, by entrance.
        moments: of the events.
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
            # As `Run.wt` counts: one in the first state there, but none in the first state of all.
            arrived = crossed[0] or 1
            self._waited[at, agent] = self._times[at] - arrived + 1
            self._arrived.append(arrived)
        self._lights = np.repeat(run.lights[:1], len(self._times), axis=0)
        for light in lights:
            for change in sorted(known.of_lights[light], key=lambda e: moments[id(e)]):
                self._lights[self._times >= moments[id(change)], light] = change.code

    def key(self, tie: int) -> object:
        """Return the same for words that no rule about order tells apart."""
        arrivals = tuple(_compare(one - two, tie) for one, two in combinations(self._arrived, 2))
        return self._zone.tobytes(), self._lights.tobytes(), arrivals

    def judged(self, template: Template, values: Values) -> Judgement:
        """Return what an instance says of it, in ticks of the whole run."""
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
    """Return the two events, nearest to each other, whose order another reading changes; or the one that is open."""
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
