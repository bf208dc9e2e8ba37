"""Checks of a simulator before any vehicle drives: name, braking envelope, places of the start, refused scenarios."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from pytest_rvads.conformance.bench import Bench, Broken, NotTried, crowd, own_row, set_back
from pytest_rvads.conformance.probes import Brakes
from pytest_rvads.physics.body import start
from pytest_rvads.physics.braking import FASTEST
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.simulators.simulator import usable, vmax
from pytest_rvads.support.errors import MapError, RunError, RvadsError, ScenarioError
from pytest_rvads.support.wording import one_line

__all__ = ["envelope_is_a_curve", "has_a_name", "impossible_cases", "start_places"]

PLACE, SPEED, HEADING = 0.1, 0.1, 0.1
"""A vehicle may start so far from where it should [m], [m/s], [rad]: little beside the entrance zone of 1 m."""
_DISTANCES = (0.0, 0.3, 2.0, 10.0, 30.0)


def has_a_name(bench: Bench) -> Iterator[str]:
    """It is an object with a name of one line, by which reports call it; it can be called, and has an envelope, vmax."""
    try:
        name = usable(bench.simulator).name
    except ScenarioError as error:
        yield str(error)
        return
    if name != one_line(name) or name != name.strip():
        yield f"the name must be one line without spaces around it, got {name!r:.80}: reports and records have it in tables"


def envelope_is_a_curve(bench: Bench) -> Iterator[str]:
    """v(d)max is a speed up to 30 m/s, or None where nobody is safe; more distance or harder braking never makes it less."""
    least: dict[float, float] = {}
    for aggression in (1, 3):
        before = -1.0
        for distance in _DISTANCES:
            try:
                speed = vmax(distance, aggression, simulator=bench.simulator, limit=math.inf)
            except RunError as error:
                yield str(error)
                return
            found, asked = -1.0 if speed is None else speed, f"vmax({distance:g}, aggression={aggression})"
            if found > FASTEST + 1e-9:
                yield f"{asked} is {found:.3f} m/s, expected at most {FASTEST:g} m/s: test no faster speeds"
            if found < before or found < least.get(distance, -1.0):
                yield f"{asked} is {_speed(speed)}, less than with less distance or softer braking: make it grow with both"
            before = least[distance] = found
    for distance in (-1.0, math.nan):
        try:
            got = vmax(distance, simulator=bench.simulator)
        except ScenarioError:
            continue
        yield f"vmax({distance:g}) is {_speed(got)}, expected a ScenarioError: refuse a distance that is none"


def _speed(value: float | None) -> str:
    return "None" if value is None else f"{value:.3f} m/s"


def start_places(bench: Bench) -> Iterator[str]:
    """In the first state every vehicle stands where its scenario says, with its speed, heading along its lane.

    Distances are from the front bumper to the stopping line. Tried at every junction, rotated, with lines set back, with
    followers where there is room, and with every driver.
    """
    for place in bench.junctions:
        for driver in (Brakes, *bench.drivers):
            yield from _start(bench, crowd(place, driver, speed=4.0, duration=5 * DT))
        yield from _start(bench, crowd(place, Brakes, speed=4.0, rotation=own_row(place), duration=5 * DT))
    yield from _start(bench, crowd(set_back(bench.place), Brakes, duration=5 * DT))
    with suppress(NotTried):  # the rest has been
        yield from _start(bench, bench.queue(2, most=2, speed=3.0, distance=4.0, duration=5 * DT))


def _start(bench: Bench, case: Case) -> Iterator[str]:
    run = bench.run(case)
    for column, wanted in enumerate(case.starts()):
        for wrong in _placed(case, run, column, *wanted):
            yield f"{run.label}: {run.agents[column].name} starts {wrong}"


def _placed(case: Case, run: Run, column: int, distance: float, speed: float) -> Iterator[str]:
    way = case.scenario.itineraries()[column]
    station, vehicle = way.start(distance), case.fleet.of(run.agents[column].name)
    x, y, heading = (float(number) for number in run.need("pose")[0, column])
    got, fast = float(run.need("station")[0, column]), float(run.need("speed")[0, column])
    here, yaw = way.pose(station), start(way, station, speed, vehicle).yaw
    # Each comparison is false for NaN.
    if not abs(got - station) <= PLACE:
        yield (
            f"at station {got:.2f} m, expected {station:.2f} m, {distance:g} m before its stopping line: measure from the front "
            "bumper"
        )
    if not math.hypot(x - here.x, y - here.y) <= PLACE:
        yield f"at ({x:.2f}, {y:.2f}), expected ({here.x:.2f}, {here.y:.2f}): give x and y of the front bumper, on the map"
    if not abs(fast - speed) <= SPEED:
        yield f"at {fast:.2f} m/s, expected {speed:.2f} m/s: the first state is that at 0 s, before anything moves"
    if not abs(math.remainder(heading - yaw, math.tau)) <= HEADING:
        yield f"with heading {heading:.2f}, expected {yaw:.2f} rad: counter-clockwise from east, in radians"
    if run.zone[0, column] != way.zone(got):
        zone = Zone(int(run.zone[0, column])).name.lower()
        yield f"in zone {zone}, expected {way.zone(got).name.lower()}: take it from Itinerary.zone"


def impossible_cases(bench: Bench) -> Iterator[str]:
    """A case that can't begin is refused: a distance beyond the approach, bodies inside each other, lanes that lie nowhere.

    ScenarioError for the first two and MapError for the last, so that whoever asked is told of the case and not of a fault.
    """
    place = bench.place
    far = crowd(place, Brakes, most=1, duration=DT)
    entrance = far.scenario.creation[0]
    beyond = far.but(distance=place.approach(entrance) + 10.0)
    yield from _refused(bench, beyond, ScenarioError, "a distance longer than the approach")
    wide = Case(crowd(place, Brakes, distance=0.0, duration=DT).scenario, Brakes, fleet=Fleet(Vehicle(width=60.0)))
    yield from _refused(bench, wide, ScenarioError, "vehicles that start inside each other")
    nowhere = replace(
        place,
        entrances=tuple(replace(e, approach=None) for e in place.entrances),
        exits=tuple(replace(e, road=None) for e in place.exits),
        movements={key: replace(m, path=None) for key, m in place.movements.items()},
    )
    lost = Case(far.scenario.but(place=nowhere, distance=0.0), Brakes)  # no distance is too long for it
    yield from _refused(bench, lost, MapError, "a junction of which nobody knows where its lanes lie")


def _refused(bench: Bench, case: Case, expected: type[RvadsError], what: str) -> Iterator[str]:
    try:
        run = bench.run(case)
    except expected:
        return
    except Broken:
        raise
    except Exception as error:
        got = f"{type(error).__name__}: {error}"
    else:
        got = repr(run)
    yield f"{what} must be refused by a {expected.__name__}, got {one_line(got, 160)} for {case.scenario.name}"
