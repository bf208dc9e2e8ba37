"""Fills in zones that vehicles pass between two states of a coarsely recorded run."""

from __future__ import annotations

from dataclasses import replace

from pytest_rvads.logic.conduct.memo import once
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone

__all__ = ["without_jumps"]


def without_jumps(run: Run) -> Run:
    """Return the run with every vehicle in each zone that it passes, also in zones that it passes between two states.

    A vehicle before the entrance zone in one state and in the junction in the next state was at its entrance in between: it is
    put at its entrance in the first state. A vehicle that passes the whole junction between two states is put in the junction in
    the second state. Runs as dense as simulated runs are returned unchanged, because a vehicle that jumps in a dense run does not
    drive.
    """
    return once(run, _filled) or run


def _filled(run: Run) -> Run | None:
    if run.dt <= DT or run.steps < 2:
        return None
    before, after = run.zone[:-1], run.zone[1:]
    over_entrance = (before == Zone.APPROACH) & (after >= Zone.JUNCTION)
    over_junction = (before != Zone.ABSENT) & (before <= Zone.ENTRANCE) & (after == Zone.EXIT)
    if not (over_entrance.any() or over_junction.any()):
        return None
    zone = run.zone.copy()
    zone[:-1][over_entrance] = Zone.ENTRANCE
    zone[1:][over_junction] = Zone.JUNCTION
    return replace(run, zone=zone)
