"""Checks of a simulator beside the states of its runs: name, envelope, starts, drivers, repetition, provenance."""

from __future__ import annotations

import base64
import json
import math
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pytest_rvads import __version__
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.lane import off_route
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.physics.body import start
from pytest_rvads.physics.braking import FASTEST, STANDING
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle, Zone
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
    set_back,
    unmade,
    wrong_end,
)
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.simulators.simulator import Simulator, limits, made_by, named, simulate, simulators, usable, vmax
from pytest_rvads.support.errors import MapError, RunError, RvadsError, ScenarioError
from pytest_rvads.support.wording import one_line

PLACE, SPEED, HEADING = 0.1, 0.1, 0.1
"""Largest errors of a start in place [m], speed [m/s] and heading [rad]; small beside the entrance zone of 1 m."""
_DISTANCES = (0.0, 0.3, 2.0, 10.0, 30.0)

_CUT = 12
"""Number of characters of a hash in messages."""


def has_a_name(bench: Bench) -> Iterator[str]:
    """A simulator can be called, has a name of one line for reports, and has a method vmax for the braking envelope."""
    try:
        name = usable(bench.simulator).name
    except ScenarioError as error:
        yield str(error)
        return
    if name != one_line(name) or name != name.strip():
        yield f"the name must be one line without spaces around it, got {name!r:.80}: reports and records have it in tables"


def envelope_is_a_curve(bench: Bench) -> Iterator[str]:
    """v(d)max is at most 30 m/s, or None if no speed is safe; more distance or harder braking never makes v(d)max less."""
    least: dict[float, float] = {}
    for aggression in (1, 3):
        before = -1.0
        for distance in _DISTANCES:
            try:
                speed = vmax(distance, aggression, simulator=bench.simulator, limit=math.inf)
            except RunError as error:
                yield str(error)
                return
            found = -1.0 if speed is None else speed
            speed_text = "None" if speed is None else f"{speed:.3f} m/s"
            answer = f"vmax({distance:g}, aggression={aggression}) is {speed_text}"
            if found > FASTEST + 1e-9:
                yield f"{answer}, expected at most {FASTEST:g} m/s: test no faster speeds"
            if found < before or found < least.get(distance, -1.0):
                yield f"{answer}, less than with less distance or softer braking: make it grow with both"
            before = least[distance] = found
    for distance in (-1.0, math.nan):
        try:
            got = vmax(distance, simulator=bench.simulator)
        except ScenarioError:
            continue
        speed_text = "None" if got is None else f"{got:.3f} m/s"
        yield f"vmax({distance:g}) is {speed_text}, expected a ScenarioError: refuse a distance that is none"


def start_places(bench: Bench) -> Iterator[str]:
    """In the first state every vehicle has the place and the speed of the scenario, and heads along its lane.

    Distances are from the front bumper to the stopping line. The check tries every junction and its rotation, every driver,
    stopping lines farther from the junction, and followers if there is room.
    """
    for place in bench.junctions:
        for driver in (Brakes, *bench.drivers):
            yield from _start(bench, crowd(place, driver, speed=4.0, duration=5 * DT))
        yield from _start(bench, crowd(place, Brakes, speed=4.0, rotation=own_row(place), duration=5 * DT))
    yield from _start(bench, crowd(set_back(bench.place), Brakes, duration=5 * DT))
    with suppress(NotTried):  # without room for followers, all other starts have been checked
        yield from _start(bench, bench.queue(2, most=2, speed=3.0, distance=4.0, duration=5 * DT))


def _start(bench: Bench, case: Case) -> Iterator[str]:
    run = bench.run(case)
    for column, (distance, speed) in enumerate(case.starts()):
        name, way = run.agents[column].name, case.scenario.itineraries()[column]
        starts, station = f"{run.label}: {name} starts", way.start(distance)
        x, y, heading = (float(number) for number in run.need("pose")[0, column])
        got, fast = float(run.need("station")[0, column]), float(run.need("speed")[0, column])
        here, yaw = way.pose(station), start(way, station, speed, case.fleet.of(name)).yaw
        # Each comparison is false for NaN.
        if not abs(got - station) <= PLACE:
            line = f"{station:.2f} m, {distance:g} m before its stopping line"
            yield f"{starts} at station {got:.2f} m, expected {line}: measure from the front bumper"
        if not math.hypot(x - here.x, y - here.y) <= PLACE:
            places = f"({x:.2f}, {y:.2f}), expected ({here.x:.2f}, {here.y:.2f})"
            yield f"{starts} at {places}: give x and y of the front bumper, on the map"
        if not abs(fast - speed) <= SPEED:
            yield f"{starts} at {fast:.2f} m/s, expected {speed:.2f} m/s: the first state is that at 0 s, before anything moves"
        if not abs(math.remainder(heading - yaw, math.tau)) <= HEADING:
            yield f"{starts} with heading {heading:.2f}, expected {yaw:.2f} rad: counter-clockwise from east, in radians"
        if run.zone[0, column] != way.zone(got):
            zone = Zone(int(run.zone[0, column])).name.lower()
            yield f"{starts} in zone {zone}, expected {way.zone(got).name.lower()}: take it from Itinerary.zone"


def impossible_cases(bench: Bench) -> Iterator[str]:
    """A simulator refuses a start beyond the approach, bodies that overlap at the start, and a junction without geometry.

    The first two cases raise a ScenarioError and the third case a MapError, so that the error blames the case, not the driver.
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
    lost = Case(far.scenario.but(place=nowhere, distance=0.0), Brakes)  # 0 m fits on an approach of any length
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


def repeatable(bench: Bench) -> Iterator[str]:
    """The same case gives the same run, bit for bit: a second time, after other cases, and in another order of cases.

    Random numbers depend only on the case. The check compares runs by `Run.hash`.
    """
    cases = _cases(bench)
    before = [bench.run(case).hash for case in cases]
    for case, one in zip(cases, before, strict=True):
        if (two := bench.run(case).hash) != one:
            hashes = f"its hash is {one[:_CUT]} and then {two[:_CUT]}, expected the same"
            yield f"{case.scenario.name}: {hashes}: build every run from its case alone"
            return
    for place in bench.junctions:
        bench.run(crowd(place, Brakes, duration=0.1))
    again = [bench.run(case).hash for case in reversed(cases)][::-1]
    for case, one, two in zip(cases, before, again, strict=True):
        if one != two:
            yield f"{case.scenario.name}: its hash is {one[:_CUT]}, after other cases {two[:_CUT]}: leave nothing of a run behind"


def _cases(bench: Bench) -> list[Case]:
    places = (bench.junctions[0], bench.junctions[-1])
    return [crowd(place, driver, speed=3.0, duration=4.0) for place in places for driver in bench.drivers]


def another_process(bench: Bench) -> Iterator[str]:
    """The same case gives the same run in another process, so that workers and machines agree and a failure can be repeated.

    The other process gets the simulator as ``module:name`` of ``--rvads-simulator``, by the name of a shipped simulator, or
    pickled.
    """
    cases = _cases(bench)
    try:
        simulator: str | Simulator = bench.where or bench.simulator
        if not bench.where and (name := bench.simulator.name) in simulators() and named(name) is bench.simulator:
            simulator = name
        pickled = base64.b64encode(pickle.dumps((simulator, cases))).decode()
    except Exception as error:
        yield (
            f"the simulator or a driver can't be sent to another process, {one_line(repr(error), 120)}: "
            "name it by --rvads-simulator=module:name, and take drivers that can be imported"
        )
        return
    here = [bench.run(case).hash for case in cases]
    asked = json.dumps({"path": sys.path, "pickled": pickled, "longest": bench.longest})
    longest = bench.longest * len(cases)
    program = [sys.executable, "-c", _PROGRAM.format(str(Path(__file__).parents[3]))]
    try:
        done = subprocess.run(program, input=asked, capture_output=True, text=True, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        yield f"another process has not answered within {longest:g} s of real time: see whether the simulator waits for something"
        return
    try:
        there = json.loads(done.stdout.rpartition(_MARK)[2])
    except ValueError:
        told = one_line(done.stderr.strip().rpartition("\n")[2], 200) or "it told nothing"
        end = f"status {done.returncode} and without its runs, {told}"
        yield f"another process ended with {end}: it must find simulator and drivers"
        return
    for case, one, two in zip(cases, here, there, strict=True):
        if one != two:
            yield f"{case.scenario.name}: its hash is {one[:_CUT]}, in another process {two[:_CUT]}: depend on the case alone"


_PROGRAM = "import sys; sys.path.insert(0, {!r}); from pytest_rvads.satellites.conformance.contract import answer; answer()"
_MARK = "rvads hashes of runs:"


def answer() -> None:
    """Simulate the cases on standard input, and print the hashes of their runs; `another_process` starts this function."""
    asked = json.load(sys.stdin)
    sys.path[:] = asked["path"]
    simulator, cases = pickle.loads(base64.b64decode(asked["pickled"]))
    maker = named(simulator) if isinstance(simulator, str) else simulator
    choice = limits(decision=asked["longest"], run=asked["longest"], simulator=maker)
    hashes = [simulate(case, choice).hash for case in cases]
    sys.stdout.write(f"{_MARK}{json.dumps(hashes)}\n")


def provenance(bench: Bench) -> Iterator[str]:
    """`Run.provenance` holds the scenario, the simulator, its versions and the reason of the end, as values that JSON has.

    No rule reads the provenance of a run. Reports and commands that repeat a run read it.
    """
    case = bench.alone(Brakes, duration=0.1)
    run = bench.run(case)
    said = dict(run.provenance)
    try:
        json.dumps(said, allow_nan=False)
    except (TypeError, ValueError) as error:
        yield f"{run.label}: its provenance can't be written as JSON, {error}: take numbers, texts, lists and mappings"
    wanted = {"simulator": made_by(bench.simulator, run), "scenario": case.scenario.record()}
    for name, value in wanted.items():
        if said.get(name) != value:
            got, expected = (one_line(repr(item), 80) for item in (said.get(name), value))
            yield f"{run.label}: its provenance has {name} {got}, expected {expected}"
    versions = said.get("versions")
    if not (isinstance(versions, Mapping) and versions.get("pytest-rvads") == __version__):
        got = one_line(repr(versions), 80)
        yield (
            f"{run.label}: its provenance has versions {got}, expected {{'pytest-rvads': {__version__!r}, ...}} with all that "
            "decides "
            "what it does: pytest_rvads.support.installed.versions(...) tells them"
        )
