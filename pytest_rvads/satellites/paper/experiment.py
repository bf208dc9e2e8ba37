"""The experiment of the paper: the scenarios of its two tables, the run and the verdicts of an entry, and the random draw."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pytest_rvads.drivers.lgsvl import Constants, LgsvlLike
from pytest_rvads.drivers.lgsvl.constants import RED_WAIT, TURN_WAIT
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.segment import Turn
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.errors import RunError

__all__ = [
    "LIGHT",
    "ROWS",
    "STOP",
    "TABLES",
    "WAIT",
    "Entry",
    "Job",
    "Key",
    "Setup",
    "Table",
    "crossing_wait",
    "draw_range",
    "entries",
    "judge",
    "outcome",
    "run_entry",
]


_DRAW_CLASS = 4
"""Class with a configuration, J, in which the paper's verdict needs a certain draw."""


ROWS = 4
"""Rows per class: the rotations of the junction."""
WAIT = 3.32
"""Random draw of all runs of the tables [s]; `crossing_wait` derives the draw."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the paper."""

    name: str
    """Name of the table in the paper's files."""
    junction: str
    """Built-in junction with the recorded lengths."""
    classes: Mapping[int, str] = field(hash=False)
    """Directions of row 1 by the paper's number of the class."""
    configurations: str
    rules: tuple[str, ...]
    duration: float
    """Longest run [s]."""


STOP = Table("stop4", "paper_stop4", {1: "2111", 2: "3111"}, "ABCDE", ("p1", "p2", "p3"), 30.0)
LIGHT = Table("light4", "paper_light4", {3: "1233", 4: "2121"}, "FGHIJ", ("p4", "p5", "p6"), 40.0)
TABLES = (STOP, LIGHT)


Key = tuple[int, int, str, str]
"""A cell of a table: class, row (0 for row 1), configuration, rule."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A run of a table, which fills a cell per rule."""

    table: Table
    number: int
    """The paper's number of the class."""
    row: int
    """Rotation, 0 for row 1."""
    configuration: str

    def key(self, rule: str) -> Key:
        """Return the cell of a rule."""
        return self.number, self.row, self.configuration, rule

    def scenario(self, wait: float = WAIT) -> Scenario:
        """Return the concrete scenario with `wait` as the random draw [s]."""
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
    """Deficiencies that are switched off, such as ``("i2",)``."""
    wait: float = WAIT
    """Random draw [s]."""
    simulator: str | None = None
    """Name of the simulator; None for the default simulator."""

    def system(self) -> partial[LgsvlLike]:
        """Return the autopilot of the experiment, as a factory."""
        return partial(LgsvlLike, constants=self.constants, **dict.fromkeys(self.off, False))


Job = tuple[Entry, Setup]
"""A run of a table, and its settings."""


def entries(table: Table) -> Iterator[Entry]:
    """Yield the runs of a table, by class, row and configuration in the order of the paper."""
    for number in table.classes:
        for row in range(ROWS):
            for letter in table.configurations:
                yield Entry(table, number, row, letter)


def run_entry(entry: Entry, setup: Setup) -> Run:
    """Simulate the run of an entry."""
    return simulate(Case(entry.scenario(setup.wait), setup.system()), named(setup.simulator))


def judge(job: Job) -> dict[str, str]:
    """Simulate and judge a run of a table. The single argument allows mapping the function over processes."""
    entry, setup = job
    return outcome(run_entry(entry, setup), entry.table.rules)


def outcome(run: Run, rules: tuple[str, ...]) -> dict[str, str]:
    """Return PASS, FAIL or NA per rule; OPEN counts as FAIL, as in the paper.

    Raises:
        RunError: the run can't be judged.
    """
    statuses = {}
    for rule in rules:
        verdict = check(run, rule)
        if verdict.status is Status.ERROR:
            raise RunError(f"{run.label} could not be judged by {rule}: {verdict.message}")
        statuses[rule] = "FAIL" if verdict.status is Status.OPEN else verdict.status.value
    return statuses


def draw_range(entry: Entry) -> tuple[float, float] | None:
    """Return the range of the draw of a run [s]; None for a run without a draw.

    A vehicle that turns right on red draws its waiting time. A vehicle that turns left and faces red draws its waiting time after
    green.
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
    """Return the wait [s] after which a right turn on red enters while a crossing vehicle is at its entrance.

    In configuration J of class 4, p5 is violated only by a draw from a narrow window: the vehicle that turns right must enter
    while the vehicle with green passes its entrance zone. A dry run with the longest draw gives the times at which the crossing
    vehicle is at its entrance, and the time from the end of the wait to the line.

    Raises:
        RunError: the dry run ends before a vehicle enters the junction.
    """
    setup = setup or Setup()
    longest = RED_WAIT[1]
    dry = run_entry(Entry(LIGHT, _DRAW_CLASS, 0, "J"), Setup(setup.constants, setup.off, longest))
    crossing = np.flatnonzero(dry.zone[:, 0] == Zone.ENTRANCE)
    entry = dry.entry(1)
    if not len(crossing) or entry is None:
        raise RunError(f"the dry run {dry.label} ended before a vehicle entered the junction, so no wait follows from it")
    # The time at which the vehicle that turns right stands at its entrance.
    standing = float(np.flatnonzero(dry.need("speed")[:, 1] < 0.05)[0]) * dry.dt
    start_up = entry - longest - standing
    # An entry breaks the rule from a step after the arrival of the crossing vehicle to the step in which this vehicle enters.
    middle = int(crossing[0] + crossing[-1] + 2) // 2
    return round(middle * dry.dt - start_up, 2)
