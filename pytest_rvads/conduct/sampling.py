"""What happens between two states of a run that was recorded coarsely."""

from __future__ import annotations

from dataclasses import replace

from pytest_rvads.conduct.memo import once
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone

__all__ = ["without_jumps"]


def without_jumps(run: Run) -> Run:
    """Return the run with every vehicle in each zone that it passes, those included that lie between two of its states.

    Who is before the entrance zone in one state and in the junction in the next was at its entrance: it counts as there in the
    first of them. Who passes all of the junction counts as in it in the second. Runs as dense as simulated ones come back as they
    are: who jumps there is no vehicle that drives.
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
