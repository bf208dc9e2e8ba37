"""Finds contacts of vehicle bodies: recorded contacts, or, if the run records no contacts, computed from poses and sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ABSENT, Block, Cast, Pairs, as_blocks, signal, sized
from pytest_rvads.runs.run import Collision, Run, once

_Size = float | NDArray[np.float64]
_Body = tuple[NDArray[np.float64], tuple[_Size, _Size]]
"""Poses of a body, shape ``(steps, 3)`` [m, m, rad], and its length and width [m]."""


def contacts(run: Run) -> tuple[Collision, ...]:
    """Return the first contact of every pair of vehicles that touch, as recorded or else computed from poses and sizes."""
    if run.collisions is not None:
        return run.collisions
    collisions = []
    for agent, other in combinations(range(len(run.agents)), 2):
        touching = np.flatnonzero(overlap(run, agent, other))
        if len(touching):
            tick = int(touching[0])
            apart = (velocity(run, agent) - velocity(run, other))[tick]
            names = run.agents[agent].name, run.agents[other].name
            collisions.append(Collision(tick * run.dt, names, round(float(np.hypot(*apart)), 9)))
    return tuple(sorted(collisions, key=lambda c: c.time))


def couples(cast: Cast) -> Pairs:
    """Return all pairs of two different vehicles; a pair has no order."""
    return Pairs(list(combinations(range(len(cast)), 2)), ordered=False)


@signal(pairs=couples, needs=lambda block, columns: sized(block, columns, "pose"))
def overlap(block: Block) -> NDArray[np.bool_]:
    """Return whether the bodies of each pair overlap, see `touch`; two pedestrians never do, because people step aside."""
    both, cast, pose = block.cast.static(couples), block.cast, block.need("pose")
    rows, numbers = _close(block)
    overlaps = np.zeros((len(pose), len(both)), dtype=np.bool_)
    if len(rows):
        agents, others = both.agents[numbers], both.others[numbers]
        walks, other_walks = cast.on_foot[agents], cast.on_foot[others]

        def bodies(pairs: NDArray[np.bool_], columns: NDArray[np.int64]) -> _Body:
            column = columns[pairs]
            return pose[rows[pairs], column], (cast.length[column], cast.width[column])

        for kind, first, second, test in (
            (~walks & ~other_walks, agents, others, touch),
            (~walks & other_walks, agents, others, strikes),
            (walks & ~other_walks, others, agents, strikes),
        ):
            if kind.any():
                overlaps[rows[kind], numbers[kind]] = test([bodies(kind, first), bodies(kind, second)])
    return overlaps


def _recorded_or_bodies(block: Block, columns: Sequence[int]) -> None:
    if block.touching is None:
        sized(block, columns, "pose")


@signal(pairs=couples, needs=_recorded_or_bodies)
def collide(block: Block) -> NDArray[np.bool_]:
    """Return whether the bodies of each pair of vehicles touch; a recorded contact counts in its first state only."""
    if block.touching is None:
        return overlap(block)
    both, names = block.cast.static(couples), {agent.name: column for column, agent in enumerate(block.cast.agents)}
    collisions = np.zeros((len(block.zone), len(both)), dtype=np.bool_)
    for pair, row in block.touching:
        first, second = (names.get(name, -1) for name in pair)
        if (first, second) in both.column:
            collisions[row, both.column[first, second]] = True
    return collisions


def touch(bodies: Sequence[_Body]) -> NDArray[np.bool_]:
    """Return in which states no axis separates the rectangles of two bodies, shape ``(steps,)`` (Gottschalk 1996)."""
    centres, halves = zip(*(_box(pose, *size) for pose, size in bodies), strict=True)
    apart, sides = centres[1] - centres[0], np.concatenate(halves, axis=1)
    units = sides / np.hypot(sides[..., :1], sides[..., 1:])
    along = np.abs((sides[:, None] * units[:, :, None]).sum(axis=-1))
    reach = along.reshape(len(along), -1, 2, 2).sum(axis=-1).sum(axis=-1)
    return (np.abs((apart[:, None] * units).sum(axis=-1)) < reach).all(axis=1)


def strikes(bodies: Sequence[_Body]) -> NDArray[np.bool_]:
    """Return in which states the rectangle of a vehicle and the circle of a pedestrian overlap, shape ``(steps,)``."""
    (centres, halves), (middles, around) = (_box(pose, *size) for pose, size in bodies)
    reach, radius = np.hypot(halves[..., 0], halves[..., 1]), np.hypot(around[:, 0, 0], around[:, 0, 1])
    along = np.abs(((middles - centres)[:, None] * halves).sum(axis=-1)) / reach
    return np.hypot(*np.maximum(along - reach, 0.0).T) < radius


def close(run: Run) -> NDArray[np.bool_]:
    """Return which pairs of agents come so close in some state that they might touch, shape ``(agents, agents)``, symmetric."""
    close_pairs = np.zeros((len(run.agents), len(run.agents)), dtype=np.bool_)
    for block in once(run, as_blocks):
        both, (_, numbers), columns = block.cast.static(couples), _close(block), np.array(list(block.columns), dtype=np.int64)
        agents, others = columns[both.agents[numbers]], columns[both.others[numbers]]
        close_pairs[agents, others] = close_pairs[others, agents] = True
    return close_pairs


_BLOCK = 50
"""Number of ticks in a span; nearness is first checked for whole spans, and then for the ticks of spans with near vehicles."""
_MARGIN = 1.0
"""Distance below which two bodies might touch [m]; the errors of positions are smaller."""


@signal
def headings(block: Block) -> NDArray[np.float64]:
    """Return the unit vector of the heading of each vehicle, shape ``(n, agents, 2)``."""
    heading = block.need("pose")[..., 2]
    units = np.empty((*heading.shape, 2))
    units[..., 0], units[..., 1] = np.cos(heading), np.sin(heading)
    return units


def _circles(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return circles around bodies: centres behind the fronts and radii [m], and per pair the squared sum of radii [m^2]."""
    length, width, both = np.nan_to_num(cast.length), np.nan_to_num(cast.width), cast.static(couples)
    radius = np.hypot(length, width) / 2 + _MARGIN / 2
    return length / 2, radius, (both.first(radius) + both.second(radius)) ** 2


@signal
def _close(block: Block) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows (states) and the numbers of pairs of vehicles where circles around the two bodies touch or nearly touch."""
    pose, both, (half, radius, squares) = block.need("pose"), block.cast.static(couples), block.cast.static(_circles)
    centre = pose[..., :2] - half[:, None] * headings(block)
    if len(pose) > _BLOCK:
        starts, place, recorded = np.arange(0, len(centre), _BLOCK), centre.copy(), block.zone != ABSENT
        for column in np.flatnonzero(recorded.any(axis=0) & ~recorded.all(axis=0)).tolist():
            ticks = np.flatnonzero(recorded[:, column])
            place[: ticks[0], column], place[ticks[-1] :, column] = centre[ticks[0], column], centre[ticks[-1], column]
        moved = np.hypot(*np.moveaxis(np.diff(place, axis=0, prepend=place[:1]), -1, 0))
        moved[starts] = 0.0
        # The distance of a vehicle from its place at the start of a span is at most the distance that it moves in the span.
        wide = np.add.reduceat(moved, starts, axis=0) + radius
        present, place = np.logical_or.reduceat(block.here, starts, axis=0), place[starts]
        apart = place[:, both.agents] - place[:, both.others]
        near_in_span = np.hypot(apart[..., 0], apart[..., 1]) <= both.first(wide) + both.second(wide)
        near_in_span &= both.first(present) & both.second(present)
        rows, numbers = np.nonzero(np.repeat(near_in_span, _BLOCK, axis=0)[: len(pose)])
        apart = centre[rows, both.agents[numbers]] - centre[rows, both.others[numbers]]
        near = np.einsum("ij,ij->i", apart, apart) <= squares[numbers]
        rows, numbers = rows[near], numbers[near]
    else:
        apart = centre.take(both.agents, axis=1) - centre.take(both.others, axis=1)
        rows, numbers = np.nonzero(np.einsum("ijk,ijk->ij", apart, apart) <= squares)
    present = block.here[rows, both.agents[numbers]] & block.here[rows, both.others[numbers]]
    return rows[present], numbers[present]


def _box(pose: NDArray[np.float64], length: _Size, width: _Size) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres of a body, shape ``(steps, 2)``, and its half axes along and across, shape ``(steps, 2, 2)`` [m]."""
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    across = np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1)
    long, wide = (np.asarray(size)[..., None] / 2 for size in (length, width))
    return pose[:, :2] - long * ahead, np.stack((long * ahead, wide * across), axis=1)


def velocity(run: Run, agent: int) -> NDArray[np.float64]:
    """Return the velocity of an agent, shape ``(steps, 2)`` [m/s]; zero where speeds are not recorded."""
    if run.speed is None:
        return np.zeros((run.steps, 2))
    heading = run.need("pose")[:, agent, 2]
    return run.speed[:, agent, None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)


_DOUBT = 1e-6
"""Largest computed gap between two bodies that counts as contact [m]."""


class Box(NamedTuple):
    """The rectangle of a body, given by the middle of its front edge."""

    x: float
    """East coordinate of the middle of the front [m]."""
    y: float
    """North coordinate of the middle of the front [m]."""
    heading: float
    """Heading of the body, counter-clockwise from east [rad]."""
    length: float
    """Length of the body [m]."""
    width: float
    """Width of the body [m]."""


def gap(body: Box, other: Box) -> float:
    """Return a lower bound of the distance between two bodies [m]; the bound is 0 or negative if the bodies touch."""
    _, _, heading, length, width = body
    _, _, other_heading, other_length, other_width = other
    cos, sin, other_cos, other_sin = math.cos(heading), math.sin(heading), math.cos(other_heading), math.sin(other_heading)
    long, half, other_long, other_half = length / 2, width / 2, other_length / 2, other_width / 2
    x = (other.x - other_long * other_cos) - (body.x - long * cos)
    y = (other.y - other_long * other_sin) - (body.y - long * sin)
    round_gap = math.hypot(x, y) - math.hypot(long, half) - math.hypot(other_long, other_half)
    if round_gap > _DOUBT:
        return round_gap
    along, across = abs(cos * other_cos + sin * other_sin), abs(cos * other_sin - sin * other_cos)
    return max(
        abs(x * cos + y * sin) - long - other_long * along - other_half * across,
        abs(y * cos - x * sin) - half - other_long * across - other_half * along,
        abs(x * other_cos + y * other_sin) - other_long - long * along - half * across,
        abs(y * other_cos - x * other_sin) - other_half - long * across - half * along,
    )
