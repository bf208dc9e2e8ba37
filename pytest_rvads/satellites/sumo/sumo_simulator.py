"""The simulator ``sumo``: runs of cases in which SUMO's models drive the vehicles with the driver ``sumo``.

A vehicle with another driver is moved by the commands of that driver and by the vehicle dynamics of this package, because a
verdict must be about the driver that was named. SUMO runs in another process, so that a crash or hang of SUMO ends a single run.
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
from pytest_rvads.physics.braking import FASTEST, cached, check_start, greatest_safe, vmax
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.satellites.sumo.road_network import straight
from pytest_rvads.satellites.sumo.sumo_process import acquire, release
from pytest_rvads.satellites.sumo.sumo_world import SumoWorld, lone_departure
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.forks import forks
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.simulators.loop import Loop, usual
from pytest_rvads.simulators.patience import USUAL, Watch
from pytest_rvads.support.errors import ScenarioError, needs, require
from pytest_rvads.support.installed import versions

SEED = 23423
"""SUMO's default seed; a run uses the sum of this seed and the seed of the scenario's senses."""
_SEED_BOUND = 2**31
"""Upper bound of SUMO's seeds, exclusive."""
_ROAD = 5000.0
"""Length of the road on which braking distances are measured [m]; a vehicle that does not stop on it counts as unable to stop."""
_FIXED_ATTRIBUTES = ("id", "length", "width", "height")
"""Attributes of vehicle types that the case determines, so that users can't set them."""
_LIBRARIES = ("libsumo", "eclipse-sumo")


class Sumo:
    """SUMO's microscopic traffic simulation, in steps of 0.01 s.

    SUMO's models move the vehicles with the driver ``sumo`` along their lanes. Vehicles with other drivers are driven as in
    every simulator and moved by the vehicle dynamics of this package. SUMO gets the positions of these vehicles in every step.

    Args:
        attributes: attributes of the vehicle types in SUMO that replace SUMO's defaults for all vehicles, such as ``sigma=0`` or
            ``jmTimegapMinor=2``; see SUMO's page "Definition of Vehicles, Vehicle Types, and Routes". The sizes of vehicles can't
            be set, because the case determines them.

    Raises:
        ScenarioError: a name is no name of an attribute, a value is no number or text, or the case determines the attribute.
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

    def __call__(self, case: Case, watch: Watch | None = None) -> Run:
        """Simulate a case, see `pytest_rvads.simulators.simulator.simulate`.

        A case in which no vehicle has the driver ``sumo`` is simulated by the default simulator, which the provenance of the
        run names.

        Raises:
            ScenarioError: SUMO can't represent the junction, `SumoDriver` has senses that are not ideal, or vehicles of two
                entrances start where the lanes of these entrances are still one lane.
            RunError: SUMO or netconvert is not installed or failed.
        """
        _check_installation()
        driven, seed = _columns_driven_by_sumo(case), (SEED + case.scenario.senses.seed) % _SEED_BOUND
        if not driven:
            return usual()(case, watch)
        make = partial(SumoWorld, case, driven, seed, self.attributes, (watch or Watch()).limits.decision)
        loop = Loop(case, self.name, make, versions(*_LIBRARIES, engines.usual().library), driven, watch=watch)
        run = loop.drive()
        return replace(run, provenance={**run.provenance, "sumo": {"seed": seed, "attributes": dict(self.attributes)}})

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest speed [m/s] from which every vehicle can stop within a distance before its stopping line.

        For vehicles that SUMO drives, the speed is found by braking in SUMO, whose brakes have no lag. For vehicles with other
        drivers, the speed is the result of `pytest_rvads.physics.braking.vmax`. The smaller of the two speeds is returned.

        Args:
            distance: distance from the front to the stopping line [m].
            aggression: level 1, 2 or 3, which selects the deceleration.
            vehicle: parameters of the vehicle; None for a passenger car.

        Returns:
            The speed [m/s]; None if a vehicle can't stop within the distance from any speed.

        Raises:
            ScenarioError: the distance is negative or not finite, or the aggression is unknown.
            RunError: SUMO or netconvert is not installed or failed.
        """
        check_start(distance, aggression)
        body = vehicle or Vehicle()
        attributes = dict(self.attributes)
        values = {"distance": float(distance), "aggression": aggression, "vehicle": asdict(body), "attributes": attributes}
        cache_key = {"what": self.name, "up to": FASTEST} | values
        limit_of_sumo = cached(cache_key, lambda: self._measured_vmax(distance, aggression, body), *_LIBRARIES)
        limit_of_dynamics = vmax(distance, aggression, body, limit=FASTEST)
        return None if limit_of_sumo is None or limit_of_dynamics is None else min(limit_of_sumo, limit_of_dynamics)

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value}" for name, value in self.attributes.items())
        return f"rvads.Sumo({arguments})" if arguments else "rvads.sumo"

    def _measured_vmax(self, distance: float, aggression: int, vehicle: Vehicle) -> float | None:
        _check_installation()
        road, process = straight(_ROAD), acquire(USUAL.decision)
        try:

            def safe(speed: float) -> bool:
                return process.brake(road, lone_departure("a0", speed, vehicle, aggression, self.attributes), "a0") <= distance

            return greatest_safe(safe, FASTEST)
        finally:
            release(process)


def _columns_driven_by_sumo(case: Case) -> tuple[int, ...]:
    """Return the columns (positions among the agents of a case) of the vehicles that SUMO drives."""
    scenario, agents = case.scenario, case.vehicles()
    drivers = [case.driver if case.traffic is None or a.name == scenario.under_test else case.traffic for a in agents]
    driven = tuple(column for column, driver in enumerate(drivers) if driver is SumoDriver)
    if case.driver is SumoDriver and scenario.senses != Senses(seed=scenario.senses.seed):
        raise ScenarioError(
            f"SUMO's driver has ideal senses and no delay, got senses with {scenario.senses.label} in {scenario.name}: choose "
            "ideal senses, or name another driver"
        )
    if driven and scenario.pedestrians:
        raise ScenarioError(
            f"SUMO's driver does not see pedestrians, and {scenario.name} has some: leave the pedestrians out, or name another "
            "driver"
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
        raise ScenarioError(
            f"simulator 'sumo' needs a POSIX system for the process of SUMO, got {os.name!r}: choose another simulator"
        )
    if not find_spec("libsumo"):
        raise ScenarioError(needs("simulator 'sumo'", "libsumo", "sumo"))


sumo: Sumo = Sumo()
