"""The shipped rulebooks: ``paper``, as published, and ``road``, what a road user is held to."""

from __future__ import annotations

from pytest_rvads.logic.rules import Rule
from pytest_rvads.maps.junction import JunctionControl

__all__ = ["PAPER", "ROAD", "VARIANTS"]

_STOP, _LIGHTS = JunctionControl.STOP, JunctionControl.LIGHTS
_SOURCE = "Li et al., Simulation-based Validation for Autonomous Driving Systems, table of traffic rules"

PAPER = (
    Rule(
        "p1",
        "forall a, a'. G(a@j & a != a' -> !a'@j)",
        "no two vehicles in the junction",
        "If a vehicle is in the junction, then no other vehicle can be in the junction.",
        source=_SOURCE,
        responsible="the vehicle that enters while another is inside; both, if they enter in the same step",
        about=_STOP,
    ),
    Rule(
        "p2",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt = a'.wt & j.en right-of j.en' -> (N a'@j.en') U a@j)",
        "right-of-way",
        "If a vehicle arrives at the same time as another vehicle, the vehicle on the right has the right-of-way.",
        source=_SOURCE,
        responsible="the vehicle on the left",
        about=_STOP,
        companions=("p3",),
    ),
    Rule(
        "p3",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt < a'.wt -> (N a@j.en) U a'@j)",
        "first come, first served",
        "The vehicle that arrives first at the entrance will pass before other vehicles.",
        source=_SOURCE,
        responsible="the vehicle that arrived later",
        about=_STOP,
        companions=("p2",),
    ),
    Rule(
        "p4",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & !take(a, j.en, right) -> a@j.en U lt.cl = green)",
        "red light",
        "Any vehicle facing a red light must stop until the traffic light turns green, unless the vehicle is turning right.",
        source=_SOURCE,
        responsible="the vehicle at the red light",
        about=_LIGHTS,
    ),
    Rule(
        "p5",
        "forall j.en, j.en', a, a', lt. G(a@j.en & a'@j.en' & j.en right-of j.en' & lt@j.en & lt.cl = red"
        " & take(a, j.en, right) -> (N a@j.en) U a'@j)",
        "right turn on red",
        "If a vehicle facing a red light is turning right, then the vehicle should wait until there is no vehicle on the left.",
        source=_SOURCE,
        responsible="the vehicle turning right at the red light",
        about=_LIGHTS,
    ),
    Rule(
        "p6",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & j.en opposite j.en' & take(a, j.en, left)"
        " & !take(a', j.en', left) -> (N a@j.en) U a'@j)",
        "left turn yields",
        "If two vehicles arrive at opposite entrances, the vehicle turning left must give way to the other.",
        source=_SOURCE + "; as its formula, which does not ask for green lights",
        responsible="the vehicle turning left",
        about=_LIGHTS,
    ),
)

VARIANTS = (
    Rule(
        "p6g",
        "forall j.en, j.en', a, a', lt, lt'. G(a@j.en & a'@j.en' & j.en opposite j.en' & lt@j.en & lt'@j.en'"
        " & lt.cl = green & lt'.cl = green & take(a, j.en, left) & !take(a', j.en', left) -> (N a@j.en) U a'@j)",
        "left turn yields on green",
        "If two vehicles arrive at opposite entrances and the lights are green, the vehicle turning left must give way.",
        source=_SOURCE + "; as its text, which asks for green lights",
        responsible="the vehicle turning left",
        about=_LIGHTS,
    ),
)

_TIE = 0.5
"""How much later still counts as "at approximately the same time" [s]; statutes give no number."""
_VIENNA = "Vienna Convention on Road Traffic 1968"
_SIGNS = "Vienna Convention on Road Signs and Signals 1968"
_CVC = "California Vehicle Code"
_UVC = "Uniform Vehicle Code (US model law)"

ROAD = (
    Rule(
        "full_stop",
        "forall a, j.en. G(a@j.en -> !a@j W stopped(a))",
        "full stop",
        "At a stop sign a vehicle comes to a full stop before the line before it enters the junction.",
        source=f"{_SIGNS}, Art. 10(3), sign B, 2; {_CVC} 22450(a)",
        responsible="the vehicle that enters",
        about=_STOP,
    ),
    Rule(
        "first_come",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt < a'.wt -> (N a@j.en) U a'@j)",
        "first come, first served",
        "At an all-way stop, of two vehicles at the entrances the one that arrived clearly earlier enters first.",
        source=f"{_CVC} 21800(a); California Driver's Handbook on four-way stops",
        responsible="the vehicle that arrived later",
        about=_STOP,
        tie=_TIE,
        companions=("right_first",),
    ),
    Rule(
        "right_first",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt = a'.wt & j.en right-of j.en' -> (N a'@j.en') U a@j)",
        "right before left",
        "At an all-way stop, of two vehicles that arrive at about the same time the one on the right enters first.",
        source=f"{_CVC} 21800(c); {_UVC} 11-401; where traffic keeps to the right, {_VIENNA}, Art. 18(4)(a)",
        responsible="the vehicle on the left",
        about=_STOP,
        tie=_TIE,
        companions=("first_come",),
    ),
    Rule(
        "red",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & !turn(a, right) -> a@j.en U lt.cl = green)",
        "red light",
        "A vehicle facing a red light waits for green, unless it turns right.",
        source=f"{_SIGNS}, Art. 23 on light signals; {_CVC} 21453(a)",
        responsible="the vehicle at the red light",
        about=_LIGHTS,
    ),
    Rule(
        "right_on_red",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & turn(a, right) -> (!a@j W (stopped(a) | lt.cl = green))"
        " & (forall j.en', a', lt'. a'@j.en' & j.en right-of j.en' & lt'@j.en' & lt'.cl = green"
        " -> (N a@j.en) U (a'@j | lt.cl = green)))",
        "right turn on red",
        "A vehicle turning right at a red light first comes to a full stop, and lets pass who comes from the left on green.",
        source=f"national law only: {_CVC} 21453(b); {_UVC} 11-202(c)",
        responsible="the vehicle turning right at the red light",
        about=_LIGHTS,
    ),
    Rule(
        "left_yields",
        "forall j.en, j.en', a, a', lt, lt'. G(a@j.en & a'@j.en' & j.en opposite j.en' & lt@j.en & lt'@j.en'"
        " & lt.cl = green & lt'.cl = green & turn(a, left) & !turn(a', left) -> (N a@j.en) U a'@j)",
        "left turn yields",
        "A vehicle turning left on green gives way to one that comes from the opposite entrance and does not turn left.",
        source=f"{_VIENNA}, Art. 16(2); {_CVC} 21801(a)",
        responsible="the vehicle turning left",
        about=_LIGHTS,
    ),
    Rule(
        "no_collision",
        "forall a, a'. G(a != a' -> !collide(a, a'))",
        "no collision",
        "No two vehicles touch.",
        source=f"{_VIENNA}, Art. 7(1) and 13(1)",
        responsible="the vehicle that caused it; both, where nothing tells them apart",
    ),
    Rule(
        "no_conflict",
        "forall a, a'. G(a@j & a != a' & conflict(a, a') -> !a'@j)",
        "no conflicting movements",
        "No two vehicles are in the junction on movements that get in each other's way; others may pass side by side.",
        source=f"{_CVC} 21800(a); in its spirit {_VIENNA}, Art. 18(1)",
        responsible="the vehicle that enters while the other is inside; both, if they enter in the same step",
    ),
    Rule(
        "keep_clear",
        "forall a. G !blocks(a)",
        "keep clear",
        "No vehicle comes to stand in the junction.",
        source=f"{_VIENNA}, Art. 18(5); {_CVC} 22526(a)",
        responsible="the vehicle that stands",
    ),
    Rule(
        "speed_limit",
        "forall a. G !speeding(a)",
        "speed limit",
        "No vehicle drives faster than the limit.",
        source=f"limits are national law: {_CVC} 22349 and 22352; in general {_VIENNA}, Art. 13",
        responsible="the vehicle that speeds",
    ),
)
