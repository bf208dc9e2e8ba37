"""Junctions from the turn and the length of their movements: a shape for recordings that hold no positions.

Arms stand at right angles and approaches are straight. A movement goes straight up to a bend and on from it; the bend
is an arc as wide as fits. The distances of the vertices from the middle and the lateral place of the lanes are those
that give the recorded lengths best, and, where several do, the most even ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import opposite_pairs, right_of_pairs
from pytest_rvads.geometry.control import JunctionControl, Sign, phase_groups
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Movement, cross
from pytest_rvads.support.errors import MapError

APPROACH = 120.0
"""Length of approaches and exit roads [m]."""
TOLERANCE = 2.5
"""A movement may be this much longer or shorter than recorded [m]."""
_SHORTEST = 1.0
"""The way before and after the corner of a movement is longer than this [m]."""
_EVEN = 0.05
"""Weight of evenness against the recorded lengths."""
_SPACING = 0.25
_ANGLE = {Turn.RIGHT: 1, Turn.STRAIGHT: 2, Turn.LEFT: 3}
"""Quarter turns, counter-clockwise, from the arm of the entrance to that of the exit."""

Lengths = Mapping[tuple[int, int], tuple[Turn, float]]
"""Turn and length [m] of every movement, by entrance and exit."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Where the vertices of a junction lie."""

    quarters: tuple[int, ...]
    """Per arm its direction in quarter turns, counter-clockwise from the south."""
    entrances: tuple[float, ...]
    """Per arm the distance of the entrance vertex from the middle [m]."""
    exits: tuple[float, ...]
    """Per arm the distance of the exit vertex from the middle [m]."""
    lane: float
    """Middle of the road to the centre of a lane [m]."""

    def legs(self, entrance: int, exit: int, turn: Turn) -> tuple[float, float]:
        """Return the way before and after the corner of a movement [m]."""
        aside = {Turn.RIGHT: -self.lane, Turn.STRAIGHT: 0.0, Turn.LEFT: self.lane}[turn]
        return self.entrances[entrance] + aside, self.exits[exit] + aside

    def length(self, entrance: int, exit: int, turn: Turn) -> float:
        """Return the length of a movement with the widest bend [m]."""
        one, two = self.legs(entrance, exit, turn)
        return one + two - (0.0 if turn is Turn.STRAIGHT else (2.0 - math.pi / 2) * min(one, two))


def fit_shape(lengths: Lengths, ways: int) -> Shape:
    """Return the shape whose movements have the lengths given, in the sense of least squares."""
    quarters = _quarters(lengths, ways)
    keys = sorted(lengths)
    wanted = np.array([lengths[key][1] for key in keys])
    start = float(np.mean([length for turn, length in lengths.values() if turn is Turn.STRAIGHT] or [wanted.mean()])) / 2
    x = np.array([start] * (2 * ways) + [start / 4])

    def shape(values: NDArray[np.float64]) -> Shape:
        numbers = [float(v) for v in values]
        return Shape(quarters, tuple(numbers[:ways]), tuple(numbers[ways : 2 * ways]), numbers[-1])

    def error(values: NDArray[np.float64]) -> NDArray[np.float64]:
        found = shape(values)
        misfit = [found.length(i, k, lengths[i, k][0]) for i, k in keys] - wanted
        return np.concatenate((misfit, _EVEN * (values[:-1] - values[:-1].mean())))

    for _ in range(50):  # Gauss and Newton; the lengths are linear but for the choice of the shorter leg
        now = error(x)
        slope = np.column_stack([(error(x + 1e-6 * unit) - now) / 1e-6 for unit in np.eye(len(x))])
        step = np.linalg.lstsq(slope, -now, rcond=None)[0]
        x = x + step
        if float(np.abs(step).max()) < 1e-9:
            break
    found = shape(x)
    for i, k in keys:
        turn, length = lengths[i, k]
        fitted = found.length(i, k, turn)
        if abs(fitted - length) > TOLERANCE or min(found.legs(i, k, turn)) <= _SHORTEST:
            raise MapError(
                f"no junction with arms at right angles has these lengths: {length:g} m from entrance {i} to exit {k} "
                f"({turn}) comes out as {fitted:.2f} m; up to {TOLERANCE:g} m may be missing, and every leg needs {_SHORTEST:g} m"
            )
    return found


def build_junction(name: str, control: JunctionControl, lengths: Lengths, ways: int) -> Junction:
    """Return a junction to drive on."""
    shape = fit_shape(lengths, ways)
    turns = {key: turn for key, (turn, _) in lengths.items()}
    movements = {}
    for key, turn in turns.items():
        path = _movement(shape, *key, turn)
        movements[key] = Movement(*key, turn, path.length, path.id, path)
    opposite = opposite_pairs(turns)
    entrances, exits = cross(
        (Sign(control.value),) * ways,
        phase_groups=phase_groups(range(ways), opposite) if control is JunctionControl.LIGHTS else (),
        approaches=[_road(f"in{arm}", shape, arm, True) for arm in range(ways)],
        roads=[_road(f"out{arm}", shape, arm, False) for arm in range(ways)],
    )
    return Junction(name, name, entrances, exits, movements, right_of_pairs(turns, left_hand=False), opposite)


def _quarters(lengths: Lengths, ways: int) -> tuple[int, ...]:
    """Return the direction of every arm from the turns, after checking that all turns agree on it."""
    wanted = {(i, k) for i in range(ways) for k in range(ways) if i != k}
    if set(lengths) != wanted:
        raise MapError(f"a {ways}-way junction needs a movement from every entrance to every other arm, got {sorted(lengths)}")
    quarters = (0, *(_ANGLE[lengths[0, k][0]] for k in range(1, ways)))
    if list(quarters) != sorted(set(quarters)):
        turns = ", ".join(str(lengths[0, k][0]) for k in range(1, ways))
        raise MapError(f"entrances must be counted counter-clockwise; from the first one the ways to the others turn {turns}")
    if any((quarters[k] - quarters[i]) % 4 != _ANGLE[turn] for (i, k), (turn, _) in lengths.items()):
        shown = {f"{i}->{k}": str(turn) for (i, k), (turn, _) in sorted(lengths.items())}
        raise MapError(f"these turns do not go with arms at right angles: {shown}")
    return quarters


def _movement(shape: Shape, entrance: int, exit: int, turn: Turn) -> Segment:
    """Return the centre line of a movement: straight, bend, straight."""
    one, two = shape.legs(entrance, exit, turn)
    id = f"{entrance}to{exit}"
    if turn is Turn.STRAIGHT:
        return Segment(id, _place(shape, entrance, [(0.0, 0.0), (one + two, 0.0)]), turn, "site")
    radius = min(one, two)
    side = 1.0 if turn is Turn.LEFT else -1.0
    count = math.ceil(radius * math.pi / 2 / _SPACING)
    angles = [math.pi / 2 * k / count for k in range(count + 1)]
    ahead = one - radius
    points = [(ahead + radius * math.sin(a), side * radius * (1.0 - math.cos(a))) for a in angles]
    points = [(0.0, 0.0), *points] if ahead > 1e-9 else points
    if two - radius > 1e-9:
        points.append((one, side * two))
    return Segment(id, _place(shape, entrance, points), turn, "site")


def _road(id: str, shape: Shape, arm: int, inbound: bool) -> Segment:
    if inbound:
        return Segment(id, _place(shape, arm, [(-APPROACH, 0.0), (0.0, 0.0)]))
    # Outbound, seen from the entrance of the same arm: two lanes to the left, and the other way round.
    start, left = shape.entrances[arm] - shape.exits[arm], 2.0 * shape.lane
    return Segment(id, _place(shape, arm, [(start, left), (start - APPROACH, left)]))


def _place(shape: Shape, arm: int, points: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Return points given ahead of the entrance vertex and to its left, on the map."""
    outward = -math.pi / 2 + shape.quarters[arm] * math.pi / 2
    cos, sin = math.cos(outward + math.pi), math.sin(outward + math.pi)
    # The entrance lane lies right of the middle for who drives inward.
    x = -shape.entrances[arm] * cos + shape.lane * sin
    y = -shape.entrances[arm] * sin - shape.lane * cos
    return np.array([(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in points])
