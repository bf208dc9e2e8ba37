"""Two runs side by side: how each vehicle fared in the one, and the one in its place in the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["side_by_side"]


def side_by_side(one: Run, first: Verdict, other: Run, second: Verdict, image: Sequence[int], what: str) -> str:
    """Return a table: a row per vehicle of `one`, beside the vehicle that corresponds to it in `other`.

    Args:
        one: a run.
        first: its verdict.
        other: the run to compare with.
        second: the verdict of the same rule on it.
        image: per entrance of `one` the one that corresponds to it in `other`.
        what: what was changed between them.
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
