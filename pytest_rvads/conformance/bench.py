"""The bench: what all checks of a simulator share, and the cases that they try it with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pytest_rvads.conformance.probes import Brakes, Cruises
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.geometry.junction import Junction, Movement
from pytest_rvads.geometry.segment import Turn
from pytest_rvads.logic.conduct.validate import damage
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.orbits import Orbits
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.choice import limits
from pytest_rvads.simulators.simulator import Simulator, answered
from pytest_rvads.support.errors import ScenarioError

__all__ = ["JUNCTIONS", "Bench", "Broken", "Look", "NotTried", "among", "crowd", "meeting", "own_row", "set_back", "straight"]

JUNCTIONS = ("stop4", "stop3", "light4", "yield4", "lanes4")
"""Names of the built-in junctions at which a simulator is checked; most is tried at the first one."""
_SETBACK = 3.0
"""Of stopping lines that are set back [m]."""


class NotTried(Exception):
    """None of the junctions has what a check needs; says which."""


class Broken(Exception):
    """What a check needs to look at did not come about; says why."""


@dataclass(frozen=True, slots=True)
class Bench:
    """What is checked, and with what."""

    simulator: Simulator
    drivers: tuple[Factory, ...]
    """What drives where any driver will do."""
    junctions: tuple[Junction, ...]
    """At least one."""
    where: str | None = None
    """How another process finds the simulator, ``module:name``; None: it is named or pickled."""
    longest: float = 60.0
    """Real time that a run may take [s]."""
    _trips: list[Run] = field(default_factory=list, repr=False, compare=False)

    @property
    def place(self) -> Junction:
        """The first of the junctions."""
        return self.junctions[0]

    def run(self, case: Case, decision: float | None = None) -> Run:
        """Return the run of a case.

        Args:
            case: what is simulated.
            decision: real time that one call into a driver may take [s]; as much as a run by default.

        Raises:
            RvadsError: as for `answered`.
            Broken: the run lacks something, or is damaged.
        """
        with limits(decision=self.longest if decision is None else decision, run=self.longest):
            run = answered(case, self.simulator)
        for name in ("station", "speed", "pose"):
            if getattr(run, name) is None:
                raise Broken(f"{run.label}: its {name} is None, expected an array of floats: who simulates knows it")
        for finding in damage(run):
            raise Broken(f"{run.label}: {finding}: rvads.validate(run) must find nothing in a run of a simulator")
        return run

    def alone(self, driver: Factory = Cruises, *, most: int = 1, **scenario: Any) -> Case:
        """Return a case at the first junction with one vehicle at each of the first `most` entrances that have a movement."""
        return crowd(self.place, driver, most=most, **scenario)

    def queue(self, followers: int, **scenario: Any) -> Case:
        """Return a case with vehicles that brake at the first entrances of the first junction, and followers behind each.

        Raises:
            NotTried: there is no room for them.
        """
        case = self.alone(Brakes, followers=followers, **scenario)
        try:
            case.starts()
        except ScenarioError as error:
            raise NotTried(f"the first junction has no room for followers, {error}") from None
        return case

    def trips(self) -> Iterator[tuple[Case, Run]]:
        """Return runs of every driver at every junction, made once; nobody is in a hurry.

        Raises:
            Broken: one of them ended by a fault.
        """
        cases = [crowd(place, driver, speed=3.0, duration=12.0) for place in self.junctions for driver in self.drivers]
        for number, case in enumerate(cases):
            if number == len(self._trips):
                self._trips.append(self.run(case))
            run = self._trips[number]
            if run.fault is not None:
                raise Broken(
                    f"{run.label}: the run ended by a fault at {run.fault.time:.2f} s, expected none: {run.fault.reason}; try "
                    "drivers that drive in this simulator"
                )
            yield case, run


Look = Callable[[Bench], Iterator[str]]
"""A check looks for what is wrong: a sentence each."""


def crowd(place: Junction, driver: Factory, *, most: int | None = None, **scenario: Any) -> Case:
    """Return a case with a vehicle at every entrance of a junction, or a vehicle per arm if the entrances have no room.

    Args:
        place: the junction.
        driver: the driver of every vehicle.
        most: largest number of vehicles; the first entrances get a vehicle.
        scenario: arguments of `Scenario`; by default the distances of the entrances differ.
    """
    ways = [place.directions(entrance) for entrance in range(len(place.entrances))]
    code = tuple(found[0] if found else 0 for found in ways)
    entrances = [entrance for entrance, direction in enumerate(code) if direction]
    firsts = [next((e for e in arm.entrances if code[e]), None) for arm in place.arms]
    far = [min(8.0 + 2.0 * e, place.approach(e) - 1.0) for e in range(len(code))]
    for chosen in (entrances, [e for e in firsts if e is not None]):
        kept = chosen[:most]
        directions = tuple(direction if e in kept else 0 for e, direction in enumerate(code))
        case = Case(Scenario(place, directions, **({"distance": far} | scenario)), driver)
        try:
            case.starts()
        except ScenarioError:
            continue
        return case
    return case


def among(place: Junction, movements: dict[Movement, float], driver: Factory, **scenario: Any) -> Case:
    """Return a case with one vehicle per movement, `movements` tells how far before its line each starts [m]."""
    codes, far = [0] * len(place.entrances), [1.0] * len(place.entrances)
    for (entrance, direction), movement in place.by_direction.items():
        if movement in movements:
            codes[entrance], far[entrance] = direction, movements[movement]
    return Case(Scenario(place, codes, distance=far, **scenario), driver)


def own_row(place: Junction) -> int:
    """Return the last rotation of a junction: by that many entrances it keeps lanes, movements and signs."""
    return list(Orbits.at(place).rows)[-1]


def set_back(place: Junction) -> Junction:
    """Return a junction with stopping lines further from it."""
    return replace(
        place,
        name=f"{place.name}_set_back",
        entrances=tuple(replace(entrance, setback=entrance.setback + _SETBACK) for entrance in place.entrances),
    )


def straight(place: Junction, *, conflicting: bool) -> list[tuple[Movement, Movement]]:
    """Return pairs of movements straight ahead from different arms, which conflict or do not."""
    ahead = [m for m in place.movements.values() if m.turn is Turn.STRAIGHT]
    conflicts = place.conflicts or frozenset()
    return [
        (one, two)
        for number, one in enumerate(ahead)
        for two in ahead[number + 1 :]
        if place.entrances[one.entrance].arm != place.entrances[two.entrance].arm
        and ((one.key, two.key) in conflicts or (two.key, one.key) in conflicts) == conflicting
    ]


def meeting(place: Junction, one: Movement, two: Movement) -> tuple[float, float, float]:
    """Return where the centre lines of two movements come nearest: the stations on each [m], and how near [m]."""
    ways = [itinerary(place, *movement.key) for movement in (one, two)]
    along = [np.arange(0.0, way.length, 0.1) for way in ways]
    points = [way.centre(stations)[0] for way, stations in zip(ways, along, strict=True)]
    apart = np.hypot(*np.moveaxis(points[0][:, None] - points[1][None], -1, 0))
    first, second = np.unravel_index(int(apart.argmin()), apart.shape)
    return float(along[0][first]), float(along[1][second]), float(apart.min())
