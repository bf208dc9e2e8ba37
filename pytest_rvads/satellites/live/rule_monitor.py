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
from numpy.typing import ArrayLike, NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import element_name
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Before, zones
from pytest_rvads.runs.run import DT, Facts
from pytest_rvads.runs.states import ABSENT, Agent
from pytest_rvads.satellites.live.groups import Groups, Mover, Plan, Plans, Watched, plans
from pytest_rvads.satellites.live.instant import Decided, Seen, State, Stream, row_of, sizes_of
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
        """States that wait for the other states of their block."""
        self._agents = None if agents is None else tuple(agents)
        if vehicle_size is not None and self._agents is not None:
            sizes = sizes_of(vehicle_size, len(self._agents))
            self._agents = tuple(replace(a, size=size) for a, size in zip(self._agents, sizes, strict=True))
        self._size = None if vehicle_size is None or agents is not None else sizes_of(vehicle_size, 1)[0]
        atoms = dict.fromkeys(atom for rule in self.rules for atom in f.atoms(rule.formula))
        words = [word for word in map(word_of, atoms) if word is not None]
        attributes = [ATTRIBUTES[term.name].read for atom in atoms for term in atom.terms if isinstance(term, f.Attr)]
        self._signals = tuple(dict.fromkeys((*attributes, *(word.holds for word in words if isinstance(word.holds, Signal)))))
        self._stream = Stream(junction, dt, Facts(speed_limit=speed_limit))
        self._groups = Groups()
        self._plans: Plans | None = None
        self._columns = [Mover(agent, column) for column, agent in enumerate(self._agents or ())]
        """The vehicles by column. A vehicle keeps its column until all its instances are decided and another vehicle comes."""
        self._borders = np.empty((0, 4))
        """The borders of the zones of every vehicle, by column."""
        self._present: dict[str, Mover] = {}
        self._new: list[Mover] = []
        """The vehicles that have come in the state that waits, and those that have left in it."""
        self._leaving: list[Mover] = []
        if self._agents is not None:
            self._stream.recast(self._agents, [None] * len(self._agents))
        self._broken: list[Watched] = []
        self._failed: set[str] = set()
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
        begun = self._stream.tick > 0 and self._agents is not None
        open_rules = {watched.plan.rule.name for watched in self._groups} if begun else {rule.name for rule in self.rules}
        return {
            name: Truth.FALSE if name in self._failed else Truth.UNKNOWN if name in open_rules else Truth.TRUE
            for name in (rule.name for rule in self.rules)
            if name not in self.not_judged
        }

    @property
    def violated(self) -> tuple[dict[str, str], ...]:
        """Per violation, the variables of the rule with the names of the vehicles and entrances that they stand for.

        Without `agents`, violations by vehicles that have left are not included.
        """
        return tuple(map(_binding, self._broken))

    def violated_of(self, rule: str) -> tuple[dict[str, str], ...]:
        """Return, for each violation of a rule, the variables of the rule and the vehicles and entrances that they stand for."""
        return tuple(_binding(watched) for watched in self._broken if watched.plan.rule.name == rule)

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
        touching = None if collisions is None else frozenset(frozenset(pair) for pair in collisions)
        state = State(
            row_of("zone", zone, (count,)),
            self._colours(lights),
            None if station is None else row_of("station", station, (count,)),
            None if speed is None else row_of("speed", speed, (count,)),
            None if pose is None else row_of("pose", pose, (count, 3)),
            touching,
        )
        if self._states and state.given != self._states[0].given:
            self.flush()
        self._states.append(state)
        if len(self._states) >= self._block:
            self.flush()
        return Truth.FALSE if self._failed else Truth.UNKNOWN if any(True for _ in self._groups) else self.verdict

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
        if self._plans is None:
            self._plans = Plans(self.rules, self._junction, self._stream.dt, colours)
        decided: tuple[Decided, ...] = ()
        if seen.keys() != self._present.keys():
            decided = self.flush()
            self._replace(seen)
        self._states.append(self._state(seen, colours))
        return decided if len(self._states) < self._block else (*decided, *self.flush())

    def flush(self) -> tuple[Decided, ...]:
        """Judge the states of an incomplete block, and return the final verdicts of the instances that these states decide.

        A monitor with `agents` returns no verdicts here; its property `verdicts` shows them.
        """
        states, self._states = self._states, []
        if not states:
            return ()
        decided: list[Decided] = []
        block = self._stream.read(self._signals, states)
        for row in range(len(states)):
            self._groups.begin(block, row)
            new, leaving, self._new, self._leaving = self._new, self._leaving, [], []
            self._begin(new)
            for watched, verdict in self._groups.read():
                decided.append(self._decided(watched, verdict))
                if verdict is Truth.FALSE:
                    self._failed.add(watched.plan.rule.name)
                    self._broken.append(watched)
            if leaving:  # some verdicts are final because vehicles have left
                ended = self._groups.end(leaving, list(self._present.values()))
                decided += [self._decided(watched, Truth.UNKNOWN) for watched in ended]
                self._broken = [watched for watched in self._broken if not any(m in leaving for m in watched.movers)]
        return tuple(decided) if self._agents is None else ()

    def _begin(self, new: Sequence[Mover]) -> None:
        """Let the groups read the instances about the vehicles that have come in the present state."""
        if self._agents is not None and self._groups.tick == 0:
            static = extract(self._groups.run)
            for rule in self.rules:
                self._watch(plans(rule, static, self._stream.dt), tuple(self._columns))
        present = list(self._present.values())
        for number, mover in enumerate(present):
            if self._plans is not None and mover in new:
                self._watch(self._plans.of(mover), (mover,))
                for neighbour in present[:number]:
                    self._watch(self._plans.of(neighbour, mover), (neighbour, mover))

    def _replace(self, seen: Mapping[str, Seen]) -> None:
        """Give every vehicle that has come a column, new or free since a vehicle left and all about that vehicle was decided."""
        self._leaving = [self._present.pop(name) for name in list(self._present) if name not in seen]
        used = {*self._present.values(), *(mover for watched in self._groups for mover in watched.movers)}
        free = [mover.column for mover in self._columns if mover not in used]
        self._groups.forget(used)
        for name in [name for name in seen if name not in self._present]:
            agent = seen[name].agent
            if self._size is not None and agent.size is None:
                agent = replace(agent, size=self._size)
            column = free.pop(0) if free else len(self._columns)
            mover = self._present[name] = Mover(agent, column)
            self._columns[column : column + 1] = [mover]
            self._new.append(mover)
        if self._new:
            columns = [None if mover in self._new else mover.column for mover in self._columns]
            self._stream.recast([mover.agent for mover in self._columns], columns)
            self._borders = np.array([itinerary(self._junction, *mover.agent.way.key).borders for mover in self._columns])

    def _state(self, seen: Mapping[str, Seen], colours: NDArray[np.float64]) -> State:
        """Return the next state of vehicles that come and go, with the zones that follow from their stations."""
        names = [mover.agent.name if self._present.get(mover.agent.name) is mover else None for mover in self._columns]
        values = np.array([_NOWHERE if name is None else seen[name][1:] for name in names]).reshape(-1, len(_NOWHERE))
        station, speed, pose, spread = values[:, 0], values[:, 1], values[:, 2:5], values[:, 5]
        before = Before(*np.array([mover.last for mover in self._columns]).reshape(-1, 3).T)
        zone = zones(self._borders, station[None], spread[None], before)[0]
        zone[np.isnan(station)] = ABSENT
        for mover, *last in zip(self._columns, zone.tolist(), station.tolist(), spread.tolist(), strict=True):
            mover.last = tuple(last)
        return State(zone, colours, station, speed, pose)

    def _watch(self, instances: Iterable[Plan], movers: tuple[Mover, ...]) -> None:
        for plan in instances:
            rule = plan.rule
            if rule.name in self.not_judged:
                continue
            try:
                self._groups.add(plan, movers)
            except RunError as error:
                if len(self.rules) == 1:
                    raise
                # The rule is not judged any more, because it needs a value that is not given.
                self.not_judged[rule.name] = str(error)
                self._groups.drop(rule)

    def _decided(self, watched: Watched, verdict: Truth) -> Decided:
        return Decided(watched.plan.rule.name, _binding(watched), verdict, round(self._groups.tick * self._stream.dt, 9))

    def _colours(self, lights: ArrayLike | None) -> NDArray[np.float64]:
        starts = len(self._junction.starts)
        return np.zeros(starts) if lights is None else row_of("lights", lights, (starts,))


_NOWHERE = (math.nan,) * 6
"""Station, speed, pose and spread of an absent vehicle."""
_WORST = (Truth.FALSE, Truth.UNKNOWN, Truth.TRUE)


def _binding(watched: Watched) -> dict[str, str]:
    """Return the variables of an instance, and the names of the vehicles and places that the variables stand for."""

    def name(element: f.Element) -> str:
        return watched.movers[element.index].agent.name if element.sort == Sort.AGENT else element_name(element)

    return {variable: name(element) for variable, element in watched.plan.template.binding}
