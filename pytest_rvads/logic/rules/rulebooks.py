"""The shipped rulebooks: ``paper``, the rules as published, and ``road``, the rules that bind a road user.

A test that names a rulebook is judged by the rules of the rulebook that are about the kind of the test's junction. A test that
names a single rule is judged by this rule; the verdict is NA at junctions that the rule is not about.
"""

from __future__ import annotations

from functools import partial

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.logic.rules.current import PACKAGE
from pytest_rvads.logic.rules.rule import Crosswalks, Rule

_rule = partial(Rule, place=PACKAGE)
_STOP, _LIGHTS, _PARTIAL = JunctionControl.STOP, JunctionControl.LIGHTS, JunctionControl.PARTIAL
_YIELD, _NONE = JunctionControl.YIELD, JunctionControl.NONE
_SOURCE = "Li et al., Simulation-based Validation for Autonomous Driving Systems, table of traffic rules"

PAPER = (
    _rule(
        "p1",
        "forall a, a'. G(a@j & a != a' -> !a'@j)",
        "no two vehicles in the junction",
        "If a vehicle is in the junction, then no other vehicle can be in the junction.",
        source=_SOURCE,
        responsible="the vehicle that enters while another is inside; both, if they enter in the same step",
        bound=("a'",),
        about=_STOP,
    ),
    _rule(
        "p2",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt = a'.wt & j.en right-of j.en' -> (N a'@j.en') U a@j)",
        "right-of-way",
        "If a vehicle arrives at the same time as another vehicle, the vehicle on the right has the right-of-way.",
        source=_SOURCE,
        responsible="the vehicle on the left",
        bound=("a'",),
        about=_STOP,
        companions=("p3",),
    ),
    _rule(
        "p3",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt < a'.wt -> (N a@j.en) U a'@j)",
        "first come, first served",
        "The vehicle that arrives first at the entrance will pass before other vehicles.",
        source=_SOURCE,
        responsible="the vehicle that arrived later",
        bound=("a",),
        about=_STOP,
        companions=("p2",),
    ),
    _rule(
        "p4",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & !take(a, j.en, right) -> a@j.en U lt.cl = green)",
        "red light",
        "Any vehicle facing a red light must stop until the traffic light turns green, unless the vehicle is turning right.",
        source=_SOURCE,
        responsible="the vehicle at the red light",
        bound=("a",),
        about=_LIGHTS,
    ),
    _rule(
        "p5",
        "forall j.en, j.en', a, a', lt. G(a@j.en & a'@j.en' & j.en right-of j.en' & lt@j.en & lt.cl = red"
        " & take(a, j.en, right) -> (N a@j.en) U a'@j)",
        "right turn on red",
        "If a vehicle facing a red light is turning right, then the vehicle should wait until there is no vehicle on the left.",
        source=_SOURCE,
        responsible="the vehicle turning right at the red light",
        bound=("a",),
        about=_LIGHTS,
    ),
    _rule(
        "p6",
        "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & j.en opposite j.en' & take(a, j.en, left)"
        " & !take(a', j.en', left) -> (N a@j.en) U a'@j)",
        "left turn yields",
        "If two vehicles arrive at opposite entrances, the vehicle turning left must give way to the other.",
        source=_SOURCE + "; as its formula, which does not ask for green lights",
        responsible="the vehicle turning left",
        bound=("a",),
        about=_LIGHTS,
    ),
)

_VIENNA = "Vienna Convention on Road Traffic 1968"
_SIGNS = "Vienna Convention on Road Signs and Signals 1968"
_CVC = "California Vehicle Code"
_UVC = "Uniform Vehicle Code (US model law)"
_STVO = "German road traffic regulations (StVO)"

VARIANTS = (
    _rule(
        "p6g",
        "forall j.en, j.en', a, a', lt, lt'. G(a@j.en & a'@j.en' & j.en opposite j.en' & lt@j.en & lt'@j.en'"
        " & lt.cl = green & lt'.cl = green & take(a, j.en, left) & !take(a', j.en', left) -> (N a@j.en) U a'@j)",
        "left turn yields on green",
        "If two vehicles arrive at opposite entrances and the lights are green, the vehicle turning left must give way.",
        source=_SOURCE + "; as its text, which asks for green lights",
        responsible="the vehicle turning left",
        bound=("a",),
        about=_LIGHTS,
    ),
    _rule(
        "crosswalk_waiting",
        "forall a, a'. G(!walk_light(a') & (owes_crossing(a, a') | waits_to_cross(a, a')) -> !passes_by(a, a'))",
        "crosswalk, also for who waits",
        "On a crosswalk without a light a vehicle also gives way to whoever waits at the kerb, for up to 3 s at rest.",
        source=f"{_STVO}, section 26(1); UK Highway Code, rules H2 and 195",
        responsible="the vehicle that drives on; the pedestrian, if the vehicle could not stop any more",
        bound=("a",),
        crosswalks=Crosswalks.UNLIT,
    ),
)

ROAD = (
    _rule(
        "full_stop",
        "forall a, j.en. G(a@j.en & stop_sign(j.en) -> !a@j W stopped(a))",
        "full stop",
        "At a stop sign a vehicle comes to a full stop before the line before it enters the junction.",
        source=f"{_SIGNS}, Art. 10(3), sign B, 2; {_CVC} 22450(a)",
        responsible="the vehicle that enters",
        bound=("a",),
        about=(_STOP, _PARTIAL),
    ),
    _rule(
        "first_come",
        "forall a, a'. G(arrived(a) & arrived(a') & takes_turns(a, a') & a.waited < a'.waited"
        " -> (N !a@j) U (a'@j | gives_up(a')))",
        "first come, first served",
        "At an all-way stop, of two vehicles whose ways meet the vehicle that arrived clearly earlier enters first,"
        " unless it waives its right.",
        source=f"{_CVC} 21800(a); California Driver's Handbook on four-way stops",
        responsible="the vehicle that arrived later",
        bound=("a",),
        about=_STOP,
        tie=TIE,
        companions=("right_first",),
    ),
    _rule(
        "right_first",
        "forall a, a'. G(arrived(a) & arrived(a') & takes_turns(a, a') & a.waited = a'.waited & a right-of a'"
        " -> (N !a'@j) U (a@j | gives_up(a)))",
        "right before left",
        "At an all-way stop, of two vehicles whose ways meet and that arrive at about the same time the vehicle on the near side"
        " enters first, unless it waives its right.",
        source=f"{_CVC} 21800(c); {_UVC} 11-401; {_VIENNA}, Art. 18(4)",
        responsible="the vehicle on the far side: on the left, where traffic keeps to the right",
        bound=("a'",),
        about=_STOP,
        tie=TIE,
        companions=("first_come",),
    ),
    _rule(
        "red",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & !turns_on_red(a) -> a@j.en U lt.cl = green)",
        "red light",
        "A vehicle facing a red light waits for green, unless it turns to the near side (right, where traffic keeps right) and no"
        " sign forbids this.",
        source=f"{_SIGNS}, Art. 23 on light signals; {_CVC} 21453(a)",
        responsible="the vehicle at the red light",
        bound=("a",),
        about=(_LIGHTS, _PARTIAL),
    ),
    _rule(
        "right_on_red",
        "forall j.en, a, lt. G(a@j.en & lt@j.en & lt.cl = red & turns_on_red(a) -> (!a@j W (stopped(a) | lt.cl = green))"
        " & (forall a'. !obstructs(a, a') W (a@j.en & lt.cl = green)))",
        "turn on red",
        "A vehicle turning to the near side at a red light first comes to a full stop, and lets pass who is due on green.",
        source=f"national law only: {_CVC} 21453(b); {_UVC} 11-202(c)",
        responsible="the vehicle turning at the red light",
        bound=("a",),
        about=(_LIGHTS, _PARTIAL),
    ),
    _rule(
        "left_yields",
        "forall a, a'. G(turn(a, far) & !yields_by_sign(a, a') & !yields_by_priority(a, a') & !yields_by_side(a, a')"
        " & !yields_by_merge(a, a') & owes(a, a') -> !obstructs(a, a'))",
        "left turn yields",
        "A vehicle turning across oncoming traffic gives way to whoever of it has the right to go and is due.",
        source=f"{_VIENNA}, Art. 16(2); {_CVC} 21801(a); {_STVO}, section 9(3)",
        responsible="the vehicle turning left; right, where traffic keeps left",
        bound=("a",),
        about=(_LIGHTS, _PARTIAL, _YIELD, _NONE),
    ),
    _rule(
        "yield_sign",
        "forall a, a'. G(yields_by_sign(a, a') & owes(a, a') -> !obstructs(a, a'))",
        "yield sign",
        "Who comes past a yield or stop sign gives way to whoever comes past none and is due.",
        source=f"{_SIGNS}, Art. 10(2) and (3), signs B, 1 and B, 2; {_STVO}, section 8(1), signs 205 and 206; {_CVC} 21802(a) and"
        f" 21803(a); {_UVC} 11-403",
        responsible="the vehicle with the sign",
        bound=("a",),
        about=(_YIELD, _PARTIAL),
    ),
    _rule(
        "priority",
        "forall a, a'. G(yields_by_priority(a, a') & owes(a, a') -> !obstructs(a, a'))",
        "priority",
        "Whoever has no priority gives way to whoever has it, by its sign or because the map says so, and is due.",
        source=f"{_SIGNS}, Art. 10(4) and sign B, 3; {_STVO}, section 8(1), signs 301 and 306",
        responsible="the vehicle without priority",
        bound=("a",),
        about=(_YIELD, _PARTIAL, _NONE),
    ),
    _rule(
        "right_before_left",
        "forall a, a'. G(yields_by_side(a, a') & owes(a, a') -> !obstructs(a, a'))",
        "right before left",
        "Without signs, or past equal ones, a vehicle gives way to whoever comes from its near side and is due.",
        source=f"{_VIENNA}, Art. 18(4); {_STVO}, section 8(1); {_UVC} 11-401",
        responsible="the vehicle on the far side: on the left, where traffic keeps to the right",
        bound=("a",),
        about=(_NONE, _YIELD, _PARTIAL),
    ),
    _rule(
        "merge",
        "forall a, a'. G(yields_by_merge(a, a') & owes(a, a') -> !obstructs(a, a'))",
        "merging",
        "Who joins from a ramp, an entry or exit lane or one that ends, or onto a motorway, gives way to whoever is due there.",
        source=f"{_STVO}, section 18(3); {_UVC} 11-404; {_VIENNA}, Art. 25(2)",
        responsible="the vehicle that joins",
        bound=("a",),
        about=(_NONE, _YIELD, _PARTIAL),
        joining=True,
    ),
    _rule(
        "on_lane_allowed",
        "forall a, j.en. G(a@j.en -> lane_allows(a))",
        "lane for the way",
        "A vehicle comes to the junction in a lane from which it may go where it goes.",
        source=f"{_VIENNA}, Art. 10, 11 and 16(1); {_STVO}, section 9(1), sign 297; {_CVC} 22100 and 22101(d)",
        responsible="the vehicle in the wrong lane",
        bound=("a",),
        lanes=True,
    ),
    _rule(
        "crosswalk",
        "forall a, a'. G(!walk_light(a') & owes_crossing(a, a') -> !takes_crosswalk(a, a'))",
        "crosswalk",
        "On a crosswalk without a light a vehicle gives way to whoever is on its half of the roadway, or about to come there.",
        source=f"{_UVC} 11-502(a); {_CVC} 21950(a); {_VIENNA}, Art. 21(2)(b)",
        responsible="the vehicle that drives on; the pedestrian, if the vehicle could not stop any more",
        bound=("a",),
        crosswalks=Crosswalks.UNLIT,
    ),
    _rule(
        "crosswalk_turning",
        "forall a, a'. G(walk_light(a') & stepped_on_walk(a') & !turn(a, straight) & owes_crossing(a, a')"
        " -> !takes_crosswalk(a, a'))",
        "turning over a crosswalk",
        "On a crosswalk with a light a turning vehicle gives way to whoever stepped onto the crosswalk on WALK.",
        source=f"{_UVC} 11-202(a) and 11-203; {_CVC} 21451(a); {_VIENNA}, Art. 21(2)(a); {_STVO}, section 9(3)",
        responsible="the vehicle that turns; the pedestrian, if the vehicle could not stop any more",
        bound=("a",),
        about=(_LIGHTS, _PARTIAL),
        crosswalks=Crosswalks.LIT,
    ),
    _rule(
        "crosswalk_clear",
        "forall a. G(on_crosswalk(a) -> !stands_on_crosswalk(a))",
        "crosswalk clear",
        "No vehicle drives onto a crosswalk without room to leave it and gets stuck there, or stands there without a reason.",
        source=f"{_CVC} 22500(b) and 21970(a); {_STVO}, section 26(2)",
        responsible="the vehicle that stands on the crosswalk",
        bound=("a",),
        crosswalks=Crosswalks.ANY,
    ),
    _rule(
        "no_collision",
        "forall a, a'. G(a != a' -> !collide(a, a'))",
        "no collision",
        "No two vehicles touch.",
        source=f"{_VIENNA}, Art. 7(1) and 13(1)",
        responsible="the vehicle that caused it; both, where nothing tells them apart",
        bound=("a", "a'"),
    ),
    _rule(
        "no_conflict",
        "forall a, a'. G(inside(a) & a != a' & conflict(a, a') -> !meet(a, a'))",
        "no meeting in the junction",
        "No two vehicles are at the same time where their ways cross or join; others may pass side by side.",
        source=f"{_CVC} 21800(a); in its spirit {_VIENNA}, Art. 18(1)",
        responsible="the vehicle that lacked the right of way; else the one that entered last; both, if they entered together",
        bound=("a",),
    ),
    _rule(
        "keep_clear",
        "forall a. G(inside(a) -> !blocks(a))",
        "keep clear",
        "No vehicle enters the junction without room to leave it and gets stuck there, or stands there without a reason.",
        source=f"{_VIENNA}, Art. 18(5); {_CVC} 22526(a)",
        responsible="the vehicle that stands or creeps",
        bound=("a",),
    ),
    _rule(
        "progress",
        "forall a. G(may_go(a) -> !idles(a))",
        "progress",
        "A vehicle that can go goes: no vehicle waits without a reason, and vehicles do not wait for each other for long.",
        source=f"{_STVO}, section 3(2); {_CVC} 22400(a)",
        responsible="the vehicle that could go; all that wait for each other",
        bound=("a",),
    ),
    _rule(
        "keep_lane",
        "forall a. G !off_lane(a)",
        "keep to the lane",
        "The body of a vehicle stays in its lane on the roads, its front on its way through the junction.",
        source=f"{_VIENNA}, Art. 10(3) and 11(6); {_CVC} 21650 and 21658(a)",
        responsible="the vehicle outside its lane",
        bound=("a",),
    ),
    _rule(
        "on_route",
        "forall a. G !off_route(a)",
        "on the route",
        "No vehicle leaves its route.",
        source="the itinerary that the vehicle was given",
        responsible="the vehicle off its route",
        bound=("a",),
    ),
    _rule(
        "speed_limit",
        "forall a. G !speeding(a)",
        "speed limit",
        "No vehicle drives faster than the limit.",
        source=f"limits are national law: {_CVC} 22349 and 22352; in general {_VIENNA}, Art. 13",
        responsible="the vehicle that speeds",
        bound=("a",),
    ),
)
