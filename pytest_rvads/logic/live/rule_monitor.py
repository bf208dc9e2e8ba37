"""Rules on a run while it is being produced: one state at a time, in constant memory.

Verdicts equal those of `check`, tick for tick, except UNSURE, which needs the whole run; so ``rvads check --follow`` judges the
runs of vehicles that have left. If vehicles come and go, instances about one or two vehicles are kept as long as a violation can
come. A rule about three vehicles at once needs the vehicles beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.conduct.blocks import Signal
from pytest_rvads.conduct.predicates import extract
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.live.board import Board
from pytest_rvads.logic.live.instances import Instances
from pytest_rvads.logic.live.instant import Instant, Mover, State
from pytest_rvads.logic.live.seeing import Decided, Seen, row_of, sizes_of
from pytest_rvads.logic.live.watch import Fact, Reading, Watch
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.telling.phrase import element_name
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Before, zones
from pytest_rvads.runs.run import DT, Facts
from pytest_rvads.runs.states import ABSENT, Agent

__all__ = ["RuleMonitor"]


class RuleMonitor:
    """Follows rules through a run that is not over: `step` says whether they can still be kept.

    What atoms need of the past (waiting times, having stopped, time lost, ways taken) is carried along, so that a state costs
    the same however long the run is. A predicate of your own sees one state only, unless it is given with `follow`. How a run
    ended, and why, is for `check` to say once it is over.

    With `agents` the vehicles are the same from the first state to the last, and `step` reads them. Without, they come and go:
    `see` reads who is there, and instances are about vehicles that are there at the same time.

    Args:
        rule: a rule or the name of one, a rulebook, or several of these; of a rulebook, the rules about this junction.
        junction: where the vehicles drive.
        agents: the vehicles, in the order of the columns that `step` gets; None: those that `see` gets.
        dt: time between two states [s].
        speed_limit: where the map states none [m/s], for rules that ask for it.
        vehicle_size: length and width of the vehicles [m], likewise; one pair for all, or one for each.
        book: to look the rule up in; by default the one that is open, with what you registered.
        block: so many states are judged at once, which takes much less time for each. What happens in a state is told up to
            ``block - 1`` states later, 0.09 s for ten states of 0.01 s, with the time of the state in which it happened; `see`
            tells it earlier where a vehicle comes or goes, `flush` at once.

    Raises:
        FormulaError: an unknown rule, one whose monitor would be too large, or without `agents` one about three vehicles at once.
        RunError: the rule is about another kind of junction, or a block without states.
    """

    def __init__(  # noqa: PLR0913 - what a monitor has to know, the rarer part by keyword
        self,
        rule: str | Rule | Sequence[str | Rule],
        junction: Junction,
        agents: Sequence[Agent] | None = None,
        *,
        dt: float = DT,
        speed_limit: float | None = None,
        vehicle_size: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
        book: RuleBook | None = None,
        block: int = 1,
    ) -> None:
        self.rules = rules_for(rule, junction, book)
        for one in self.rules:
            if not one.concerns(junction):
                kinds = " or ".join(one.kinds) + (" and several lanes on an arm" if one.lanes else "")
                kinds += " and a lane that joins another one" if one.joining else ""
                raise RunError(f"{one.name} is about junctions with {kinds}, this one has {junction.control}")
        if block < 1:
            raise RunError(f"block must be a number of states from 1 on, got {block!r:.20}")
        self._junction, self._block = junction, block
        self._states: list[State] = []
        self._seen: list[tuple[dict[str, Seen], list[int]]] = []
        self._agents = None if agents is None else tuple(agents)
        if vehicle_size is not None and self._agents is not None:
            sizes = sizes_of(vehicle_size, len(self._agents))
            self._agents = tuple(replace(a, size=size) for a, size in zip(self._agents, sizes, strict=True))
        self._size = None if vehicle_size is None or agents is not None else sizes_of(vehicle_size, 1)[0]
        self._now = Instant(junction, dt, Facts(speed_limit=speed_limit))
        words = {word_of(atom) for rule in self.rules for atom in f.atoms(rule.formula)}
        self._now.signals += [word.holds for word in words if word is not None and isinstance(word.holds, Signal)]
        self._board = Board(self._now)
        self._queue: list[Watch] = []
        self._readings: dict[tuple[int, tuple[int, ...]], tuple[Machine, Reading]] = {}
        self._watches: dict[Watch, tuple[Mover, ...]] = {}
        self._pending = [0] * len(self.rules)
        """Of every rule, how many watches there are."""
        self._broken: dict[Watch, tuple[Mover, ...]] = {}
        self._failed: set[int] = set()
        self._instances: Instances | None = None
        self._there: dict[str, Mover] = {}
        self._about: dict[Mover, dict[Watch, None]] = {}
        self._free: list[int] = []
        self.not_judged: dict[str, str] = {}
        """Of several rules, those that ask for something that is not given, and what that is."""

    @property
    def rule(self) -> Rule:
        """The rule, the first where there are several."""
        return self.rules[0]

    @property
    def verdict(self) -> Truth:
        """``F`` when an instance is violated, whatever follows; ``T`` when none can be any more; else ``?``."""
        return min(self.verdicts.values(), key=_WORST.index, default=Truth.UNKNOWN)

    @property
    def verdicts(self) -> dict[str, Truth]:
        """The same of every rule, by its name; ``T`` only where the vehicles are known from the beginning."""
        begun = self._now.tick >= 0 and self._agents is not None
        return {
            rule.name: Truth.FALSE if k in self._failed else Truth.UNKNOWN if self._pending[k] or not begun else Truth.TRUE
            for k, rule in enumerate(self.rules)
            if rule.name not in self.not_judged
        }

    @property
    def violated(self) -> tuple[dict[str, str], ...]:
        """Of violated instances, what the variables of the rule stand for; without `agents`, as long as these are there."""
        return tuple(_binding(watch.template, movers) for watch, movers in self._broken.items())

    def violated_of(self, rule: str) -> tuple[dict[str, str], ...]:
        """Return the same of one of several rules, by its name."""
        return tuple(_binding(w.template, movers) for w, movers in self._broken.items() if self.rules[w.rule].name == rule)

    def step(
        self,
        zone: ArrayLike,
        lights: ArrayLike | None = None,
        *,
        station: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        pose: ArrayLike | None = None,
        collisions: Iterable[tuple[str, str]] | None = None,
    ) -> Truth:
        """Read one state and return the verdict so far.

        Args:
            zone: `Zone` of every agent, shape ``(agents,)``.
            lights: `Colour` at every entrance, shape ``(entrances,)``; none by default.
            station: along the itinerary, 0 at the entrance vertex, shape ``(agents,)`` [m].
            speed: forward, shape ``(agents,)`` [m/s].
            pose: x [m], y [m], heading [rad] of the reference points, shape ``(agents, 3)``.
            collisions: pairs of vehicles that touch for the first time in this state, by name; empty when none do. None works
                it out from poses and sizes.

        Raises:
            RunError: an array of another shape, or one missing that the rule asks for.
        """
        if self._agents is None:
            raise RunError("step reads vehicles that are known beforehand: give RuleMonitor its agents, or call see")
        count = len(self._agents)
        zones = row_of("zone", zone, (count,))
        colours = self._colours(lights)
        stations = None if station is None else row_of("station", station, (count,))
        speeds = None if speed is None else row_of("speed", speed, (count,))
        poses = None if pose is None else row_of("pose", pose, (count, 3))
        touching = None if collisions is None else frozenset(frozenset(pair) for pair in collisions)
        state = State(list(map(int, zones)), stations, speeds, poses, colours, touching)
        if self._states and state.given != self._states[0].given:
            self.flush()
        self._states.append(state)
        if len(self._states) >= self._block:
            self.flush()
        return Truth.FALSE if self._failed else self.verdict

    def see(self, vehicles: Iterable[Seen], lights: ArrayLike | None = None) -> tuple[Decided, ...]:
        """Read who is there now and return what is decided by it, each instance once.

        A vehicle is there from the first state in which it is seen to the last one before a state in which it is not. Its zone
        follows from its stations: a border between two zones is crossed once, as in recordings. What is decided is not kept.

        Args:
            vehicles: that are seen now.
            lights: `Colour` at every entrance, shape ``(entrances,)``; none by default.

        Raises:
            RunError: two vehicles of one name, a way that the junction does not have, a number that is not finite, or something
                missing that the only rule asks for.
        """
        if self._agents is not None:
            raise RunError("see reads vehicles that come and go: call step, or make a RuleMonitor without agents")
        given = tuple(vehicles)
        seen = {vehicle.agent.name: vehicle for vehicle in given}
        colours = self._colours(lights)
        for vehicle in given:
            self._check(vehicle, len(seen) == len(given))
        if self._instances is None:
            self._instances = Instances(self.rules, self._junction, colours)
        decided: tuple[Decided, ...] = ()
        if self._seen and seen.keys() != self._seen[0][0].keys():
            decided = self.flush()
        self._seen.append((seen, colours))
        return decided if len(self._seen) < self._block else (*decided, *self.flush())

    def flush(self) -> tuple[Decided, ...]:
        """Judge the states that wait for their block to be full, and return what `see` would return."""
        states, seen, self._states, self._seen = self._states, self._seen, [], []
        if self._agents is not None and states:
            self._judge(states)
        return self._judge_seen(seen) if seen else ()

    def _judge(self, states: Sequence[State]) -> None:
        """Judge the next states of vehicles that are known beforehand."""
        now, first = self._now, self._now.tick < 0
        if first:
            for slot, agent in enumerate(self._agents or ()):
                now.add(agent, slot)
        now.feed(states)
        for number in range(len(states)):
            now.go_on()
            if first and number == 0:
                self._begin()
            else:
                self._board.read()
            self._run_monitors()

    def _judge_seen(self, states: Sequence[tuple[dict[str, Seen], list[int]]]) -> tuple[Decided, ...]:
        """Judge the next states, in all of which the same vehicles are seen."""
        now, seen, instances = self._now, states[0][0], self._instances
        old = tuple(self._there.values())
        new = tuple(self._enter(vehicle.agent) for name, vehicle in seen.items() if name not in self._there)
        gone = [self._there.pop(name) for name in self._there.keys() - seen.keys()]
        now.feed([State(*self._columns(vehicles), colours) for vehicles, colours in states])
        old = tuple(mover for mover in old if mover.zone != ABSENT)
        decided: list[Decided] = []
        for number in range(len(states)):
            now.go_on()
            self._board.read()
            if number == 0 and instances is not None:
                for place, mover in enumerate(new):
                    self._watch(instances.of(mover.agent.route.key), (mover,))
                    for other in (*old, *new[:place]):
                        self._watch(instances.of(other.agent.route.key, mover.agent.route.key), (other, mover))
            decided += self._run_monitors()
            if number == 0:
                decided += self._leave(gone)
        return tuple(decided)

    def _check(self, vehicle: Seen, unique: bool) -> None:
        if not unique:
            raise RunError("two vehicles of a state have the same name: give each its own")
        if not all(map(math.isfinite, vehicle[1:])):
            raise RunError(f"vehicle {vehicle.agent.name!r}: what is seen must be finite numbers, got {tuple(vehicle[1:])!r:.80}")
        known = self._there.get(vehicle.agent.name)
        if known is None and vehicle.agent.route.key not in self._junction.movements:
            raise RunError(f"vehicle {vehicle.agent.name!r}: the junction has no way {vehicle.agent.route.key}")

    def _enter(self, agent: Agent) -> Mover:
        """Return a vehicle that was not there before, in the column that has been free for longest."""
        now = self._now
        if self._size is not None and agent.size is None:
            agent = replace(agent, size=self._size)
        slot = self._free.pop(0) if len(self._free) > _SPARE else len(now.slots)
        mover = self._there[agent.name] = now.add(agent, slot)
        self._about[mover] = {}
        return mover

    def _columns(self, seen: Mapping[str, Seen]) -> tuple[list[int], list[float], list[float], list[tuple[float, float, float]]]:
        """Return zones, stations, speeds and poses by column."""
        slots = self._now.slots
        if not slots:
            return [], [], [], []
        there = [seen.get(mover.agent.name) if self._there.get(mover.agent.name) is mover else None for mover in slots]
        stations, speeds, *pose, spreads = zip(*(_NOWHERE if vehicle is None else vehicle[1:] for vehicle in there), strict=True)
        borders = np.array([itinerary(self._junction, *mover.agent.route.key).borders for mover in slots])
        before = Before(*(np.array(values) for values in zip(*((m.zone, m.station, m.spread) for m in slots), strict=True)))
        zone = zones(borders, np.array([stations]), np.array([spreads]), before)[0].tolist()
        zone = [int(ABSENT) if vehicle is None else z for vehicle, z in zip(there, zone, strict=True)]
        for mover, *values in zip(slots, zone, stations, spreads, strict=True):
            mover.zone, mover.station, mover.spread = values
        return zone, list(stations), list(speeds), list(zip(*pose, strict=True))

    def _begin(self) -> None:
        """Make the monitors of vehicles that are known beforehand."""
        static, movers = extract(self._now.run), tuple(self._now.slots)
        for number, rule in enumerate(self.rules):
            templates = prepare(rule.formula, static, rule.bound).templates
            self._watch(tuple((number, template) for template in templates), movers)

    def _watch(self, templates: Sequence[tuple[int, Template]], movers: tuple[Mover, ...]) -> None:
        """Make monitors of instances about these vehicles."""
        for number, template in templates:
            rule = self.rules[number]
            if rule.name in self.not_judged:
                continue
            try:
                facts = [self._board.fact(atom, movers, rule.tie) for atom in template.atoms]
            except RunError as error:
                if len(self.rules) == 1:
                    raise
                self._give_up(number, str(error))
                continue
            watch = Watch(number, template, self._reading(template.machine, facts), facts, self._queue)
            self._watches[watch] = movers
            self._pending[number] += 1
            if self._agents is None:
                for mover in movers:
                    self._about[mover][watch] = None

    def _give_up(self, number: int, reason: str) -> None:
        """Judge by a rule no more, which asks for something that nobody gives."""
        self.not_judged[self.rules[number].name] = reason
        for watch in [watch for watch in self._watches if watch.rule == number]:
            self._end(watch)

    def _reading(self, machine: Machine, facts: Sequence[Fact]) -> Reading:
        asked = tuple(k for k, fact in enumerate(facts) if fact.ask is not None)
        known = self._readings.get((id(machine), asked))
        if known is None:
            known = self._readings[id(machine), asked] = machine, Reading(machine, asked)
        return known[1]

    def _run_monitors(self) -> tuple[Decided, ...]:
        """Step those monitors that have something to read, and return what they decide."""
        decided = []
        todo = self._queue[:]
        self._queue.clear()
        for watch in todo:
            if watch not in self._watches:
                continue
            verdict = watch.step()
            if verdict is Truth.UNKNOWN:
                continue
            movers = self._watches[watch]
            decided.append(self._decide(watch, verdict))
            self._end(watch)
            if verdict is Truth.FALSE:
                self._failed.add(watch.rule)
                self._broken[watch] = movers
        return tuple(decided)

    def _decide(self, watch: Watch, verdict: Truth) -> Decided:
        movers = self._watches[watch]
        return Decided(
            self.rules[watch.rule].name, _binding(watch.template, movers), verdict, round(self._now.tick * self._now.dt, 9)
        )

    def _end(self, watch: Watch) -> None:
        watch.end()
        self._pending[watch.rule] -= 1
        for mover in self._watches.pop(watch):
            self._about.get(mover, {}).pop(watch, None)

    def _leave(self, gone: Sequence[Mover]) -> tuple[Decided, ...]:
        """Return what is decided because vehicles have vanished, and forget them as soon as nothing depends on them."""
        decided = []
        for mover in gone:
            for watch in list(self._about[mover]):
                absent = [m for m in self._watches[watch] if m.zone == ABSENT]
                if len(absent) == len(self._watches[watch]) or not watch.can_fail(self._board.bodily(absent)):
                    decided.append(self._decide(watch, Truth.UNKNOWN))
                    self._end(watch)
        for mover in [m for m, watches in self._about.items() if not watches and m.zone == ABSENT]:
            del self._about[mover]
            self._free.append(mover.slot)
            self._board.drop(mover)
            self._broken = {watch: movers for watch, movers in self._broken.items() if mover not in movers}
        return tuple(decided)

    def _colours(self, lights: ArrayLike | None) -> list[int]:
        entrances = len(self._junction.entrances)
        return [0] * entrances if lights is None else list(map(int, row_of("lights", lights, (entrances,))))


_SPARE = 4
"""Columns that stay free for a while after their vehicle has left, so that its past need not be worked out at once."""
_NOWHERE = (math.nan,) * 6
"""Station, speed, pose and spread of a vehicle that is not there."""
_WORST = (Truth.FALSE, Truth.UNKNOWN, Truth.TRUE)


def _binding(template: Template, movers: Sequence[Mover]) -> dict[str, str]:
    """Return the variables of an instance, and what they stand for."""

    def name(element: f.Element) -> str:
        return movers[element.index].agent.name if element.sort == Sort.AGENT else element_name(element)

    return {variable: name(element) for variable, element in template.binding}
