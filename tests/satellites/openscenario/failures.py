"""Short runs that break rules, with several drivers and bodies at junctions of every kind."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Kind, Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tools.crossings import Layout, opendrive

__all__ = ["FAILURES", "LAYOUTS", "TRUCK", "Failure", "write_maps"]

LAYOUTS = {
    "left": Layout(left_hand=True),
    "five": Layout(5, stop=22.0),
    "setback": Layout(4, JunctionControl.LIGHTS, setback=3.0),
}
"""Junctions that are not built in: with left-hand traffic, with five arms, with lines before the lights."""
TRUCK = Vehicle(length=9.0, width=2.5, front_axle=2.5, rear_axle=2.5, mass=9000.0, kind=Kind.TRUCK)


@dataclass(frozen=True)
class Failure:
    """A case, and a rule that its run breaks."""

    rule: str
    junction: str
    directions: str
    driver: str
    more: dict[str, Any] = field(default_factory=dict)
    """Further arguments of the scenario."""
    truck: str | None = None
    """Name of the vehicle that is a truck."""

    def __str__(self) -> str:
        parts = [self.rule, self.junction, self.directions, self.driver]
        return "-".join([*parts, *(["truck"] if self.truck else []), *(["subject"] if "subject" in self.more else [])])

    def run(self, maps: Path) -> Run:
        """Return the run of the case, simulated once per process; `maps` is the folder of map files."""
        return _run(FAILURES.index(self), str(maps))


@lru_cache(maxsize=64)
def _run(key: int, maps: str) -> Run:
    failure = FAILURES[key]
    place = find("1", Path(maps, f"{failure.junction}.xodr")) if failure.junction in LAYOUTS else find(failure.junction)
    scenario = Scenario(place, failure.directions, **failure.more)
    fleet = Fleet(others={failure.truck: TRUCK} if failure.truck else {})
    others = traffic("reference") if scenario.subject is not None else None
    return simulate(Case(scenario, traffic(failure.driver), others, fleet))


def write_maps(folder: Path) -> Path:
    """Write the map files of `LAYOUTS` into a folder."""
    for name, layout in LAYOUTS.items():
        (folder / f"{name}.xodr").write_text(opendrive(layout), encoding="utf-8")
    return folder


_AT_LINE = {"distance": 0.3, "duration": 7.0}
_FAST = {"distance": 15.0, "speed": 8.0, "duration": 6.0}
_RED = {"distance": 5.0, "speed": 5.0, "duration": 4.0}
_NEAR = {"distance": 1.0, "duration": 7.0}
FAILURES = [
    Failure("p1", "paper_stop4", "1133", "lgsvl", _AT_LINE),
    Failure("p2", "stop4", "1133", "lgsvl", _AT_LINE),
    Failure("p2", "stop4", "3333", "rolling_stop", _AT_LINE),
    Failure("p1", "stop4", "2030", "rolling_stop", _AT_LINE),
    Failure("p2", "stop4", "1200", "lgsvl", _AT_LINE),
    Failure("full_stop", "stop3", "121", "rolling_stop", {"distance": 3.0, "duration": 5.0}),
    Failure("p1", "stop3", "121", "red_light_runner", {"distance": 3.0, "duration": 5.0}),
    Failure("p2", "stop3", "121", "lgsvl", {"distance": 3.0, "duration": 7.0}),
    Failure("red", "light4", "2323", "red_light_runner", _RED),
    Failure("p4", "light4", "2323", "lgsvl", _RED),
    Failure("p6", "light3", "121", "red_light_runner", _RED),
    Failure("right_on_red", "light3", "121", "rolling_stop", _RED),
    Failure("p5", "lanes4", "13131313", "red_light_runner", _RED),
    Failure("red", "setback", "2222", "red_light_runner", _RED),
    Failure("yield_sign", "yield4", "2222", "red_light_runner", _FAST),
    Failure("no_collision", "right4", "2222", "red_light_runner", _FAST),
    Failure("right_before_left", "right4", "2222", "red_light_runner", _FAST, truck="a1"),
    Failure("p2", "left", "2222", "lgsvl", _NEAR),
    Failure("right_first", "five", "22222", "rolling_stop", _NEAR),
    Failure("p2", "stop4", "2222", "red_light_runner", {**_NEAR, "subject": 0}),
    Failure("p2", "stop4", "1133", "rolling_stop", {**_AT_LINE, "followers": 1}, truck="a2"),
    Failure("p1", "five", "22222", "red_light_runner", _NEAR),
    Failure("no_conflict", "yield4", "2222", "red_light_runner", _FAST),
]
"""Distances of 1 m put vehicles on the border of the entrance zone, to the last bit."""
