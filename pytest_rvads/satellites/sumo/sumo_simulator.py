"""The simulator ``sumo``: runs of cases in which SUMO's models drive the vehicles with the driver `SumoDriver`.

Every other vehicle is driven by its own driver and moved by the vehicle dynamics of this package, because a verdict must be about
the named driver. SUMO runs in another process, and a crash or a hang of SUMO costs a single run.
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

from pytest_rvads.drivers.traffic import SumoDriver
from pytest_rvads.physics import engines
from pytest_rvads.physics.braking import FASTEST, check_start, greatest_safe, vmax
from pytest_rvads.physics.cache import cached
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.satellites.sumo.road_network import straight
from pytest_rvads.satellites.sumo.sumo_process import acquire, release
from pytest_rvads.satellites.sumo.sumo_world import SumoWorld, lone_departure
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.forks import forks
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.simulators.planar import usual
from pytest_rvads.support.errors import ScenarioError, needs, require
from pytest_rvads.support.versions import versions

__all__ = ["Sumo", "sumo"]

SEED = 23423
"""SUMO's default seed; the seed of a scenario's senses is added."""
_SEED_BOUND = 2**31
"""Upper bound of SUMO's seeds."""
_ROAD = 5000.0
"""Length of the road for tests of braking [m]; a vehicle that has not stopped at its end counts as unable to stop."""
_FIXED_ATTRIBUTES = ("id", "length", "width", "height")
"""Attributes of vehicle types that follow from the case."""
_LIBRARIES = ("libsumo", "eclipse-sumo")


class Sumo:
    """SUMO's microscopic traffic simulation, in steps of 0.01 s.

    SUMO's models move the vehicles with the driver `SumoDriver` along their lanes. All other vehicles are driven as in every
    simulator and moved by the vehicle dynamics of this package. SUMO gets their positions in every step.

    Args:
        attributes: attributes of the types of all vehicles in SUMO, in place of SUMO's defaults, such as ``sigma=0`` or
            ``jmTimegapMinor=2``; see SUMO's page "Definition of Vehicles, Vehicle Types, and Routes". Sizes are the sizes of the
            case's vehicles.

    Raises:
        ScenarioError: a name is no attribute, a value is no number or text, or the attribute follows from the case.
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
            if name in _FIXED_ATTRIBUTES or not (name.isascii() and name.isidentifier()):
                raise ScenarioError(
                    f"rvads.Sumo takes attributes of a vType of SUMO other than {', '.join(_FIXED_ATTRIBUTES)}, such as sigma=0, "
                    f"got {name!r:.60}: sizes are those of the vehicles in the fleet of a case"
                )
            require(value, str | Real, f"rvads.Sumo({name}=) takes a number or a text", ScenarioError)
        self.attributes: Mapping[str, str] = MappingProxyType({name: f"{value}" for name, value in attributes.items()})

    def __call__(self, case: Case) -> Run:
        """Simulate a case, see `pytest_rvads.simulators.simulator.simulate`.

        A case without a vehicle for SUMO is simulated by the default simulator, and the provenance of the run names this
        simulator.

        Raises:
            ScenarioError: SUMO can't represent the junction, SUMO's driver has senses that are not ideal, or two entrances share
                a lane at the starts.
            RunError: SUMO or netconvert is not installed or failed.
        """
        _check_installation()
        driven, seed = _columns_driven_by_sumo(case), (SEED + case.scenario.senses.seed) % _SEED_BOUND
        if not driven:
            return usual()(case)
        make = partial(SumoWorld, case, driven, seed, self.attributes)
        loop = Loop(case, self.name, make, versions(*_LIBRARIES, engines.usual().library), driven)
        run = loop.drive()
        return replace(run, provenance={**run.provenance, "sumo": {"seed": seed, "attributes": dict(self.attributes)}})

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed before the stopping line, for SUMO's vehicles and for all other vehicles [m/s].

        For SUMO's vehicles the speed is found by tests of braking in SUMO, whose brakes have no lag. For all other vehicles the
        speed is the result of `pytest_rvads.physics.braking.vmax`. The smaller of both speeds is returned.

        Args:
            distance: distance from the front to the stopping line [m].
            aggression: level 1, 2 or 3, which selects the deceleration.
            vehicle: parameters of the vehicle; None for a passenger car.

        Returns:
            The speed [m/s]; None if no speed is safe.

        Raises:
            ScenarioError: the distance is negative or not finite, or the aggression is unknown.
            RunError: SUMO or netconvert is not installed or failed.
        """
        check_start(distance, aggression)
        body = vehicle or Vehicle()
        attributes = dict(self.attributes)
        values = {"distance": float(distance), "aggression": aggression, "vehicle": asdict(body), "attributes": attributes}
        cache_key = {"what": self.name, "up to": FASTEST} | values
        limit_of_sumo = cached(cache_key, lambda: self._tested(distance, aggression, body), *_LIBRARIES)
        limit_of_dynamics = vmax(distance, aggression, body, limit=FASTEST)
        return None if limit_of_sumo is None or limit_of_dynamics is None else min(limit_of_sumo, limit_of_dynamics)

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value}" for name, value in self.attributes.items())
        return f"rvads.Sumo({arguments})" if arguments else "rvads.sumo"

    def _tested(self, distance: float, aggression: int, vehicle: Vehicle) -> float | None:
        _check_installation()
        road, process = straight(_ROAD), acquire()
        try:

            def safe(speed: float) -> bool:
                return process.brake(road, lone_departure("a0", speed, vehicle, aggression, self.attributes), "a0") <= distance

            return greatest_safe(safe, FASTEST)
        finally:
            release(process)


def _columns_driven_by_sumo(case: Case) -> tuple[int, ...]:
    """Return the columns of the vehicles that SUMO drives.

    Raises:
        ScenarioError: SUMO's driver has senses that are not ideal, or two entrances share a lane at the starts.
    """
    scenario, agents = case.scenario, case.agents()
    drivers = [case.driver if case.traffic is None or a.name == scenario.under_test else case.traffic for a in agents]
    driven = tuple(column for column, driver in enumerate(drivers) if driver is SumoDriver)
    if case.driver is SumoDriver and scenario.senses != Senses(seed=scenario.senses.seed):
        raise ScenarioError(
            f"SUMO's driver has ideal senses and no delay, got senses with {scenario.senses.label} in {scenario.name}: choose "
            "ideal senses, or name another driver"
        )
    farthest = {agent.entrance: distance for agent, (distance, _) in zip(agents, case.starts(), strict=True)}
    for fork in forks(scenario.place) if driven else ():
        first, second = fork.entrances
        if all(farthest.get(e, -math.inf) > parted for e, parted in zip(fork.entrances, fork.distances, strict=True)):
            raise ScenarioError(
                f"the lanes of entrances {first} and {second} of junction {scenario.place.name!r} are one lane at the starts of "
                f"{scenario.name}, where SUMO's vehicles would not see each other: choose smaller distances"
            )
    return driven


def _check_installation() -> None:
    if os.name != "posix":
        raise ScenarioError(f"simulator 'sumo' runs SUMO in a process of its own on POSIX systems, this one is {os.name!r}")
    if not find_spec("libsumo"):
        raise ScenarioError(needs("simulator 'sumo'", "libsumo", "sumo"))


sumo: Sumo = Sumo()
