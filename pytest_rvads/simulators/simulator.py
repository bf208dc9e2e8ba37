"""Simulators: what makes a run of a case. One protocol, found by name.

Callers make runs by `simulate` and speeds by `vmax`, which check the answer of a simulator against the question. The inner
workings of a simulator are its own affair.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from importlib.util import find_spec
from numbers import Real
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pytest_rvads.conduct.validate import impossible
from pytest_rvads.drivers.naming import at
from pytest_rvads.entrypoints import entries
from pytest_rvads.errors import RunError, ScenarioError, needs, require, suggest
from pytest_rvads.maps.segment import SPEED_LIMIT
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.choice import choice
from pytest_rvads.simulators.patience import TooLate, Watch
from pytest_rvads.simulators.planar import usual

__all__ = ["Simulator", "answered", "made_by", "meant", "named", "simulate", "simulators", "usable", "vmax"]


class Simulator(Protocol):
    """Makes runs: a value or object that can be called, with a name and a braking envelope of its own.

    A call returns the run of a case. The same case gives the same run, bit for bit, in any process and order.

    The run ends when every vehicle has left, or at the scenario's duration; also when two vehicles collide or one leaves its
    route, because what follows is no driving. It ends with `Run.fault` set when an autopilot raises or answers with something
    that is not a command, when a limit of real time is over, or when the plant fails. The states up to the end are kept. What
    ``timing()`` of an autopilot tells is kept under ``timing`` in `Run.provenance`.

    A simulator may have an attribute ``caveat``, a sentence on what does not carry over to it: the head of a session says it.
    The tests of ``pytest_rvads.conformance`` read two more: ``drivers``, the drivers that the simulator has of its own, and
    ``unsupported``, the checks that it can't pass with a reason for each. An attribute ``libraries`` names what the simulator
    imports when it simulates, if an extra of the name of the simulator installs it.
    """

    @property
    def name(self) -> str:
        """The simulator's name in reports and options."""

    def __call__(self, case: Case, /) -> Run:
        """Return the run of `case`.

        Raises:
            MapError: it is not known where the lanes of the junction lie.
            ScenarioError: a vehicle does not fit on its approach, or two start inside each other.
        """

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest speed up to 30 m/s from which the vehicle stops within `distance` [m]; None where none is safe."""


def simulators() -> dict[str, str]:
    """Return where the simulators are that have a name, ``module:name``; those of other packages are entry points."""
    core = {name: f"pytest_rvads.simulators.planar:{name}" for name in ("bullet", "mujoco")}
    return core | {name: entry.value for name, entry in entries("simulators").items()}


def named(name: str | None, here: Path | None = None) -> Simulator:
    """Return the simulator of that name, or the one at ``module:name``.

    Args:
        name: what options call it; None for the usual one.
        here: a folder in which modules are looked for first.

    Raises:
        ScenarioError: no simulator has this name, the named object is no simulator, or a library of the simulator is missing.
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
        simulator = usable(at(where, here), repr(name))
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"simulator {name!r} can't be loaded: {error}") from error
    for library in getattr(simulator, "libraries", ()):
        if not find_spec(library):
            raise ScenarioError(needs(f"simulator {name!r}", library, name))
    return simulator


def usable(simulator: Any, said: str = "") -> Simulator:
    """Return what is to simulate, if it can.

    Args:
        simulator: from an option, a fixture, an argument.
        said: what it was named by.

    Raises:
        ScenarioError: it is no simulator.
    """
    if isinstance(simulator, type):
        wrong = "is a class"
    elif missing := next((a for a in ("__call__", "vmax") if not callable(getattr(simulator, a, None))), ""):
        wrong = f"has no {missing}"
    elif not (isinstance(name := getattr(simulator, "name", None), str) and name):
        wrong = f"is called {name!r}, which is no name"
    else:
        found: Simulator = simulator
        return found
    raise ScenarioError(
        f"simulator {said or f'{simulator!r:.60}'} {wrong}: it has to be an object with a name, a text, and "
        "vmax(distance, aggression, vehicle), that can be called with a case"
    )


def meant(simulator: Simulator | None = None) -> Simulator:
    """Return the simulator that a caller names; by default that of the session, outside of sessions the usual one.

    Raises:
        ScenarioError: what is named is no simulator.
    """
    found = choice().simulator if simulator is None else usable(simulator)
    return usual() if found is None else found


def simulate(case: Case, simulator: Simulator | None = None) -> Run:
    """Return the run of a case; see `Simulator` for how runs end.

    Args:
        case: scenario, what drives, and in which bodies.
        simulator: what makes the run; by default what ``--rvads-simulator`` names, outside of sessions the usual one.

    Raises:
        MapError: it is not known where the lanes of the junction lie.
        ScenarioError: a vehicle does not fit on its approach, two start inside each other, or `simulator` is none.
        RunError: what the simulator returned is not the run of this case, can't be, or was cut short without a reason; or it took
            too long outside of all drivers.
    """
    run = answered(case, simulator)
    wrong = next((str(finding) for finding in impossible(run)), "") or _cut(run, case)
    if wrong:
        raise RunError(f"the simulator {meant(simulator).name!r} gives a run that can't be, {run.label}: {wrong}")
    return run


def answered(case: Case, simulator: Simulator | None = None) -> Run:
    """Return what a simulator answers a case with, looked at no further than that it is the run of this case.

    Raises and takes what `simulate` does.
    """
    require(case, Case, "simulate takes a case: write simulate(rvads.Case(scenario, driver))", ScenarioError)
    maker = meant(simulator)
    run = _made(maker, case)
    require(run, Run, f"the simulator {maker.name!r} must answer a case with its Run", RunError)
    scenario = case.scenario
    for what, got, expected in (
        ("junction", run.junction, scenario.place),
        ("agents", _routes(run.agents), _routes(case.agents())),
        ("subject", run.subject, scenario.under_test),
        ("label", run.label, scenario.name),
    ):
        if got != expected:
            raise RunError(
                f"the simulator {maker.name!r} must answer a case with its Run, got one with another {what}: {got!s:.200}, "
                f"expected {expected!s:.200}"
            )
    return run


def made_by(simulator: Simulator, run: Run) -> str:
    """Return the name of what made a run: of a shipped simulator that another one asked for it, else of `simulator` itself.

    ``sumo`` leaves cases in which SUMO is to drive nobody to the usual simulator.
    """
    told = str(run.provenance.get("simulator"))
    return told if {simulator.name, told} <= simulators().keys() else simulator.name


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
        aggression: 1, 2 or 3, the scenario's; selects the service brake.
        vehicle: the parameters; a passenger car by default.
        simulator: whose vehicles brake; by default what ``--rvads-simulator`` names, outside of sessions the usual one.
        limit: the speed limit where the vehicle drives [m/s], such as `Junction.top_limit`.

    Returns:
        The speed, at most the speed limit [m/s]; None where not even a standing vehicle is safe.

    Raises:
        ScenarioError: a distance that is negative or not finite, an unknown aggression, or `simulator` is none.
        RunError: what the simulator returned is no speed.
    """
    require(distance, Real, "vmax takes a distance to the stopping line in metres", ScenarioError)
    require(vehicle, Vehicle | None, "vehicle= takes a rvads.Vehicle", ScenarioError)
    maker = meant(simulator)
    speed: Any = maker.vmax(distance, aggression, vehicle)
    if speed is None:
        return None
    number = float(speed) if isinstance(speed, Real) and not isinstance(speed, bool) else math.nan
    if not 0 <= number < math.inf:
        raise RunError(
            f"the simulator {maker.name!r} must give v(d)max as a speed of 0 m/s or more, or as None, got {speed!r:.60} at "
            f"{distance!r} m"
        )
    return min(number, limit)


def _cut(run: Run, case: Case) -> str:
    """Return what is wrong with the clock of a run or with its end, or nothing."""
    if run.dt != DT:
        return f"its states are {run.dt:g} s apart, expected {DT:g} s"
    more = run.steps - 1 - round(case.scenario.duration / DT)
    if more > 0:
        return f"it goes on for {more} states after the scenario's {case.scenario.duration:g} s"
    if more == 0 or run.fault or run.collisions or run.facts.strayed:
        return ""
    ways = case.scenario.itineraries()
    gone = run.zone[-1] >= Zone.EXIT if run.station is None else run.station[-1] >= [way.leave for way in ways]
    here = [agent.name for agent, left in zip(run.agents, gone, strict=True) if not left]
    told = "nobody collided, left its route or failed: simulate it to its end, or tell what ended it as Run.fault"
    return f"it ends at {run.duration:.2f} s without a reason: {' and '.join(here)} had not left yet, {told}" if here else ""


def _made(maker: Simulator, case: Case) -> Run:
    # What a driver sets of numpy, such as to raise on underflow, holds for its own run.
    with np.errstate(), Watch(choice().limits) as watch:
        try:
            return maker(case)
        except TooLate as late:
            if not watch.late:
                raise  # it is meant for a run that this one is simulated within
            raise RunError(f"the simulator {maker.name!r} at {case.scenario.name}: {watch.late}") from late


def _routes(agents: Iterable[Agent]) -> list[str]:
    return [f"{agent.name} from {agent.entrance} to {agent.exit}" for agent in agents]
