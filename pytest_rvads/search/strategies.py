"""Hypothesis strategies for junctions and scenarios, as arguments of ``@given``.

Hypothesis simplifies (shrinks) scenarios toward few vehicles, standing starts, equal starts and round distances. No vehicle
starts faster than a share of v(d)max, the greatest speed from which it can stop before its line, so no vehicle violates a rule
only because it starts too fast.

Most crashes happen if vehicles arrive up to 2 s apart. So for every vehicle but the first, the gap between its arrival and the
arrival of the first vehicle is drawn, and its distance is computed from the gap. Most faults show with two vehicles, so half of
the scenarios with more vehicles are reduced to two vehicles.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import cache
from operator import neg
from typing import Any, NamedTuple

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.classes import Directions, Orbits
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.space import FARTHEST, NEAREST, Space, explored
from pytest_rvads.simulators.simulator import Simulator, vmax
from pytest_rvads.support.errors import ScenarioError

__all__ = ["abstract_scenarios", "distances", "junctions", "scenarios", "waits"]

LONGEST_WAIT = 4.0
"""Greatest waiting time for autopilots with a random waiting time, by default [s]; the least is 0."""
USUAL_WAIT = 1.5
"""Waiting time in a scenario that sets no ``wait`` [s]."""
PACE = 0.75
"""Greatest initial speed as a share of v(d)max, by default, so that a vehicle can react without full braking."""
_ROUND_DISTANCES = (20.0, 10.0, 5.0, 2.0, 1.0, 0.3, 30.0)
_KNOWN_DISTANCES = (0.3, 0.6, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0)
"""Distances for which v(d)max is computed [m]. At other distances, the value of the next smaller distance is used, which is safe
because v(d)max grows with the distance."""
_SHARES = 10
"""Number of equal steps between speed 0 and the greatest initial speed."""
_SMALL_GAPS = range(3, 21)
"""Gaps between arrivals with which most crashes at stop signs happen: 0.3 to 2 s, in tenths of a second."""
_WIDEST_GAP = 30
"""Greatest gap between arrivals that is drawn, in tenths of a second; greater gaps come from distances that are drawn freely."""
_ACCELERATION, _BRAKING = 2.5, 2.3
"""Mean acceleration and mean deceleration for a stop of a passenger car under the reference autopilot [m/s^2]."""


def junctions(control: JunctionControl | str | None = None, ways: int | None = None) -> SearchStrategy[Junction]:
    """Return a strategy for built-in junctions.

    Args:
        control: ``"stop"`` or ``"lights"``; any control by default.
        ways: number of arms; any number by default.

    Raises:
        ScenarioError: no built-in junction has this control and number of arms.
    """
    matching = [j for j in map(find, names()) if control in (None, j.control) and ways in (None, j.ways)]
    if not matching:
        raise ScenarioError(f"no built-in junction has control {control!r} and {ways!r} ways: there are {', '.join(names())}")
    return st.sampled_from(matching)


def abstract_scenarios(ways: int = 4, *, partial: bool = True) -> SearchStrategy[Directions]:
    """Return a strategy for abstract scenarios: a direction per entrance, or 0 for an empty entrance.

    Args:
        ways: number of arms, each with an entrance.
        partial: whether scenarios with empty entrances are drawn; at least one entrance always has a vehicle.

    Raises:
        ScenarioError: the number of arms is not 3 to 8.
    """
    return _codes(Orbits.plain(ways, partial=partial))


def _codes(orbits: Orbits, subject: int | None = None) -> SearchStrategy[Directions]:
    """Return a strategy for abstract scenarios with a vehicle at the entrance `subject`, or with None, at any entrance."""
    choices, first = [], 0
    for slot in orbits.slots:
        entrances = range(first, first + len(slot[0]))
        letters = slot if subject is None or subject not in entrances else [code for code in slot if code[subject - first]]
        choices.append(st.sampled_from(letters))
        first = entrances.stop
    codes = st.tuples(*choices).map(lambda chosen: tuple(direction for letter in chosen for direction in letter))
    return codes.filter(any) if orbits.partial and subject is None else codes


def distances(low: float = NEAREST, high: float = FARTHEST) -> SearchStrategy[float]:
    """Return a strategy for distances to the stopping line [m]: round numbers, and other multiples of 0.1 m.

    Args:
        low: least distance [m].
        high: greatest distance [m].

    Raises:
        ScenarioError: the range is empty or begins below 0.
    """
    if not 0 <= low < high < math.inf:
        raise ScenarioError(f"distances must go from 0 m or more to a greater distance, got {low!r} to {high!r}")
    near = [d for d in _ROUND_DISTANCES if low <= d <= high] or [low]
    tenths = _whole(math.ceil(10 * low), max(math.floor(10 * high), math.ceil(10 * low))).map(lambda n: n / 10)
    return st.one_of(st.sampled_from(near), tenths.filter(lambda d: low <= d <= high) if high - low >= 0.1 else st.just(low))


def waits(low: float = 0.0, high: float = LONGEST_WAIT) -> SearchStrategy[float]:
    """Return a strategy for the random waiting time of an autopilot [s]: whole seconds, and other multiples of 0.01 s.

    Args:
        low: least waiting time [s].
        high: greatest waiting time [s].

    Raises:
        ScenarioError: the range is empty or begins below 0.
    """
    if not 0 <= low <= high < math.inf:
        raise ScenarioError(f"waits must begin at 0 s or more and not end before, got {low!r} to {high!r}")
    whole_seconds = [USUAL_WAIT, *map(float, range(math.ceil(low), math.floor(high) + 1))]
    whole_seconds = [s for s in whole_seconds if low <= s <= high] or [low]
    hundredths = _whole(math.ceil(100 * low), math.floor(100 * high)).map(lambda n: n / 100)
    return st.one_of(st.sampled_from(whole_seconds), hundredths)


def _whole(low: int, high: int) -> SearchStrategy[int]:
    """Return a strategy for integers from `low` to `high`.

    Hypothesis prefers integers of 100 or more that stand in the source code of the modules of a user that are loaded. So the
    strategy draws integers below 100, and adds them up. With one seed, the same integers are drawn in every process.
    """
    span = high - low
    if span < 100:
        return st.integers(0, span).map(lambda n: low + n)
    above = st.builds(lambda hundreds, units: 100 * hundreds + units, st.integers(0, span // 100), st.integers(0, 99))
    return above.filter(lambda n: n <= span).map(lambda n: low + n)


def scenarios(  # noqa: PLR0913 - keywords, each a bound of the space
    junction: str | Junction = "stop4",
    *,
    map: str | None = None,
    subject: int | None = None,
    partial: bool = True,
    near: float = NEAREST,
    far: float = FARTHEST,
    pace: float = PACE,
    wait: tuple[float, float] = (0.0, LONGEST_WAIT),
    aggression: int = 1,
    duration: float | None = None,
    vehicle: Vehicle | None = None,
    simulator: Simulator | None = None,
) -> SearchStrategy[Scenario]:
    """Return a strategy for concrete scenarios in which every vehicle starts slowly enough to stop before its line.

    Args:
        junction: built-in name, or id of a junction in `map`; or the junction itself.
        map: map file of a junction given by id.
        subject: entrance of the vehicle under test among traffic; every scenario has a vehicle at this entrance.
        partial: whether scenarios with empty arms are drawn; if not, each arm has a vehicle, on any lane of the arm.
        near: least distance to the stopping line [m].
        far: greatest distance to the stopping line [m]; on a shorter approach, the length of the approach.
        pace: greatest initial speed as a share of v(d)max, the greatest speed from which a vehicle can stop before its line; a
            vehicle that starts with v(d)max has to brake fully from the first step on if it must stop.
        wait: least and greatest waiting time of an autopilot with a random waiting time [s].
        aggression: braking level 1, 2 or 3.
        duration: duration after which a run ends [s], as for `Scenario`.
        vehicle: parameters of the vehicle whose v(d)max bounds the speeds; a passenger car by default.
        simulator: the simulator of the runs, as for `simulate`, which also gives v(d)max.

    Raises:
        MapError: the junction is unknown or unusable.
        ScenarioError: a range is empty, or a bound is out of its range.
    """
    bounds = Space(map=map, subject=subject, partial=partial, near=near, far=far, pace=pace)
    place = explored(junction, {**bounds, "wait": wait, "aggression": aggression, "duration": duration})
    reach = [min(far, place.approach(e)) for e in range(len(place.entrances))]
    spans = [distances(near, room) for room in reach]
    codes, delays = _codes(Orbits.at(place, partial=partial), subject), waits(*wait)

    # The simplest value comes first, because Hypothesis shrinks toward it. If the gap is None, the distance is drawn. If the
    # share is None, the share of the first vehicle is used.
    small = st.sampled_from(_SMALL_GAPS)
    gaps = st.one_of(st.just(0), small, small.map(neg), st.integers(-_WIDEST_GAP, _WIDEST_GAP), st.none())
    shares = st.integers(0, _SHARES)
    further_shares = st.one_of(st.none(), shares)

    def start_at(distance: float, share: int) -> VehicleStart:
        # The limit is v(d)max at this distance, or at a shorter distance, where it is lower [m/s].
        below, limit = bisect_right(_KNOWN_DISTANCES, distance), 0.0
        if share and below:
            limit = vmax(_KNOWN_DISTANCES[below - 1], aggression, vehicle, simulator, place.top_limit) or 0.0
        return VehicleStart(distance, math.floor(10 * pace * limit * share / _SHARES) / 10)

    def arrival(entrance: int, start: VehicleStart) -> float:
        return nominal_arrival(start, place.top_limit, stops=place.entrances[entrance].sign is Sign.STOP)

    @cache
    def arrivals(entrance: int, share: int) -> list[tuple[float, VehicleStart]]:
        tenths = range(math.ceil(10 * near), math.floor(10 * reach[entrance]) + 1)
        starts = [start_at(distance, share) for distance in (near, *(n / 10 for n in tenths))]
        return [(arrival(entrance, start), start) for start in starts]

    @st.composite
    def build(draw: Callable[[SearchStrategy[Any]], Any]) -> Scenario:
        code = draw(codes)
        starts = [VehicleStart(20.0, 0.0)] * len(code)
        first, *others = sorted((e for e, direction in enumerate(code) if direction), key=lambda e: e != subject)
        if partial and len(others) > 1 and draw(st.booleans()):
            others = [draw(st.sampled_from(others))]
            code = tuple(direction if e in (first, *others) else 0 for e, direction in enumerate(code))
        first_share = draw(shares)
        starts[first] = start_at(draw(spans[first]), first_share)
        for e in others:
            drawn_share, gap = draw(further_shares), draw(gaps)
            share = first_share if drawn_share is None else drawn_share
            if gap is None:
                starts[e] = start_at(draw(spans[e]), share)
            else:
                wanted = arrival(first, starts[first]) + gap / 10
                starts[e] = min(arrivals(e, share), key=lambda timed: abs(timed[0] - wanted))[1]
        return Scenario(
            place,
            code,
            distance=[start.distance for start in starts],
            speed=[start.speed for start in starts],
            subject=subject,
            wait=draw(delays),
            aggression=aggression,
            duration=duration,
        )

    return build()


class VehicleStart(NamedTuple):
    """Distance and speed of a vehicle at the start of a run."""

    distance: float
    """Distance from the reference point to the stopping line [m]."""
    speed: float
    """Speed at the start [m/s]."""


def nominal_arrival(start: VehicleStart, limit: float, *, stops: bool) -> float:
    """Return the time at which a vehicle on a free road with a speed limit [m/s] reaches its stopping line [s].

    The vehicle accelerates with constant acceleration up to the speed limit, and brakes with constant deceleration if it stops at
    the line. The peak speed p follows from ``distance = (p^2 - speed^2) / (2 _ACCELERATION) + p^2 / (2 _BRAKING)``. Drivers other
    than the reference arrive at other times, but the gap between two vehicles with the same driver is about the same.
    """
    distance, speed = start
    if not distance:
        return 0.0
    slowing = 1.0 / _BRAKING if stops else 0.0
    peak = min(math.sqrt((2.0 * distance + speed**2 / _ACCELERATION) / (1.0 / _ACCELERATION + slowing)), limit)
    if peak <= speed:  # the vehicle does not accelerate: it brakes at once, or passes the line at its initial speed
        return distance / speed * (2.0 if stops else 1.0)
    cruised = distance - (peak**2 - speed**2) / (2.0 * _ACCELERATION) - peak**2 * slowing / 2.0
    return (peak - speed) / _ACCELERATION + peak * slowing + cruised / peak
