"""Bodies that touch: as a simulator recorded it, else from poses and sizes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.predicates import once
from pytest_rvads.runs.run import Collision, Run

__all__ = ["collide", "contacts", "overlap", "tick_of", "velocity"]


def contacts(run: Run) -> tuple[Collision, ...]:
    """Return who touched whom for the first time and when: what was recorded, else what poses and sizes say.

    Raises:
        RunError: nothing was recorded, and the run holds no positions or no sizes.
    """
    return once(run, _contacts) if run.collisions is None else run.collisions


def _contacts(run: Run) -> tuple[Collision, ...]:
    found = []
    for one, two in combinations(range(len(run.agents)), 2):
        touching = np.flatnonzero(overlap(run, one, two))
        if len(touching):
            tick = int(touching[0])
            apart = (velocity(run, one) - velocity(run, two))[tick]
            names = run.agents[one].name, run.agents[two].name
            found.append(Collision(tick * run.dt, names, round(float(np.hypot(*apart)), 9)))
    return tuple(sorted(found, key=lambda c: c.time))


def collide(run: Run, one: int, two: int) -> NDArray[np.bool_]:
    """The bodies of two agents touch, for the first time where a simulator recorded it."""
    if run.collisions is None:
        return overlap(run, one, two)
    pair = {run.agents[one].name, run.agents[two].name}
    found = np.zeros(run.steps, dtype=np.bool_)
    for collision in run.collisions:
        if set(collision.agents) == pair:
            found[tick_of(run, collision)] = True
    return found


def tick_of(run: Run, collision: Collision) -> int:
    """Return the tick of a collision."""
    return min(max(round(collision.time / run.dt), 0), run.steps - 1)


def overlap(run: Run, one: int, two: int) -> NDArray[np.bool_]:
    """Return where the rectangles of two bodies overlap, shape ``(steps,)``: no axis separates them (Gottschalk et al. 1996)."""
    pose = run.need("pose")
    there: NDArray[np.bool_] = run.here[:, one] & run.here[:, two]
    boxes = [_box(pose[:, k], *run.size(k)) for k in (one, two)]
    apart = boxes[1][0] - boxes[0][0]
    for _, axes in boxes:
        for unit in (axes / np.hypot(axes[..., :1], axes[..., 1:])).swapaxes(0, 1):
            reach = sum(np.abs((halves * unit[:, None]).sum(axis=-1)).sum(axis=-1) for _, halves in boxes)
            there &= np.abs((apart * unit).sum(axis=-1)) < reach
    return there


def _box(pose: NDArray[np.float64], length: float, width: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centres, shape ``(steps, 2)``, and half axes along and across, shape ``(steps, 2, 2)`` [m]."""
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    left = np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1)
    return pose[:, :2] - length / 2 * ahead, np.stack((length / 2 * ahead, width / 2 * left), axis=1)


def velocity(run: Run, agent: int) -> NDArray[np.float64]:
    """Return the velocity of an agent, shape ``(steps, 2)`` [m/s]; zero where speeds are not recorded."""
    if run.speed is None:
        return np.zeros((run.steps, 2))
    heading = run.need("pose")[:, agent, 2]
    found: NDArray[np.float64] = run.speed[:, agent, None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    return found
