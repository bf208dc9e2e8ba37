"""Finds the way (path through a junction) that a recorded agent took, and computes the agent's track along this way.

The way of a vehicle is the way nearest to its whole track. If several ways are equally near, the way is not decided. The track
of a matched vehicle is computed from the samples of a log: station, speed, and the accuracy of both.

A pedestrian is in the recording while it is on a crosswalk, or on the sidewalk before or behind the crosswalk. A pedestrian who
walks over several crosswalks is several agents. The body of a pedestrian is a circle of the diameter `PERSON`, whatever size the
log states. The reference point is the front of this circle in the direction of the crossing. The recorded heading and speed are
not used: the heading is that of the crossing, and the speed follows from the positions. So a pedestrian who turns back keeps its
crossing, and its speed becomes negative.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import PERSON, SIDEWALK, Crossing, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Track
from pytest_rvads.runs.smoothing import QUIET, delay, linkage, roughness, smoothed
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.tracks.samples import Samples

_Values = NDArray[np.float64]

_FOLLOWED_APPROACH = 150.0
"""Distance before the stopping line from which a vehicle is followed [m]."""
FAR = 3.0
"""Largest root mean square of the distances between the points of a track and its way [m]: about the width of a lane, because
some vehicles change lanes late."""
_STANDING = 1.75
"""Largest distance from its way of a vehicle that never moves [m]: half the width of a lane. Farther away it is parked."""
_FARTHEST_SAMPLE = 6.0
"""Largest distance between a sample and a way [m]; a sample farther away lies on another road."""
_DECISIVE_APPROACH = 50.0
"""Distance before the entrance vertex from which a track is compared with ways [m]; earlier, the vehicle can change lanes."""
_LEAST_DIFFERENCE = 0.5
"""If the root mean square distances of a track from the two nearest ways differ by less than this [m], its way is unknown."""
STEP = 2.0
"""Distance between the points of a track that are compared with ways [m]; a vehicle that stands adds no points."""
_GAP = 2.0
"""A track is cut at a gap between samples that is longer than this [s] and longer than five usual times between samples."""
_LONGEST_GAP = 10.0
"""A track with rare samples is cut at a longer gap [s], because the position of the vehicle in the gap is unknown."""
_AGAINST = -0.3
"""Least cosine of the angle between the headings of a vehicle and of a way at which the vehicle can be on the way."""
_EXACT = 0.005
"""Standard deviation of positions below which positions count as exact [m]: rounding to two decimals has a smaller deviation."""
_CHANCE = 1.25
"""Largest `linkage` that a few vehicles with independent errors can show."""
_BODY = 5.0
"""Length that is assumed for a vehicle without a recorded length [m]. While any part of this length is in a bend, recorded speeds
can differ from the speed of the front bumper, because the front bumper follows another line than the recorded point."""
_WIDE = 200.0
"""Least radius of a bend that counts as straight [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """A pass of a vehicle through a junction, with the way that it was matched to."""

    way: Itinerary
    rows: slice
    """The samples of the vehicle that lie on the way."""
    station: _Values
    """Station of each of these samples, shape ``(rows,)`` [m]."""
    lateral: _Values
    """Distance of each of these samples from the way, positive to the left, shape ``(rows,)`` [m]."""
    offset: float
    """Root mean square of the lateral distance over points at equal distances along the track [m]."""
    other_exits: tuple[int, ...] = ()
    """Exits of the other ways that are equally near."""
    doubt: str = ""
    """The reason why the way is not decided; empty if it is."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """The centre line of a way as straight pieces."""

    way: Itinerary
    start: _Values
    """Start of each piece, shape ``(pieces, 2)`` [m]."""
    ahead: _Values
    """Direction of each piece as a unit vector, shape ``(pieces, 2)``."""
    station: _Values
    """Station of the start of each piece, shape ``(pieces,)`` [m]."""
    long: _Values
    """Length of each piece, shape ``(pieces,)`` [m]."""

    @classmethod
    def of(cls, way: Itinerary) -> Line:
        """Return the centre line of a way."""
        points, station = way.path.points, way.path.stations - way.origin
        long = np.diff(station)
        return cls(way, points[:-1], np.diff(points, axis=0) / long[:, None], station[:-1], long)

    def project(self, points: _Values, heading: _Values | None = None) -> tuple[_Values, _Values]:
        """Project each point onto the nearest piece of the line that does not lead against the heading of the vehicle.

        The results are stations, and distances from the line, positive to the left [m]. A distance is infinite if every piece
        leads against the heading [rad]; without a heading, every piece can be the nearest.
        """
        facing = None if heading is None else np.stack((np.cos(heading), np.sin(heading)), axis=1)
        station, offset = np.empty(len(points)), np.empty(len(points))
        for begin in range(0, len(points), _BATCH):
            block = slice(begin, begin + _BATCH)
            apart = points[block, None, :] - self.start
            along = np.clip((apart * self.ahead).sum(axis=2), 0.0, self.long)
            apart -= along[:, :, None] * self.ahead
            squared = (apart**2).sum(axis=2)
            if facing is not None:
                squared[facing[block] @ self.ahead.T < _AGAINST] = np.inf
            best = squared.argmin(axis=1)
            rows = np.arange(len(best))
            ahead, beside = self.ahead[best], apart[rows, best]
            side = ahead[:, 0] * beside[:, 1] - ahead[:, 1] * beside[:, 0]
            station[block] = self.station[best] + along[rows, best]
            offset[block] = np.copysign(np.sqrt(squared[rows, best]), side)
        return station, offset


_BATCH = 1000
"""Number of points that are projected together."""


class Matcher:
    """Matches vehicles to the ways through a junction."""

    def __init__(self, junction: Junction) -> None:
        self.lines = [Line.of(Itinerary.through(junction, *key)) for key in sorted(junction.movements)]
        inner = np.vstack([movement.path.points for movement in junction.movements.values() if movement.path is not None])
        self.centre = inner.mean(axis=0)
        self._radius = float(np.hypot(*(inner - self.centre).T).max()) + _DECISIVE_APPROACH

    def match(self, vehicle: Samples, points: _Values, heading: _Values) -> Iterator[Matched | str]:
        """Yield each pass of a vehicle through the junction, or the reason why nothing is known of its way.

        If several ways from the same entrance are equally near, a pass is on the nearest of them, and has a `Matched.doubt`. The
        points are the middle of the front bumper in each sample, shape ``(samples, 2)`` [m].
        """
        if float(np.hypot(*(points - self.centre).T).min()) > self._radius:
            yield NEVER
            return
        for piece in unbroken(vehicle.times):
            yield from self._passes(points[piece], heading[piece], piece.start)

    def _passes(self, points: _Values, heading: _Values, first: int) -> Iterator[Matched | str]:
        """Yield the passes, or reasons, of a part of a track without gaps, whose first sample has the number `first`."""
        if len(points) < 2:
            yield ONCE
            return
        picked = evenly_spaced(points)
        projections = [line.project(points[picked], heading[picked]) for line in self.lines]
        station, offset = (np.array(values) for values in zip(*projections, strict=True))  # (ways, picked)
        # A point counts as inside the junction if its projection onto the nearest way lies between entrance and exit.
        nearest = np.abs(offset).argmin(axis=0)
        column = np.arange(len(picked))
        lengths = np.array([line.way.length for line in self.lines])
        nearest_station = station[nearest, column]
        inside = (
            (np.abs(offset[nearest, column]) <= _FARTHEST_SAMPLE) & (nearest_station > 0.0) & (nearest_station < lengths[nearest])
        )
        numbers = np.flatnonzero(inside)
        if not len(numbers) and not bool(((np.abs(offset) <= _FARTHEST_SAMPLE) & (station <= 0.0)).any()):
            yield BEHIND if bool((np.abs(offset) <= _FARTHEST_SAMPLE).any()) else NEVER
            return
        exits = np.flatnonzero(np.diff(numbers) > _SHORTEST_ABSENCE / STEP)
        cuts = (numbers[exits] + numbers[exits + 1]) // 2
        bounds = [0, *picked[cuts].tolist(), len(points)]
        for begin, end in pairwise(bounds):
            of_pass = (picked >= begin) & (picked < end)
            chosen, doubt = self._choose(station[:, of_pass], offset[:, of_pass])
            match = _match_along(chosen[0], points[begin:end], heading[begin:end], first + begin) if chosen else doubt
            others = tuple(line.way.exit for line in chosen[1:])
            yield (doubt or match) if isinstance(match, str) else replace(match, other_exits=others, doubt=doubt)

    def _choose(self, station: _Values, offset: _Values) -> tuple[list[Line], str]:
        """Return the ways from one entrance that a pass can be on, nearest first, and the reason if it is not a single way.

        Stations and offsets of the points of the pass on each way have the shape ``(ways, points)`` [m].
        """
        ends = np.array([line.way.end for line in self.lines])[:, None]
        starts = np.array([max(-line.way.origin, -_DECISIVE_APPROACH) for line in self.lines])[:, None]
        on_way = (np.abs(offset) <= _FARTHEST_SAMPLE) & (station > starts) & (station < ends)
        near = on_way.any(axis=0)
        apart = np.minimum(np.abs(offset[:, near]), _OFF_DISTANCE)
        cost = np.sqrt((apart**2).sum(axis=1) / max(apart.shape[1], 1))
        order = np.argsort(cost, kind="stable")
        best = int(order[0])
        if not near.any():
            return [], NEVER
        if cost[best] > (FAR if offset.shape[1] > 1 else _STANDING):
            return [], BESIDE if offset.shape[1] > 1 else PARKED
        stations_of_best = station[best][on_way[best]]
        if not len(stations_of_best) or stations_of_best[0] >= 0.0:
            return [], BEHIND
        nearest = [self.lines[k] for k in order if cost[k] - cost[best] < _LEAST_DIFFERENCE]
        if len(nearest) == 1 or stations_of_best[-1] >= self.lines[best].way.length:
            return nearest[:1], ""
        doubt = BEFORE if stations_of_best[-1] <= 0.0 else UNCLEAR
        return (nearest if len({line.way.entrance for line in nearest}) == 1 and len(nearest) <= _MOST_WAYS else []), doubt


_MOST_WAYS = 6
"""Most ways between which a vehicle can be undecided, because all combinations of the ways of two vehicles are judged."""
NEVER = "it never comes near the junction"
ONCE = "it is seen once"
PARKED = f"it stands more than {_STANDING:g} m beside every way through the junction"
BEFORE = "its way is not known: the track ends before the junction"
BEHIND = "its way is not known: the track begins in the junction or behind it"
UNCLEAR = "its way is not known: the track ends in the junction, and several ways are equally near"
BESIDE = f"it is more than {FAR:g} m away from every way through the junction"
_OFF_DISTANCE = 10.0
"""A point farther away from a way counts as if it had this distance, so that single points do not decide on the way [m]."""


def directions(points: _Values) -> _Values:
    """Return the headings of a vehicle, derived from its positions, shape ``(samples,)`` [rad].

    A standing vehicle keeps its heading; the headings of a vehicle that never moves by `STEP` are 0.
    """
    picked = evenly_spaced(points)
    if len(picked) < 2:
        return np.zeros(len(points))
    along = np.gradient(points[picked], axis=0)
    angle = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    headings: _Values = np.interp(np.arange(len(points)), picked, angle)
    return headings


def evenly_spaced(points: _Values) -> NDArray[np.int64]:
    """Return the numbers of samples of a track that are at least `STEP` apart, beginning with the first sample."""
    picked, (x, y) = [0], points[0].tolist()
    for k, (px, py) in enumerate(points.tolist()):
        if (px - x) ** 2 + (py - y) ** 2 >= STEP**2:
            picked.append(k)
            x, y = px, py
    return np.array(picked)


def unbroken(times: _Values) -> list[slice]:
    """Return the parts of a track between long gaps, given the times of its samples [s]."""
    steps = np.diff(times)
    limit = min(max(_GAP, 5.0 * float(np.median(steps))), _LONGEST_GAP) if len(steps) else _GAP
    bounds = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(times)]
    return [slice(begin, end) for begin, end in pairwise(bounds)]


_SHORTEST_ABSENCE = 20.0
"""Least distance driven outside of the junction between two passes [m]; after a shorter distance, the same pass goes on."""


def _match_along(line: Line, points: _Values, heading: _Values, first: int) -> Matched | str:
    """Return the samples of a pass around the crossing of the entrance vertex for which the vehicle was always on the way.

    The result is the reason if these samples do not begin before the junction.
    """
    way = line.way
    station, lateral = line.project(points, heading)
    low, high = max(-way.origin, way.line - _FOLLOWED_APPROACH), way.end
    on = (np.abs(lateral) <= _FARTHEST_SAMPLE) & (station > low) & (station < high)
    crossed = np.flatnonzero(on & (station > 0.0))
    crossing = int(crossed[0]) if len(crossed) else int(np.flatnonzero(on)[-1])
    off = np.flatnonzero(~on)
    before, after = off[off < crossing], off[off > crossing]
    rows = slice(int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(points))
    station, lateral = station[rows], lateral[rows]
    if len(station) < 2 or station[0] >= 0.0:
        return BEHIND
    picked = evenly_spaced(points[rows])
    offset = float(np.sqrt((lateral[picked] ** 2).mean()))
    return Matched(way, slice(first + rows.start, first + rows.stop), station, lateral, offset)


def accuracy_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the standard deviation of a coordinate, estimated from the roughness of the tracks [m]; 0 if positions are exact.

    The roughness of a sequence is the standard deviation of the noise that its third differences show. Noise of positions makes
    stations and lateral offsets rough. Braking makes stations rough even without noise. A simulator that moves vehicles exactly
    along their ways makes lateral offsets smooth. So the smaller of the two values is taken for each vehicle, and the estimate is
    the median over all vehicles.
    """
    estimates = []
    for vehicle, match in matches:
        times = vehicle.times[match.rows]
        estimates.append(min(roughness(times, match.station), roughness(times, match.lateral)))
    estimate = float(np.median(estimates)) if estimates else 0.0
    return estimate if estimate >= _EXACT else 0.0


def noise_of(matches: Sequence[tuple[Samples, Matched]], linked: float = 1.0) -> float:
    """Return the standard deviation of a recorded speed, estimated from the roughness of the speeds and their linkage [m/s].

    The result is 0 if the speeds are exact or the log has no speeds.
    """
    estimates = [
        roughness(vehicle.times[match.rows], vehicle.speed[match.rows]) for vehicle, match in matches if vehicle.speed is not None
    ]
    estimate = linked * float(np.median(estimates)) if estimates else 0.0
    return estimate if estimate > QUIET else 0.0


def linkage_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the `linkage` of the errors of lateral offsets, the median over all vehicles; 1 if it can be due to chance.

    Vehicles keep their lateral offsets, so that only errors change the offsets within a second. A tracker links the errors of
    positions and speeds alike.
    """
    estimate = float(np.median([linkage(vehicle.times[match.rows], match.lateral) for vehicle, match in matches] or [1.0]))
    return estimate if estimate > _CHANCE else 1.0


def delay_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return by how much the recorded speeds lag behind the recorded positions, estimated from all vehicles [s]."""
    delays = [
        delay(vehicle.times[match.rows], match.station, vehicle.speed[match.rows], _straight(match))
        for vehicle, match in matches
        if vehicle.speed is not None
    ]
    weight = math.fsum(weight for _, weight in delays)
    return math.fsum(late * weight for late, weight in delays) / weight if weight else 0.0


def track_of(
    agent: Agent,
    vehicle: Samples,
    match: Matched,
    points: NDArray[np.float64],
    heading: NDArray[np.float64] | None,
    accuracy: float,
    late: float = 0.0,
    noise: float | None = None,
) -> Track:
    """Return the track of a vehicle along its way: stations, speeds and poses, smoothed according to their accuracy.

    Args:
        points: middle of the front bumper in all samples, shape ``(samples, 2)`` [m].
        heading: heading in all samples, shape ``(samples,)`` [rad]; None to derive it from the way, on which front and rear are.
        accuracy: standard deviation of a coordinate [m]; with 0, the positions are not smoothed.
        late: time by which the speeds lag behind the positions [s], see `delay_of`.
        noise: standard deviation of a recorded speed [m/s]; None to estimate it from the vehicle's speeds.
    """
    times = vehicle.times[match.rows]
    speed = None if vehicle.speed is None else vehicle.speed[match.rows]
    straight = _straight(match) if accuracy > 0.0 else None
    station, fast, spread = smoothed(times, match.station, speed, accuracy, straight, late, noise)
    place, ahead = match.way.centre(station)
    if accuracy > 0.0:
        lateral = smoothed(times, match.lateral, None, accuracy)[0]
        place = place + lateral[:, None] * np.column_stack((-ahead[:, 1], ahead[:, 0]))
    else:
        place = points[match.rows]
    if heading is None:
        length = _BODY if agent.size is None else agent.size[0]
        along = match.way.centre(station)[0] - match.way.centre(station - length)[0]
        facing = np.arctan2(along[:, 1], along[:, 0])
    else:
        facing = heading[match.rows]
    return Track(agent, times, station, fast, np.column_stack((place, facing)), spread, match.offset)


def _straight(match: Matched) -> NDArray[np.bool_]:
    """Return, for each sample, whether the part of the way below the vehicle is straight, shape ``(rows,)``."""
    behind, ahead = (match.way.centre(match.station - back)[1] for back in (_BODY, 0.0))
    turn = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    straight: NDArray[np.bool_] = np.abs(turn) <= _BODY / _WIDE
    return straight


_BESIDE = 1.0
"""Distance beside the painted area at which a pedestrian is still on the crosswalk [m], because many cut a corner of the area."""
_STEPPED = 0.5
"""Least distance of a pedestrian from both kerbs that proves a step onto the roadway [m]. Measured places are less accurate, and
the side of a car in the middle of its lane is farther from the kerb."""
_REACH = SIDEWALK - PERSON
"""Length of the sidewalk on which a pedestrian is recorded [m]: the whole body is on the way."""


class CrossingMatcher:
    """Matches pedestrians to the crossings of a junction that has them among its further ways, see `Junction.walked`."""

    def __init__(self, junction: Junction) -> None:
        ways = [way for way, _, _ in junction.further if isinstance(way, Crossing)]
        there, back = ([Itinerary.through(junction, *way.key) for way in ways if way.side is side] for side in Side)
        areas = [crosswalk.area for crosswalk in junction.crossings]
        self._crosswalks = list(zip(map(Line.of, there), back, areas, strict=True))

    def match(self, walker: Samples, points: _Values, ahead: float) -> list[Matched]:
        """Return each walk of a pedestrian over a crosswalk, in the order of their times.

        The recorded points on the map have the shape ``(samples, 2)`` [m]; the front of the body is `ahead` of them [m].
        """
        walks = []
        for line, back, area in self._crosswalks:
            length, (_, sides) = line.way.length, line.project(area)
            low, high = sides.min() - _BESIDE, sides.max() + _BESIDE
            station, lateral = line.project(points)
            near = np.flatnonzero((lateral >= low) & (lateral <= high) & (station >= -_REACH) & (station <= length + _REACH))
            for part in unbroken(walker.times[near]):
                if len(near[part]) < 2:
                    continue
                rows = slice(int(near[part][0]), int(near[part][-1]) + 1)
                along, beside = np.clip(station[rows], -_REACH, length + _REACH), lateral[rows]
                road = (along > 0.0) & (along < length)
                stepped = bool(((along >= _STEPPED) & (along <= length - _STEPPED)).any())
                # Who rides in a vehicle, or walks along the road, moves across the crosswalk and not along it.
                if not stepped or np.ptp(beside[road]) > max(np.ptp(along[road]), (high - low) / 2):
                    continue
                if along[0] >= length or (along[0] > 0.0 and along[-1] < along[0]):
                    along, beside, way = length - along, -beside, back
                else:
                    way = line.way
                walks.append(Matched(way, rows, along + ahead, beside, float(np.sqrt((beside**2).mean()))))
        return sorted(walks, key=lambda walk: walk.rows.start)


def track_on_foot(agent: Agent, walker: Samples, walk: Matched, points: _Values, ahead: float, accuracy: float) -> Track:
    """Return the track of a pedestrian along a crossing, see `track_of`; `accuracy` is that of a coordinate [m]."""
    fronts = points.copy()
    fronts[walk.rows] += ahead * walk.way.centre(walk.station)[1]
    return track_of(agent, replace(walker, speed=None), walk, fronts, None, accuracy)
