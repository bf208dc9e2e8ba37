"""The two tables of the paper's experiment: computed, swept over the random waiting time of vehicles, and as published.

The tables are shown as text and as a picture in the layout of the paper; cells that differ from the published cells are marked.

The published verdicts are those of Li, Sifakis, Wang, Yan, Zhang: Simulation-based Validation for Autonomous Driving Systems
(ISSTA 2023). The paper has tables of classes 1 and 3; the text of the paper gives some cells of classes 2 and 4.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.report.svg import document, polyline, text
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.lgsvl import RED_WAIT, TURN_WAIT, Constants, LgsvlLike
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import label, parse, rotate
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.executors import Progress, spread
from pytest_rvads.support.wording import page

_DRAW_CLASS = 4
"""Number of the class whose published verdict in configuration J holds only for certain random waiting times."""
ROWS = 4
"""Number of rows per class in a table: a row per rotation of the class's scenario through the four entrances."""
WAIT = 3.32
"""Waiting time that is drawn at random in the paper, fixed for all runs of the tables [s]; `crossing_wait` derives the value."""
Key = tuple[int, int, str, str]
"""A cell of a table: class, row (0 for row 1), configuration, rule."""
FITTED = (1, 3)
"""Classes to whose published cells the constants of the LGSVL-like driver were fitted."""
_STATUSES = {"F": "FAIL", "P": "PASS", "-": "NA"}
# Per configuration, a word per rule of the table: a letter for each row, or a single letter if all rows have the same verdict.
_CLASS_1 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "FFPF F -", "E": "FFPF F P"}
_CLASS_2 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "? F -", "E": "? F P"}
_CLASS_3 = {"F": "F - F", "G": "P - F", "H": "P - F", "I": "P - F", "J": "P - F"}
_CLASS_4 = {"F": "- P -", "G": "- P -", "H": "- - -", "I": "- - -", "J": "- F -"}
Shares = dict[str, float]
"""For each of the verdicts FAIL, PASS and NA, its share of the tried waiting times."""
SWEEP_STEP = 0.05
"""Difference between successive waiting times of a sweep [s]."""
MARK = "!"
"""Sign that is printed after a verdict that differs from the published verdict."""
_WORDS = {"FAIL": "Fail", "PASS": "Pass", "NA": "NA"}
_COLOURS = {"FAIL": "#b3261e", "PASS": "#1b6e3c", "NA": "#777"}


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


_CLASSES = {1: (STOP, _CLASS_1), 2: (STOP, _CLASS_2), 3: (LIGHT, _CLASS_3), 4: (LIGHT, _CLASS_4)}


def compute(
    setup: Setup | None = None,
    *,
    tables: Sequence[Table] = TABLES,
    numbers: Sequence[int] = (1, 2, 3, 4),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[Key, str]:
    """Return the verdict PASS, FAIL or NA of every cell of some classes, by default in runs with the settings of the paper."""
    chosen_entries = [entry for table in tables for entry in entries(table) if entry.number in numbers]
    jobs = [(entry, setup or Setup()) for entry in chosen_entries]
    verdicts: dict[Key, str] = {}
    for entry, statuses in zip(chosen_entries, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in statuses.items():
            verdicts[entry.key(rule)] = value
    return verdicts


def sweep(
    setup: Setup | None = None, *, executor: Executor | int | None = None, progress: Progress | None = None
) -> dict[Key, Shares]:
    """Return, for every cell whose run has a random waiting time, the share of waiting times with each verdict.

    The waiting times are spread evenly over the range from which the driver draws, see `draw_range`.
    """
    setup = setup or Setup()
    jobs: list[Job] = []
    for entry in (entry for table in TABLES for entry in entries(table)):
        span = draw_range(entry)
        if span is not None:
            low, high = span
            count = round((high - low) / SWEEP_STEP) + 1
            waits = [round(low + k * SWEEP_STEP, 6) for k in range(count)]
            jobs += [(entry, replace(setup, wait=wait)) for wait in waits]
    values_of_cell: dict[Key, list[str]] = {}
    for (entry, _), statuses in zip(jobs, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in statuses.items():
            values_of_cell.setdefault(entry.key(rule), []).append(value)
    return {
        key: {word: values.count(word) / len(values) for word in ("FAIL", "PASS", "NA")} for key, values in values_of_cell.items()
    }


def nested(cells: dict[Key, str] | dict[Key, Shares]) -> dict[str, dict[str, dict[str, dict[str, object]]]]:
    """Return the cells nested by table, class and row, with the directions of each row, as ``rvads paper --json`` prints them."""
    result: dict[str, dict[str, dict[str, dict[str, object]]]] = {}
    for table in TABLES:
        for number, directions in table.classes.items():
            for row in range(ROWS):
                entry: dict[str, object] = {"directions": label(rotate(parse(directions), row))}
                for letter in table.configurations:
                    cells_of_entry = {r: cells[number, row, letter, r] for r in table.rules if (number, row, letter, r) in cells}
                    if cells_of_entry:
                        entry[letter] = cells_of_entry
                result.setdefault(table.name, {}).setdefault(f"class{number}", {})[f"row{row + 1}"] = entry
    return result


def published(numbers: tuple[int, ...] = (1, 2, 3, 4)) -> dict[Key, str]:
    """Return the published verdicts of the cells of some classes; a cell without a published verdict is left out."""
    cells: dict[Key, str] = {}
    for number in numbers:
        table, cells_by_letter = _CLASSES[number]
        for letter, words in cells_by_letter.items():
            for rule, word in zip(table.rules, words.split(), strict=True):
                for row in range(ROWS):
                    mark = word[row] if len(word) == ROWS else word
                    if mark != "?":
                        cells[number, row, letter, rule] = _STATUSES[mark]
    return cells


def agreement(verdicts: Mapping[Key, str], numbers: tuple[int, ...]) -> tuple[int, int]:
    """Return, for some classes, the number of published cells that `verdicts` reproduces, and the number of published cells."""
    cells = published(numbers)
    return sum(verdicts[key] == value for key, value in cells.items()), len(cells)


def null_models() -> dict[str, int]:
    """Return, by name of a model that guesses cells without a simulation, how many cells of classes 1 and 3 it can get right.

    A model gives the same answer to all cells that it can't distinguish. Its best answer to these cells is their most frequent
    verdict.
    """
    models: dict[str, Callable[[Key], object]] = {
        "one verdict for everything": lambda _: None,
        "by rule": lambda key: key[3],
        "by rule and configuration": lambda key: key[2:],
        "by rule, configuration and row": lambda key: key[1:],
    }
    cells = published(FITTED)
    scores = {}
    for name, group in models.items():
        counters: dict[object, Counter[str]] = {}
        for key, value in cells.items():
            counters.setdefault(group(key), Counter())[value] += 1
        scores[name] = sum(max(counter.values()) for counter in counters.values())
    return scores


def disagreements(verdicts: Mapping[Key, str]) -> list[tuple[Key, str, str]]:
    """Return the cells that differ from the published cells: cell, verdict, published verdict."""
    return [(key, verdicts[key], value) for key, value in published().items() if key in verdicts and verdicts[key] != value]


def text_tables(verdicts: Mapping[Key, str]) -> str:
    """Return both tables of the paper as text, followed by a summary."""
    lines = []
    for table in TABLES:
        groups = " | ".join(f"{letter:<17}" for letter in table.configurations)
        rules = " | ".join(" ".join(f"{rule:<5}" for rule in table.rules) for _ in table.configurations)
        lines += [_title(table), f"{'':>23} | {groups}".rstrip(), f"class  {'scenario':<16} | {rules}".rstrip()]
        for number, row, scenario in _rows(table):
            cells = [f"{number if row == 0 else '':>5}  {scenario:<16}"]
            for letter in table.configurations:
                words = (_marked_word(verdicts, (number, row, letter, rule)) for rule in table.rules)
                cells.append(" ".join(f"{word:<5}" for word in words))
            lines.append(" | ".join(cells).rstrip())
        lines.append("")
    return "\n".join([*lines, *_summary_lines(verdicts)])


def text_sweep(shares: Mapping[Key, Shares]) -> str:
    """Return the result of `sweep` as text, with a line per cell: the shares of FAIL, PASS and NA in per cent."""
    lines = ["Shares of Fail/Pass/NA over the range of the draw, in per cent"]
    for table in TABLES:
        for number, row, scenario in _rows(table):
            for letter in table.configurations:
                for rule in table.rules:
                    shares_of_cell = shares.get((number, row, letter, rule))
                    if shares_of_cell:
                        percent = "/".join(f"{100 * shares_of_cell[word]:.0f}" for word in ("FAIL", "PASS", "NA"))
                        lines.append(f"class {number}  {scenario}  {letter}  {rule}  {percent}")
    return "\n".join(lines)


def svg_tables(verdicts: Mapping[Key, str]) -> str:
    """Return both tables as an SVG document."""
    body, y, wide = [], 30.0, 190 + 5 * 3 * 46
    for table in TABLES:
        body.append(text(20, y, _title(table), font_weight="bold"))
        y += 26
        pairs = [(letter, rule) for letter in table.configurations for rule in table.rules]
        columns = [(190.0 + 46 * k, letter, rule) for k, (letter, rule) in enumerate(pairs)]
        body.append(text(20, y, "class", fill="#444"))
        body += [text(x, y - 14, letter, font_weight="bold") for x, letter, _ in columns[::3]]
        body += [text(x, y, rule, fill="#444") for x, _, rule in columns]
        body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#222"))
        for number, row, scenario in _rows(table):
            y += 20
            body += [text(20, y, str(number) if row == 0 else ""), text(50, y, scenario)]
            for x, letter, rule in columns:
                key = number, row, letter, rule
                word = _marked_word(verdicts, key)
                style = {"font_weight": "bold"} if word.endswith(MARK) else {}
                body.append(text(x, y, word, fill=_COLOURS[verdicts[key]], **style))
            if row == ROWS - 1:
                body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#bbb"))
        y += 40
    for line in _summary_lines(verdicts):
        body.append(text(20, y, line, fill="#444"))
        y += 18
    return document(wide + 20, y, body)


def _title(table: Table) -> str:
    kind = "stop" if table.name == "stop4" else "traffic light"
    return f"4-way {kind} junction ({table.junction}), LGSVL-like autopilot, one draw of {WAIT:g} s for all runs"


def _rows(table: Table) -> Iterator[tuple[int, int, str]]:
    for number, directions in table.classes.items():
        for row in range(ROWS):
            placed = rotate(parse(directions), row)
            yield number, row, " ".join(f"{entrance}d{d}" for entrance, d in enumerate(placed))


def _marked_word(verdicts: Mapping[Key, str], key: Key) -> str:
    return _WORDS[verdicts[key]] + ("" if published().get(key, verdicts[key]) == verdicts[key] else MARK)


def _summary_lines(verdicts: Mapping[Key, str]) -> list[str]:
    differences = [
        f"  {MARK} class {k[0]} row {k[1] + 1} {k[2]} {k[3]}: {got}, published {want}" for k, got, want in disagreements(verdicts)
    ]
    fitted, unfitted = agreement(verdicts, FITTED), agreement(verdicts, (2, 4))
    guess = null_models()["by rule and configuration"]
    return [
        f"Replicated with a calibrated surrogate: {page('replication')}",
        f"Classes 1 and 3, fitted: {fitted[0]} of {fitted[1]} cells as published; "
        f"a table by rule and configuration alone would get {guess}.",
        f"Classes 2 and 4, not fitted: {unfitted[0]} of the {unfitted[1]} cells that the paper's text tells.",
        *differences,
    ]
