"""The experiment of the paper: the scenarios of its two tables, their runs and verdicts, and the random wait of vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.lgsvl import Constants, LgsvlLike
from pytest_rvads.satellites.lgsvl.scheduler import RED_WAIT, TURN_WAIT
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.errors import RunError

_DRAW_CLASS = 4
"""Number of the class whose published verdict in configuration J holds only for certain random waiting times."""
ROWS = 4
"""Number of rows per class in a table: a row per rotation of the class's scenario through the four entrances."""
WAIT = 3.32
"""Waiting time that is drawn at random in the paper, fixed for all runs of the tables [s]; `crossing_wait` derives the value."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the paper."""

    name: str
    """Name of the table in the files of the paper's authors."""
    junction: str
    """Name of the built-in junction, whose roads have the lengths in the recordings of the paper's authors."""
    classes: Mapping[int, str] = field(hash=False)
    """By the paper's number of a class, the directions of its vehicles in row 1."""
    configurations: str
    rules: tuple[str, ...]
    duration: float
    """Duration after which a run ends [s]."""


STOP = Table("stop4", "paper_stop4", {1: "2111", 2: "3111"}, "ABCDE", ("p1", "p2", "p3"), 30.0)
LIGHT = Table("light4", "paper_light4", {3: "1233", 4: "2121"}, "FGHIJ", ("p4", "p5", "p6"), 40.0)
TABLES = (STOP, LIGHT)
Key = tuple[int, int, str, str]
"""A cell of a table: class, row (0 for row 1), configuration, rule."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A run of a table of the paper; its verdicts fill a cell per rule."""

    table: Table
    number: int
    """The paper's number of the class."""
    row: int
    """Number of entrances by which the scenario is rotated; 0 for row 1."""
    configuration: str

    def key(self, rule: str) -> Key:
        """Return the row and the column of the paper's table of verdicts in which the verdict of a rule on this run stands."""
        return self.number, self.row, self.configuration, rule

    def scenario(self, wait: float = WAIT) -> Scenario:
        """Return the concrete scenario, with `wait` as the waiting time that drivers would draw at random [s]."""
        point = configuration(self.configuration, ROWS)
        return Scenario(
            find(self.table.junction),
            self.table.classes[self.number],
            distance=point.distances,
            speed=point.speeds,
            rotation=self.row,
            configuration=self.configuration,
            duration=self.table.duration,
            wait=wait,
        )


@dataclass(frozen=True, slots=True)
class Setup:
    """Settings of all runs of an experiment, as plain values that can be sent to another process."""

    constants: Constants = field(default_factory=Constants)
    off: tuple[str, ...] = ()
    """Deficiencies of the driver that are switched off, such as ``("i2",)``."""
    wait: float = WAIT
    """Waiting time that drivers would draw at random [s]."""
    simulator: str | None = None
    """Name of the simulator; None for the default simulator."""

    def system(self) -> partial[LgsvlLike]:
        """Return the driver of all vehicles: LGSVL-like autopilots with these constants and switched-off deficiencies."""
        return partial(LgsvlLike, constants=self.constants, **dict.fromkeys(self.off, False))


Job = tuple[Entry, Setup]
"""A run of a table, and its settings."""


def entries(table: Table) -> Iterator[Entry]:
    """Yield the runs of a table, sorted by class, row and configuration as in the paper."""
    for number in table.classes:
        for row in range(ROWS):
            for letter in table.configurations:
                yield Entry(table, number, row, letter)


def run_entry(entry: Entry, setup: Setup) -> Run:
    """Simulate and return the run of a table entry."""
    return simulate(Case(entry.scenario(setup.wait), setup.system()), named(setup.simulator))


def judge(job: Job) -> dict[str, str]:
    """Simulate a run of a table and return its verdict per rule. A single argument lets executors map this function."""
    entry, setup = job
    return outcome(run_entry(entry, setup), entry.table.rules)


def outcome(run: Run, rules: tuple[str, ...]) -> dict[str, str]:
    """Return the verdict PASS, FAIL or NA per rule; OPEN (an obligation is left at the end) counts as FAIL, as in the paper."""
    statuses = {}
    for rule in rules:
        verdict = check(run, rule)
        if verdict.status is Status.ERROR:
            raise RunError(f"{run.label} could not be judged by {rule}: {verdict.message}")
        statuses[rule] = "FAIL" if verdict.status is Status.OPEN else verdict.status.value
    return statuses


def draw_range(entry: Entry) -> tuple[float, float] | None:
    """Return the range of the waiting time that the driver draws at random in a run [s]; None if it draws none.

    A vehicle that turns right on red draws how long it waits at red. A vehicle that turns left, with red at the start of the run,
    draws how long it waits after its light has become green.
    """
    if entry.table is not LIGHT:
        return None
    scenario = entry.scenario()
    junction = scenario.place
    colours = scenario.signals().colours(0.0, len(junction.entrances))
    turns = {agent.turn for agent in scenario.agents() if colours[agent.entrance] is Colour.RED}
    ranges = [span for turn, span in ((Turn.RIGHT, RED_WAIT), (Turn.LEFT, TURN_WAIT)) if turn in turns]
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def crossing_wait(setup: Setup | None = None) -> float:
    """Return the wait [s] after which a vehicle that turns right on red enters while a crossing vehicle is at its own entrance.

    In configuration J of the paper's class 4, rule p5 is violated only if the random wait of the vehicle that turns right lies in
    a narrow window: this vehicle must enter while the vehicle with green is in its own entrance zone. A run with the longest
    possible wait shows when the crossing vehicle is in its entrance zone, and how long the turning vehicle needs from the end of
    its wait to the line. The returned wait is in the middle of the window.
    """
    setup = setup or Setup()
    longest = RED_WAIT[1]
    dry = run_entry(Entry(LIGHT, _DRAW_CLASS, 0, "J"), Setup(setup.constants, setup.off, longest))
    crossing = np.flatnonzero(dry.zone[:, 0] == Zone.ENTRANCE)
    entry = dry.entry(1)
    if not len(crossing) or entry is None:
        raise RunError(f"the dry run {dry.label} ended before a vehicle entered the junction, so no wait follows from it")
    # The time at which the vehicle that turns right has stopped at its entrance.
    standing = float(np.flatnonzero(dry.need("speed")[:, 1] < 0.05)[0]) * dry.dt
    start_up = entry - longest - standing
    # p5 is violated if the turning vehicle enters after the crossing vehicle reached its entrance, and not after it entered.
    middle = int(crossing[0] + crossing[-1] + 2) // 2
    return round(middle * dry.dt - start_up, 2)
