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

ROAD: tuple[Rule, ...] = ()
