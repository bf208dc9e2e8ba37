"""Hypothesis strategies for junctions and scenarios, to use under ``@given``.

Everything shrinks towards what is easy to read: fewer vehicles, standing starts, round distances. Concrete scenarios stay
inside the braking envelope: nobody starts faster than a share of v(d)max, so a violation is never a matter of speed alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.finder import find, names
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.orbits import Directions, Orbits
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.space import FARTHEST, NEAREST, Space, explored
from pytest_rvads.simulators.simulator import Simulator, vmax

__all__ = ["abstract_scenarios", "distances", "junctions", "scenarios", "waits"]

LONGEST_WAIT = 4.0
"""Range of the draw of autopilots that have one, from 0 [s]."""
USUAL_WAIT = 1.5
"""Draw of a scenario without ``wait`` [s]."""
PACE = 0.75
"""Share of v(d)max that vehicles start with at most, so that reacting takes no more than ordinary braking."""
_ROUND = (20.0, 10.0, 5.0, 2.0, 1.0, 0.3, 30.0)
_KNOTS = (0.3, 0.6, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0)
"""Where v(d)max is asked for; it grows with d, so the value at the next knot below is safe [m]."""
_SHARES = 10
"""Into how many steps the speeds up to v(d)max are divided."""


def junctions(control: JunctionControl | str | None = None, ways: int | None = None) -> SearchStrategy[Junction]:
    """Return a strategy for built-in junctions.

    Args:
        control: ``"stop"`` or ``"lights"``; any by default.
        ways: number of arms; any by default.

    Raises:
        ScenarioError: no such junction.
    """
    found = [j for j in map(find, names()) if control in (None, j.control) and ways in (None, j.ways)]
    if not found:
        raise ScenarioError(f"no built-in junction has control {control!r} and {ways!r} ways: there are {', '.join(names())}")
    return st.sampled_from(found)


def abstract_scenarios(ways: int = 4, *, partial: bool = True) -> SearchStrategy[Directions]:
    """Return a strategy for abstract scenarios: a direction per entrance, 0 where nobody stands.

    Args:
        ways: number of arms, each with one entrance.
        partial: with empty entrances, of which there may be all but one.

    Raises:
        ScenarioError: another number of ways than 3..8.
    """
    return _codes(Orbits.plain(ways, partial=partial))


def _codes(orbits: Orbits) -> SearchStrategy[Directions]:
    letters = [st.integers(0, len(slot) - 1).map(slot.__getitem__) for slot in orbits.slots]
    codes = st.tuples(*letters).map(lambda chosen: tuple(direction for letter in chosen for direction in letter))
    return codes.filter(any) if orbits.partial else codes


def distances(low: float = NEAREST, high: float = FARTHEST) -> SearchStrategy[float]:
    """Return a strategy for distances to the stopping line [m]: round ones, and any multiple of 0.1 m.

    Raises:
        ScenarioError: an empty range, or less than 0.
    """
    if not 0 <= low < high < math.inf:
        raise ScenarioError(f"distances go from 0 m or more to something greater, got {low!r} to {high!r}")
    near = [d for d in _ROUND if low <= d <= high] or [low]
    tenths = st.integers(math.ceil(10 * low), max(math.floor(10 * high), math.ceil(10 * low))).map(lambda n: n / 10)
    return st.one_of(st.sampled_from(near), tenths.filter(lambda d: low <= d <= high) if high - low >= 0.1 else st.just(low))


def waits(low: float = 0.0, high: float = LONGEST_WAIT) -> SearchStrategy[float]:
    """Return a strategy for the draw of an autopilot [s]: whole seconds, and any tick of 0.01 s.

    Raises:
        ScenarioError: an empty range, or less than 0.
    """
    if not 0 <= low <= high < math.inf:
        raise ScenarioError(f"waits go from 0 s or more upwards, got {low!r} to {high!r}")
    whole = [USUAL_WAIT, *map(float, range(math.ceil(low), math.floor(high) + 1))]
    whole = [s for s in whole if low <= s <= high] or [low]
    return st.one_of(st.sampled_from(whole), st.integers(math.ceil(100 * low), math.floor(100 * high)).map(lambda n: n / 100))


def scenarios(  # noqa: PLR0913 - keywords, each an axis of its own
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
        subject: entrance of the vehicle under test among traffic; there is always one.
        partial: whether arms may be empty; otherwise one vehicle stands on each arm, on any lane of the arm.
        near: least distance to the stopping line [m].
        far: greatest distance [m]; no farther than the approach of an entrance reaches.
        pace: greatest speed as a share of v(d)max; at 1 a vehicle may have to brake with all it has from the first step on.
        wait: range of the draw of autopilots that have one [s].
        aggression: braking level 1, 2 or 3.
        duration: longest run [s], as for `Scenario`.
        vehicle: whose v(d)max bounds the speeds; a passenger car by default.
        simulator: what will make the runs, as for `simulate`; v(d)max is its own.

    Raises:
        MapError: unknown or unusable junction.
        ScenarioError: an empty range, or a value that means nothing.
    """
    asked = Space(map=map, subject=subject, partial=partial, near=near, far=far, pace=pace)
    place = explored(junction, {**asked, "wait": wait, "aggression": aggression, "duration": duration})
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
                limit = _limit(distance, aggression, vehicle, simulator, place.top_limit) if share else 0.0
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


def _limit(distance: float, aggression: int, vehicle: Vehicle | None, simulator: Simulator | None, most: float) -> float:
    """Return a speed [m/s] up to v(d)max and the speed limit `most` [m/s]."""
    below = bisect_right(_KNOTS, distance)
    return (vmax(_KNOTS[below - 1], aggression, vehicle, simulator, most) or 0.0) if below else 0.0
