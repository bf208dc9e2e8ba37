"""The vehicles near the junction at the same time, in runs whose vehicles come and go.

Instances of rules are about vehicles that are `together`: near the junction at the same time, or anywhere so close to each other
that they might touch. No other vehicles can violate a shipped rule together:

- p1, p2, p3, p5, p6, p6g, first_come, right_first are about two vehicles in their stop places or in the junction at the same
time, and vehicles there are near. The obligations of these rules end while both vehicles are present, see `window`.
- no_conflict: a vehicle that meets another vehicle is on a stretch of its movement, so part of its body is in the junction.
- left_yields, yield_sign, priority, right_before_left, merge, right_on_red: a vehicle at its entrance or inside owes the way to a
vehicle at its entrance or inside, or to a vehicle that would reach a stretch after the entrance within `priority.DUE`, 4 s, which
is nearer than `NEAR_TIME`.
- no_collision: bodies that touch are closer than any other bodies.
- p4, red, full_stop, keep_clear, progress, keep_lane, on_lane_allowed, on_route and speed_limit are about one vehicle. The
vehicles that it waits for, or that follow it, are looked up on the run, not among instances.

Because only vehicles that are together have instances about pairs, the cost of judging grows with the traffic, and not with its
square.

`without_jumps` prepares coarse recordings: it fills in the zones that vehicles pass between two states.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.bodies import close
from pytest_rvads.logic.conduct.memo import once
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.periods import NEAR, NEAR_TIME
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone

__all__ = ["crossed", "cut_off", "judged", "last_seen", "near", "together", "window", "without_jumps"]


def judged(run: Run) -> frozenset[int] | None:
    """Return the columns of the agents whose instances are judged in this run; None if all agents are judged."""
    if run.excerpt is None or run.excerpt.judged is None:
        return None
    names = set(run.excerpt.judged)
    return frozenset(column for column, agent in enumerate(run.agents) if agent.name in names)


def together(run: Run) -> frozenset[tuple[int, int]] | None:
    """Return the pairs of agents that instances are about, by column, in both orders; None if no agent is ever absent.

    If positions are not recorded, the pairs are the agents that are in the run at the same time.
    """
    if not (run.zone == Zone.ABSENT).any():
        return None
    begin, end = run.spans.T if run.station is None else near(run).T
    pairs = np.minimum(end[:, None], end) > np.maximum(begin[:, None], begin)
    if run.pose is not None:
        pairs |= close(run)
    return frozenset((agent, other) for agent, other in np.argwhere(pairs).tolist() if agent != other)


def near(run: Run) -> NDArray[np.int64]:
    """Return every agent's first tick near the junction and the tick after the last, shape ``(agents, 2)``; (0, 0) if none.

    An agent is near from `NEAR` before its stopping line on, or from `NEAR_TIME` at its speed before the line on. It stays near
    until its whole body has left.

    Raises:
        RunError: the run does not record positions.
    """
    spans = np.zeros((len(run.agents), 2), dtype=np.int64)
    for column, agent in enumerate(run.agents):
        begin, end = run.spans[column]
        station = run.need("station")[begin:end, column]
        speed = np.zeros_like(station) if run.speed is None else run.speed[begin:end, column]
        reach = np.maximum(NEAR, NEAR_TIME * np.maximum(speed, 0.0))
        end_of_stay = agent.way.length + max(LEAVE, agent.size[0] if agent.size else 0.0)
        near_line = (
            (station >= -run.junction.setbacks[agent.entrance] - reach) & (station <= end_of_stay) & run.here[begin:end, column]
        )
        ticks = np.flatnonzero(near_line)
        if len(ticks):
            spans[column] = begin + ticks[0], begin + ticks[-1] + 1
    return spans


def window(run: Run, columns: Iterable[int]) -> tuple[int, int]:
    """Return the first tick with all these agents in the run, and the tick after the last; two equal ticks if there is none.

    Instances are judged between the two ticks: no obligation towards an absent vehicle, or of an absent vehicle, is broken.
    """
    spans = once(run, _spans)
    begin, end = 0, run.steps
    for column in columns:
        begins, ends = spans[column]
        begin, end = max(begin, begins), min(end, ends)
    return begin, max(begin, end)


def _spans(run: Run) -> list[tuple[int, int]]:
    return [(begin, end) for begin, end in run.spans.tolist()]


def last_seen(run: Run, columns: Iterable[int]) -> tuple[str, int] | None:
    """Return the first of these agents to vanish before the run ends, and its last tick; None if all stay to the end."""
    column = min(columns, key=lambda k: int(run.spans[k, 1]), default=None)
    if column is None or run.spans[column, 1] >= run.steps:
        return None
    return run.agents[column].name, int(run.spans[column, 1]) - 1


def cut_off(run: Run) -> bool:
    """Return whether a simulated run was too short for its subject to cross.

    The run was too short if its duration ended it before the rear of the subject had left the junction. Runs without a subject,
    recordings, and runs that a collision, a fault or a vehicle off its route ended are not cut off. If positions or the size of
    the subject are not recorded, the reference point of the subject stands for its rear.
    """
    if run.subject is None or run.excerpt is not None or run.fault or run.collisions or run.facts.strayed:
        return False
    column = next(k for k, agent in enumerate(run.agents) if agent.name == run.subject)
    agent, zones = run.agents[column], run.zone[:, column]
    if (zones == Zone.GONE).any():
        return False
    if run.station is None or agent.size is None:
        return not (zones == Zone.EXIT).any()
    return bool(run.station[:, column].max() - agent.size[0] <= agent.way.length)


def crossed(run: Run) -> bool:
    """Return whether the run shows a crossing: a vehicle entered the junction, and the run is not `cut_off`."""
    return bool((run.entered < run.steps).any()) and not cut_off(run)


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
