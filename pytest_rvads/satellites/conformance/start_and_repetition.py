"""Checks of a simulator before any vehicle drives, and checks that a run depends on its case alone.

Before any vehicle drives, a simulator must have a name and a braking envelope, place the vehicles, and refuse impossible
scenarios. A run must depend neither on earlier runs nor on the process.
"""

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
from pathlib import Path

from pytest_rvads import __version__
from pytest_rvads.physics.body import start
from pytest_rvads.physics.braking import FASTEST
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.satellites.conformance.bench import Bench, Brakes, Broken, NotTried, crowd, own_row, set_back
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
    program = [sys.executable, "-c", _PROGRAM.format(str(Path(__file__).parents[2]))]
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


_PROGRAM = (
    "import sys; sys.path.insert(0, {!r}); from pytest_rvads.satellites.conformance.start_and_repetition import answer; answer()"
)
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
