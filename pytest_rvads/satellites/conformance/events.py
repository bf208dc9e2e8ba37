"""Checks of events between agents: a vehicle that has left is out of the way, only bodies that touch collide, people walk."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.sweep import EXIT_LENGTH
from pytest_rvads.logic.conduct.bodies import overlap
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.satellites.conformance.bench import (
    Bench,
    Brakes,
    Cast,
    Cruises,
    NotTried,
    Witness,
    among,
    meeting,
    straight,
    wrong_end,
)
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.simulators.walkers import Walker

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
            expected = f"its behaviour gives {wanted:.2f} m: move it by pytest_rvads.simulators.walkers.Walker"
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
