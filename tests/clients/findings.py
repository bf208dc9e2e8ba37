"""The findings in CARLA's agents: a run that shows each, and the change of a few lines in CARLA's code that removes it."""

from __future__ import annotations

import importlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest_rvads as rvads
from pytest_rvads.report.animated import animated

FOREIGN = Path(__file__).parents[2] / "clients" / "foreign"
DRIVERS = {"agents", "PathTracking", "PathPlanning", "utils", *(file.stem for file in FOREIGN.glob("*.py"))}
"""Top-level modules of the drivers and of their shims."""

Change = tuple[str, str, str]
"""File within ``agents``, a text that the file has once, and the text in its place."""
SEEN_AHEAD = ("tools/misc.py", "return min_angle < angle < max_angle", "return min_angle <= angle < max_angle")
IN_TIME = (
    "navigation/behavior_agent.py",
    "self._affected_by_traffic_light(lights_list)",
    "self._affected_by_traffic_light(lights_list, self._base_tlight_threshold + (self._speed / 3.6) ** 2 / 8)",
)
PLAN_KEPT = (
    "navigation/behavior_agent.py",
    "        control = carla.VehicleControl()\n",
    "        control = self._local_planner.run_step()\n",
)
OWN_LANE = (
    "navigation/basic_agent.py",
    "if trigger_wp.road_id != ego_vehicle_waypoint.road_id:",
    "if (trigger_wp.road_id, trigger_wp.lane_id) != (ego_vehicle_waypoint.road_id, ego_vehicle_waypoint.lane_id):",
)


@dataclass(frozen=True)
class Finding:
    """A run that shows a defect, and changes of CARLA's code."""

    driver: str
    place: str
    directions: str
    subject: int
    speed: float
    rule: str
    instants: tuple[float, float]
    """The instants that a viewer without animation shows, before and after the change [s]."""
    before: tuple[Change, ...] = ()
    """Changes of other findings, which leave the defect alone."""
    after: tuple[Change, ...] = ()
    """The changes without the defect; empty for what no change of a few lines removes."""


FINDINGS = {
    "c1": Finding("Basic", "light4", "0200", 1, 8.0, "red", (6.0, 6.0), after=(SEEN_AHEAD,)),
    "c2": Finding("Normal", "light4", "0200", 1, 10.0, "red", (6.0, 6.0), before=(SEEN_AHEAD,), after=(SEEN_AHEAD, IN_TIME)),
    "c4": Finding("Basic", "light4", "3020", 0, 8.0, "left_yields", (5.8, 0.0)),
    "c7": Finding("Normal", "light4", "0200", 1, 8.0, "on_route", (21.5, 21.5), after=(PLAN_KEPT,)),
    "c8": Finding("Basic", "lanes4", "20000000", 0, 8.0, "progress", (80.0, 6.0), after=(OWN_LANE,)),
}


def forget(path: list[str]) -> None:
    """Forget the modules of the drivers, and set the path of modules."""
    sys.path[:] = path
    for module in [module for module in sys.modules if module.partition(".")[0] in DRIVERS]:
        del sys.modules[module]


def pictured(finding: Finding, agents: Any, after: bool) -> tuple[str, str]:
    """Return the status of the rule and an animated picture of the run, with a driver of an imported shim."""
    scenario = rvads.Scenario(
        rvads.find(finding.place), finding.directions, distance=40, speed=finding.speed, subject=finding.subject
    )
    run = rvads.simulate(rvads.Case(scenario, getattr(agents, finding.driver), traffic=rvads.traffic("reference")))
    verdict = rvads.check(run, finding.rule)
    name = next(agent.name for agent in run.agents if agent.entrance == finding.subject)
    title = f"{'after the change: ' if after else ''}{finding.rule} {verdict.status}"
    instant = finding.instants[after]
    return verdict.status, animated(run, title=title, responsible=[name], around=instant, width=480)


def imported(carla: Path) -> Any:
    """Return the shim of CARLA's agents, imported anew with the agents of a folder."""
    forget(sys.path)
    sys.path.insert(0, str(FOREIGN))
    os.environ["RVADS_CARLA"] = str(carla)
    return importlib.import_module("carla_agents")
