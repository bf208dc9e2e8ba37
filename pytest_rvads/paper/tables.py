"""Running the paper's experiment: both tables, on several processes, and the sweep over the random draw."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

from pytest_rvads.executors import Progress, spread
from pytest_rvads.paper.draws import draw_range
from pytest_rvads.paper.experiment import ROWS, TABLES, Job, Key, Setup, Table, entries, judge
from pytest_rvads.scenarios.classes import label, parse, rotate

__all__ = ["Shares", "compute", "nested", "sweep"]

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
    wanted = [entry for table in tables for entry in entries(table) if entry.number in numbers]
    jobs = [(entry, setup or Setup()) for entry in wanted]
    verdicts: dict[Key, str] = {}
    for entry, found in zip(wanted, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in found.items():
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
    seen: dict[Key, list[str]] = {}
    for (entry, _), found in zip(jobs, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in found.items():
            seen.setdefault(entry.key(rule), []).append(value)
    return {key: {word: values.count(word) / len(values) for word in ("FAIL", "PASS", "NA")} for key, values in seen.items()}


def nested(cells: dict[Key, str] | dict[Key, Shares]) -> dict[str, dict[str, dict[str, dict[str, object]]]]:
    """Return cells by table, class and row, with the directions of the row: the shape of ``rvads paper --json``."""
    result: dict[str, dict[str, dict[str, dict[str, object]]]] = {}
    for table in TABLES:
        for number, directions in table.classes.items():
            for row in range(ROWS):
                entry: dict[str, object] = {"directions": label(rotate(parse(directions), row))}
                for letter in table.configurations:
                    found = {r: cells[number, row, letter, r] for r in table.rules if (number, row, letter, r) in cells}
                    if found:
                        entry[letter] = found
                result.setdefault(table.name, {}).setdefault(f"class{number}", {})[f"row{row + 1}"] = entry
    return result
