"""The two tables of the paper's experiment: computed on several processes, swept over the random draw, and as published.

The published verdicts are those of Li, Sifakis, Wang, Yan, Zhang: Simulation-based Validation for Autonomous Driving Systems
(ISSTA 2023). The paper has tables of classes 1 and 3; its text gives the known cells of classes 2 and 4.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from pytest_rvads.satellites.paper.experiment import LIGHT, ROWS, STOP, TABLES, Job, Key, Setup, Table, draw_range, entries, judge
from pytest_rvads.scenarios.classes import label, parse, rotate
from pytest_rvads.support.executors import Progress, spread

__all__ = ["FITTED", "Shares", "agreement", "compute", "nested", "null_models", "published", "sweep"]


FITTED = (1, 3)
"""Classes whose published cells determined the constants."""

_WORDS = {"F": "FAIL", "P": "PASS", "-": "NA"}
# Verdicts per configuration, in the order of the rules of the table: a letter per row, or a letter for all rows.
_CLASS_1 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "FFPF F -", "E": "FFPF F P"}
_CLASS_2 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "? F -", "E": "? F P"}
_CLASS_3 = {"F": "F - F", "G": "P - F", "H": "P - F", "I": "P - F", "J": "P - F"}
_CLASS_4 = {"F": "- P -", "G": "- P -", "H": "- - -", "I": "- - -", "J": "- F -"}
_CLASSES = {1: (STOP, _CLASS_1), 2: (STOP, _CLASS_2), 3: (LIGHT, _CLASS_3), 4: (LIGHT, _CLASS_4)}


Shares = dict[str, float]
"""Share of the range of the draw per verdict FAIL, PASS, NA."""
SWEEP_STEP = 0.05
"""Distance between the draws of a sweep [s]."""


def compute(
    setup: Setup | None = None,
    *,
    tables: Sequence[Table] = TABLES,
    numbers: Sequence[int] = (1, 2, 3, 4),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[Key, str]:
    """Return the verdict of every cell: PASS, FAIL or NA.

    Args:
        setup: constants, deficiencies and draw of all runs; the settings of the paper by default.
        tables: tables to compute; both by default.
        numbers: classes to compute.
        executor: executor or number of processes, as for `spread`.
        progress: called after every run.

    Raises:
        RunError: a run ended by a fault.
    """
    chosen = [entry for table in tables for entry in entries(table) if entry.number in numbers]
    jobs = [(entry, setup or Setup()) for entry in chosen]
    verdicts: dict[Key, str] = {}
    for entry, statuses in zip(chosen, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in statuses.items():
            verdicts[entry.key(rule)] = value
    return verdicts


def sweep(
    setup: Setup | None = None, *, executor: Executor | int | None = None, progress: Progress | None = None
) -> dict[Key, Shares]:
    """Return the share of each verdict over the range of the draw, for every cell of a run with a draw."""
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
    """Return cells by table, class and row, with the directions of the row, in the shape of ``rvads paper --json``."""
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
        for letter, text in cells_by_letter.items():
            for rule, word in zip(table.rules, text.split(), strict=True):
                for row in range(ROWS):
                    mark = word[row] if len(word) == ROWS else word
                    if mark != "?":
                        cells[number, row, letter, rule] = _WORDS[mark]
    return cells


def agreement(verdicts: Mapping[Key, str], numbers: tuple[int, ...]) -> tuple[int, int]:
    """Return the number of cells of some classes that agree with the published cells, and the number of published cells."""
    cells = published(numbers)
    return sum(verdicts[key] == value for key, value in cells.items()), len(cells)


def null_models() -> dict[str, int]:
    """Return, for models without a simulation, the greatest possible number of correct cells of classes 1 and 3.

    A model gives equal answers to all cells that it can't distinguish. Its best answer is the most frequent verdict among these
    cells.
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
