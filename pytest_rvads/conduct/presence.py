"""Who is near the junction at the same time, in runs whose vehicles come and go.

Instances of rules are about vehicles that are `together`: both near the junction at some time, or so close to each other
somewhere that they might touch. No shipped rule is violated by others:

- p1, p2, p3, p5, p6, p6g, first_come, right_first speak of two in their stop places or in the junction at the same time, and a
  vehicle there is near. What one of them owes to the other since then ends while both are there, see `window`.
- no_conflict: who meets is on a stretch of its movement, so that part of its body is in the junction.
- left_yields, yield_sign, priority, right_before_left, merge, right_on_red: a way is owed by who is at its entrance or inside to
  who is there, too, or would reach a stretch after the entrance within `priority.DUE`, 4 s: nearer than `NEAR_TIME`.
- no_collision: bodies that touch come closer than any others.
- p4, red, full_stop, keep_clear, progress, keep_lane, on_lane_allowed, on_route and speed_limit speak of one vehicle. Whom it
  waits for, or is followed by, is looked up on the run, not among instances.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.bodies import close
from pytest_rvads.conduct.memo import once
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.periods import NEAR, NEAR_TIME
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["crossed", "cut_off", "judged", "last_seen", "near", "together", "window"]


def judged(run: Run) -> frozenset[int] | None:
    """Return the columns of the agents whose instances are judged in this run, None where all are."""
    if run.excerpt is None or run.excerpt.judged is None:
        return None
    names = set(run.excerpt.judged)
    return frozenset(column for column, agent in enumerate(run.agents) if agent.name in names)


def together(run: Run) -> frozenset[tuple[int, int]] | None:
    """Return the pairs of columns of agents that instances are about, in both orders; None where nobody is absent.

    Where positions are not recorded, who is in the run at the same time is.
    """
    if not (run.zone == Zone.ABSENT).any():
        return None
    begin, end = run.spans.T if run.station is None else near(run).T
    both = np.minimum(end[:, None], end) > np.maximum(begin[:, None], begin)
    if run.pose is not None:
        both |= close(run)
    return frozenset((one, two) for one, two in np.argwhere(both).tolist() if one != two)


def near(run: Run) -> NDArray[np.int64]:
    """Return the first tick of every agent near the junction, and the one after its last, shape ``(agents, 2)``; both 0 if none.

    It is near from `NEAR` before its stopping line on, or `NEAR_TIME` at its speed, until it has left with its whole body.

    Raises:
        RunError: the run does not record positions.
    """
    found = np.zeros((len(run.agents), 2), dtype=np.int64)
    for column, agent in enumerate(run.agents):
        begin, end = run.spans[column]
        station = run.need("station")[begin:end, column]
        speed = np.zeros_like(station) if run.speed is None else run.speed[begin:end, column]
        reach = np.maximum(NEAR, NEAR_TIME * np.maximum(speed, 0.0))
        left = agent.route.length + max(LEAVE, agent.size[0] if agent.size else 0.0)
        there = (station >= -run.junction.setbacks[agent.entrance] - reach) & (station <= left) & run.here[begin:end, column]
        ticks = np.flatnonzero(there)
        if len(ticks):
            found[column] = begin + ticks[0], begin + ticks[-1] + 1
    return found


def window(run: Run, columns: Iterable[int]) -> tuple[int, int]:
    """Return the first tick in which these agents are all in the run, and the one after the last; equal if they never are.

    What is owed to who is not there, or by who is not, is not broken, so instances are judged in between.
    """
    spans = once(run, _spans)
    begin, end = 0, run.steps
    for column in columns:
        first, last = spans[column]
        begin, end = max(begin, first), min(end, last)
    return begin, max(begin, end)


def _spans(run: Run) -> list[tuple[int, int]]:
    return [(begin, end) for begin, end in run.spans.tolist()]


def last_seen(run: Run, columns: Iterable[int]) -> tuple[str, int] | None:
    """Return which of these agents vanishes first, before the run ends, and its last tick; None where all stay to the end."""
    column = min(columns, key=lambda k: int(run.spans[k, 1]), default=None)
    if column is None or run.spans[column, 1] >= run.steps:
        return None
    return run.agents[column].name, int(run.spans[column, 1]) - 1


def cut_off(run: Run) -> bool:
    """Return whether a simulated run lasted too short for its subject to cross.

    That is so where the duration ended the run before the rear of the subject had left the junction. Not cut off are runs without
    a subject, recordings, and runs that a collision, a fault or a vehicle off its route ended. Where positions or the size of the
    subject are not recorded, its reference point stands for its rear.
    """
    if run.subject is None or run.excerpt is not None or run.fault or run.collisions or run.facts.strayed:
        return False
    column = next(k for k, agent in enumerate(run.agents) if agent.name == run.subject)
    agent, zones = run.agents[column], run.zone[:, column]
    if (zones == Zone.GONE).any():
        return False
    if run.station is None or agent.size is None:
        return not (zones == Zone.EXIT).any()
    return bool(run.station[:, column].max() - agent.size[0] <= agent.route.length)


def crossed(run: Run) -> bool:
    """Return whether the run shows how somebody crosses: a vehicle entered the junction, and the run is not `cut_off`."""
    return bool((run.entered < run.steps).any()) and not cut_off(run)
