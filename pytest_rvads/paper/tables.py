"""Running the paper's experiment: both tables, on several processes, and the sweep over the random draw.

What the paper publishes about its tables, and how many cells a table without any mechanism would get right.

Verdicts are those of Li, Sifakis, Wang, Yan, Zhang: Simulation-based Validation for Autonomous Driving Systems (ISSTA
2023). Classes 1 and 3 stand in its tables; what is known here of classes 2 and 4 is what its text says about them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from pytest_rvads.executors import Progress, spread
from pytest_rvads.paper.experiment import LIGHT, ROWS, STOP, TABLES, Job, Key, Setup, Table, draw_range, entries, judge
from pytest_rvads.scenarios.classes import label, parse, rotate

__all__ = ["FITTED", "Shares", "agreement", "compute", "nested", "null_models", "published", "sweep"]


FITTED = (1, 3)
"""Classes that the constants were fitted on."""

_WORDS = {"F": "FAIL", "P": "PASS", "-": "NA"}
# Per configuration the rules of the table; four letters stand for the rows, one for all of them.
_CLASS_1 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "FFPF F -", "E": "FFPF F P"}
_CLASS_2 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "? F -", "E": "? F P"}
_CLASS_3 = {"F": "F - F", "G": "P - F", "H": "P - F", "I": "P - F", "J": "P - F"}
_CLASS_4 = {"F": "- P -", "G": "- P -", "H": "- - -", "I": "- - -", "J": "- F -"}
_CLASSES = {1: (STOP, _CLASS_1), 2: (STOP, _CLASS_2), 3: (LIGHT, _CLASS_3), 4: (LIGHT, _CLASS_4)}


Shares = dict[str, float]
"""Per FAIL, PASS, NA the share of the range of the draw."""

SWEEP_STEP = 0.05
"""Distance of the draws of a sweep [s]."""


def compute(
    setup: Setup | None = None,
    *,
    tables: Sequence[Table] = TABLES,
    numbers: Sequence[int] = (1, 2, 3, 4),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[Key, str]:
    """Simulate and judge every cell.

    Args:
        setup: constants, deficiencies and draw of all runs; those of the paper by default.
        tables: both by default.
        numbers: classes to run.
        executor: as for `spread`.
        progress: called after every run.

    Returns:
        PASS, FAIL or NA per cell.

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
    """Return, for every cell whose run draws, how often each verdict comes over the range of the draw."""
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
    """Return cells by table, class and row, with the directions of the row: the shape of ``rvads paper --json``."""
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
    """Return what the paper says about the cells of classes `numbers`; a cell it does not tell is left out."""
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
    """Return how many cells of classes `numbers` are as published, and how many are published."""
    cells = published(numbers)
    return sum(verdicts[key] == value for key, value in cells.items()), len(cells)


def null_models() -> dict[str, int]:
    """Return how many of the cells of classes 1 and 3 a table would get that knows less than a simulation.

    Each model answers with the most frequent verdict among the cells it cannot tell apart, so its count is the best
    that it could reach.
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
