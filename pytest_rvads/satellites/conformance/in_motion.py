"""Checks of the states of a run (clock, zones, speeds, poses, bodies, lights), of its events, its pedestrians and its end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.sweep import EXIT_LENGTH
from pytest_rvads.logic.conduct.bodies import overlap
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import SLOT, Colour, Kind, Vehicle, Zone
from pytest_rvads.satellites.conformance.bench import (
    Bench,
    Brakes,
    Cast,
    Cruises,
    NotTried,
    Witness,
    among,
    crowd,
    meeting,
    own_row,
    straight,
    wrong_end,
)
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.simulators.loop import Walker

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


SPEED = 8.0
"""Speed of the vehicles that meet [m/s]."""
LATER = 8.0
"""Delay of the following vehicle's start [s], after which the leading vehicle has left the bend, where it drives slowly."""
GAP = 0.5
"""Gap between two bodies that pass each other [m]."""
NEAR = 0.2
"""Largest gap between two bodies in the states around a reported contact [m]; a physics engine pushes bodies apart at once."""
EARLY = 0.05
"""Longest accepted time from the first overlap of two bodies to the reported contact [s]."""
STRAY = 0.1
"""Largest distance of a pedestrian from the station that the behaviour gives [m]."""


def gone_for_good(bench: Bench) -> Iterator[str]:
    """A vehicle past the end of its itinerary stays GONE: no driver sees it, no vehicle touches it, and other vehicles go on.

    A follower drives over the place where the vehicle was last seen, while other vehicles stand.
    """
    shown: list[Observation] = []
    case = bench.queue(1, most=2, distance=3.0, speed=0.0, duration=30.0)
    agents = case.agents()
    if len({agent.entrance for agent in agents}) < 2:
        raise NotTried("the first junction has vehicles at one entrance alone: give one with two")
    leaving = [agent.name for agent in agents if agent.entrance == agents[0].entrance]
    cast = partial(Cast, dict.fromkeys(leaving, SPEED), dict.fromkeys(leaving[1:], LATER))
    run = bench.run(Case(case.scenario, partial(Witness, shown, cast)))
    if run.collisions:
        one, two = run.collisions[0].agents
        yield f"{run.label}: {one} and {two} collide at {run.collisions[0].time:.2f} s, expected nobody to: take out who is gone"
        return
    if run.steps != round(case.scenario.duration / DT) + 1:
        yield f"{run.label}: the run ends at {run.duration:.2f} s, expected {case.scenario.duration:g} s: the others go on"
    for column, name in enumerate(leaving):
        gone = run.zone[:, column] == Zone.GONE
        if not gone.any():
            zone = Zone(int(run.zone[-1, column])).name.lower()
            yield f"{run.label}: {name} is in zone {zone} at the end, expected gone, after {EXIT_LENGTH:g} m of its exit road"
            continue
        tick = int(gone.argmax())
        if not gone[tick:].all():
            again = tick + int((~gone[tick:]).argmax())
            yield f"{run.label}: {name} is gone at {tick * DT:.2f} s and back at {again * DT:.2f} s, expected it to stay gone"
        if not (run.need("station")[tick:, column] == run.need("station")[tick, column]).all():
            yield f"{run.label}: the station of {name} changes after it is gone, expected it to stay as it was last seen"
        late = [s for s in shown if round(s.time / DT) >= tick and name in (s.me.name, *(other.name for other in s.others))]
        if late:
            yield f"{run.label}: {name} is gone at {tick * DT:.2f} s, {late[0].me.name} is shown it at {late[0].time:.2f} s"


def crossing(bench: Bench) -> Iterator[str]:
    """Two vehicles that cross and ignore each other collide once, when their bodies touch, and the collision ends the run.

    `Collision.speed` is the relative speed of the two vehicles at the collision.
    """
    place, one, two = next(
        ((place, *pair) for place in bench.junctions for pair in straight(place, conflicting=True)), (None, None, None)
    )
    if place is None or one is None or two is None:
        raise NotTried("no junction has two movements straight ahead that cross: give one")
    first, second, _ = meeting(place, one, two)
    farther = max(first, second)
    starts = {one: 10.0 + farther - first, two: 10.0 + farther - second}
    yield from _collides(bench, among(place, starts, Cruises, speed=SPEED, duration=10.0))


def running_into(bench: Bench) -> Iterator[str]:
    """A vehicle that runs into a standing vehicle collides with the standing vehicle."""
    case = bench.queue(1, distance=5.0, speed=3.0, duration=10.0)
    behind = case.agents()[1].name
    yield from _collides(bench, Case(case.scenario, partial(Cast, {behind: SPEED})))


def pedestrians(bench: Bench) -> Iterator[str]:
    """Pedestrians walk by their behaviours, as Walker moves them, and who drives into a pedestrian collides with the pedestrian.

    The check uses the first junction with crosswalks, or the built-in junction zebra4.
    """
    place = next((junction for junction in bench.junctions if junction.crossings), find("zebra4"))
    over = [key for number, key in place.covers if not number and place.entrances[key[0]].arm == place.crossings[0].arm]
    drive = {place.movements[over[0]]: 10.0}
    case = among(place, drive, Brakes, duration=15.0, pedestrians=[Pedestrian(0, behaviour="stops")])
    run, (setting,) = bench.run(case), case.scenario.walkers()
    walker = Walker(case.scenario.place, setting, ())
    for tick in range(run.steps):
        wanted, got = walker.sample().station, float(run.need("station")[tick, 1])
        if abs(got - wanted) > STRAY:
            expected = f"its behaviour gives {wanted:.2f} m: move it by pytest_rvads.simulators.loop.Walker"
            yield f"{run.label}: {setting.agent.name} is at station {got:.2f} m at {tick * DT:.2f} s, {expected}"
            break
        walker.walk(tick * DT, run.lights[tick].tolist(), ())
    yield from _collides(bench, among(place, drive, Cruises, speed=SPEED, duration=15.0, pedestrians=[Pedestrian(0)]))


def _collides(bench: Bench, case: Case) -> Iterator[str]:
    run = bench.run(case)
    pair = {agent.name for agent in run.agents}
    names = " and ".join(sorted(pair))
    touch = np.flatnonzero(overlap(run, 0, 1))
    if not run.collisions:
        when = f"their bodies overlap from {touch[0] * DT:.2f} s on" if len(touch) else "they are steered into each other"
        yield f"{run.label}: no collision of {names} is reported, {when}: report who touches in Run.collisions"
        return
    if len(run.collisions) > 1:
        yield f"{run.label}: {len(run.collisions)} collisions of one pair, expected 1: each pair once"
    collision = run.collisions[0]
    if set(collision.agents) != pair:
        yield f"{run.label}: the collision is said to be of {' and '.join(collision.agents)}, expected {names}"
        return
    tick = round(collision.time / DT)
    around = _wider(run)[max(tick - 1, 0) : tick + 2]
    early = len(touch) and touch[0] * DT < collision.time - EARLY
    if not around.any() or early:
        bodies = f"overlap from {touch[0] * DT:.2f} s on" if len(touch) else "never overlap"
        told = f"the collision of {names} is said to be at {collision.time:.2f} s"
        yield f"{run.label}: {told}, their bodies {bodies}: poses and sizes decide"
    if run.steps - 1 - tick > 2:
        more = run.duration - collision.time
        yield f"{run.label}: the run goes on for {more:.2f} s after the collision, expected it to end there"
    before = max(min(tick, run.steps - 1) - 1, 0)
    (_, _, one), (_, _, two) = run.need("pose")[before]
    fast, slow = run.need("speed")[before]
    impact = math.hypot(fast * math.cos(one) - slow * math.cos(two), fast * math.sin(one) - slow * math.sin(two))
    if abs(collision.speed - impact) > 0.5 + 0.1 * impact:
        speed = f"{collision.speed:.2f} m/s"
        yield f"{run.label}: the collision is at {speed}, the two move apart or together at {impact:.2f} m/s before it"
    yield from wrong_end(run, "collision")


def _wider(run: Run) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return for each state whether the two bodies, made longer and wider by `NEAR`, overlap, shape ``(steps,)``."""
    sizes = [agent.size or (0.0, 0.0) for agent in run.agents]
    agents = [
        replace(agent, size=(length + NEAR, width + NEAR)) for agent, (length, width) in zip(run.agents, sizes, strict=True)
    ]
    return overlap(replace(run, agents=tuple(agents), collisions=None), 0, 1)


def passing(bench: Bench) -> Iterator[str]:
    """Vehicles that pass each other at a gap of 0.5 m don't collide: a body has exactly the length and width of its vehicle."""
    for place in bench.junctions:
        for one, two in straight(place, conflicting=False):
            _, _, apart = meeting(place, one, two)
            width = apart - GAP
            if 1.0 <= width <= 4.0:
                case = among(place, {one: 10.0, two: 10.0}, Cruises, speed=SPEED, duration=20.0)
                run = bench.run(Case(case.scenario, Cruises, fleet=Fleet(Vehicle(width=width))))
                for collision in run.collisions or ():
                    told = f"{' and '.join(collision.agents)} are said to collide at {collision.time:.2f} s"
                    sizes = f"their ways are {apart:.2f} m apart and they are {width:.2f} m wide"
                    yield f"{run.label}: {told}, {sizes}: bodies have the length and width of their vehicles"
                end = run.provenance.get("end")
                if not run.collisions and end != "left":
                    yield f"{run.label}: it ended by {end!r}, expected 'left': both drive past each other and away"
                return
    raise NotTried("no junction has two straight movements in opposite directions: give one")
