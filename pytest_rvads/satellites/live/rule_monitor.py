"""Judges rules on a run while the run is being produced, one state at a time, in constant memory.

The verdicts equal the verdicts of `check`, tick for tick. Only UNSURE needs the whole run; therefore ``rvads check --follow``
judges the runs of vehicles that have left by `check`. If vehicles come and go, a rule for one or two certain vehicles is
monitored as long as these vehicles can violate the rule. A rule about three vehicles at once needs to be given the vehicles
before the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.judging.instances import Template, prepare
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.current import PACKAGE
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import element_name
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Before, zones
from pytest_rvads.runs.run import DT, Facts
from pytest_rvads.runs.states import ABSENT, Agent
from pytest_rvads.satellites.live.board import Board, Instances
from pytest_rvads.satellites.live.instant import OF_RUNS, Decided, Instant, Mover, Seen, State, row_of, sizes_of
from pytest_rvads.satellites.live.watch import Reading, Watch
from pytest_rvads.support.errors import RunError


class RuleMonitor:
    """Judges rules on a run while the run goes on: after every state the verdict says whether a rule can still be kept.

    Values that depend on earlier states (waiting times, stops, lost time, who owes the way) are carried from state to state.
    Therefore the cost of a state does not grow with the run. A user's predicate sees a single state, unless the predicate was
    registered with ``follow=``, see `predicate`. Only `check` judges the end of a run, such as obligations that are still open.

    With `agents`, the same vehicles are present in all states, and `step` reads the states. Without `agents`, vehicles come and
    go, and `see` reads the states; rules are judged for vehicles that are present at the same time.

    Args:
        rule: a rule, the name of a rule or rulebook, or several of these. Of a rulebook, only the rules about this junction are
            judged.
        junction: the junction.
        agents: the vehicles, in the order of the columns that `step` takes; None for vehicles that come and go.
        dt: time between two states [s].
        speed_limit: speed limit on roads for which the map states no limit [m/s]; only some rules need the limit.
        vehicle_size: length and width of the vehicles [m]: a pair for all, or a pair per vehicle; only some rules need sizes.
        book: the book in which names of rules are looked up; by default the open book, with your registered rules, see `rule`.
        block: number of states that are judged together; a larger number takes less time per state. A decision about a state is
            returned up to ``block - 1`` states later (0.09 s for ten states of 0.01 s), with the time of the state. When a
            vehicle comes or goes, `see` judges all states of an incomplete block. `flush` judges these states at any time.

    Raises:
        FormulaError: a rule is unknown, its monitor would be too large, or it is about three vehicles and `agents` is None.
        RunError: the rule is about another kind of junction, or `block` is no whole number from 1 on.
    """

    def __init__(
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
                kinds += f" and {candidate.crosswalks}" if candidate.crosswalks else ""
                raise RunError(f"{candidate.name} is about junctions with {kinds}, and this junction has {junction.control}")
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
        atoms = dict.fromkeys(atom for rule in self.rules for atom in f.atoms(rule.formula))
        words = [word for word in map(word_of, atoms) if word is not None]
        attributes = [ATTRIBUTES[term.name].read for atom in atoms for term in atom.terms if isinstance(term, f.Attr)]
        # A user's predicate can read all signals of `OF_RUNS` from its run.
        offered = OF_RUNS if any(word.place != PACKAGE for word in words) else ()
        signals = (*offered, *attributes, *(word.holds for word in words if isinstance(word.holds, Signal)))
        self._now = Instant(junction, dt, Facts(speed_limit=speed_limit), dict.fromkeys(signals))
        self._board = Board(self._now)
        self._queue: list[Watch] = []
        self._readings: dict[tuple[int, tuple[int, ...]], tuple[Machine, Reading]] = {}
        self._watches: dict[Watch, tuple[Mover, ...]] = {}
        self._pending = [0] * len(self.rules)
        """Per rule, the number of its watches: monitors of instances without a final verdict."""
        self._broken: dict[Watch, tuple[Mover, ...]] = {}
        self._failed: set[int] = set()
        self._instances: Instances | None = None
        self._present: dict[str, Mover] = {}
        self._about: dict[Mover, dict[Watch, None]] = {}
        self._free: list[int] = []
        self.not_judged: dict[str, str] = {}
        """Maps the name of a rule that can't be judged, because a value that the rule needs is not given, to the reason."""

    @property
    def rule(self) -> Rule:
        """The rule of the monitor, or the first of its rules."""
        return self.rules[0]

    @property
    def verdict(self) -> Truth:
        """``F`` if a rule is violated for some vehicles, ``T`` if no continuation violates any rule, ``?`` in all other cases."""
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
        """Per violation, the variables of the rule with the names of the vehicles and entrances that they stand for.

        Without `agents`, violations by vehicles that have left are not included.
        """
        return tuple(_binding(watch.template, movers) for watch, movers in self._broken.items())

    def violated_of(self, rule: str) -> tuple[dict[str, str], ...]:
        """Return, for each violation of a rule, the variables of the rule and the vehicles and entrances that they stand for."""
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
        """Read the next state of the run and return the verdict so far.

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
        """Read the vehicles that are present in the next state, and return the final verdicts of instances decided by this state.

        A vehicle is present from the first state in which it is given until the first state in which it is missing. The zone of a
        vehicle follows from its stations: a vehicle crosses a border between two zones only once, as in recordings. The monitor
        does not store decided instances.

        Args:
            vehicles: the present vehicles.
            lights: `Colour` at every entrance, shape ``(entrances,)``; by default no entrance has a light.

        Raises:
            RunError: two vehicles have the same name, the way of a vehicle is not in the junction, a number is not finite, or the
                monitor has a single rule and a value that this rule needs is missing.
        """
        if self._agents is not None:
            raise RunError("see reads vehicles that come and go: call step, or make a RuleMonitor without agents")
        present = tuple(vehicles)
        seen = {vehicle.agent.name: vehicle for vehicle in present}
        colours = self._colours(lights)
        if len(seen) < len(present):
            raise RunError("two vehicles of a state have the same name: give each its own")
        for vehicle in present:
            name, way, values = vehicle.agent.name, vehicle.agent.way.key, tuple(vehicle[1:])
            if not all(map(math.isfinite, values)):
                raise RunError(f"vehicle {name!r}: what is seen must be finite numbers, got {values!r:.80}")
            if name not in self._present and way not in self._junction.every_way:
                raise RunError(f"vehicle {name!r}: the junction has no way {way}")
        if self._instances is None:
            self._instances = Instances(self.rules, self._junction, colours)
        decided: tuple[Decided, ...] = ()
        if self._seen and seen.keys() != self._seen[0][0].keys():
            decided = self.flush()
        self._seen.append((seen, colours))
        return decided if len(self._seen) < self._block else (*decided, *self.flush())

    def flush(self) -> tuple[Decided, ...]:
        """Judge the states of an incomplete block, and return the final verdicts of the instances that these states decide.

        A monitor with `agents` returns no verdicts here; its property `verdicts` shows them.
        """
        states, seen_states, self._states, self._seen = self._states, self._seen, [], []
        if self._agents is None or not states:
            return self._judge_seen(seen_states, self._instances) if seen_states and self._instances else ()
        now, first = self._now, self._now.tick < 0
        if first:
            for slot, agent in enumerate(self._agents):
                now.add(agent, slot)
        now.feed(states)
        for number in range(len(states)):
            now.go_on()
            if first and number == 0:
                static = extract(now.run)
                for rule_number, rule in enumerate(self.rules):
                    templates = prepare(rule.formula, static, rule.bound).templates
                    self._watch([(rule_number, template) for template in templates], tuple(now.slots))
            else:
                self._board.read()
            self._run_monitors()
        return ()

    def _judge_seen(self, states: Sequence[tuple[dict[str, Seen], list[int]]], instances: Instances) -> tuple[Decided, ...]:
        """Judge the next states, all with the same vehicles, and return the final verdicts of the instances that they decide."""
        now, seen = self._now, states[0][0]
        old = tuple(self._present.values())
        new: list[Mover] = []
        for vehicle in [vehicle for name, vehicle in seen.items() if name not in self._present]:
            agent = vehicle.agent
            if self._size is not None and agent.size is None:
                agent = replace(agent, size=self._size)
            # A vehicle gets a new column, or the column that has been free for longest.
            slot = self._free.pop(0) if len(self._free) > _SPARE else len(now.slots)
            new.append(now.add(agent, slot))
            self._present[agent.name], self._about[new[-1]] = new[-1], {}
        leaving = [self._present.pop(name) for name in self._present.keys() - seen.keys()]
        now.feed([State(*self._columns(vehicles), colours) for vehicles, colours in states])
        old = tuple(mover for mover in old if mover.zone != ABSENT)
        decided: list[Decided] = []
        for number in range(len(states)):
            now.go_on()
            self._board.read()
            if number:
                decided += self._run_monitors()
                continue
            for place, mover in enumerate(new):
                self._watch(instances.of(mover.agent.way.key), (mover,))
                for neighbour in (*old, *new[:place]):
                    self._watch(instances.of(neighbour.agent.way.key, mover.agent.way.key), (neighbour, mover))
            decided += self._run_monitors()
            # Some verdicts are final because vehicles have left.
            for mover in leaving:
                for watch in list(self._about[mover]):
                    absent = [m for m in self._watches[watch] if m.zone == ABSENT]
                    if len(absent) == len(self._watches[watch]) or not watch.can_fail(self._board.bodily(absent)):
                        decided.append(self._end(watch, Truth.UNKNOWN))
            for mover in [m for m, watches in self._about.items() if not watches and m.zone == ABSENT]:
                del self._about[mover]
                self._free.append(mover.slot)
                self._board.drop(mover)
                self._broken = {watch: movers for watch, movers in self._broken.items() if mover not in movers}
        return tuple(decided)

    def _columns(
        self, by_name: Mapping[str, Seen]
    ) -> tuple[list[int], list[float], list[float], list[tuple[float, float, float]]]:
        """Return the zones, stations, speeds and poses of the present vehicles, by column."""
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

    def _watch(self, templates: Sequence[tuple[int, Template]], movers: tuple[Mover, ...]) -> None:
        for number, template in templates:
            rule = self.rules[number]
            if rule.name in self.not_judged:
                continue
            try:
                facts = [self._board.fact(atom, movers, rule.tie) for atom in template.atoms]
            except RunError as error:
                if len(self.rules) == 1:
                    raise
                # The rule is not judged any more, because it needs a value that is not given.
                self.not_judged[rule.name] = str(error)
                for watch in [watch for watch in self._watches if watch.rule == number]:
                    self._end(watch, Truth.UNKNOWN)
                continue
            asked = tuple(k for k, fact in enumerate(facts) if fact.ask is not None)
            key = id(template.machine), asked
            if key not in self._readings:
                self._readings[key] = template.machine, Reading(template.machine, asked)
            watch = Watch(number, template, self._readings[key][1], facts, self._queue)
            self._watches[watch] = movers
            self._pending[number] += 1
            if self._agents is None:
                for mover in movers:
                    self._about[mover][watch] = None

    def _run_monitors(self) -> tuple[Decided, ...]:
        """Let the monitors in the queue read the present state, and return the final verdicts of instances."""
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
            decided.append(self._end(watch, verdict))
            if verdict is Truth.FALSE:
                self._failed.add(watch.rule)
                self._broken[watch] = movers
        return tuple(decided)

    def _end(self, watch: Watch, verdict: Truth) -> Decided:
        movers = self._watches.pop(watch)
        watch.end()
        self._pending[watch.rule] -= 1
        for mover in movers:
            self._about.get(mover, {}).pop(watch, None)
        time = round(self._now.tick * self._now.dt, 9)
        return Decided(self.rules[watch.rule].name, _binding(watch.template, movers), verdict, time)

    def _colours(self, lights: ArrayLike | None) -> list[int]:
        starts = len(self._junction.starts)
        return [0] * starts if lights is None else list(map(int, row_of("lights", lights, (starts,))))


_SPARE = 4
"""Number of columns that stay free after their vehicles have left, before a new vehicle takes the oldest free column."""
_NOWHERE = (math.nan,) * 6
"""Station, speed, pose and spread of an absent vehicle."""
_WORST = (Truth.FALSE, Truth.UNKNOWN, Truth.TRUE)


def _binding(template: Template, movers: Sequence[Mover]) -> dict[str, str]:
    """Return the variables of an instance, and the names of the vehicles and places that the variables stand for."""

    def name(element: f.Element) -> str:
        return movers[element.index].agent.name if element.sort == Sort.AGENT else element_name(element)

    return {variable: name(element) for variable, element in template.binding}
