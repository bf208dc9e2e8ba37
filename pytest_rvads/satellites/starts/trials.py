"""Simulates and judges starts of a line of starts, each start once, and tells which kind of failure breaking a rule is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import arrival_differences
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts.starts import CHANGED, LONGEST, Line
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import Choice, Simulator, simulate
from pytest_rvads.support.errors import RunError

_TIMID = frozenset({"progress"})
"""Rules that a driver breaks by waiting."""
_MANNERS = frozenset({"full_stop", "keep_lane", "on_lane_allowed", "on_route", "speed_limit"})
"""Rules about the subject alone."""

Outcomes = tuple[tuple[str, Outcome], ...]


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
