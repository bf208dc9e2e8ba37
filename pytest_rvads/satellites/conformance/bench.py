"""The bench of the conformance checks: the cases and the drivers with which the checks try a simulator."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from pytest_rvads.drivers.interface import Command, Control, Drives, Factory, Observation, TargetSpeed
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Movement
from pytest_rvads.logic.conduct.validate import damage
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import Orbits
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.patience import Limits
from pytest_rvads.simulators.simulator import Choice, Simulator, answered
from pytest_rvads.support.errors import ScenarioError

FAULTY_FROM = 3
"""Tick (number of a state of the run) from which a driver with a fault shows the fault."""
_ASLEEP = 30.0
"""Time after which a hanging driver returns if no time limit ends the run before [s]."""

JUNCTIONS = ("stop4", "stop3", "light4", "yield4", "lanes4")
"""Names of the built-in junctions at which a simulator is checked; most checks use only the first junction."""
_SETBACK = 3.0
"""Distance by which `set_back` moves stopping lines away from the junction [m]."""


class Brakes:
    """A driver that always brakes fully."""

    def control(self, _seen: Observation, /) -> Control:
        """Return the command to brake fully."""
        return Control(brake=1.0)


class Cruises:
    """A driver that keeps a constant speed [m/s], whatever other vehicles do."""

    def __init__(self, speed: float = 8.0) -> None:
        self._speed = speed

    def control(self, _seen: Observation, /) -> TargetSpeed:
        """Return the constant speed as the target speed."""
        return TargetSpeed(self._speed)


class Cast:
    """A driver that keeps the speed given for its vehicle [m/s] from its time in `since` on [s]; without a speed, it brakes."""

    def __init__(self, speeds: Mapping[str, float], since: Mapping[str, float] = MappingProxyType({})) -> None:
        self._speeds, self._since = speeds, since

    def control(self, seen: Observation) -> Control | TargetSpeed:
        """Return the speed given for the vehicle, or the command to brake fully."""
        speed = self._speeds.get(seen.me.name)
        if speed is None or seen.time < self._since.get(seen.me.name, 0.0):
            return Control(brake=1.0)
        return TargetSpeed(speed)


class Steers:
    """A driver that steers to the left until the vehicle leaves the route."""

    def control(self, _seen: Observation, /) -> Control:
        """Return some throttle and a large steering angle."""
        return Control(throttle=0.3, steering=0.5)


class Witness:
    """A driver that appends each observation to a list, and returns the command of another driver."""

    def __init__(self, shown: list[Observation], driver: Callable[[], Drives] = Brakes) -> None:
        self._shown = shown
        self._driver = driver()

    def control(self, seen: Observation) -> Command:
        """Store the observation, and return the command of the other driver."""
        self._shown.append(seen)
        return self._driver.control(seen)


def _due(seen: Observation) -> bool:
    # Only the vehicle that was created first has no vehicle created before it.
    return round(seen.time / DT) >= FAULTY_FROM and not seen.created


class Raises:
    """A driver that brakes, and raises an error from tick `FAULTY_FROM` on."""

    def control(self, seen: Observation) -> Control:
        """Return the command to brake, or raise an error from tick `FAULTY_FROM` on."""
        if _due(seen):
            raise ValueError("raised by the conformance tests")
        return Control(brake=1.0)


class NotANumber:
    """A driver that brakes, and answers with a throttle of NaN from tick `FAULTY_FROM` on."""

    def control(self, seen: Observation) -> Control:
        """Return the command to brake, or a throttle of NaN from tick `FAULTY_FROM` on."""
        return Control(throttle=math.nan) if _due(seen) else Control(brake=1.0)


class Hangs:
    """A driver that brakes, and no longer answers from tick `FAULTY_FROM` on."""

    def control(self, seen: Observation) -> Control:
        """Return the command to brake, or sleep from tick `FAULTY_FROM` on."""
        begun = time.monotonic()
        while _due(seen) and time.monotonic() - begun < _ASLEEP:
            time.sleep(0.05)
        return Control(brake=1.0)


def unmade() -> Brakes:
    """Raise an error when the simulator calls this factory to make a driver."""
    raise ValueError("raised by the conformance tests")


class NotTried(Exception):
    """No junction of the bench has what a check needs, such as crossing movements; the message says what to add."""


class Broken(Exception):
    """A run that a check needs is damaged or ended by a fault; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulator to check, with the drivers and junctions for the checks."""

    simulator: Simulator
    drivers: tuple[Factory, ...]
    """Drivers for the checks that work with any driver."""
    junctions: tuple[Junction, ...]
    """Junctions at which the simulator is checked, at least one."""
    where: str | None = None
    """The simulator as ``module:name``, for another process; None if that process gets a shipped name or a pickled simulator."""
    longest: float = 60.0
    """Limit of the real time of a run [s]."""
    dump: int | None = None
    """File descriptor for the stacks of a process that ends because a driver does not stop, see `Limits.dump`."""
    _trips: list[Run] = field(default_factory=list, repr=False, compare=False)

    @property
    def place(self) -> Junction:
        """The first junction of the bench, which most checks use."""
        return self.junctions[0]

    def run(self, case: Case, decision: float | None = None) -> Run:
        """Return the run of a case; raise Broken if the run has no stations, speeds or poses, or is damaged.

        `decision` is the limit of the real time of a call of a driver [s]; by default `longest`, the limit of a run.
        """
        limits = Limits(self.longest if decision is None else decision, self.longest, self.dump)
        run = answered(case, Choice(self.simulator, limits))
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
        """Return a case at the first junction with braking vehicles at its first entrances, and followers behind each vehicle."""
        case = self.alone(Brakes, followers=followers, **scenario)
        try:
            case.starts()
        except ScenarioError as error:
            raise NotTried(f"the first junction has no room for followers, {error}") from None
        return case

    def trips(self) -> Iterator[tuple[Case, Run]]:
        """Yield a case and its run for every driver at every junction, at low speed; each run is made only once."""
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
"""A check of a simulator: a function that yields a sentence for each error of the simulator."""


def crowd(place: Junction, driver: Factory, *, most: int | None = None, **scenario: Any) -> Case:
    """Return a case with a vehicle at every entrance of a junction, or a vehicle per arm if vehicles at all entrances don't fit.

    At most `most` vehicles start, at the first entrances. By default the distances of the entrances differ.
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


def wrong_end(run: Run, end: str) -> Iterator[str]:
    """Yield an error if the provenance of a run gives another reason of the end than `end`."""
    if (got := run.provenance.get("end")) != end:
        yield f"{run.label}: its provenance says that it ended by {got!r}, expected {end!r} under 'end'"


def among(place: Junction, movements: dict[Movement, float], driver: Factory, **scenario: Any) -> Case:
    """Return a case with a vehicle per movement; `movements` has the distance from each start to the stopping line [m]."""
    codes, far = [0] * len(place.entrances), [1.0] * len(place.entrances)
    for (entrance, direction), movement in place.by_direction.items():
        if movement in movements:
            codes[entrance], far[entrance] = direction, movements[movement]
    return Case(Scenario(place, codes, distance=far, **scenario), driver)


def own_row(place: Junction) -> int:
    """Return the largest rotation that keeps lanes, movements and signs of a junction, as a number of entrances."""
    return list(Orbits.at(place).rows)[-1]


def set_back(place: Junction) -> Junction:
    """Return a junction with its stopping lines moved away from the junction by `_SETBACK`."""
    return replace(
        place,
        name=f"{place.name}_set_back",
        entrances=tuple(replace(entrance, setback=entrance.setback + _SETBACK) for entrance in place.entrances),
    )


def straight(place: Junction, *, conflicting: bool) -> list[tuple[Movement, Movement]]:
    """Return pairs of movements straight ahead from different arms: all conflicting pairs, or all pairs without a conflict."""
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
    """Return the stations of two movements at which their centre lines are nearest [m], and the distance between the two [m]."""
    ways = [itinerary(place, *movement.key) for movement in (one, two)]
    along = [np.arange(0.0, way.length, 0.1) for way in ways]
    points = [way.centre(stations)[0] for way, stations in zip(ways, along, strict=True)]
    apart = np.hypot(*np.moveaxis(points[0][:, None] - points[1][None], -1, 0))
    first, second = np.unravel_index(int(apart.argmin()), apart.shape)
    return float(along[0][first]), float(along[1][second]), float(apart.min())
