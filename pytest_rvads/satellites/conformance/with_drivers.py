"""Checks of a simulator's exchange with drivers: observations, faults of drivers, traffic, vehicles that leave their route."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.lane import off_route
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.physics.braking import STANDING
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.satellites.conformance.bench import (
    FAULTY_FROM,
    Bench,
    Brakes,
    Broken,
    Cruises,
    Hangs,
    NotANumber,
    NotTried,
    Raises,
    Steers,
    Witness,
    crowd,
    own_row,
    unmade,
    wrong_end,
)
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.simulators.simulator import vmax

_PATIENCE = 1.0
"""Longest real time for a decision of the hanging driver [s]."""
_BRAKING_FROM = 8.0
"""Distance before the stopping line at which a vehicle begins to brake, at aggression 1 [m]."""
_RULE = "speed_limit"
"""A rule that applies to every vehicle at every junction."""


def what_drivers_see(bench: Bench) -> Iterator[str]:
    """Every driver is shown its vehicle and the other vehicles that are still in the run, in the order of their creation.

    An observation equals the recorded state, and holds the itinerary, the vehicle, the junction and the settings of the scenario.
    """
    shown: list[Observation] = []
    place = bench.place
    case = crowd(place, partial(Witness, shown, partial(Cruises, 4.0)), speed=4.0, rotation=own_row(place), duration=0.2)
    scenario, fleet = case.scenario.but(aggression=2, wait=2.5), Fleet(Vehicle(mass=1200.0))
    run = bench.run(Case(scenario, case.driver, fleet=fleet))
    order = sorted(run.agents, key=lambda agent: scenario.creation.index(agent.entrance))
    names = [agent.name for agent in order]
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    ways = {agent.name: way for agent, way in zip(run.agents, scenario.itineraries(), strict=True)}
    asked = sorted((round(seen.time / DT), seen.me.name) for seen in shown)
    if asked != sorted((tick, name) for tick in range(run.steps - 1) for name in names):
        yield f"{run.label}: {len(asked)} observations, expected one for each of {', '.join(names)} in every state but the last"
        return
    wanted = {"junction": place, "vehicle": fleet.vehicle, "aggression": 2, "wait": 2.5}
    for seen in shown:
        me, tick = seen.me.name, round(seen.time / DT)
        others = [state.name for state in seen.others]
        if me not in names or others != [name for name in names if name != me]:
            sees = f"{me} sees {others} at {seen.time:.2f} s"
            yield f"{run.label}: {sees}, expected the others of {names}, in this order: that of creation"
            return
        if seen.created != names.index(me):
            yield f"{run.label}: {me} is told created={seen.created}, expected {names.index(me)}: how many were created before it"
            return
        wrong = [f"{name} {getattr(seen, name)!r:.60}" for name, value in wanted.items() if getattr(seen, name) != value]
        if seen.speed_limit != ways[me].limit_at(seen.me.station):
            wrong.append(f"speed_limit {seen.speed_limit!r}")
        if (seen.itinerary.entrance, seen.itinerary.exit) != (ways[me].entrance, ways[me].exit):
            wrong.append(f"an itinerary from {seen.itinerary.entrance} to {seen.itinerary.exit}")
        if wrong:
            yield f"{run.label}: {me} is shown {', '.join(wrong)}, expected what the case says"
            return
        for state in (seen.me, *seen.others):
            column = columns[state.name]
            there = [run.need("station")[tick, column], *run.need("pose")[tick, column], run.need("speed")[tick, column]]
            got = [state.station, state.x, state.y, state.heading, state.speed]
            if not np.allclose(got, there, rtol=0.0, atol=1e-6) or state.zone != run.zone[tick, column]:
                sees = f"{me} sees {state.name} at {seen.time:.2f} s at station {state.station:.3f} m, {state.speed:.3f} m/s"
                has = f"the run has {there[0]:.3f} m, {there[-1]:.3f} m/s"
                yield f"{run.label}: {sees}, {has}: show all drivers the state that is recorded"
                return


def faults(bench: Bench) -> Iterator[str]:
    """A driver that raises an error, answers NaN or can't be made ends its run by a fault, and the verdicts are ERROR.

    The fault names the vehicle and the time. The run keeps the states before the fault, and a fault does not change the next run.
    """
    case = bench.alone(Brakes, most=2, duration=0.2)
    before = bench.run(case).hash
    for driver, states in ((Raises, FAULTY_FROM + 1), (NotANumber, FAULTY_FROM + 1), (unmade, 1)):
        kind = str(getattr(driver, "__qualname__", driver))
        try:
            run = bench.run(Case(case.scenario, driver))
        except Broken:
            raise
        except Exception as error:
            yield f"a driver that is {kind} makes the simulator raise {error!r:.120}, expected a run with Run.fault set"
            continue
        yield from _ended(run, kind, states)
        if run.fault is not None:
            yield from wrong_end(run, "fault")
    if bench.run(case).hash != before:
        yield f"{case.scenario.name}: after runs with faults its run is another one than before: leave nothing of a run behind"


def _ended(run: Run, driver: str, states: int) -> Iterator[str]:
    """Yield the errors of a run that should have ended by a fault of the driver of its first vehicle."""
    if run.fault is None:
        yield f"{run.label}: the driver {driver} has a fault, the run has none: set Run.fault, or nobody learns of it"
        return
    first = run.agents[0].name
    if run.fault.agent != first:
        yield f"{run.label}: the fault of {driver} is said to be of {run.fault.agent!r}, expected {first!r}"
    if run.steps != states:
        yield f"{run.label}: {run.steps} states with {driver}, expected {states}: keep those up to the fault, add none"
    if abs(run.fault.time - (states - 1) * DT) > DT / 2:
        yield f"{run.label}: the fault of {driver} came at {run.fault.time:.2f} s, expected {(states - 1) * DT:.2f} s"
    if driver not in run.fault.reason:
        yield f"{run.label}: the reason of the fault does not name the driver {driver}: {run.fault.reason:.120}"
    if (status := check(run, _RULE).status) != Status.ERROR:
        yield f"{run.label}: {_RULE} says {status} of a run that {driver} ended, expected ERROR"


def hanging(bench: Bench) -> Iterator[str]:
    """A driver that does not answer within the time limit of a decision ends its run by a fault.

    `rvads.limits` sets the time limit, and `pytest_rvads.simulators.seat` enforces it. ``end`` in `Run.provenance` is ``late``.
    """
    case = Case(bench.alone(Brakes, most=2, duration=0.2).scenario, Hangs)
    try:
        run = bench.run(case, decision=_PATIENCE)
    except Broken:
        raise
    except Exception as error:
        name = case.scenario.name
        yield f"{name}: a driver that hangs makes the simulator raise {error!r:.160}, expected a run with Run.fault set"
        return
    yield from _ended(run, "Hangs", FAULTY_FROM + 1)
    if run.fault is not None:
        yield from wrong_end(run, "late")


def subject_and_traffic(bench: Bench) -> Iterator[str]:
    """The driver of a case drives the vehicle under test, the traffic of the case all others; the facts hold the speed limit."""
    scenario = bench.alone(Brakes, most=2, duration=1.0, speed=0.0).scenario
    entrances = scenario.creation
    if len(entrances) < 2:
        raise NotTried("the first junction has one entrance alone: give one with two")
    run = bench.run(Case(scenario.but(subject=entrances[1]), Cruises, traffic=Brakes))
    way = np.ptp(run.need("station"), axis=0)
    for column, agent in enumerate(run.agents):
        if (way[column] > 0.1) != (agent.name == run.subject):
            moves = f"{agent.name} moves {way[column]:.2f} m in 1 s"
            wanted = f"where the subject {run.subject} is to drive off and the traffic to stand"
            yield f"{run.label}: {moves}, {wanted}: Case.driver drives the subject, Case.traffic all others"
    limit = run.facts.speed_limit
    if limit != SPEED_LIMIT:
        yield f"{run.label}: its facts have the speed limit {limit}, expected {SPEED_LIMIT:g} m/s: rules judge by it"


def leaving_the_route(bench: Bench) -> Iterator[str]:
    """A vehicle that leaves its route ends the run without a fault, and `Facts.strayed` names the vehicle."""
    case = bench.alone(Steers, distance=20.0, speed=6.0, duration=20.0)
    run = bench.run(case)
    first = run.agents[0].name
    if run.fault is not None:
        yield f"{run.label}: a vehicle that leaves its route ends the run by a fault, expected none: {run.fault.reason:.120}"
    elif run.facts.strayed != (first,):
        yield f"{run.label}: {first} steers off its route, its facts name {run.facts.strayed} as strayed, expected ({first!r},)"
    elif not off_route(run, 0)[-1] or off_route(run, 0)[:-1].any():
        yield f"{run.label}: {first} is not off its route for the first time in the last state: end the run when it is"
    else:
        yield from wrong_end(run, "route")


def brakes_by_its_envelope(bench: Bench) -> Iterator[str]:
    """A vehicle that brakes fully from v(d)max stops before the line; from 1.3 times that speed it does not.

    The braking envelope v(d)max decides which starts are worth a test.
    """
    for aggression in (1, 3):
        distance = _BRAKING_FROM / aggression
        speed = vmax(distance, aggression, simulator=bench.simulator)
        if speed is None:
            asked = f"vmax({distance:g}, aggression={aggression})"
            yield f"{asked} is None, expected a speed: {distance:g} m are enough for a slow vehicle"
            continue
        for share, stops in ((1.0, True), (1.3, False)):
            case = bench.alone(Brakes, distance=distance, speed=share * speed, aggression=aggression, duration=10.0)
            run = bench.run(case)
            way = case.scenario.itineraries()[0]
            farthest = float(run.need("station").max())
            stood = abs(float(run.need("speed")[-1, 0])) < STANDING
            if (farthest <= way.line) != stops or (stops and not stood):
                much = "stops before" if stops else "passes"
                start = f"from {share:g} x v(d)max = {share * speed:.2f} m/s, {distance:g} m before the line"
                past = f"it gets {farthest - way.line:+.2f} m past it, expected that it {much} it"
                yield f"{run.label}: braking fully {start}, {past}: find vmax by tests of this plant"
