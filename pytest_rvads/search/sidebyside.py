"""A table of two runs side by side, which compares each vehicle of the first run with its counterpart in the second run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["side_by_side"]


def side_by_side(one: Run, first: Verdict, other: Run, second: Verdict, image: Sequence[int], what: str) -> str:
    """Return a table with a row per vehicle of `one`, beside the corresponding vehicle of `other`.

    Args:
        one: the first run.
        first: the verdict on the first run.
        other: the second run.
        second: the verdict of the same rule on the second run.
        image: for each entrance of `one` the corresponding entrance of `other`.
        what: the change between the runs, in words.
    """
    columns: dict[int, list[int]] = {}
    for k, agent in enumerate(other.agents):
        columns.setdefault(agent.entrance, []).append(k)
    rows = [("", "first run", what), ("scenario", one.label, other.label), (first.rule, str(first.status), str(second.status))]
    for k, agent in enumerate(one.agents):
        rows.append(("vehicle", _fate(one, k), _fate(other, columns[image[agent.entrance]].pop(0))))
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"{a:{widths[0]}}  {b:{widths[1]}}  {c}".rstrip() for a, b, c in rows]
    lines += [f"{name:{widths[0]}}  {text}" for name, text in (("first run", first.message), (what, second.message))]
    return "\n".join(lines)


def _fate(run: Run, column: int) -> str:
    agent = run.agents[column]
    events = []
    for word, zone in (("arrives", Zone.ENTRANCE), ("enters", Zone.JUNCTION), ("leaves", Zone.EXIT)):
        reached = np.flatnonzero(run.zone[:, column] >= zone)
        events.append(f"{word} {reached[0] * run.dt:.2f} s" if len(reached) else f"never {word}")
    return f"{agent.name} {agent.entrance}->{agent.exit}: {', '.join(events)}"
