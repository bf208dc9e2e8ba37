"""Rules on a run while it is being produced: one state at a time, in constant memory.

Verdicts equal those of `check`, tick for tick, except UNSURE, which needs the whole run; so ``rvads check --follow`` judges the
runs of vehicles that have left. If vehicles come and go, instances about one or two vehicles are kept as long as a violation can
come. A rule about three vehicles at once needs the vehicles beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.live.board import Board, Instances
from pytest_rvads.logic.live.instant import OF_RUNS, Decided, Instant, Mover, Seen, State, row_of, sizes_of
from pytest_rvads.logic.live.watch import Fact, Reading, Watch
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.current import PACKAGE
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.telling.phrase import element_name
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Before, zones
from pytest_rvads.runs.run import DT, Facts
from pytest_rvads.runs.states import ABSENT, Agent
from pytest_rvads.support.errors import RunError

__all__ = ["RuleMonitor"]


class RuleMonitor:
    """Judges rules on a run while the run goes on: after every state the verdict says whether a rule can still be kept.

    Values that depend on earlier states (waiting times, stops, lost time, ways) are carried from state to state, so the cost of
    a state does not grow with the run. A user's predicate sees a single state, unless the predicate has a `follow`. `check`
    judges the end of a run, such as obligations that are still open.

    With `agents`, the same vehicles are present in all states, and `step` reads the states. Without `agents`, vehicles come and
    go, and `see` reads the states; an instance is about vehicles that are present at the same time.

    Args:
        rule: a rule, the name of a rule, a rulebook, or several of these; of a rulebook, the rules about this junction count.
        junction: the junction.
        agents: the vehicles, in the order of the columns that `step` takes; None for vehicles that come and go.
        dt: time between two states [s].
        speed_limit: speed limit on roads for which the map states no limit [m/s]; only some rules need the limit.
        vehicle_size: length and width of the vehicles [m]: a pair for all, or a pair per vehicle; only some rules need it.
        book: the rulebook in which names are looked up; by default the open book, with your registered rules.
        block: number of states that are judged together, which takes less time per state. A decision about a state is returned up
            to ``block - 1`` states later, 0.09 s for ten states of 0.01 s, with the time of its state. `see` also judges
            the waiting states when a vehicle comes or goes, and `flush` judges them at once.

    Raises:
        FormulaError: a rule is unknown, its monitor would be too large, or it is about three vehicles and `agents` is None.
        RunError: the rule is about another kind of junction, or `block` is no whole number from 1 on.
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
        for candidate in self.rules:
            if not candidate.concerns(junction):
                kinds = " or ".join(candidate.kinds) + (" and several lanes on an arm" if candidate.lanes else "")
                kinds += " and a lane that joins another one" if candidate.joining else ""
                raise RunError(f"{candidate.name} is about junctions with {kinds}, this one has {junction.control}")
        if not isinstance(block, int) or block < 1:
            raise RunError(f"block must be a whole number of states from 1 on, got {block!r:.20}")
        self._junction, self._block = junction, block
        self._states: list[State] = []
        self._seen: list[tuple[dict[str, Seen], list[int]]] = []
        self._agents = None if agents is None else tuple(agents)
        if vehicle_size is not None and self._agents is not None:
            sizes = sizes_of(vehicle_size, len(self._agents))
            self._agents = tuple(replace(a, size=size) for a, size in zip(self._agents, sizes, strict=True))
        self._size = None if vehicle_size is None or agents is not None else sizes_of(vehicle_size, 1)[0]
        self._now = Instant(junction, dt, Facts(speed_limit=speed_limit), _signals_of(self.rules))
        self._board = Board(self._now)
        self._queue: list[Watch] = []
        self._readings: dict[tuple[int, tuple[int, ...]], tuple[Machine, Reading]] = {}
        self._watches: dict[Watch, tuple[Mover, ...]] = {}
        self._pending = [0] * len(self.rules)
        """Number of watches per rule."""
        self._broken: dict[Watch, tuple[Mover, ...]] = {}
        self._failed: set[int] = set()
        self._instances: Instances | None = None
        self._present: dict[str, Mover] = {}
        self._about: dict[Mover, dict[Watch, None]] = {}
        self._free: list[int] = []
        self.not_judged: dict[str, str] = {}
        """Names of the rules that can't be judged, because a value that the rule needs is not given, with the reason."""

    @property
    def rule(self) -> Rule:
        """The rule, or the first of several rules."""
        return self.rules[0]

    @property
    def verdict(self) -> Truth:
        """``F`` if an instance is violated, ``T`` if no instance can be violated in any future, else ``?``."""
        return min(self.verdicts.values(), key=_WORST.index, default=Truth.UNKNOWN)

    @property
    def verdicts(self) -> dict[str, Truth]:
        """The verdict of every rule, by name; a verdict can be ``T`` only if `agents` were given."""
        begun = self._now.tick >= 0 and self._agents is not None
        return {
            rule.name: Truth.FALSE if k in self._failed else Truth.UNKNOWN if self._pending[k] or not begun else Truth.TRUE
            for k, rule in enumerate(self.rules)
            if rule.name not in self.not_judged
        }

    @property
    def violated(self) -> tuple[dict[str, str], ...]:
        """Values of the variables of every violated instance; without `agents`, only of instances about present vehicles."""
        return tuple(_binding(watch.template, movers) for watch, movers in self._broken.items())

    def violated_of(self, rule: str) -> tuple[dict[str, str], ...]:
        """Return the violated instances of the rule with a name, each as its variables and their values."""
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
            lights: `Colour` at every entrance, shape ``(entrances,)``; by default no entrance has a light.
            station: station of every agent along its itinerary, 0 at the entrance vertex, shape ``(agents,)`` [m].
            speed: forward speed of every agent, shape ``(agents,)`` [m/s].
            pose: x [m], y [m], heading [rad] of the reference points, shape ``(agents, 3)``.
            collisions: names of the pairs of vehicles that touch for the first time in this state; None computes the collisions
                from poses and sizes.

        Raises:
            RunError: an array has another shape, or an array that the rule needs is missing.
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
        return Truth.FALSE if self._failed else Truth.UNKNOWN if self._watches else self.verdict

    def see(self, vehicles: Iterable[Seen], lights: ArrayLike | None = None) -> tuple[Decided, ...]:
        """Read the vehicles that are present in one state, and return the instances that are decided, each instance once.

        A vehicle is present from the first state that holds the vehicle until a state without it. The zone of a vehicle follows
        from its stations: a border between two zones is crossed once, as in recordings. Decided instances are not stored.

        Args:
            vehicles: the present vehicles.
            lights: `Colour` at every entrance, shape ``(entrances,)``; by default no entrance has a light.

        Raises:
            RunError: two vehicles have the same name, the junction has no way of a vehicle, a number is not finite, or a value
                that the only rule needs is missing.
        """
        if self._agents is not None:
            raise RunError("see reads vehicles that come and go: call step, or make a RuleMonitor without agents")
        present = tuple(vehicles)
        seen = {vehicle.agent.name: vehicle for vehicle in present}
        colours = self._colours(lights)
        for vehicle in present:
            self._check_seen(vehicle, len(seen) == len(present))
        if self._instances is None:
            self._instances = Instances(self.rules, self._junction, colours)
        decided: tuple[Decided, ...] = ()
        if self._seen and seen.keys() != self._seen[0][0].keys():
            decided = self.flush()
        self._seen.append((seen, colours))
        return decided if len(self._seen) < self._block else (*decided, *self.flush())

    def flush(self) -> tuple[Decided, ...]:
        """Judge the states of an incomplete block, and return the decided instances as `see` does."""
        states, seen_states, self._states, self._seen = self._states, self._seen, [], []
        if self._agents is not None and states:
            self._judge(states)
        return self._judge_seen(seen_states) if seen_states else ()

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
        old = tuple(self._present.values())
        new = tuple(self._enter(vehicle.agent) for name, vehicle in seen.items() if name not in self._present)
        leaving = [self._present.pop(name) for name in self._present.keys() - seen.keys()]
        now.feed([State(*self._columns(vehicles), colours) for vehicles, colours in states])
        old = tuple(mover for mover in old if mover.zone != ABSENT)
        decided: list[Decided] = []
        for number in range(len(states)):
            now.go_on()
            self._board.read()
            if number == 0 and instances is not None:
                for place, mover in enumerate(new):
                    self._watch(instances.of(mover.agent.way.key), (mover,))
                    for neighbour in (*old, *new[:place]):
                        self._watch(instances.of(neighbour.agent.way.key, mover.agent.way.key), (neighbour, mover))
            decided += self._run_monitors()
            if number == 0:
                decided += self._leave(leaving)
        return tuple(decided)

    def _check_seen(self, vehicle: Seen, unique: bool) -> None:
        if not unique:
            raise RunError("two vehicles of a state have the same name: give each its own")
        if not all(map(math.isfinite, vehicle[1:])):
            raise RunError(f"vehicle {vehicle.agent.name!r}: what is seen must be finite numbers, got {tuple(vehicle[1:])!r:.80}")
        mover = self._present.get(vehicle.agent.name)
        if mover is None and vehicle.agent.way.key not in self._junction.every_way:
            raise RunError(f"vehicle {vehicle.agent.name!r}: the junction has no way {vehicle.agent.way.key}")

    def _enter(self, agent: Agent) -> Mover:
        """Return a new vehicle, in the column that has been free for the longest time."""
        now = self._now
        if self._size is not None and agent.size is None:
            agent = replace(agent, size=self._size)
        slot = self._free.pop(0) if len(self._free) > _SPARE else len(now.slots)
        mover = self._present[agent.name] = now.add(agent, slot)
        self._about[mover] = {}
        return mover

    def _columns(
        self, by_name: Mapping[str, Seen]
    ) -> tuple[list[int], list[float], list[float], list[tuple[float, float, float]]]:
        """Return zones, stations, speeds and poses by column."""
        slots = self._now.slots
        if not slots:
            return [], [], [], []
        vehicles = [by_name.get(mover.agent.name) if self._present.get(mover.agent.name) is mover else None for mover in slots]
        stations, speeds, *pose, spreads = zip(
            *(_NOWHERE if vehicle is None else vehicle[1:] for vehicle in vehicles), strict=True
        )
        borders = np.array([itinerary(self._junction, *mover.agent.way.key).borders for mover in slots])
        before = Before(*(np.array(values) for values in zip(*((m.zone, m.station, m.spread) for m in slots), strict=True)))
        zone = zones(borders, np.array([stations]), np.array([spreads]), before)[0].tolist()
        zone = [int(ABSENT) if vehicle is None else z for vehicle, z in zip(vehicles, zone, strict=True)]
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
        """Stop judging a rule that needs a value which is not given."""
        self.not_judged[self.rules[number].name] = reason
        for watch in [watch for watch in self._watches if watch.rule == number]:
            self._end(watch)

    def _reading(self, machine: Machine, facts: Sequence[Fact]) -> Reading:
        asked = tuple(k for k, fact in enumerate(facts) if fact.ask is not None)
        entry = self._readings.get((id(machine), asked))
        if entry is None:
            entry = self._readings[id(machine), asked] = machine, Reading(machine, asked)
        return entry[1]

    def _run_monitors(self) -> tuple[Decided, ...]:
        """Step the monitors whose letter may have changed, and return the decided instances."""
        decided = []
        queued = self._queue[:]
        self._queue.clear()
        for watch in queued:
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

    def _leave(self, leaving: Sequence[Mover]) -> tuple[Decided, ...]:
        """Return the instances that are decided because vehicles have left, and drop vehicles without undecided instances."""
        decided = []
        for mover in leaving:
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
        starts = len(self._junction.starts)
        return [0] * starts if lights is None else list(map(int, row_of("lights", lights, (starts,))))


_SPARE = 4
"""Number of columns that stay free after their vehicles have left, before a new vehicle takes the oldest free column."""
_NOWHERE = (math.nan,) * 6
"""Station, speed, pose and spread of a vehicle that is not there."""
_WORST = (Truth.FALSE, Truth.UNKNOWN, Truth.TRUE)


def _signals_of(rules: Sequence[Rule]) -> dict[Signal[Any], None]:
    """Return the signals of the words and attributes of rules; a user's word may read all that a run of one state offers."""
    atoms = dict.fromkeys(atom for rule in rules for atom in f.atoms(rule.formula))
    words = [word for word in map(word_of, atoms) if word is not None]
    attributes = [ATTRIBUTES[term.name].read for atom in atoms for term in atom.terms if isinstance(term, f.Attr)]
    offered = OF_RUNS if any(word.place != PACKAGE for word in words) else ()
    return dict.fromkeys((*offered, *attributes, *(word.holds for word in words if isinstance(word.holds, Signal))))


def _binding(template: Template, movers: Sequence[Mover]) -> dict[str, str]:
    """Return the variables of an instance, and what they stand for."""

    def name(element: f.Element) -> str:
        return movers[element.index].agent.name if element.sort == Sort.AGENT else element_name(element)

    return {variable: name(element) for variable, element in template.binding}
