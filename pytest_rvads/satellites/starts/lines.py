"""Lines of starts: scenarios of two vehicles whose ways conflict, ordered by which vehicle is ahead and by how much.

A `Trial` simulates and judges starts of a line, each start once.

A start on a line is given by its lead: the time by which the subject (the vehicle under test) would reach its stopping line
before the other vehicle, if both kept their speeds. If the two vehicles have green at different times, the lead is the time by
which the subject would reach its line before its light turns yellow; the other vehicle then waits at its own red light.

On a line from rest, the subject stands at its stopping line at the start, and the other vehicle comes. If the two vehicles have
green at different times, the other vehicle has green, and the subject waits at its own red light. On a line on red, the subject
comes to its red light on the move and turns to the near side (right, where traffic keeps right), and the other vehicle has green.

On a line with a pedestrian, the subject is the only vehicle, and its way leads over the crosswalk of the pedestrian. The lead is
the arrival of the pedestrian at the way of the subject minus the arrival of the subject at the way of the pedestrian, if nobody
reacts (`Pedestrian.difference`). The subject starts alike at all starts of such a line.

Two starts on a line differ only in the distances of the vehicles; from rest, a near vehicle is slower as well. By Li et al.
(arXiv 2405.16914), a driver that passes the test at the start where waiting turns into going has to pass at every start farther
away from this start.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.drivers.walking import behaviour
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import Crossing, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import arrival_differences
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import CLEARANCE, GREEN_TIME, SLOT, YELLOW_TIME
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.classes import Directions, Orbits, pairs_at, rotate
from pytest_rvads.scenarios.configurations import fastest_start
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.scenarios.pedestrians import Pedestrian, cast_of, least
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import Choice, Simulator, simulate
from pytest_rvads.support.errors import RunError, ScenarioError

LONGEST = 12.0
"""Greatest lead of either vehicle [s]."""
STEP = 0.01
"""Time between two neighbouring starts of a line [s]; 0.08 m at `_SPEED`."""
_SPEED, _NEAREST = 8.0, 20.0
"""Speed of a start [m/s], and the least distance to the stopping line at that speed [m]; v(d)max is 12 m/s there."""
_SHORTEST = _NEAREST / _SPEED
"""Least time of a vehicle to its stopping line [s]. On a shorter approach, a vehicle is slower."""
_BEFORE_YELLOW = 6.0
"""Time from the start until the light of the subject turns yellow [s]."""
CHANGED = _BEFORE_YELLOW + YELLOW_TIME + CLEARANCE
"""Time from the start until the phase after that of the subject begins [s]; the other vehicle has no green before."""
_AT_RED = 0.3
"""Distance of a vehicle that waits at a red light to its stopping line [m]."""
_AT_LINE = 0.01
"""Distance of a subject at rest to its stopping line [m], as in the configurations A and F of Li et al."""
_WAITING = frozenset({Sign.STOP, Sign.YIELD, Sign.LIGHTS})
"""Signs at which a vehicle may have to wait."""
_TIMID = frozenset({"progress"})
"""Rules that a driver breaks by waiting."""
_MANNERS = frozenset({"full_stop", "keep_lane", "on_lane_allowed", "on_route", "speed_limit"})
"""Rules about the subject alone."""
Outcomes = tuple[tuple[str, Outcome], ...]


class Begin(StrEnum):
    """What the subject of a line of starts does at the beginning of a run."""

    MOVING = "moving"
    """The subject comes to its stopping line, and its light, if any, is green."""
    REST = "rest"
    """The subject stands at its stopping line."""
    RED = "red"
    """The subject comes to its red light, where it may turn, while the other vehicle has green."""


_LABELS = {Begin.MOVING: "", Begin.REST: " from rest", Begin.RED: " on red"}


@dataclass(frozen=True, slots=True)
class Line:
    """A line of starts: scenarios of a subject (the vehicle under test) and another vehicle or pedestrian whose ways conflict."""

    place: Junction
    """The junction; on a line with a pedestrian, a walked junction, see `Junction.walked`."""
    directions: Directions
    """Direction per entrance; two entrances have a vehicle, or only that of the subject on a line with a pedestrian."""
    seat: int
    """Entrance of the subject."""
    begin: Begin = Begin.MOVING
    walker: Pedestrian | None = None
    """The pedestrian, without a difference of arrivals; None on a line with another vehicle."""

    @property
    def ways(self) -> tuple[Key, Key]:
        """The ways of the subject and of the other vehicle or pedestrian, each as the numbers of its start and its end."""
        keys = {e: self.place.leads(e, direction).key for e, direction in enumerate(self.directions) if direction}
        subject = keys.pop(self.seat)
        if self.walker:
            return subject, cast_of(self.place, [self.walker])[0].way.key
        (other,) = keys.values()
        return subject, other

    @property
    def by_light(self) -> bool:
        """Whether the two vehicles have green at different times."""
        if self.walker:
            return False
        first, second = (self.place.entrances[way[0]] for way in self.ways)
        return first.sign is second.sign is Sign.LIGHTS and first.phase != second.phase

    @property
    def by_yellow(self) -> bool:
        """Whether the lead is the time by which a moving subject would reach its line before its light turns yellow."""
        return self.by_light and self.begin is Begin.MOVING

    @property
    def vista(self) -> str:
        """The rule of priority that decides between the two, in words."""
        subject, other = self.ways
        signs = {self.place.starts[way[0]].sign for way in (subject, other)}
        if signs == {Sign.STOP}:
            return "all-way stop"
        if self.by_light:
            return "turn on red" if self.begin is Begin.RED else "end of green"
        yields = self.place.yields or {}
        if (subject, other) in yields:
            return "subject gives way"
        return "other vehicle gives way" if (other, subject) in yields else "nobody has priority"

    def reach(self, longest: float = LONGEST) -> tuple[int, int]:
        """Return the least and the greatest lead, up to `longest` [s], for which both vehicles have room [steps of `STEP`].

        A pedestrian has room if the pedestrian has not crossed when the run begins (`Setting.crossed`).
        """
        if self.walker:
            most = math.floor(longest / STEP)
            crossed = max(self._started(LONGEST).walkers()[0].crossed, -longest - STEP)
            return max(math.floor(crossed / STEP + 1e-6) + 1, -most), most
        subject, other = (way[0] for way in self.ways)
        room, other_room = (self._room(entrance) / self._speed(entrance) for entrance in (subject, other))  # [s]
        if self.begin is Begin.REST:
            low, high = 0.0, other_room
        elif self.by_yellow:
            low, high = _BEFORE_YELLOW - room, _BEFORE_YELLOW - _SHORTEST
        else:
            low, high = _SHORTEST - room, other_room - _SHORTEST
        return math.ceil(max(low, -longest) / STEP), math.floor(min(high, longest) / STEP)

    def scenario(self, lead: int) -> Scenario:
        """Return the scenario of the line with a lead in steps of `STEP`; the lead is positive if the subject is early."""
        scenario = self._started(lead * STEP)
        if self.walker:
            scenario.walkers()  # an error if the pedestrian has crossed when the run begins
        else:
            scenario.starts()  # an error if a vehicle has no room
        return scenario

    def _started(self, seconds: float) -> Scenario:
        """Return the scenario of the line whose lead is `seconds`, whether there is room for its agents or not."""
        subject, other = (way[0] for way in self.ways)
        count = len(self.directions)
        distances, speeds = [_NEAREST] * count, [0.0] * count
        times = {}
        if self.begin is Begin.REST:
            distances[subject] = _AT_LINE
            if not self.walker:
                times[other] = seconds
        elif self.walker:
            times[subject] = _SHORTEST
        elif self.by_yellow:
            times[subject] = _BEFORE_YELLOW - seconds
            distances[other] = _AT_RED
        else:
            early = max(_SHORTEST, _SHORTEST - seconds)
            times = {subject: early, other: early + seconds}
        for entrance, time in times.items():
            # A vehicle that is nearer than `_SHORTEST` is slower in proportion, so that the same braking stops it at its line.
            speeds[entrance] = round(self._speed(entrance) * min(time / _SHORTEST, 1.0), 2)
            distances[entrance] = max(round(speeds[entrance] * time, 2), _AT_LINE)
        # The vehicle that moves first has green.
        mover = subject if self.begin is Begin.MOVING or self.walker else other
        turn = next((turn for turn, group in enumerate(self.place.phase_groups) if mover in group), None)
        passed = GREEN_TIME - _BEFORE_YELLOW if self.by_light else 0.0
        return Scenario(
            self.place,
            self.directions,
            distance=distances,
            speed=speeds,
            subject=self.seat,
            elapsed=0 if turn is None else round(turn * SLOT + passed),
            pedestrians=[replace(self.walker, difference=seconds)] if self.walker else [],
        )

    def _speed(self, entrance: int) -> float:
        """Return the speed of a vehicle at its start [m/s], rounded down to 0.1 m/s."""
        room = self._room(entrance)
        allowed = fastest_start(self.place, entrance, min(room, LONGEST * _SPEED + _NEAREST))
        return max(int(10 * min(_SPEED, allowed, min(room, _NEAREST) / _SHORTEST)) / 10, 0.1)

    def _room(self, entrance: int) -> float:
        """Return the greatest distance to its stopping line at which a vehicle can start [m]; 0.01 m are left for rounding."""
        return self.place.approach(entrance) - 0.01

    @property
    def id(self) -> str:
        """The name of the line in ids of tests: junction, seat, and both ways, such as ``stop4-s0-0to2-meets-1to3-rest``.

        On a line with a pedestrian, ``zebra4-s0-0to2-meets-0n.steady`` names crosswalk, side and behaviour.
        """
        ways = "-meets-".join(self.named("to"))
        return f"{self.place.name}-s{self.seat}-{ways}{'' if self.begin is Begin.MOVING else f'-{self.begin}'}"

    @property
    def labels(self) -> tuple[str, str]:
        """The ways of the subject and of the other vehicle in words, such as ``0->2 from rest`` and ``1->3``."""
        subject, other = self.named()
        return f"{subject}{_LABELS[self.begin]}", other

    def named(self, arrow: str = "->") -> tuple[str, str]:
        """Return the two ways, such as ``0->2`` and ``1->3``; a pedestrian as in ids, ``0n.steady``."""
        subject, other = (arrow.join(map(str, way)) for way in self.ways)
        return subject, self.walker.course if self.walker else other

    def __str__(self) -> str:
        return f"{self.place.name}: {' meets '.join(self.labels)}"


def lines_at(place: Junction, seats: Iterable[int] | None = None, behaviours: Sequence[str] = ()) -> tuple[tuple[Line, ...], ...]:
    """Return the lines of starts of every pair of conflicting ways, with either vehicle as the subject (vehicle under test).

    If the subject may have to wait at its stopping line, the pair of ways has a second line, from rest. If the subject may turn
    on red in front of the other vehicle, the pair has a third line, on red. The lines leave out ways on which no car can keep its
    lane (`Junction.tight`).
    """
    count = len(place.entrances)
    chosen = tuple(range(count)) if seats is None else tuple(seats)
    for seat in chosen:
        if seat not in range(count):
            raise ScenarioError(f"a seat of {place.name!r} is one of its entrances, 0 to {count - 1}, got {seat!r}")
    groups: dict[tuple[object, ...], list[Line]] = {}
    for line in _walked_lines(place.walked, behaviours) if behaviours else _every_line(place):
        if line.seat not in chosen:
            continue
        # The least image under the rotations of the junction, which is equal for lines that differ by a rotation.
        if line.walker:
            image: tuple[object, ...] = (
                least(line.place, line.directions, line.seat, line.walker.crossing),
                line.walker.side,
                line.walker.behaviour,
            )
        else:
            rows = Orbits.at(line.place).rows
            image = min((rotate(line.directions, row), (line.seat + row) % count) for row in rows)
        groups.setdefault((*image, line.begin), []).append(line)
    if not groups and behaviours:
        raise ScenarioError(
            f"no way of junction {place.name!r} from seats {list(chosen)} gives way to pedestrians: choose a junction with "
            "crosswalks"
        )
    if not groups:
        raise ScenarioError(f"no two ways of junction {place.name!r} from seats {list(chosen)} conflict: choose another junction")
    return tuple(map(tuple, groups.values()))


def _every_line(place: Junction) -> Iterator[Line]:
    directions = {movement.key: direction for (_, direction), movement in place.by_direction.items()}
    for pair in pairs_at(place, conflicting=True):
        if not set(pair) & set(place.tight):
            code = [0] * len(place.entrances)
            for key in pair:
                code[key[0]] = directions[key]
            for seat, _ in pair:
                line = Line(place, tuple(code), seat)
                yield line
                if place.entrances[seat].sign in _WAITING or line.vista == "subject gives way":
                    yield replace(line, begin=Begin.REST)
                if line.by_light and place.turns_on_red(seat, place.movements[line.ways[0]].turn):
                    yield replace(line, begin=Begin.RED)


def _walked_lines(place: Junction, behaviours: Sequence[str]) -> Iterator[Line]:
    directions = {movement.key: direction for (_, direction), movement in place.by_direction.items()}
    for subject, other in sorted(place.yields or ()):
        crossing = place.every_way[other]
        if isinstance(crossing, Crossing) and subject in directions and subject not in place.tight:
            code = tuple(directions[subject] if entrance == subject[0] else 0 for entrance in range(len(place.entrances)))
            for name in dict.fromkeys(behaviours):
                if crossing.side is Side.NEAR or not behaviour(name).parked:
                    walker = Pedestrian(crossing.crosswalk, crossing.side, name)
                    yield from (Line(place, code, subject[0], begin, walker) for begin in (Begin.MOVING, Begin.REST))


class Fault(StrEnum):
    """The kinds of failures of a driver at a start."""

    BOLD = "too bold"
    """The subject breaks a rule about other vehicles: it collides, gets in the way, or takes another vehicle's turn."""
    TIMID = "too timid"
    """The subject could go and does not."""
    MANNERS = "wrong by itself"
    """The subject breaks a rule about itself: full stop, lane, route, speed."""
    IRRATIONAL = "irrational"
    """The subject keeps a rule about other vehicles at a start, and breaks the rule at a less critical start."""


class Start(NamedTuple):
    """A start that was simulated and judged."""

    lead: int
    """Lead of the start [steps of `STEP`]."""
    goes: bool
    """Whether the subject entered the junction before the other vehicle, or came to the way of the pedestrian first."""
    outcomes: Outcomes
    difference: float | None = None
    """Arrival of the other vehicle minus that of the subject [s]; None if they did not meet, or no rule required anything."""

    def failed(self) -> list[tuple[str, Outcome]]:
        """Return the failed rules with their outcomes, the rules that matter most first."""
        return sorted([pair for pair in self.outcomes if pair[1].bad], key=lambda pair: (rank(pair[0]), pair[1].severity))


@dataclass(frozen=True, slots=True)
class Setting:
    """The driver, traffic, rules, vehicles and simulator that all starts have in common."""

    driver: Factory
    rules: tuple[Rule, ...]
    traffic: Policy | None
    """Drives the other vehicle; None if the driver drives both vehicles."""
    fleet: Fleet
    simulator: Choice

    @classmethod
    def of(
        cls,
        driver: Factory,
        rules: Iterable[Rule],
        traffic: str | Factory | None = "reference",
        fleet: Fleet | None = None,
        simulator: Simulator | None = None,
    ) -> Setting:
        """Return a setting, by default with the usual simulator."""
        policy = None if traffic is None else Policy.of(traffic)
        return cls(driver, tuple(rules), policy, fleet or Fleet(), Choice.of(simulator))

    def judged(self, scenario: Scenario) -> tuple[Run, list[Verdict]]:
        """Simulate a scenario, and judge the run by every rule."""
        run = self.simulated(scenario)
        if run.fault is not None:
            raise RunError(f"{scenario.name}: {run.fault.reason}")
        verdicts = [check(run, rule) for rule in self.rules if rule.concerns(scenario.place)]
        for verdict in verdicts:
            if verdict.status is Status.ERROR:
                raise RunError(f"{scenario.name} can't be judged by {verdict.rule}: {verdict.reason}")
        return run, verdicts

    def simulated(self, scenario: Scenario) -> Run:
        """Simulate a scenario; the run may have ended by a fault."""
        if self.traffic is None:
            case = Case(scenario.but(subject=None), self.driver, fleet=self.fleet)
        else:
            case = Case(scenario, self.driver, self.traffic.factory, self.fleet)
        return simulate(case, self.simulator)

    def id(self, scenario: Scenario) -> str:
        """Return the id of a start, given by its scenario, in reports."""
        return run_id(scenario, self.traffic.name if self.traffic else None)


def start_of(line: Line, lead: int, setting: Setting) -> dict[str, Any]:
    """Return a start of a line as a JSON object: lead [s], id, distance [m] and speed [m/s] per vehicle."""
    scenario = line.scenario(lead)
    entrances = [start for start, _ in line.ways if start < len(line.place.entrances)]
    return {
        "lead": round(lead * STEP, 2),
        "id": setting.id(scenario),
        "distances": [scenario.start(entrance)[0] for entrance in entrances],
        "speeds": [scenario.start(entrance)[1] for entrance in entrances],
    }


def fault_of(rule: str) -> Fault:
    """Return the kind of failure that breaking a rule is; a rule of a user is taken to be about other vehicles."""
    return Fault.TIMID if rule in _TIMID else Fault.MANNERS if rule in _MANNERS else Fault.BOLD


def rank(rule: str) -> int:
    """Return a number for how much breaking a rule matters; 0 matters most."""
    return list(Fault).index(fault_of(rule))


class Trial:
    """Simulates and judges starts of a line, each start once; neither vehicle has a lead greater than `longest` [s]."""

    def __init__(self, setting: Setting, line: Line, longest: float = LONGEST) -> None:
        self.setting, self.line = setting, line
        self.low, self.high = line.reach(longest)
        self._starts: dict[int, Start] = {}

    def start(self, lead: int) -> Start:
        """Return the simulated and judged start with a lead [steps of `STEP`]."""
        if lead not in self._starts:
            run, verdicts = self.setting.judged(self.line.scenario(lead))
            outcomes = tuple((verdict.rule, verdict.outcome) for verdict in verdicts)
            measured, difference = arrival_differences(run), None
            if measured is not None and any(verdict.asked and verdict.outcome.judges for verdict in verdicts):
                tried = (seconds for own, _, seconds in measured.tried if run.agents[own].entrance == self.line.seat)
                difference = next(tried, None)
            if self.line.walker:
                shared, times = (self.line.place.stretches or {})[self.line.ways], []
                for column, station in enumerate((shared.mine.start, shared.yours.start)):
                    reached = np.flatnonzero(run.need("station")[:, column] >= station)
                    times.append(float(reached[0]) * run.dt if len(reached) else math.inf)
                goes = times[0] < times[1]
            else:
                entries = {agent.entrance: run.entry(column) for column, agent in enumerate(run.agents)}
                subject = entries.pop(self.line.seat)
                (other,) = entries.values()
                until = CHANGED if self.line.by_yellow else other
                goes = subject is not None and (until is None or subject < until)
            self._starts[lead] = Start(lead, goes, outcomes, difference)
        return self._starts[lead]

    def tried(self) -> list[Start]:
        """Return the starts that have been simulated, sorted by their lead."""
        return [self._starts[lead] for lead in sorted(self._starts)]
