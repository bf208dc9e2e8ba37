"""Simulators make runs of cases. All simulators share a protocol and are found by name.

Callers use `simulate` for runs and `vmax` for the greatest safe speeds; both check that the simulator's answer fits the question.
A session or a command makes a `Choice`, a simulator with the limits of real time of its runs, and passes it on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.util import find_spec
from inspect import signature
from numbers import Real
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pytest_rvads.drivers.naming import at
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.logic.conduct.validate import impossible
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import usual
from pytest_rvads.simulators.patience import NEVER, USUAL, Limits, TooLate, Watch
from pytest_rvads.support.errors import RunError, ScenarioError, needs, require, suggest
from pytest_rvads.support.installed import entries


class Simulator(Protocol):
    """A callable that returns the run of a case, with a name and a braking envelope.

    A call gets a case, and the `Watch` that enforces the limits of real time, and returns the run of the case. A simulator passes
    the watch on to its `Loop`, to its seats, or to the simulator that it asks. The same case gives the same run, bit for bit, in
    any process and order.

    The run ends when every vehicle has left, at the scenario's duration, when two vehicles collide, or when a vehicle leaves its
    route. The run ends with a `Run.fault` when an autopilot raises an exception or answers with no command, when a limit of real
    time is exceeded, or when the simulator fails. The run holds all states up to its end, also after a fault. The measurements of
    ``timing()`` of an autopilot are stored under ``timing`` in `Run.provenance`.

    A simulator can have further attributes. ``caveat`` is a sentence on the limits of its results, printed in the header of a
    session. The tests for authors of simulators read ``drivers``, the drivers of the simulator, and ``unsupported``, the
    checks that the simulator can't pass, each with a reason. ``libraries`` names the packages that the simulator imports when it
    simulates and that an extra with the name of the simulator installs.
    """

    @property
    def name(self) -> str:
        """The simulator's name in reports and options."""

    def __call__(self, case: Case, watch: Watch | None = None, /) -> Run:
        """Return the run of `case`; with None as `watch` there are no limits of real time.

        Raises:
            MapError: the positions of the lanes of the junction are unknown.
            ScenarioError: a vehicle does not fit on its approach, or two vehicles start inside each other.
        """

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed `distance` metres before the line, at most 30 m/s; None if no speed is safe."""


def simulators() -> dict[str, str]:
    """Return the name and the place, ``module:name``, of every simulator that an installed package declares as entry point.

    The simulators of the core come first.
    """
    places = {name: entry.value for name, entry in entries("simulators").items()}
    return dict(sorted(places.items(), key=lambda place: not place[1].startswith("pytest_rvads.simulators.")))


def named(name: str | None, folder: Path | None = None) -> Simulator:
    """Return the simulator that has a name, or that ``module:name`` denotes, looked for in `folder` first.

    None is the name of the usual simulator. A library of the simulator that is missing is a ScenarioError, too.
    """
    if name is None:
        return usual()
    places = simulators()
    where = places.get(name, name)
    if ":" not in where:
        raise ScenarioError(
            f"unknown simulator {name!r}, there is {', '.join(places)}, or say module:name{suggest(name, places)}"
        )
    try:
        simulator = usable(at(where, folder), repr(name))
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"simulator {name!r} can't be loaded: {error}") from error
    for library in getattr(simulator, "libraries", ()):
        if not find_spec(library):
            raise ScenarioError(needs(f"simulator {name!r}", library, name))
    return simulator


def usable(simulator: Any, label: str = "") -> Simulator:
    """Return the value of an option, a fixture or an argument if it is a simulator; `label` names the value in the message."""
    if isinstance(simulator, type):
        objection = "is a class"
    elif missing := next((a for a in ("__call__", "vmax") if not callable(getattr(simulator, a, None))), ""):
        objection = f"has no {missing}"
    elif not (isinstance(name := getattr(simulator, "name", None), str) and name):
        objection = f"is called {name!r}, which is no name"
    elif not _takes_watch(simulator):
        objection = "can't be called with two arguments"
    else:
        checked: Simulator = simulator
        return checked
    raise ScenarioError(
        f"simulator {label or f'{simulator!r:.60}'} {objection}: it has to be an object with a name, a text, and "
        "vmax(distance, aggression, vehicle), that can be called with a case and a watch"
    )


def _takes_watch(simulator: Any) -> bool:
    """Return whether a simulator can be called with a case and a watch."""
    try:
        signature(simulator).bind(None, None)
    except TypeError:
        return False
    except ValueError:  # of code in C, whose signature is unknown
        return True
    return True


@dataclass(frozen=True, slots=True)
class Choice:
    """A simulator with the limits of real time of its runs, which is a simulator, too."""

    simulator: Simulator
    limits: Limits = USUAL

    @classmethod
    def of(cls, simulator: Simulator | None = None, limits: Limits = USUAL) -> Choice:
        """Return a simulator, by default the usual one, with limits; a choice keeps its own limits, except `Limits.dump`."""
        if not isinstance(simulator, Choice):
            return cls(usual() if simulator is None else usable(simulator), limits)
        own = simulator.limits
        return cls(simulator.simulator, own if limits.dump is None else own._replace(dump=limits.dump))

    @property
    def name(self) -> str:
        """The simulator's name in reports and options."""
        return self.simulator.name

    def __call__(self, case: Case, watch: Watch | None = None, /) -> Run:
        """Return the run of a case within the limits of `watch`; `simulate` makes a watch with the limits of the choice."""
        return self.simulator(case, watch)

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the simulator's greatest safe speed, see `Simulator.vmax`."""
        return self.simulator.vmax(distance, aggression, vehicle)

    def __reduce__(self) -> tuple[Any, ...]:  # in another process, the descriptor of `dump` means another file
        dump = NEVER if self.limits.dump == NEVER else None
        return Choice, (self.simulator, self.limits._replace(dump=dump))


def limits(decision: float = USUAL.decision, run: float = USUAL.run, simulator: Simulator | None = None) -> Choice:
    """Return a simulator with limits of real time, for every argument `simulator=` and for the fixture `rvads_simulator`.

    A run that exceeds a limit ends by a fault that names the driver and its current line.

    Args:
        decision: longest call into a driver [s]; 0 sets no limit.
        run: longest run [s]; 0 sets no limit.
        simulator: the simulator; by default the usual simulator.

    Raises:
        ScenarioError: a limit is negative, infinite or no number, or `simulator` is no simulator.
    """
    for name, limit in (("decision", decision), ("run", run)):
        if not (isinstance(limit, Real) and 0 <= limit < math.inf):
            raise ScenarioError(f"limits({name}=) takes a number of seconds, 0 for no limit, got {limit!r:.60}")
    chosen = Choice.of(simulator)
    return Choice(chosen.simulator, chosen.limits._replace(decision=float(decision), run=float(run)))


def simulate(case: Case, simulator: Simulator | None = None) -> Run:
    """Return the run of a case; see `Simulator` for how runs end.

    Args:
        case: scenario, drivers and vehicles.
        simulator: the simulator, in a session the value of the fixture ``rvads_simulator``, with the limits of the session; by
            default the usual simulator. A simulator without limits of its own has the usual limits of real time, see `limits`.

    Raises:
        MapError: the positions of the lanes of the junction are unknown.
        ScenarioError: a vehicle does not fit on its approach, two vehicles start inside each other, or `simulator` is no
            simulator.
        RunError: the simulator returned no run of this case, an impossible run, or a run that ends without a reason; or the
            simulator exceeded a time limit outside of all drivers.
    """
    require(case, Case, "simulate takes a case: write simulate(rvads.Case(scenario, driver))", ScenarioError)
    choice = Choice.of(simulator)
    run = answered(case, choice)
    objection = next((str(finding) for finding in impossible(run)), "") or _flaw_of_end(run, case)
    if objection:
        raise RunError(f"the simulator {choice.name!r} gives a run that can't be, {run.label}: {objection}")
    return run


def answered(case: Case, choice: Choice) -> Run:
    """Return the answer of a simulator to a case, after a check that the answer is a run of this case.

    Arguments and errors are those of `simulate`. An impossible run, or a run that ends without a reason, raises no error.
    """
    maker = choice.simulator
    # Error settings of numpy that a driver changes hold for its own run only.
    with np.errstate(), Watch(choice.limits) as watch:
        try:
            run = maker(case, watch)
        except TooLate as late:
            if not watch.late:
                raise  # the limit of an outer run, within which this run is simulated
            raise RunError(f"the simulator {maker.name!r} at {case.scenario.name}: {watch.late}") from late
    require(run, Run, f"the simulator {maker.name!r} must answer a case with its Run", RunError)
    scenario = case.scenario
    routes, expected_routes = (
        [f"{agent.name} from {agent.entrance} to {agent.exit}" for agent in agents] for agents in (run.agents, case.agents())
    )
    for field, got, expected in (
        ("junction", run.junction, scenario.place),
        ("agents", routes, expected_routes),
        ("subject", run.subject, scenario.under_test),
        ("label", run.label, scenario.name),
    ):
        if got != expected:
            raise RunError(
                f"the simulator {maker.name!r} must answer a case with its Run, got one with another {field}: {got!s:.200}, "
                f"expected {expected!s:.200}"
            )
    return run


def made_by(simulator: Simulator, run: Run) -> str:
    """Return the name of the simulator that made a run.

    A simulator can pass a case to another simulator: ``sumo`` passes cases without a vehicle of SUMO to the usual simulator.
    """
    name = str(run.provenance.get("simulator"))
    return name if {simulator.name, name} <= simulators().keys() else simulator.name


def vmax(
    distance: float,
    aggression: int = 1,
    vehicle: Vehicle | None = None,
    simulator: Simulator | None = None,
    limit: float = SPEED_LIMIT,
) -> float | None:
    """Return the greatest safe speed `distance` metres before the stopping line.

    Args:
        distance: reference point to stopping line [m].
        aggression: braking level 1, 2 or 3, which selects the service brake.
        vehicle: the vehicle; a passenger car by default.
        simulator: the simulator; by default the usual simulator.
        limit: speed limit of the road [m/s], such as `Junction.top_limit`.

    Returns:
        The speed, at most the speed limit [m/s]; None if not even a standing vehicle is safe.

    Raises:
        ScenarioError: the distance is negative or not finite, the aggression is unknown, or `simulator` is no simulator.
        RunError: the simulator returned no speed.
    """
    require(distance, Real, "vmax takes a distance to the stopping line in metres", ScenarioError)
    require(vehicle, Vehicle | None, "vehicle= takes a rvads.Vehicle", ScenarioError)
    choice = Choice.of(simulator)
    speed: Any = choice.vmax(distance, aggression, vehicle)
    if speed is None:
        return None
    number = float(speed) if isinstance(speed, Real) and not isinstance(speed, bool) else math.nan
    if not 0 <= number < math.inf:
        raise RunError(
            f"the simulator {choice.name!r} must give v(d)max as a speed of 0 m/s or more, or as None, got {speed!r:.60} at "
            f"{distance!r} m"
        )
    return min(number, limit)


def _flaw_of_end(run: Run, case: Case) -> str:
    """Return the fault in the clock of a run or in its end, as a clause; empty for a sound run."""
    if run.dt != DT:
        return f"its states are {run.dt:g} s apart, expected {DT:g} s"
    more = run.steps - 1 - round(case.scenario.duration / DT)
    if more > 0:
        return f"it goes on for {more} states after the scenario's {case.scenario.duration:g} s"
    if more == 0 or run.fault or run.collisions or run.facts.strayed:
        return ""
    ways = case.scenario.itineraries()
    count = len(ways)  # pedestrians come after the vehicles, and no run waits for them
    gone = run.zone[-1, :count] >= Zone.EXIT if run.station is None else run.station[-1, :count] >= [way.leave for way in ways]
    present = [agent.name for agent, left in zip(run.agents[:count], gone, strict=True) if not left]
    advice = "nobody collided, left its route or failed: simulate it to its end, or tell what ended it as Run.fault"
    if not present:
        return ""
    return f"it ends at {run.duration:.2f} s without a reason: {' and '.join(present)} had not left yet, {advice}"
