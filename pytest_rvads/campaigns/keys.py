"""The hashes of cases; a case with a result under its hash need not run again."""

from __future__ import annotations

import json
from dataclasses import asdict
from hashlib import sha256
from typing import Any, NamedTuple

from pytest_rvads.drivers.identity import identity
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.naming import called
from pytest_rvads.drivers.traffic import policy_name
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.simulators.simulator import Simulator

__all__ = ["Keys", "Known", "bodies"]

_MOST = 64
"""Most drivers that are cached; a campaign often has one driver, and never thousands."""


class Known(NamedTuple):
    """Name and identity of a driver."""

    made: Factory
    """The driver, kept alive so that its id() cannot be reused for another object."""
    name: str
    policy: str
    """Name of the driver in ids if it drives the traffic."""
    identity: str


class Keys:
    """Computes the hashes of cases; names and identities of drivers are computed once."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator.name, identity(simulator)
        self._known: dict[int, Known] = {}

    def known(self, driver: Factory) -> Known:
        """Return name and identity of a driver."""
        found = self._known.get(id(driver))
        if found is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            found = Known(driver, called(driver), policy_name(driver), identity(driver))
            self._known[id(driver)] = found
        return found

    def of(self, case: Case) -> str:
        """Return the SHA-256 of everything that decides the run of a case, without the path of its map and names of files."""
        scenario = case.scenario
        told = {**scenario.record(), "map": None, "place": scenario.place.digest}
        drivers = [made and self.known(made)[1:] for made in (case.driver, case.traffic)]
        whole = [told, drivers, _fleet(case.fleet), self._simulator]
        return sha256(json.dumps(whole, sort_keys=True).encode("utf-8", "surrogatepass")).hexdigest()


def bodies(fleet: Fleet) -> str:
    """Return a digest of a fleet."""
    return sha256(json.dumps(_fleet(fleet), sort_keys=True).encode()).hexdigest()[:12]


def _fleet(fleet: Fleet) -> list[Any]:
    return [asdict(fleet.vehicle), {name: asdict(vehicle) for name, vehicle in fleet.others.items()}]
