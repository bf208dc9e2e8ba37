"""pytest-rvads: validate autonomous-driving controllers against traffic rules, in pytest.

The public names below are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pytest_rvads.autopilots import Follower, Reference, RollingStop
    from pytest_rvads.autopilots.lgsvl import LgsvlLike
    from pytest_rvads.autopilots.playback import Replay
    from pytest_rvads.autopilots.traffic import traffic
    from pytest_rvads.collection import known, scenario
    from pytest_rvads.errors import (
        AutopilotError,
        FormulaError,
        MapError,
        OpenObligation,
        RuleViolation,
        RunError,
        RvadsError,
        ScenarioError,
    )
    from pytest_rvads.logic.check import check
    from pytest_rvads.logic.rules import Rule, rule
    from pytest_rvads.logic.verdicts import Status, Verdict
    from pytest_rvads.maps.finder import find
    from pytest_rvads.maps.junction import Junction
    from pytest_rvads.maps.segment import Turn
    from pytest_rvads.physics.braking import vmax
    from pytest_rvads.physics.simulation import simulate
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.semantics.itinerary import Itinerary
    from pytest_rvads.semantics.run import Run
    from pytest_rvads.semantics.states import Agent, Autopilot, Colour, Control, Observation, TrafficSystem, VehicleState, Zone
    from pytest_rvads.semantics.vehicle import Vehicle

__version__ = "0.1.0"

_HOMES = {
    "autopilots": ["Follower", "Reference", "RollingStop"],
    "autopilots.lgsvl": ["LgsvlLike"],
    "autopilots.playback": ["Replay"],
    "autopilots.traffic": ["traffic"],
    "collection": ["known", "scenario"],
    "errors": [
        "AutopilotError",
        "FormulaError",
        "MapError",
        "OpenObligation",
        "RuleViolation",
        "RunError",
        "RvadsError",
        "ScenarioError",
    ],
    "logic.check": ["check"],
    "logic.rules": ["Rule", "rule"],
    "logic.verdicts": ["Status", "Verdict"],
    "maps.finder": ["find"],
    "maps.junction": ["Junction"],
    "maps.segment": ["Turn"],
    "physics.braking": ["vmax"],
    "physics.simulation": ["simulate"],
    "scenarios.scenario": ["Scenario"],
    "semantics.itinerary": ["Itinerary"],
    "semantics.run": ["Run"],
    "semantics.states": [
        "Agent",
        "Autopilot",
        "Colour",
        "Control",
        "Observation",
        "TrafficSystem",
        "VehicleState",
        "Zone",
    ],
    "semantics.vehicle": ["Vehicle"],
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Agent",
    "Autopilot",
    "AutopilotError",
    "Colour",
    "Control",
    "Follower",
    "FormulaError",
    "Itinerary",
    "Junction",
    "LgsvlLike",
    "MapError",
    "Observation",
    "OpenObligation",
    "Reference",
    "Replay",
    "RollingStop",
    "Rule",
    "RuleViolation",
    "Run",
    "RunError",
    "RvadsError",
    "Scenario",
    "ScenarioError",
    "Status",
    "TrafficSystem",
    "Turn",
    "Vehicle",
    "VehicleState",
    "Verdict",
    "Zone",
    "check",
    "find",
    "known",
    "rule",
    "scenario",
    "simulate",
    "traffic",
    "vmax",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
