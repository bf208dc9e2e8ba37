"""How firmly the replication stands: margins of p1, ablation of the mechanisms, room of the free constants.

The numbers of ``docs/replication.md`` come from here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pytest_rvads.autopilots.lgsvl import Constants
from pytest_rvads.experiment.draws import crossing_wait
from pytest_rvads.experiment.paper import compute
from pytest_rvads.experiment.published import Key
from pytest_rvads.experiment.tables import STOP, TABLES, Setup, Table, entries, outcome, run_entry
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Zone

__all__ = ["FREE", "Free", "ablation", "admissible", "p1_margin", "p1_margins"]


@dataclass(frozen=True, slots=True)
class Free:
    """A free constant: how to move it, and which tables depend on it."""

    move: Callable[[Constants, float], Constants]
    """Returns the constants with this one moved by so much."""
    resolution: float
    """Its room is found to this resolution."""
    limit: float
    """Farthest move that is tried."""
    tables: tuple[Table, ...] = TABLES


FREE: Mapping[str, Free] = {
    "zone x [m]": Free(lambda c, d: replace(c, zone4=replace(c.zone4, x=c.zone4.x + d)), 0.06, 0.9, (STOP,)),
    "zone y [m]": Free(lambda c, d: replace(c, zone4=replace(c.zone4, y=c.zone4.y + d)), 0.06, 0.9, (STOP,)),
    "zone half extent [m]": Free(
        lambda c, d: replace(c, zone4=replace(c.zone4, half_x=c.zone4.half_x + d, half_y=c.zone4.half_y + d)), 0.06, 0.9, (STOP,)
    ),
    "launch [s]": Free(lambda c, d: replace(c, launch=c.launch + d), 0.02, 0.14),
    "halt [m]": Free(lambda c, d: replace(c, halt=c.halt + d), 0.05, 0.35),
    "braking": Free(lambda c, d: replace(c, braking=c.braking + d), 0.03, 0.21),
}


def p1_margin(run: Run) -> int:
    """Return how many ticks the p1 verdict of a run hangs on.

    Positive: the shortest gap between one vehicle leaving the junction and the next one entering it. Negative: the
    longest time that two were in it together. The verdict turns when it changes sign.
    """
    inside = run.zone == Zone.JUNCTION
    spans = []
    for column in range(len(run.agents)):
        ticks = np.flatnonzero(inside[:, column])
        if len(ticks):
            spans.append((int(ticks[0]), int(ticks[-1]) + 1))
    spans.sort()
    gaps = [later[0] - earlier[1] for k, later in enumerate(spans) for earlier in spans[:k]]
    return min(gaps, default=run.steps)


def p1_margins(setup: Setup | None = None) -> dict[tuple[int, int, str], int]:
    """Return `p1_margin` per class, row and configuration of the stop table."""
    setup = setup or Setup()
    return {(e.number, e.row, e.configuration): p1_margin(run_entry(e, setup)) for e in entries(STOP)}


def ablation(base: Mapping[Key, str], workers: int | None = None) -> dict[str, list[tuple[Key, str, str]]]:
    """Return, per deficiency switched off, the cells that flip: cell, verdict with it, verdict without it."""
    found = {}
    for name in ("i1", "i2", "i3", "i4", "i5"):
        verdicts = compute(Setup(off=(name,)), workers=workers)
        found[name] = [(key, base[key], verdicts[key]) for key in base if verdicts[key] != base[key]]
    return found


def admissible(free: Free, base: Mapping[Key, str]) -> tuple[float, float]:
    """Return how far down and up a free constant can move without any cell changing.

    The draw of the tables follows the other constants, so it is derived anew for every value.
    """
    order = [
        entry for letters in ("CFJ", "BEG", "ADHI") for t in free.tables for entry in entries(t) if entry.configuration in letters
    ]

    def same(amount: float) -> bool:
        constants = free.move(Constants(), amount)
        setup = Setup(constants, wait=crossing_wait(Setup(constants)))
        # The cells that hang on least come first, so that a change is noticed early.
        return all(
            base[e.number, e.row, e.configuration, rule] == value
            for e in order
            for rule, value in outcome(run_entry(e, setup), e.table.rules).items()
        )

    room = []
    for sign in (-1.0, 1.0):
        good, bad = 0, round(free.limit / free.resolution) + 1
        while bad - good > 1:
            middle = (good + bad) // 2
            if same(sign * middle * free.resolution):
                good = middle
            else:
                bad = middle
        room.append(round(sign * good * free.resolution, 6))
    return room[0], room[1]
