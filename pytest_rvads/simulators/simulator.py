"""Simulators: what makes a run of a case. One protocol, found by name."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from pytest_rvads.drivers.naming import at
from pytest_rvads.errors import ScenarioError, require, suggest
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.bullet import bullet

__all__ = ["SIMULATORS", "Simulator", "named", "simulate"]


class Simulator(Protocol):
    """Makes runs: a value or object that can be called, with a name and a braking envelope of its own.

    A call returns the run of a case. The same case gives the same run, bit for bit, in any process and order.

    The run ends when every vehicle has left, or at the scenario's duration; also when two vehicles collide or one leaves its
    route, because what follows is no driving. It ends with `Run.fault` set when an autopilot raises or answers with something
    that is not a command, or when the plant fails. The states up to the end are kept. What ``timing()`` of an autopilot returns
    is kept under ``timing`` in `Run.provenance`.
    """

    @property
    def name(self) -> str:
        """What reports call it, and options choose it by."""

    def __call__(self, case: Case, /) -> Run:
        """Return the run of `case`.

        Raises:
            MapError: it is not known where the lanes of the junction lie.
            ScenarioError: a vehicle does not fit on its approach, or two start inside each other.
        """

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest speed [m/s] from which the vehicle stops within `distance` [m]; None where none is safe."""


SIMULATORS = {"bullet": "pytest_rvads.simulators.bullet:bullet"}
"""By name, where each is: module and attribute. What it needs is imported when it is chosen."""


def named(name: str, here: Path | None = None) -> Simulator:
    """Return the simulator of that name, or the one at ``module:name``.

    Args:
        name: what options call it.
        here: a folder in which modules are looked for first.

    Raises:
        ScenarioError: there is none, or what is there can't simulate.
    """
    where = SIMULATORS.get(name, name)
    if ":" not in where:
        raise ScenarioError(
            f"unknown simulator {name!r}, there is {', '.join(SIMULATORS)}, or say module:name{suggest(name, SIMULATORS)}"
        )
    try:
        found: Simulator = at(where, here)
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"simulator {name!r} can't be loaded: {error}") from error
    for ability in ("__call__", "vmax", "name"):
        if not hasattr(found, ability):
            raise ScenarioError(
                f"simulator {name!r} has no {ability}: it needs name, vmax(distance, ...) and to be called with a case"
            )
    return found


def simulate(case: Case, simulator: Simulator = bullet) -> Run:
    """Return the run of a case; see `Simulator` for how runs end.

    Args:
        case: scenario, what drives, and in which bodies.
        simulator: what makes the run.

    Raises:
        MapError: it is not known where the lanes of the junction lie.
        ScenarioError: a vehicle does not fit on its approach, or two start inside each other.
    """
    require(case, Case, "simulate takes a case: write simulate(rvads.Case(scenario, driver))", ScenarioError)
    return simulator(case)
