"""Judges other readings of a run (runs with measured values changed within their accuracy), to find verdicts that are UNSURE.

A reading is a complete, consistent run. If single truth values were changed instead, a vehicle could be in two places at once.
Rules about the order of events are judged in all possible orders, see `orders`. All other rules are judged in a few readings at
the limits of the accuracy: places, sizes or speeds are changed by three standard deviations. Where the recording lacks the colour
of a light, a few combinations of colours are tried.

A definite verdict is the same in every reading. A verdict that a reading changes is UNSURE, which is neither red nor green. An
exact run that is as dense as a simulated run has no other readings, and its verdict costs no further time.

`tolerance` tells how wrong the measurements can be before a violation is in doubt. If a map lies 0.8 m beside the road, vehicles
that keep the rules seem to break the rules. So a violation is judged again with places, or speeds, that are less exact than the
recording says. The same errors are tried for all rules, so that rules share runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil, log2

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.priority import owes
from pytest_rvads.logic.conduct.standing import STANDSTILL, in_stop_place, stands
from pytest_rvads.logic.conduct.static_model import colourings
from pytest_rvads.logic.judging.attribution import by_walkers, is_about
from pytest_rvads.logic.judging.instances import Binding, Template
from pytest_rvads.logic.judging.judge import Values, judge, unsure
from pytest_rvads.logic.judging.judgement import Hinge, Judgement
from pytest_rvads.logic.judging.orders import about_order, certain, crossings, plain, reordered
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import agents_of
from pytest_rvads.logic.rules.vocabulary import Measured, RightOfWay
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import zones
from pytest_rvads.runs.run import Excerpt, Run, once
from pytest_rvads.runs.states import Zone

SURE = 3.0
"""Number of standard deviations by which the true value can differ from the measured value."""
_AFTER = "what happened after a vehicle had left the recording before it was clear"
_LINE = "where its stopping line is: one is painted in the junction where ways have met, and the end of the lane is taken for it"


@dataclass(frozen=True, slots=True)
class Reading:
    """Another reading of a run: the run with the measurements of a kind changed within their accuracy."""

    asks: Measured
    """The kind of the changed measurements."""
    within: float
    """Largest change [m or m/s]; 0 if the reading changes no measured value."""
    run: Run

    @property
    def words(self) -> str:
        """The kind of the changed measurements, and their accuracy, in words."""
        if not self.within:
            return self.asks
        return f"{self.asks}, known to {self.within:.2f} {'m/s' if self.asks == Measured.PACE else 'm'}"


def doubted(recorded: Sequence[Judgement], values: Values, sampled: Run, *, standing: bool = False) -> list[Judgement]:
    """Return the judgements, in which every instance whose status differs in another reading of the run has become UNSURE."""
    run = values.run
    if certain(sampled):
        return _of_lines(recorded, values, standing=standing)
    result = [unsure(j, Hinge(reading=_AFTER)) if _left_early(run, j) else j for j in recorded]
    events = crossings(sampled)
    if not events.exact:
        result = [reordered(j, events, values) if about_order(j.template, run) and not standing else j for j in result]
    measured = {k: j for k, j in enumerate(recorded) if standing or not about_order(j.template, run)}
    in_colour = {k: j for k, j in enumerate(recorded) if j.status is not Status.NA}
    for ask in Measured:
        asked = {k: j for k, j in (in_colour if ask is Measured.COLOURS else measured).items() if ask in _asks(j.template)}
        for reading in once(run, _MAKERS[ask]) if asked else ():
            undoubted = {}
            for k, j in asked.items():
                agents = [e.index for e in agents_of(j.template.formula)]
                # Changed measurements can't change the status of vehicles that are far apart.
                apart = len(agents) > 1 and run.pose is not None and not once(run, _nearby)[agents[0], agents[1]]
                if result[k] is j and not apart:
                    undoubted[k] = j
            reread_values = Values(reading.run, values.tie, standing=standing)
            reread = judge(tuple(j.template for j in undoubted.values()), reread_values) if undoubted else []
            for (k, j), judgement in zip(undoubted.items(), reread, strict=True):
                blame = ask is Measured.COLOURS and _blame(judgement, reading.run) != _blame(j, run)
                if blame or plain(judgement.status) is not plain(j.status):
                    result[k] = unsure(j, Hinge(reading=reading.words))
    return _of_lines(result, values, standing=standing)


def agreed(judged: Iterable[tuple[Run, Sequence[Judgement]]], doubt: str) -> list[Judgement]:
    """Return the judgements of a run on which the ways of some vehicles are not decided.

    An instance whose status or blame depends on a way is UNSURE. An instance that is kept on some ways and not triggered on the
    others is left out, unless no other instance is triggered.
    """
    told = [[(j, (j.status, *_blame(j, run))) for j in judgements] for run, judgements in judged]
    outcomes = [dict[Binding, set[tuple[Status, bool, bool]]]() for _ in told]
    for found, judgements in zip(outcomes, told, strict=True):
        for j, outcome in judgements:
            for member in j.template.members:
                found.setdefault(member.binding, set()).add(outcome)
    result, kept, doubtful = list[Judgement](), list[Judgement](), set[Binding]()
    for number, judgements in enumerate(told):
        for j, outcome in judgements:
            binding = j.template.binding
            on_ways = [found.get(binding, {(Status.NA, False, False)}) for found in outcomes]
            if all(outcome in on_way for on_way in on_ways):
                result += [] if number else [j]
            elif not number or binding not in doubtful:
                broken = any(plain(status) is not Status.PASS for on_way in on_ways for status, *_ in on_way)
                (result if broken else kept).append(j if j.status is Status.UNSURE else unsure(j, Hinge(reading=doubt)))
                doubtful.add(binding)
    return result if any(j.status is not Status.NA for j in result) else result + kept


def _of_lines(judgements: Sequence[Judgement], values: Values, *, standing: bool) -> list[Judgement]:
    """Return the judgements, in which violations that painted lines excuse, which the junction can't use, have become UNSURE."""
    failed = {k: j for k, j in enumerate(judgements) if j.status is Status.FAIL}
    painted = once(values.run, _at_painted_lines) if failed else None
    if painted is None:
        return list(judgements)
    reread = judge(tuple(j.template for j in failed.values()), Values(painted, values.tie, standing=standing))
    kept = {k for k, judgement in zip(failed, reread, strict=True) if judgement.status is not Status.FAIL}
    return [unsure(j, Hinge(reading=_LINE)) if k in kept else j for k, j in enumerate(judgements)]


def _at_painted_lines(run: Run) -> Run | None:
    """Return a run whose junction has its lines where they are painted, see `Entrance.beyond`; None if it has them so already."""
    lanes = run.junction.entrances
    if run.station is None or all(lane.beyond is None for lane in lanes):
        return None
    lanes = tuple(lane if lane.beyond is None else replace(lane, setback=-lane.beyond, beyond=None) for lane in lanes)
    return _rezoned(replace(run, junction=replace(run.junction, entrances=lanes)), run.station)


def _blame(j: Judgement, run: Run) -> tuple[bool, bool]:
    """Return whether pedestrians alone are to blame for an instance, and whether the subject (the vehicle under test) is."""
    return by_walkers(j, run), run.subject is not None and is_about(j, run, run.subject)


def _left_early(run: Run, j: Judgement) -> bool:
    """Return whether a vehicle of a kept instance left the recording while an atom could still become true, and break it."""
    if j.status is not Status.PASS or j.ended is None:
        return False
    words = ((word_of(atom), [e.index for e in agents_of(atom)]) for atom in j.template.atoms)
    taking = (agents for word, agents in words if word is not None and word.debt is RightOfWay.TAKEN)
    return any(owes(run, *agents)[j.ended] and run.zone[j.ended, agents[0]] >= Zone.JUNCTION for agents in taking)


def _asks(template: Template) -> frozenset[Measured]:
    """Return the kinds of measurement on which an instance of a rule depends."""
    words = [word_of(atom) for atom in template.atoms]
    asks = {ask for word in words for ask in ((Measured.PACE,) if word is None else word.turns_on)}
    if Measured.PACE in asks or any(word is not None and word.cause is not None for word in words):
        asks |= {Measured.COLOURS}
    if Measured.ALONG in asks and len(agents_of(template.formula)) < 2:
        asks = asks - {Measured.ALONG} | {Measured.ALONE}
    return frozenset(asks)


NEARBY = 30.0
"""Largest distance between the fronts of two vehicles at which the vehicles can affect each other [m].

The distance covers a car and a truck, and the gap between them at a speed of 5 m/s.
"""


def _nearby(run: Run) -> NDArray[np.bool_]:
    """Return which vehicles ever come within `NEARBY` of each other, shape ``(agents, agents)``."""
    places = run.need("pose")[:: max(round(0.2 / run.dt), 1), :, :2]
    nearby = np.zeros((len(run.agents), len(run.agents)), dtype=np.bool_)
    for column in range(len(run.agents)):
        apart = places - places[:, column, None]
        nearby[column] = ((apart**2).sum(axis=-1) < NEARBY**2).any(axis=0)  # an absent vehicle is at NaN: false
    return nearby


def _of_sizes(run: Run) -> tuple[Reading, ...]:
    by = 0.0 if run.excerpt is None else SURE * run.excerpt.position_accuracy
    if by <= 0.0 or run.pose is None or run.station is None or not all(agent.size for agent in run.agents):
        return ()
    readings = []
    for larger in (by, -by):  # on all sides
        sizes = ((max(a.size[0] + 2 * larger, larger), max(a.size[1] + 2 * larger, by)) for a in run.agents if a.size)
        agents = tuple(replace(agent, size=size) for agent, size in zip(run.agents, sizes, strict=True))
        resized = replace(run, agents=agents, pose=_shifted(run, larger, 0.0), station=run.station + larger, spread=None)
        readings.append(Reading(Measured.SIZES, by, resized))
    return tuple(readings)


def _of_sides(run: Run) -> tuple[Reading, ...]:
    by = 0.0 if run.excerpt is None else SURE * run.excerpt.position_accuracy
    if by <= 0.0 or run.pose is None:
        return ()
    return tuple(Reading(Measured.SIDES, by, replace(run, pose=_shifted(run, 0.0, to), spread=None)) for to in (by, -by))


def _of_pace(run: Run) -> tuple[Reading, ...]:
    by = 0.0 if run.excerpt is None else SURE * run.excerpt.speed_accuracy
    if by <= 0.0 or run.speed is None:
        return ()
    fast = np.abs(run.speed)
    # A speed of exactly 0 is a standstill that the positions prove. In the reading with lower speeds, every vehicle is also moved
    # back along its itinerary; in the reading with higher speeds, every vehicle is moved ahead.
    speeds = ((np.maximum(fast - by, 0.0), -1.0), (np.where(fast == 0.0, 0.0, fast + by), 1.0))
    readings = []
    for speed, sign in speeds:
        moved = run if run.spread is None else _moved(run, np.full(len(run.agents), sign))
        readings.append(Reading(Measured.PACE, by, replace(moved, speed=np.copysign(speed, run.speed))))
    return tuple(readings)


def _of_the_past(run: Run) -> tuple[Reading, ...]:
    """Return two runs: in one, vehicles that appear in their stop place brake to a stop there; in the other, they roll slowly."""
    if run.excerpt is None or run.speed is None or run.station is None:
        return ()
    stopping, rolling = run.speed.copy(), run.speed.copy()
    late = [a for a, (begin, end) in enumerate(run.spans) if end > begin + 1 and in_stop_place(run)[begin, a]]
    for agent in late:
        begin, end = run.spans[agent]
        still = stands(run)[begin:end, agent]
        stopping[begin : begin + 2, agent] = 1.0, 0.0
        rolling[begin : begin + (len(still) if still.all() else still.argmin()), agent] = 2 * STANDSTILL
    return tuple(Reading(Measured.BEFORE, 0.0, replace(run, speed=speed)) for speed in (stopping, rolling) if late)


def _all_moved(run: Run, asks: Measured) -> tuple[Reading, ...]:
    """Return runs in which every agent is moved ahead of its measured station, or back.

    For `Measured.ALONE` all agents move the same way. For `Measured.ALONG` the agents of an entrance move the same way, and for
    any two entrances, in at least one of the runs the agents of the first are ahead and the agents of the second are behind.
    """
    within = 0.0 if run.spread is None or run.station is None else float(np.nanmax(run.spread, initial=0.0))
    if within <= 0.0:
        return ()
    signs = [np.ones(len(run.agents))]
    if asks is Measured.ALONG:
        entrances = np.array([agent.entrance for agent in run.agents])
        bits = range(ceil(log2(max(len(run.junction.starts), 2))))
        signs = [np.where(entrances >> bit & 1, 1.0, -1.0) for bit in bits]
    return tuple(Reading(asks, within, _moved(run, to * ahead)) for ahead in signs for to in (1.0, -1.0))


def _moved(run: Run, signs: NDArray[np.float64]) -> Run:
    """Return a run in which every agent is moved ahead (sign 1) or back (sign -1) by the spread of its station (`Run.spread`)."""
    by = signs * np.asarray(run.spread)
    moved = _rezoned(run, run.need("station") + by)
    return replace(moved, pose=None if run.pose is None else _shifted(run, by, 0.0), spread=None)


def _rezoned(run: Run, station: NDArray[np.float64]) -> Run:
    zone = run.zone.copy()
    for column, (begin, end) in enumerate(run.spans.tolist()):
        who = run.agents[column]
        zone[begin:end, column] = zones(itinerary(run.junction, *who.way.key).borders, station[begin:end, column])
    return replace(run, zone=zone, station=station)


def _shifted(run: Run, ahead: float | NDArray[np.float64], sideways: float) -> NDArray[np.float64]:
    """Return the poses of all agents, moved ahead and to the left by distances in metres."""
    pose = run.need("pose").copy()
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    pose[..., 0] += ahead * cos - sideways * sin
    pose[..., 1] += ahead * sin + sideways * cos
    return pose


_MAKERS: dict[Measured, Callable[[Run], tuple[Reading, ...]]] = {
    Measured.SIZES: _of_sizes,
    Measured.SIDES: _of_sides,
    Measured.PACE: _of_pace,
    Measured.ALONG: lambda run: _all_moved(run, Measured.ALONG),
    Measured.ALONE: lambda run: _all_moved(run, Measured.ALONE),
    Measured.BEFORE: _of_the_past,
    Measured.COLOURS: lambda run: tuple(Reading(Measured.COLOURS, 0.0, possible) for possible in once(run, colourings)),
}
"""Per kind of measurement, the function that returns the runs with such measurements changed within their accuracy."""


_ERRORS = (("places", "m", (0.1, 0.2, 0.4, 0.8, 1.6)), ("speeds", "m/s", (0.1, 0.2, 0.5, 1.0, 2.0)))
"""Per kind of measurement its name, its unit, and the errors that are tried."""


def tolerance(run: Run, status_of: Callable[[Run], Status]) -> str:
    """Return in words with how large an error of the measurements a violation stays definite."""
    parts = []
    for kind, (noun, unit, errors) in enumerate(_ERRORS):
        held = 0
        while held < len(errors) and status_of(once(run, _less_exact, kind, held)) is Status.FAIL:
            held += 1
        if held < len(errors):
            limit = f"at {errors[held]:g} {unit} it is in doubt"
            parts.append(
                f"{noun} may be wrong by {errors[held - 1]:g} {unit}, {limit}" if held else f"if {noun} are wrong {limit}"
            )
    most = " and ".join(f"{noun} are wrong by {errors[-1]:g} {unit}" for noun, unit, errors in _ERRORS)
    return "; ".join(parts) or f"a violation even if {most}"


def _less_exact(run: Run, kind: int, number: int) -> Run:
    """Return a run whose places (kind 0) or speeds (kind 1) are known to an error of `_ERRORS` only."""
    excerpt, error = run.excerpt or Excerpt(), _ERRORS[kind][2][number]
    if kind:
        return replace(run, excerpt=replace(excerpt, speed_accuracy=max(excerpt.speed_accuracy, error / SURE)))
    spread = np.full(run.zone.shape, error) if run.spread is None else np.maximum(run.spread, error)
    accuracy = max(excerpt.position_accuracy, error / SURE)
    return replace(run, spread=spread, excerpt=replace(excerpt, position_accuracy=accuracy))
