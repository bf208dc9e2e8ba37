"""The simulator ``sumo``: from a case to a run in which SUMO's own models drive the vehicles that `SumoDriver` is named for.

Every vehicle without `SumoDriver` is driven by its own driver and moved by our vehicle dynamics, because a verdict must be about
the named driver. SUMO runs in another process, so a crash or a hang of SUMO costs one run.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from importlib.util import find_spec
from numbers import Real
from types import MappingProxyType

from pytest_rvads.drivers.sumo_driver import SumoDriver
from pytest_rvads.errors import ScenarioError, needs, require
from pytest_rvads.physics import engines
from pytest_rvads.physics.braking import FASTEST, check_start, greatest_safe, vmax
from pytest_rvads.physics.cache import cached
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.satellites.sumo.departures import lone_departure
from pytest_rvads.satellites.sumo.road_network import straight
from pytest_rvads.satellites.sumo.sumo_process import acquire, release
from pytest_rvads.satellites.sumo.sumo_world import SumoWorld
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.forks import forks
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.simulators.planar import usual
from pytest_rvads.versions import versions

__all__ = ["Sumo", "sumo"]

SEED = 23423
"""SUMO's own; the seed of a scenario's senses is added to it."""
_SEEDS = 2**31
"""SUMO's seeds are below that."""
_ROAD = 5000.0
"""The road on which braking is tested; who has not stopped after so much never will [m]."""
_OF_THE_CASE = ("id", "length", "width", "height")
"""Attributes of vehicle types that a case has, and nobody else."""
_LIBRARIES = ("libsumo", "eclipse-sumo")


class Sumo:
    """SUMO's microscopic traffic simulation, in steps of 0.01 s.

    The vehicles that `SumoDriver` is named for move by SUMO's models along their lanes. Others are asked as in every simulator
    and move by our vehicle dynamics; SUMO is told in every step where they are.

    Args:
        attributes: of the types of all vehicles in SUMO, in place of SUMO's defaults, as ``sigma=0`` or ``jmTimegapMinor=2``; see
            SUMO's page "Definition of Vehicles, Vehicle Types, and Routes". Sizes are those of the case's vehicles.

    Raises:
        ScenarioError: what can't be such an attribute, or is for the case to say.
    """

    name = "sumo"
    caveat = (
        "SUMO's driver drives only where it is named (--rvads-autopilot sumo, traffic='sumo'); its vehicles have no tyres, brake "
        "without a lag and never leave their lanes, and v(d)max is the smaller of theirs and that of our dynamics"
    )
    drivers = (SumoDriver,)
    libraries = ("libsumo",)

    def __init__(self, **attributes: str | float) -> None:
        for name, value in attributes.items():
            if name in _OF_THE_CASE or not (name.isascii() and name.isidentifier()):
                raise ScenarioError(
                    f"rvads.Sumo takes attributes of a vType of SUMO other than {', '.join(_OF_THE_CASE)}, such as sigma=0, got "
                    f"{name!r:.60}: sizes are those of the vehicles in the fleet of a case"
                )
            require(value, str | Real, f"rvads.Sumo({name}=) takes a number or a text", ScenarioError)
        self.attributes: Mapping[str, str] = MappingProxyType({name: f"{value}" for name, value in attributes.items()})

    def __call__(self, case: Case) -> Run:
        """Simulate a case, see `pytest_rvads.simulators.simulator.simulate`.

        A case in which SUMO is to drive nobody is simulated by the usual simulator, and its run says so.

        Raises:
            ScenarioError: SUMO has no such junction, its driver is to have senses that are not ideal, or lanes are one upstream.
            RunError: SUMO or netconvert is not installed or failed.
        """
        _installed()
        driven, seed = _driven(case), (SEED + case.scenario.senses.seed) % _SEEDS
        if not driven:
            return usual()(case)
        make = partial(SumoWorld, case, driven, seed, self.attributes)
        loop = Loop(case, self.name, make, versions(*_LIBRARIES, engines.usual().library), driven)
        run = loop.drive()
        return replace(run, provenance={**run.provenance, "sumo": {"seed": seed, "attributes": dict(self.attributes)}})

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest speed that is safe `distance` metres before the stopping line for SUMO's vehicles and for others.

        That of SUMO's is found by tests in SUMO: who is told to stop brakes by ``decel`` from the first step on, since SUMO's
        brakes have no lag. That of our dynamics, by which others move, is as of `pytest_rvads.physics.braking.vmax`.

        Raises:
            ScenarioError: a distance that is negative or not finite, or an unknown aggression.
            RunError: SUMO or netconvert is not installed or failed.
        """
        check_start(distance, aggression)
        body = vehicle or Vehicle()
        attributes = dict(self.attributes)
        values = {"distance": float(distance), "aggression": aggression, "vehicle": asdict(body), "attributes": attributes}
        key = {"what": self.name, "up to": FASTEST} | values
        theirs = cached(key, lambda: self._tested(distance, aggression, body), *_LIBRARIES)
        ours = vmax(distance, aggression, body, limit=FASTEST)
        return None if theirs is None or ours is None else min(theirs, ours)

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value}" for name, value in self.attributes.items())
        return f"rvads.Sumo({given})" if given else "rvads.sumo"

    def _tested(self, distance: float, aggression: int, vehicle: Vehicle) -> float | None:
        _installed()
        road, process = straight(_ROAD), acquire()
        try:

            def safe(speed: float) -> bool:
                return process.brake(road, lone_departure("a0", speed, vehicle, aggression, self.attributes), "a0") <= distance

            return greatest_safe(safe, FASTEST)
        finally:
            release(process)


def _driven(case: Case) -> tuple[int, ...]:
    """Return the columns that SUMO drives.

    Raises:
        ScenarioError: it can't.
    """
    scenario, agents = case.scenario, case.agents()
    drivers = [case.driver if case.traffic is None or a.name == scenario.under_test else case.traffic for a in agents]
    driven = tuple(column for column, driver in enumerate(drivers) if driver is SumoDriver)
    if case.driver is SumoDriver and scenario.senses != Senses(seed=scenario.senses.seed):
        raise ScenarioError(
            f"SUMO's driver sees everything as it is and acts at once, got senses with {scenario.senses.label} in "
            f"{scenario.name}: leave them ideal, or name another driver"
        )
    farthest = {agent.entrance: distance for agent, (distance, _) in zip(agents, case.starts(), strict=True)}
    for fork in forks(scenario.place) if driven else ():
        one, two = fork.entrances
        if all(farthest.get(e, -math.inf) > parted for e, parted in zip(fork.entrances, fork.distances, strict=True)):
            raise ScenarioError(
                f"the lanes of entrances {one} and {two} of junction {scenario.place.name!r} are one lane at the starts of "
                f"{scenario.name}, where SUMO's vehicles would not see each other: choose smaller distances"
            )
    return driven


def _installed() -> None:
    if os.name != "posix":
        raise ScenarioError(f"simulator 'sumo' runs SUMO in a process of its own on POSIX systems, this one is {os.name!r}")
    if not find_spec("libsumo"):
        raise ScenarioError(needs("simulator 'sumo'", "libsumo", "sumo"))


sumo: Sumo = Sumo()
