"""Hypothesis strategies for junctions and scenarios, to use under ``@given``.

Scenarios shrink towards few vehicles, standing starts and round distances. Concrete scenarios stay inside the braking envelope:
no vehicle starts faster than a share of v(d)max, and so no violation is a matter of speed alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.orbits import Directions, Orbits
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.space import FARTHEST, NEAREST, Space, explored
from pytest_rvads.simulators.simulator import Simulator, vmax
from pytest_rvads.support.errors import ScenarioError

__all__ = ["abstract_scenarios", "distances", "junctions", "scenarios", "waits"]

LONGEST_WAIT = 4.0
"""Greatest draw of an autopilot with a random draw [s]; the least is 0."""
USUAL_WAIT = 1.5
"""Draw of a scenario without ``wait`` [s]."""
PACE = 0.75
"""Greatest initial speed as a share of v(d)max, so that a vehicle can react by ordinary braking."""
_ROUND_DISTANCES = (20.0, 10.0, 5.0, 2.0, 1.0, 0.3, 30.0)
_KNOWN_DISTANCES = (0.3, 0.6, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0)
"""Distances with a computed v(d)max [m]. Since v(d)max grows with d, the value at the next smaller of these distances is safe."""
_SHARES = 10
"""Number of equal steps between a standing start and v(d)max."""


def junctions(control: JunctionControl | str | None = None, ways: int | None = None) -> SearchStrategy[Junction]:
    """Return a strategy for built-in junctions.

    Args:
        control: ``"stop"`` or ``"lights"``; any by default.
        ways: number of arms; any by default.

    Raises:
        ScenarioError: no built-in junction has this control and number of arms.
    """
    matching = [j for j in map(find, names()) if control in (None, j.control) and ways in (None, j.ways)]
    if not matching:
        raise ScenarioError(f"no built-in junction has control {control!r} and {ways!r} ways: there are {', '.join(names())}")
    return st.sampled_from(matching)


def abstract_scenarios(ways: int = 4, *, partial: bool = True) -> SearchStrategy[Directions]:
    """Return a strategy for abstract scenarios: a direction per entrance, 0 for an empty entrance.

    Args:
        ways: number of arms, each with an entrance.
        partial: whether entrances may be empty; at least one entrance has a vehicle.

    Raises:
        ScenarioError: the number of arms is not 3 to 8.
    """
    return _codes(Orbits.plain(ways, partial=partial))


def _codes(orbits: Orbits) -> SearchStrategy[Directions]:
    letters = [st.integers(0, len(slot) - 1).map(slot.__getitem__) for slot in orbits.slots]
    codes = st.tuples(*letters).map(lambda chosen: tuple(direction for letter in chosen for direction in letter))
    return codes.filter(any) if orbits.partial else codes


def distances(low: float = NEAREST, high: float = FARTHEST) -> SearchStrategy[float]:
    """Return a strategy for distances to the stopping line [m]: round distances, and any multiple of 0.1 m.

    Args:
        low: least distance [m].
        high: greatest distance [m].

    Raises:
        ScenarioError: the range is empty or begins below 0.
    """
    if not 0 <= low < high < math.inf:
        raise ScenarioError(f"distances must go from 0 m or more to a greater distance, got {low!r} to {high!r}")
    near = [d for d in _ROUND_DISTANCES if low <= d <= high] or [low]
    tenths = st.integers(math.ceil(10 * low), max(math.floor(10 * high), math.ceil(10 * low))).map(lambda n: n / 10)
    return st.one_of(st.sampled_from(near), tenths.filter(lambda d: low <= d <= high) if high - low >= 0.1 else st.just(low))


def waits(low: float = 0.0, high: float = LONGEST_WAIT) -> SearchStrategy[float]:
    """Return a strategy for the draw of an autopilot [s]: whole seconds, and any tick of 0.01 s.

    Args:
        low: least draw [s].
        high: greatest draw [s].

    Raises:
        ScenarioError: the range is empty or begins below 0.
    """
    if not 0 <= low <= high < math.inf:
        raise ScenarioError(f"waits must begin at 0 s or more and not end before, got {low!r} to {high!r}")
    whole = [USUAL_WAIT, *map(float, range(math.ceil(low), math.floor(high) + 1))]
    whole = [s for s in whole if low <= s <= high] or [low]
    return st.one_of(st.sampled_from(whole), st.integers(math.ceil(100 * low), math.floor(100 * high)).map(lambda n: n / 100))


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
    """Return a strategy for concrete scenarios inside v(d)max.

    Args:
        junction: built-in name, or id of a junction in `map`; or the junction itself.
        map: OpenDRIVE file of a junction given by id.
        subject: entrance of the vehicle under test among traffic; every scenario has a vehicle at this entrance.
        partial: whether arms may be empty; otherwise each arm has a vehicle, on any lane of the arm.
        near: least distance to the stopping line [m].
        far: greatest distance to the stopping line [m], bounded by the length of the approach.
        pace: greatest speed as a share of v(d)max; at 1 a vehicle may have to brake fully from the first step on.
        wait: range of the draw of an autopilot with a random draw [s].
        aggression: braking level 1, 2 or 3.
        duration: longest run [s], as for `Scenario`.
        vehicle: the vehicle whose v(d)max bounds the speeds; a passenger car by default.
        simulator: the simulator of the runs, as for `simulate`, which also gives v(d)max.

    Raises:
        MapError: the junction is unknown or unusable.
        ScenarioError: a range is empty, or a bound is out of its range.
    """
    bounds = Space(map=map, subject=subject, partial=partial, near=near, far=far, pace=pace)
    place = explored(junction, {**bounds, "wait": wait, "aggression": aggression, "duration": duration})
    reach = [min(far, place.approach(e)) for e in range(len(place.entrances))]
    spans = [distances(near, room) for room in reach]
    codes, delays = _codes(Orbits.at(place, partial=partial)), waits(*wait)
    if subject is not None:
        codes = codes.filter(lambda code: code[subject] > 0)

    @st.composite
    def build(draw: Callable[[SearchStrategy[Any]], Any]) -> Scenario:
        code = draw(codes)
        starts = [(20.0, 0.0)] * len(code)
        for e, direction in enumerate(code):
            if direction:
                distance = draw(spans[e])
                share = draw(st.integers(0, _SHARES))
                limit = _safe_speed(distance, aggression, vehicle, simulator, place.top_limit) if share else 0.0
                speed = math.floor(10 * pace * limit * share / _SHARES) / 10
                starts[e] = (distance, speed)
        return Scenario(
            place,
            code,
            distance=[d for d, _ in starts],
            speed=[v for _, v in starts],
            subject=subject,
            wait=draw(delays),
            aggression=aggression,
            duration=duration,
        )

    return build()


def _safe_speed(distance: float, aggression: int, vehicle: Vehicle | None, simulator: Simulator | None, most: float) -> float:
    """Return a speed [m/s] up to v(d)max and the speed limit `most` [m/s]."""
    below = bisect_right(_KNOWN_DISTANCES, distance)
    return (vmax(_KNOWN_DISTANCES[below - 1], aggression, vehicle, simulator, most) or 0.0) if below else 0.0
