"""Configurations (distances and speeds per entrance): the paper's A to J, staggered starts, or distances and speeds of a user.

In a staggered start, the other vehicles arrive at their lines earlier or later than the vehicle under test. A configuration keeps
to the braking envelope: a vehicle that starts d metres before the stopping line is no faster than v(d)max, because a faster
vehicle would break rules by its speed alone (paper, section 5.3).

`placed` finds where the vehicles of a configuration, with their queues, start. Upstream of turn lanes several entrances share a
lane, and a turn lane has no width where it begins. On such approaches, two vehicles at the same distance from their lines would
stand inside each other. So `Scenario.starts` refuses, before a run, starts of vehicles inside each other and starts on approaches
that are too short.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.follower import fastest
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.bodies import touch
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Agent, Vehicle
from pytest_rvads.scenarios.classes import rotate
from pytest_rvads.support.errors import ScenarioError, suggest

Envelope = Callable[[float], float | None]
"""v(d)max: maps the distance to the stopping line [m] to the greatest safe speed [m/s]; None if even 0 m/s is unsafe."""

PAPER = {JunctionControl.STOP: "ABCDE", JunctionControl.LIGHTS: "FGHIJ"}
"""The paper's configurations by control. Configurations A and F reveal a controller that drives off before it looks."""

ARRIVALS = "arrivals"
"""Name of the default grid of tests with a subject: all vehicles 20 m before their lines, and staggered starts."""

_NEAR, _CLOSE, _FAR, _FAST = 0.01, 0.3, 20.0, 10.0
_STAGGERED_SPEED = 8.0
"""Speed of every vehicle of a staggered configuration [m/s]; below the speed limit."""
_NEAREST = 10.0
"""Least distance of a vehicle of a staggered configuration from its line [m]; v(d)max is 8.66 m/s at this distance."""
_AT_STOPS, _ELSEWHERE = (36, "S21 S26 S31 S46 S51 S56"), (20, "S31 S42 S53 S64 S75")
"""Distance of the subject [m], and the labels of the staggered configurations: S and the distance of the other vehicles [m].

At an all-way stop, where the order of arrival decides, the other vehicles arrive 1.5, 1 and 0.5 s earlier and 1, 1.5 and 2 s
later than the subject. Elsewhere they arrive 1 to 5 s later.
"""
_STAGGERED_LABEL = re.compile(r"S\d{1,3}(_\d{1,3})*")


@dataclass(frozen=True, slots=True)
class Configuration:
    """Distances and speeds of a scenario, per entrance before rotation."""

    label: str
    distances: tuple[float, ...]
    """Distances from the reference points to the stopping lines [m]."""
    speeds: tuple[float, ...]
    """Speeds [m/s]."""
    staggered: bool = False
    """Whether the distances and speeds are counted from the entrance of the subject, counter-clockwise, instead of entrance 0."""

    @property
    def room(self) -> float:
        """Least length of an approach that the configuration needs [m]."""
        return _NEAREST if self.staggered else max(self.distances)

    def around(self, seat: int, rooms: Sequence[float]) -> Configuration:
        """Return a staggered configuration per entrance, around a subject; other configurations are returned unchanged.

        On an approach that is too short for its vehicle, the vehicle starts as far from the line as the approach allows. If the
        subject starts nearer for this reason, the other vehicles start nearer by the same distance, but at least `_NEAREST`
        before their lines. The rooms are the lengths of the approaches before rotation [m].
        """
        if not self.staggered:
            return self
        most = [max(float(math.floor(room)), _NEAREST) for room in rooms]
        nearer = max(self.distances[0] - most[seat], 0.0)
        starts = (max(distance - nearer, _NEAREST) for distance in rotate(self.distances, seat))
        return Configuration(self.label, tuple(map(min, zip(starts, most, strict=True))), self.speeds)


def configuration(label: str, entrances: int, control: JunctionControl = JunctionControl.STOP) -> Configuration:
    """Return the configuration called `label` for `entrances` entrances of a junction with a given control.

    The label is a letter of the paper, A to J; or for a staggered configuration ``S`` and the distance of the other vehicles [m],
    or a distance per entrance, counter-clockwise from the subject: ``S26_56_56``.
    """
    if not _STAGGERED_LABEL.fullmatch(label):
        first = (entrances + 1) // 2
        near, close, far = (_NEAR,) * entrances, (_CLOSE,) * entrances, (_FAR,) * entrances
        distances = {
            **dict.fromkeys("AF", near),
            **dict.fromkeys("BG", close),
            **dict.fromkeys("CHDI", far),
            "E": (_CLOSE,) * first + (_FAR,) * (entrances - first),
            "J": tuple(_CLOSE if i % 2 else _FAR for i in range(entrances)),
        }
        if label not in distances:
            hint = suggest(label.upper(), distances)
            raise ScenarioError(
                f"unknown configuration {label!r}: the paper's are A..J, staggered ones are such as S21, or give distances= and "
                f"speeds={hint}"
            )
        return Configuration(label, distances[label], (_FAST if label in "DI" else 0.0,) * entrances)
    of_subject, _ = _AT_STOPS if control is JunctionControl.STOP else _ELSEWHERE
    of_traffic = [float(number) for number in label[1:].split("_")]
    of_traffic *= entrances - 1 if len(of_traffic) == 1 else 1
    if len(of_traffic) != entrances - 1:
        raise ScenarioError(f"configuration {label!r} is for {len(of_traffic) + 1} entrances, the junction has {entrances}")
    return Configuration(label, (float(of_subject), *of_traffic), (_STAGGERED_SPEED,) * entrances, staggered=True)


def grid(names: str | Iterable[str], entrances: int, control: JunctionControl) -> tuple[Configuration, ...]:
    """Return the configurations of a named grid, or of several.

    A name is ``"paper"`` for the paper's five configurations of `control` (those of stops, if the control is neither stop nor
    lights), ``"staggered"`` for all staggered configurations, ``"arrivals"`` for the default of tests with a subject, the label
    of a staggered configuration, or a string of letters.
    """
    letters, stop = PAPER.get(control, PAPER[JunctionControl.STOP]), control is JunctionControl.STOP
    _, staggered = _AT_STOPS if stop else _ELSEWHERE
    # If several vehicles arrive together before the subject, the vehicle at the subject's left goes first, and a subject that
    # ignores that vehicle is not detected. So in one configuration only the vehicle at the right is early, and in another only
    # the vehicle at the left.
    late = ["56"] * (entrances - 2)
    at_stops = ["S21", "S46", "_".join(("S26", *late)), f"S{'_'.join((*late, '26'))}"]
    named: dict[str, Sequence[str]] = {
        "paper": letters,
        "staggered": staggered.split(),
        ARRIVALS: [letters[2], *(at_stops if stop else staggered.split()[:4])],
    }
    labels: list[str] = []
    for name in [names] if isinstance(names, str) else names:
        labels += named.get(name, [name] if _STAGGERED_LABEL.fullmatch(name) else name)
    if not labels:
        raise ScenarioError("a grid needs at least one configuration, such as 'paper', 'D' or ('C', 'D')")
    return tuple(configuration(label, entrances, control) for label in dict.fromkeys(labels))


Axis = float | tuple[float, ...] | list[float | tuple[float, ...]]


def explicit(distances: Axis, speeds: Axis, entrances: int) -> tuple[Configuration, ...]:
    """Return the product of explicit distances [m] and speeds [m/s].

    Either is a number for all entrances, a tuple with one number per entrance, or a list of such numbers and tuples.
    """
    axes = []
    for name, axis in (("distances", plain(distances)), ("speeds", plain(speeds))):
        entries: list[float | tuple[float, ...]] = axis if isinstance(axis, list) else [axis]
        if not entries:
            raise ScenarioError(f"{name} is an empty list: give at least one value")
        axes.append([per_entrance(name, entry, entrances) for entry in entries])
    return tuple(Configuration(explicit_label(d, v), d, v) for d, v in product(*axes))


def explicit_label(distances: Sequence[float], speeds: Sequence[float]) -> str:
    """Return the label of explicit values: ``d20.00_00.30v00.00``; a single value if all values are equal."""

    def text(values: Sequence[float]) -> str:
        return "_".join(f"{v:05.2f}" for v in (values[:1] if len(set(values)) == 1 else values))

    return f"d{text(distances)}v{text(speeds)}"


def outside(point: Configuration, envelope: Envelope) -> tuple[float, float] | None:
    """Return the first (distance, speed) of configuration `point` that is beyond the braking envelope, or None."""
    for distance, speed in zip(point.distances, point.speeds, strict=True):
        limit = envelope(distance) if speed > 0 else 0.0
        if limit is None or speed > limit:
            return distance, speed
    return None


def probe(point: Configuration, envelope: Envelope) -> str:
    """Return a sentence if the start `point` deliberately provokes a wrong reaction of the driver; an empty text if not."""
    beyond = outside(point, envelope)
    if beyond is not None:
        distance, speed = beyond
        limit = envelope(distance) or 0.0
        return f"a deliberate probe: at {speed:g} m/s nobody stops within {distance:g} m, v(d)max is {limit:.2f} m/s"
    if min(point.distances) <= _NEAR:
        return f"a deliberate probe: {_NEAR:g} m before the line a vehicle that drives off before looking crosses the line"
    return ""


def per_entrance(name: str, value: float | Sequence[float], entrances: int) -> tuple[float, ...]:
    """Return `value` as one finite number of 0 or more per entrance."""
    value = plain(value)
    if isinstance(value, str) or not isinstance(value, int | float | Sequence):
        raise ScenarioError(f"{name} takes numbers, got {value!r}")
    values = (value,) * entrances if isinstance(value, int | float) else tuple(map(plain, value))
    if len(values) != entrances:
        raise ScenarioError(f"{name} needs one value, or one per entrance ({entrances}), got {len(values)}: {values!r}")
    for number in values:
        if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < float("inf"):
            raise ScenarioError(f"{name} must be 0 or more and finite, got {number!r}")
    return tuple(float(v) for v in values)


def plain(value: Any) -> Any:
    """Return an array or number of numpy as builtins, any other value unchanged."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


_BESIDE = 2.0
"""Distance of centre lines below which two lanes count as one lane [m]: cars, 1.86 m wide, have no room beside each other."""
_APART = 3.0
"""Distance of centre lines from which on bodies do not touch [m].

The law allows vehicles a width of at most 2.6 m (Council Directive 96/53/EC, Annex I).
"""
_SPACING = 0.5
"""Distance of the points at which approaches are compared [m]."""


class Fork(NamedTuple):
    """Two entrances, the lower number first, whose approaches begin on one common lane."""

    entrances: tuple[int, int]
    distances: tuple[float, float]
    """Distances before the two stopping lines at which the lanes part [m]; negative behind the line."""


@lru_cache(maxsize=256)
def forks(place: Junction) -> tuple[Fork, ...]:
    """Return the pairs of entrances whose approaches begin on a common lane; entrances without a known approach are skipped."""
    lines = _approaches(place)
    pairs = []
    for first, second in combinations(lines, 2):
        distances = _parting(lines[first], lines[second])
        if distances is None and (swapped := _parting(lines[second], lines[first])) is not None:
            distances = swapped[1], swapped[0]
        if distances is not None:
            of_first, of_second = distances[0] - place.setbacks[first], distances[1] - place.setbacks[second]
            pairs.append(Fork((first, second), (of_first, of_second)))
    return tuple(pairs)


@lru_cache(maxsize=256)
def near(place: Junction) -> frozenset[tuple[int, int]]:
    """Return the pairs of entrances, the lower number first, on whose approaches vehicles could start inside each other.

    The two approaches begin on a common lane, see `forks`, or converge towards their stopping lines.
    """
    lines = {entrance: points[::-2] for entrance, points in _approaches(place).items()}
    pairs = combinations(lines, 2)
    return frozenset((a, b) for a, b in pairs if min(np.hypot(*(lines[b] - p).T).min() for p in lines[a]) < _APART)


def _parting(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the distances before their ends at which two lines part [m]; None if the first line does not begin on the second."""
    last = nearest = -1
    for k, point in enumerate(first):
        gaps = np.hypot(*(second - point).T)
        if gaps.min() >= _BESIDE:
            break
        last, nearest = k, int(gaps.argmin())
    if last < 0:
        return None
    return (len(first) - 1 - last) * _SPACING, (len(second) - 1 - nearest) * _SPACING


def _approaches(place: Junction) -> dict[int, NDArray[np.float64]]:
    """Return, per entrance with a known approach, points of the approach, the last at its end, shape ``(k, 2)`` [m]."""
    points = {}
    for entrance, lane in enumerate(place.entrances):
        if line := lane.approach:
            stations = np.arange(line.length, 0.0, -_SPACING)[::-1]
            points[entrance] = np.column_stack([np.interp(stations, line.stations, axis) for axis in line.points.T])
    return points


QUEUE_GAP = 2.0
"""Gap between two vehicles of a standing queue [m]."""
QUEUE_TIME = 1.0
"""Time gap of followers at the start, in addition to `QUEUE_GAP` [s]."""
_ROUNDING = 1e-9
"""Greatest rounding error of a distance [m]."""


class _Start(NamedTuple):
    """The start of a vehicle."""

    name: str
    way: Key
    body: Vehicle
    distance: float
    """Distance from the reference point to the stopping line [m]."""
    speed: float
    """Speed at the start [m/s]."""

    @property
    def entrance(self) -> int:
        """Number of the entrance."""
        return self.way[0]


def placed(
    place: Junction, agents: Sequence[Agent], bodies: Sequence[Vehicle], starts: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the starts of vehicles with their followers, see `Scenario.starts` for gaps and errors.

    `starts` has per vehicle the distance [m] and speed [m/s] of the first vehicle at its entrance.
    """
    rows: list[_Start] = []
    for agent, body, (distance, speed) in zip(agents, bodies, starts, strict=True):
        if rows and rows[-1].entrance == agent.entrance:
            distance = rows[-1].distance + rows[-1].body.length + QUEUE_GAP + QUEUE_TIME * speed
        room = place.approach(agent.entrance)
        if distance > room:
            followed = len({other.entrance for other in agents}) < len(agents)
            cure = "a smaller distance, fewer followers" if followed else "a smaller distance"
            raise ScenarioError(
                f"distance {distance:g} m does not fit on entrance {agent.entrance} of junction {place.name!r}, where "
                f"{agent.name} starts: its approach is {room:.1f} m long, choose {cure} or another junction"
            )
        rows.append(_Start(agent.name, agent.way.key, body, distance, speed))
    if near(place):
        _check_apart(place, rows)
    return tuple((row.distance, row.speed) for row in rows)


def _check_apart(place: Junction, starts: Sequence[_Start]) -> None:
    """Check that vehicles on a common lane start behind each other, and that vehicles on converging approaches do not touch."""
    for (first, second), (parting, second_parting) in forks(place):
        # Distances upstream of the place where the lanes part; a vehicle beyond this place is not in the common lane.
        lane = [(s.distance - parting, s) for s in starts if s.entrance == first] + [
            (s.distance - second_parting, s) for s in starts if s.entrance == second
        ]
        queue = sorted((distance, s) for distance, s in lane if distance + s.body.length > 0.0)
        for (front, ahead), (distance, behind) in pairwise(queue):
            gap, needed = distance - front - ahead.body.length, QUEUE_GAP + QUEUE_TIME * behind.speed
            if ahead.entrance != behind.entrance and gap < needed - _ROUNDING:
                raise ScenarioError(
                    f"{behind.name} would start {max(gap, 0.0):.1f} m behind {ahead.name}, where {needed:.1f} m are needed: "
                    f"entrances {first} and {second} of junction {place.name!r} are one lane from {max(parting, 0.0):.1f} and "
                    f"{max(second_parting, 0.0):.1f} m before their lines on, choose smaller or different distances, or fewer "
                    "vehicles"
                )

    ways = [itinerary(place, *start.way) for start in starts]
    bodies = [
        (np.array([way.placed(way.start(s.distance), s.body.rear_axle_offset)]), (s.body.length, s.body.width))
        for way, s in zip(ways, starts, strict=True)
    ]
    for (start, body), (other, other_body) in combinations(zip(starts, bodies, strict=True), 2):
        if (start.entrance, other.entrance) in near(place) and touch([body, other_body]):
            raise ScenarioError(
                f"{start.name} and {other.name} would start inside each other, where the approaches of entrances "
                f"{start.entrance} and {other.entrance} of junction {place.name!r} converge: choose other distances, or fewer "
                "vehicles"
            )


def started(point: Configuration, place: Junction, rotation: int, subject: int | None, followers: int) -> dict[str, Any]:
    """Return the arguments of `Scenario` that say how the vehicles start in a configuration: distances, speeds and its label."""
    queue = followers * (Vehicle().length + QUEUE_GAP + QUEUE_TIME * max(point.speeds))
    if point.staggered:
        if subject is None:
            raise ScenarioError(
                f"configuration {point.label} is staggered around a subject, and there is none: say subject=0 or 'all', or "
                "choose another configuration"
            )
        rooms = [place.approach(entrance) - queue for entrance in range(len(place.entrances))]
        point = point.around((subject - rotation) % len(rooms), rotate(tuple(rooms), -rotation))
    speeds = point.speeds
    if not point.label.startswith("d"):  # speeds that a user asks for are kept
        starts = zip(rotate(tuple(range(len(speeds))), -rotation), point.distances, speeds, strict=True)
        speeds = tuple(min(speed, fastest_start(place, entrance, distance, queue)) for entrance, distance, speed in starts)
    return {"distance": point.distances, "speed": speeds, "configuration": point.label}


def fastest_start(place: Junction, entrance: int, distance: float, queue: float = 0.0) -> float:
    """Return the highest speed [m/s] at which vehicles start `distance` before the line, with the last `queue` behind them [m].

    All speed limits between the start of the last vehicle and the entrance count, and so do all bends of this stretch.
    """
    approach, start = place.entrances[entrance].approach, place.approach(entrance) - distance
    if approach is None or start <= 0.0:
        return SPEED_LIMIT
    start = min(start, approach.length - 0.01)  # a line can lie behind the end of the approach
    first = max(start - queue, 0.0)
    limits = approach.tail(approach.length - first).limits
    limit = min((limit or SPEED_LIMIT for _, limit in limits), default=SPEED_LIMIT)
    return min(limit, fastest(approach, first, start, Vehicle(), place.lane_width))
