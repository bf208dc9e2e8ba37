"""Bodies that touch: as a simulator recorded it, else from poses and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.memo import once
from pytest_rvads.runs.run import Collision, Run

__all__ = ["close", "collide", "contacts", "overlap", "tick_of", "touch", "velocity"]


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
    """Return where the bodies of two agents overlap, shape ``(steps,)``, see `touch`."""
    pose = run.need("pose")
    sizes = run.size(one), run.size(two)
    found = np.zeros(run.steps, dtype=np.bool_)
    ticks = _candidates(run, one, two)
    if len(ticks):
        there = run.here[ticks, one] & run.here[ticks, two]
        found[ticks] = there & touch([(pose[ticks, k], size) for k, size in zip((one, two), sizes, strict=True)])
    return found


def touch(bodies: Sequence[tuple[NDArray[np.float64], tuple[float, float]]]) -> NDArray[np.bool_]:
    """Return where the rectangles of two bodies overlap, shape ``(steps,)``: no axis separates them (Gottschalk et al. 1996).

    Args:
        bodies: of each of the two its poses, shape ``(steps, 3)`` [m, m, rad], and its length and width [m].
    """
    boxes = [_box(pose, *size) for pose, size in bodies]
    apart = boxes[1][0] - boxes[0][0]
    there = np.ones(len(apart), dtype=np.bool_)
    for _, axes in boxes:
        for unit in (axes / np.hypot(axes[..., :1], axes[..., 1:])).swapaxes(0, 1):
            reach = sum(np.abs((halves * unit[:, None]).sum(axis=-1)).sum(axis=-1) for _, halves in boxes)
            there &= np.abs((apart * unit).sum(axis=-1)) < reach
    return there


def close(run: Run) -> NDArray[np.bool_]:
    """Return which pairs of agents come so close to each other that they might touch, shape ``(agents, agents)``, symmetric.

    Bodies without a size are points.

    Raises:
        RunError: the run holds no positions.
    """
    count = len(run.agents)
    found = np.zeros((count, count), dtype=np.bool_)
    for one, two in np.argwhere(np.triu(_blocks(run).near.any(axis=0), 1)).tolist():
        found[one, two] = found[two, one] = len(_candidates(run, one, two)) > 0
    return found


def _candidates(run: Run, one: int, two: int) -> NDArray[np.int64]:
    """Return the ticks, increasing, in which two agents are there, and the circles around their bodies touch or nearly so."""
    blocks = _blocks(run)
    if not blocks.near[:, one, two].any():
        return np.zeros(0, dtype=np.int64)
    ticks = (np.flatnonzero(blocks.near[:, one, two])[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
    ticks = ticks[: np.searchsorted(ticks, run.steps)]
    apart = blocks.centre[ticks, one] - blocks.centre[ticks, two]
    reach = blocks.reach[one] + blocks.reach[two]
    near = np.einsum("ij,ij->i", apart, apart) <= reach**2
    found: NDArray[np.int64] = ticks[near & run.here[ticks, one] & run.here[ticks, two]]
    return found


_BLOCK = 50
"""Ticks that are looked at together."""
_MARGIN = 1.0
"""Bodies that are this near to each other might touch [m]: more than positions are wrong by."""


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Where bodies are, roughly: circles around them, and in which blocks of ticks two may touch."""

    centre: NDArray[np.float64]
    """Of every body, shape ``(steps, agents, 2)`` [m]; while one is absent, where it appears or vanished."""
    reach: NDArray[np.float64]
    """Radius of the circle around every body, and half the margin, shape ``(agents,)`` [m]."""
    near: NDArray[np.bool_]
    """Shape ``(blocks, agents, agents)``."""


def _blocks(run: Run) -> _Blocks:
    return once(run, _find_blocks)


def _find_blocks(run: Run) -> _Blocks:
    pose, count = run.need("pose"), len(run.agents)
    sizes = np.array([agent.size or (0.0, 0.0) for agent in run.agents]).reshape(-1, 2)
    ahead = np.stack((np.cos(pose[..., 2]), np.sin(pose[..., 2])), axis=-1)
    centre = pose[..., :2] - sizes[:, :1] / 2 * ahead
    for column, (begin, end) in enumerate(run.spans.tolist()):
        centre[:begin, column] = centre[begin, column] if end > begin else 0.0
        centre[end:, column] = centre[max(end - 1, 0), column]
    moved = np.hypot(*np.moveaxis(np.diff(centre, axis=0, prepend=centre[:1]), -1, 0))
    starts = np.arange(0, run.steps, _BLOCK)
    moved[starts] = 0.0
    # Nobody is further from where it was at the start of a block than it has moved in it.
    travel = np.add.reduceat(moved, starts, axis=0) if run.steps else moved
    reach = np.hypot(*sizes.T) / 2 + _MARGIN / 2
    place, wide = centre[starts], travel + reach
    there = np.logical_or.reduceat(run.here, starts, axis=0) if run.steps else run.here
    near = np.empty((len(starts), count, count), dtype=np.bool_)
    for block in range(len(starts)):
        apart = place[block, :, None] - place[block]
        near[block] = np.hypot(apart[..., 0], apart[..., 1]) <= wide[block, :, None] + wide[block]
        near[block] &= there[block, :, None] & there[block]
    return _Blocks(centre, reach, near)


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
