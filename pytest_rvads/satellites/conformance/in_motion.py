"""Checks of the values in every state of a run (clock, zones, speeds, poses, bodies, lights), and of the end of runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import SLOT, Colour, Kind, Vehicle, Zone
from pytest_rvads.satellites.conformance.bench import Bench, Brakes, Cruises, Witness, crowd, own_row, wrong_end
from pytest_rvads.scenarios.case import Case, Fleet

RATE = (0.1, 0.03)
"""Largest difference between the speed on an approach and the progress of the station: a part [m/s], and a share of the speed."""
OFFSET = 1.5
"""Largest distance of the front bumper from the centre line [m]; in bends the bumper swings out by half of this distance."""
LAG = 0.3
"""Largest difference between the station of a vehicle and the projection of its pose onto the centre line [m]."""
TURNED = 0.6
"""Largest angle between a heading and the direction of the centre line under the middle of the body [rad]."""
_BODY = 6.0
"""Distance behind the front bumper that is longer than every body [m]."""
_STRAIGHT = 0.02
"""Largest change of direction along a body for which a lane counts as straight [rad].

With this change, the speed of the bumper differs from that of the vehicle by a fiftieth of a percent.
"""
_EVERY = 10
"""The pose in every state whose number is a multiple of this number is checked."""
_SPEED, _WHILE = 5.0, 1.0
"""Speed of the vehicle in the check `clock` [m/s], and duration of the run [s]."""


def clock(bench: Bench) -> Iterator[str]:
    """States are 0.01 s apart; in every state but the last, each driver is asked once, with the time and values of the state.

    A vehicle with a constant speed advances by this speed, so the vehicle dynamics advance by 0.01 s per state.
    """
    shown: list[Observation] = []
    case = bench.alone(partial(Witness, shown, partial(Cruises, _SPEED)), distance=12.0, speed=_SPEED, duration=_WHILE)
    run = bench.run(case)
    steps = round(_WHILE / DT)
    if run.dt != DT:
        yield f"{run.label}: states are {run.dt:g} s apart, expected {DT:g} s: rules count ticks of that"
    if run.steps != steps + 1:
        yield f"{run.label}: {run.steps} states, expected {steps + 1} in {_WHILE:g} s: the first at 0 s, one more after each step"
    if len(shown) != steps:
        asked = f"the driver was asked {len(shown)} times in {_WHILE:g} s"
        yield f"{run.label}: {asked}, expected {steps}: in every state but the last"
    for tick, seen in enumerate(shown):
        if abs(seen.time - tick * DT) > 1e-6:
            yield f"{run.label}: decision {tick} was asked for at {seen.time:.4f} s, expected {tick * DT:.2f} s"
            break
        if tick < run.steps and abs(seen.me.station - float(run.need("station")[tick, 0])) > 1e-6:
            there = float(run.need("station")[tick, 0])
            shows = f"at {seen.time:.2f} s the driver was shown station {seen.me.station:.3f} m, the run has {there:.3f} m"
            yield f"{run.label}: {shows}: record the state that drivers decide on, once"
            break
    way = float(np.ptp(run.need("station")[:, 0]))
    if not 0.85 <= way / (_SPEED * _WHILE) <= 1.15:
        got = f"got on by {way:.2f} m in {_WHILE:g} s, expected {_SPEED * _WHILE:g} m"
        yield f"{run.label}: a vehicle that keeps {_SPEED:g} m/s {got}: advance the plant by {DT:g} s per state"


def ends(bench: Bench) -> Iterator[str]:
    """A run ends with the state in which the last vehicle has left the junction, or at the duration of the scenario.

    A vehicle has left after 15 m of its exit road. The entry ``end`` of `Run.provenance` is the reason of the end: left,
    duration, collision, route, fault or late.
    """
    for duration in (0.5, 0.37):
        run = bench.run(bench.alone(Brakes, duration=duration))
        yield from wrong_end(run, "duration")
        states = round(duration / DT) + 1
        if run.steps != states:
            yield f"{run.label}: {run.steps} states, expected {states}: a run of {duration:g} s ends at that time"
    for driver in (Cruises, *bench.drivers):
        case = bench.alone(driver, distance=3.0, speed=2.0, duration=60.0)
        run = bench.run(case)
        leave = [way.leave for way in case.scenario.itineraries()]
        left = (run.need("station") >= leave).all(axis=1)
        if not left.any():
            if driver is Cruises:
                yield f"{run.label}: the vehicle has not left after {run.duration:.2f} s at up to 8 m/s, expected it to drive"
            continue
        yield from wrong_end(run, "left")
        more = run.steps - 1 - int(left.argmax())
        if more:
            yield (
                f"{run.label}: {more} states follow the one in which the last vehicle has left, expected none: end the run there"
            )


def integrity(bench: Bench) -> Iterator[str]:
    """rvads.validate finds no error in a run: no jump, no gap, no wrong order of colours, no contact without a collision.

    Progress along the itinerary is tested by the check ``speeds``, because in narrow bends the bumper is slower than the vehicle.
    """
    for _, run in bench.trips():
        if run.collisions is None:
            yield f"{run.label}: its collisions are None, expected a tuple, empty where nobody touched: who simulates can tell"
        for finding in validate(run):
            if finding.kind != "progress":
                yield f"{run.label}: {finding}: rvads.validate(run) must find nothing in a run of a simulator"


def zones_follow_stations(bench: Bench) -> Iterator[str]:
    """The zone of every vehicle is the zone of its station, and a vehicle never returns to an earlier zone."""
    for case, run in bench.trips():
        for column, way in enumerate(case.scenario.itineraries()):
            name, zone = run.agents[column].name, run.zone[:, column].astype(np.int64)
            back = np.flatnonzero(np.diff(zone) < 0)
            if len(back):
                before, after = (Zone(int(zone[back[0] + k])).name.lower() for k in (0, 1))
                yield f"{run.label}: {name} goes back from {before} to {after} at {(back[0] + 1) * DT:.2f} s: zones only go on"
            if (zone == Zone.ABSENT).any():
                yield f"{run.label}: {name} is absent, expected it in every state: only recordings lack somebody"
            for tick in np.flatnonzero(run.here[:, column]).tolist():
                station = float(run.need("station")[tick, column])
                if (wanted := way.zone(station)) != zone[tick]:
                    got = f"in zone {Zone(int(zone[tick])).name.lower()} at {tick * DT:.2f} s, expected {wanted.name.lower()}"
                    yield f"{run.label}: {name} at station {station:.2f} m is {got}: take it from Itinerary.zone"
                    break


def speeds_are_progress(bench: Bench) -> Iterator[str]:
    """On the approach, the speed of a vehicle [m/s] equals the progress of its station per second at the same time."""
    absolute, relative = RATE
    for case, run in bench.trips():
        ways = case.scenario.itineraries()
        speed, station = run.need("speed"), run.need("station")
        mean = (speed[1:] + speed[:-1]) / 2
        rate = np.diff(station, axis=0) / run.dt
        near = np.abs(rate - mean) <= absolute + relative * np.abs(mean)  # false for NaN
        wrong = np.argwhere(~near & (run.zone[1:] <= Zone.ENTRANCE) & (run.zone[1:] >= Zone.APPROACH)).tolist()
        for tick, column in wrong:
            at = float(station[tick, column])
            before, after = (ways[column].pose(at + distance).heading for distance in (-_BODY, 1.0))
            if abs(math.remainder(after - before, math.tau)) > _STRAIGHT:
                continue  # in a bend the front bumper moves on another path than the vehicle
            got = f"{run.agents[column].name} gets on by {rate[tick, column]:.2f} m/s from {tick * DT:.2f} s to the next state"
            mean_speed = f"its speed is {mean[tick, column]:.2f} m/s"
            yield f"{run.label}: {got}, {mean_speed}: give the forward speed in m/s, and the station that belongs to it"
            break


def headings_and_places(bench: Bench) -> Iterator[str]:
    """A pose is the front bumper's position on the map, near the centre line, and a heading in rad counter-clockwise from east.

    The station is the projection of the front bumper onto the centre line.
    """
    for case, run in bench.trips():
        for column, way in enumerate(case.scenario.itineraries()):
            length = case.fleet.of(run.agents[column].name).length
            for tick in range(0, run.steps, _EVERY):
                wrong = _astray(run, way, tick, column, length) if run.here[tick, column] else ""
                if wrong:
                    yield f"{run.label}: {run.agents[column].name} at {tick * DT:.2f} s {wrong}"
                    break


def _astray(run: Run, way: Itinerary, tick: int, column: int, length: float) -> str:
    """Return the error of a pose in words; an empty text for a correct pose."""
    x, y, heading = (float(number) for number in run.need("pose")[tick, column])
    station = float(run.need("station")[tick, column])
    if not all(map(math.isfinite, (x, y, heading, station))):
        return f"is at ({x}, {y}), heading {heading}, station {station}, expected finite numbers"
    along, offset = way.project(x, y, station)
    if abs(offset) > OFFSET:
        return (
            f"is {abs(offset):.2f} m beside its centre line, expected at most {OFFSET:g} m: x and y of the front bumper, y to "
            "the north"
        )
    if abs(along - station) > LAG:
        return f"has station {station:.2f} m, its pose lies at {along:.2f} m: project the front bumper onto the itinerary"
    lane = way.pose(station - length / 2).heading
    if abs(math.remainder(heading - lane, math.tau)) > TURNED:
        return f"has heading {heading:.2f}, its lane {lane:.2f} rad: counter-clockwise from east, in radians"
    return ""


def bodies_of_the_fleet(bench: Bench) -> Iterator[str]:
    """Agents have the kind and size of their vehicles in the fleet of the case, because the sizes decide which vehicles touch."""
    case = bench.alone(Brakes, most=2, duration=DT)
    first = case.agents()[0].name
    truck = Vehicle(length=8.0, width=2.4, front_axle=2.4, rear_axle=2.4, mass=9000.0, kind=Kind.TRUCK)
    case = Case(case.scenario, Brakes, fleet=Fleet(Vehicle(length=4.2), {first: truck}))
    run = bench.run(case)
    for got, wanted in zip(run.agents, case.agents(), strict=True):
        if got.size is None or not np.allclose(got.size, wanted.size or (), rtol=0.0, atol=1e-6):
            yield f"{run.label}: the size of {got.name} is {got.size}, expected {wanted.size}: take agents from case.agents()"
        if got.kind != wanted.kind:
            yield f"{run.label}: {got.name} is a {got.kind.value}, expected a {wanted.kind.value}: take agents from case.agents()"


def lights(bench: Bench) -> Iterator[str]:
    """In every state each entrance has the colour of Scenario.signals at that time, and NONE where no light stands.

    Drivers are shown the same colours. The check runs a whole cycle at every junction, and half a cycle of the rotated junction.
    """
    for place in bench.junctions:
        cycle = len(place.phase_groups) * SLOT
        yield from _colours(bench, crowd(place, Brakes, most=1, duration=cycle + 0.1))
        yield from _colours(bench, crowd(place, Brakes, most=1, rotation=own_row(place), duration=cycle / 2 + 0.1))


def _colours(bench: Bench, case: Case) -> Iterator[str]:
    shown: list[Observation] = []
    run = bench.run(Case(case.scenario, partial(Witness, shown)))
    plan, entrances = case.scenario.signals(), len(run.junction.starts)
    for tick in range(run.steps):
        wanted = plan.colours(tick * DT, entrances)
        if tuple(run.lights[tick]) != wanted:
            told = _told(run.lights[tick].tolist(), wanted, tick)
            yield f"{run.label}: {told}: take them from Scenario.signals, at the time of the state"
            break
    for seen in shown:
        tick = round(seen.time / DT)
        wanted = plan.colours(tick * DT, entrances)
        if seen.lights != wanted:
            yield f"{run.label}: the driver is shown that {_told(seen.lights, wanted, tick)}: show what the run records"
            break


def _told(got: Sequence[int], wanted: tuple[Colour, ...], tick: int) -> str:
    entrance = next(e for e, (one, two) in enumerate(zip(got, wanted, strict=True)) if one != two)
    shown, due = (Colour(colours[entrance]).name.lower() for colours in (got, wanted))
    return f"the light of entrance {entrance} is {shown} at {tick * DT:.2f} s, expected {due}"
