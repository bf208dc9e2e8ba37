"""The shipped predicates and attributes of the rule language: to add a predicate or attribute, add an entry to this module.

The entry of a predicate is called a word. A word holds the sorts of the predicate's arguments, a function or signal with the
truth per state, the part that the junction and the ways decide, phrases, the measurements on which the truth depends, and the
vehicle to blame; `Word` in the module `vocabulary` explains every field. No other module depends on the name of a word, except
``@``, which the grammar contains. A predicate that a user registers is a word, too. A rule holds its words. Therefore no name is
looked up when a run is judged.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.logic.conduct.blame import Cause, blame, cause_of, disregard, disregard_at_kerb
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.conduct.bodies import collide, contacts
from pytest_rvads.logic.conduct.lane import lane_allows, off_lane, off_route, wrong_lanes
from pytest_rvads.logic.conduct.priority import obstructs, owes
from pytest_rvads.logic.conduct.rights import Ground, gives_up, lit, owes_crossing
from pytest_rvads.logic.conduct.standing import (
    arrived,
    at_entrance,
    colour,
    in_junction,
    inside,
    on_approach,
    on_exit,
    speed,
    speeding,
    standing_time,
    stopped,
    waited,
    wt,
)
from pytest_rvads.logic.conduct.static_model import Static
from pytest_rvads.logic.conduct.stretches import meet, stepped_on_walk, takes_crosswalk
from pytest_rvads.logic.conduct.waiting import blocks, idles, may_go, on_crosswalk, stands_on_crosswalk, waits_to_cross
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.current import PACKAGE
from pytest_rvads.logic.rules.vocabulary import Attribute, FromZones, Measured, RightOfWay, Sort, TightBend, Vocabulary, Word
from pytest_rvads.runs.run import Run, once
from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import RunError

HERE = f.Element(Sort.JUNCTION, 0, "j")
"""The junction under test."""


def at(place: f.Element, entrances: int) -> Signal[NDArray[np.bool_]]:
    """Return the signal that is true in the states in which a vehicle is at a place of its way through the junction."""
    match place.sort:
        case Sort.JUNCTION:
            return in_junction
        case Sort.ENTRANCE:
            return at_entrance
        case Sort.ROAD if place.index < entrances:
            return on_approach
    return on_exit


def _may_be_at(static: Static, thing: f.Element, place: f.Element) -> bool | None:
    if thing.sort != Sort.AGENT:
        return place.sort == Sort.ENTRANCE and place.index == thing.index
    agent = static.agents[thing.index]
    match place.sort:
        case Sort.ENTRANCE:
            return None if agent.entrance == place.index else False
        case Sort.EXIT:
            return None if agent.exit == place.index else False
        case Sort.ROAD:
            return None if place.index in (agent.entrance, static.entrances + agent.exit) else False
    return None


def _take(agent: f.Term, entrance: f.Term, direction: f.Term, itinerary: bool) -> f.Formula:
    stays, turns = f.Atom("@", (agent, entrance)), f.Atom("turn", (agent, direction))
    if itinerary:
        return f.And((stays, turns))
    # As in the paper, an agent without a known itinerary stays at the entrance until it is in the junction.
    return f.And((stays, turns, f.Until(stays, f.Atom("@", (agent, HERE)))))


def _may_owe(static: Static, agent: f.Element, other: f.Element) -> bool | None:
    return None if agent != other and (static.owing is None or (agent.index, other.index) in static.owing) else False


def _has_ground(ground: Ground, static: Static, agent: f.Element, other: f.Element) -> bool | None:
    if agent == other:
        return False
    return None if static.grounds is None else (agent.index, other.index, ground) in static.grounds


def _over_crossing(static: Static, agent: f.Element, other: f.Element) -> bool | None:
    """Return False for two agents that are not a vehicle and a pedestrian whose crossing the vehicle drives over."""
    vehicle, walker = static.agents[agent.index], static.agents[other.index]
    conflicts = static.junction.conflicts
    crossed = conflicts is None or (vehicle.way.key, walker.way.key) in conflicts
    return None if agent != other and crossed and isinstance(walker.way, Crossing) else False


def _conflict(static: Static, agent: f.Element, other: f.Element) -> bool | None:
    conflicts = static.junction.conflicts
    ways = static.agents[agent.index].way.key, static.agents[other.index].way.key
    return None if conflicts is None else ways in conflicts


def _turns_on_red(static: Static, agent: f.Element) -> bool:
    who = static.agents[agent.index]
    return static.junction.turns_on_red(who.entrance, who.turn)


def _at_walk_light(static: Static, agent: f.Element) -> bool:
    who = static.agents[agent.index]
    return isinstance(who.way, Crossing) and lit(static.junction, who.entrance)


def _no_geometry(_run: Run, *_agents: int) -> NDArray[np.bool_]:
    raise RunError("the run holds no geometry of its junction")  # with geometry, the static model decides the predicate


def _from_right(static: Static, element: f.Element, other: f.Element) -> bool:
    """Return whether an entrance, or the entrance of a vehicle, is to the right of another entrance, or of that of a vehicle."""
    if element.sort == other.sort == Sort.AGENT:
        return (static.agents[element.index].entrance, static.agents[other.index].entrance) in static.junction.right_of
    return element.sort == other.sort == Sort.ENTRANCE and (element.index, other.index) in static.junction.right_of


def _cause(run: Run, agent: int, other: int, _tick: int) -> Cause | None:
    pair = {run.agents[agent].name, run.agents[other].name}
    hit = next((c for c in once(run, contacts) if set(c.agents) == pair), None)
    return None if hit is None else cause_of(run, hit)


_word = partial(Word, place=PACKAGE)
_MOVES, _STOPS = (Measured.PACE, Measured.ALONG), (Measured.PACE, Measured.ALONG, Measured.BEFORE)
_ONE, _TWO, _ENTRANCES = ("agent",), ("agent", "agent"), ("entrance or vertex", "entrance or vertex")

BUILT_IN: Vocabulary = Vocabulary.of(
    _word(
        "@",
        ("agent or light or object", "entrance or exit or junction or road or vertex"),
        lambda run, agent, place: at(place, len(run.junction.entrances))(run, agent.index),
        decide=_may_be_at,
        static="light or object",
        turns_on=(Measured.ALONG,),
        from_zones=FromZones.ALWAYS,
        present=True,
    ),
    _word("turn", ("agent", "direction"), decide=lambda s, agent, to: s.turns(agent.index, to.name), static="agent"),
    _word("take", ("agent", "entrance", "direction"), means=_take),
    _word("turns_on_red", _ONE, decide=_turns_on_red, static="agent"),
    _word(
        "conflict",
        _TWO,
        _no_geometry,
        "{0} and {1} are on conflicting movements",
        "{0} and {1} are not on conflicting movements",
        decide=_conflict,
        static="agent",
        any_way=True,
    ),
    _word(
        "meet",
        _TWO,
        meet,
        "{0} and {1} meet where their ways cross or join",
        "{0} and {1} do not meet",
        symmetric=True,
        turns_on=(Measured.ALONG,),
        present=True,
        cause=blame,
        any_way=True,
    ),
    _word(
        "collide",
        _TWO,
        collide,
        "{0} and {1} collide",
        "{0} and {1} do not collide",
        symmetric=True,
        turns_on=(Measured.SIZES, Measured.ALONG),
        present=True,
        cause=_cause,
        bend=TightBend.CAN_CAUSE,
        any_way=True,
    ),
    _word(
        "owes",
        _TWO,
        owes,
        "{0} has to let {1} pass",
        "{0} need not let {1} pass",
        decide=_may_owe,
        turns_on=_MOVES,
        debt=RightOfWay.OWED,
    ),
    _word(
        "obstructs",
        _TWO,
        obstructs,
        "{0} gets in the way of {1}",
        "{0} does not get in the way of {1}",
        decide=_may_owe,
        turns_on=_MOVES,
        debt=RightOfWay.TAKEN,
    ),
    *(
        _word(
            f"yields_by_{ground}",
            _TWO,
            _no_geometry,
            says,
            denies,
            decide=partial(_has_ground, ground),
            static="agent",
        )
        for ground, says, denies in (
            (Ground.SIGN, "{0} has a stop or yield sign against {1}", "{0} has no sign against {1}"),
            (Ground.PRIORITY, "{1} has priority over {0}", "{1} has no priority over {0}"),
            (Ground.SIDE, "{1} comes from the near side of {0}", "{1} does not come from the near side of {0}"),
            (Ground.TURN, "{0} turns across the way of {1}", "{0} does not turn across the way of {1}"),
            (Ground.MERGE, "{0} joins the traffic of {1}", "{0} does not join the traffic of {1}"),
        )
    ),
    _word(
        "stopped",
        _ONE,
        stopped,
        "{0} has stopped at the line",
        "{0} has not stopped at the line",
        turns_on=_STOPS,
        present=True,
    ),
    _word(
        "arrived",
        _ONE,
        arrived,
        "{0} has arrived at its line",
        "{0} has not arrived at its line",
        turns_on=_STOPS,
        from_zones=FromZones.BLIND,
        present=True,
    ),
    _word(
        "gives_up",
        _ONE,
        gives_up,
        "{0} has given up its turn",
        "{0} has not given up its turn",
        turns_on=_STOPS,
        from_zones=FromZones.BLIND,
    ),
    _word(
        "inside",
        _ONE,
        inside,
        "{0} is partly in the junction",
        "{0} is out of the junction",
        turns_on=(Measured.ALONG,),
        present=True,
        any_way=True,
    ),
    _word("blocks", _ONE, blocks, "{0} blocks the junction", "{0} does not block the junction", turns_on=_MOVES),
    _word("may_go", _ONE, may_go, "{0} could go", "{0} could not go", turns_on=_MOVES),
    _word("idles", _ONE, idles, "{0} could have gone and has not", "{0} has gone when it could", turns_on=_MOVES),
    _word(
        "off_lane",
        _ONE,
        off_lane,
        "{0} is outside its lane",
        "{0} is in its lane",
        turns_on=(Measured.SIZES, Measured.SIDES),
        bend=TightBend.EXCUSES,
    ),
    _word(
        "lane_allows",
        _ONE,
        lane_allows,
        "{0} is in a lane that leads where it goes",
        "{0} is in a lane that does not lead where it goes",
        decide=lambda s, agent: None if wrong_lanes(s.junction, *s.agents[agent.index].way.key) else True,
        turns_on=(Measured.SIDES,),
    ),
    *(
        _word(name, _TWO, holds, says, denies, decide=_over_crossing, turns_on=_MOVES, cause=cause, any_way=True)
        for name, holds, says, denies, cause in (
            ("owes_crossing", owes_crossing, "{0} has to let {1} cross", "{0} need not let {1} cross", disregard),
            (
                "takes_crosswalk",
                takes_crosswalk,
                "{0} takes the crosswalk from {1}",
                "{0} does not take the crosswalk from {1}",
                disregard,
            ),
            ("waits_to_cross", waits_to_cross, "{1} waits for {0} to let it cross", "{1} does not wait for {0}", None),
            (
                "passes_by",
                takes_crosswalk,
                "{0} drives onto the crosswalk of {1}",
                "{0} does not drive onto the crosswalk of {1}",
                disregard_at_kerb,
            ),
        )
    ),
    _word(
        "walk_light",
        _ONE,
        decide=_at_walk_light,
        static="agent",
        any_way=True,
    ),
    _word(
        "stepped_on_walk",
        _ONE,
        stepped_on_walk,
        "{0} stepped onto the crosswalk on WALK",
        "{0} did not step onto the crosswalk on WALK",
        turns_on=(Measured.ALONG,),
        any_way=True,
    ),
    _word("on_crosswalk", _ONE, on_crosswalk, "{0} is on a crosswalk", "{0} is on no crosswalk", turns_on=(Measured.ALONG,)),
    _word(
        "stands_on_crosswalk",
        _ONE,
        stands_on_crosswalk,
        "{0} stands on a crosswalk",
        "{0} does not stand on a crosswalk",
        turns_on=_MOVES,
    ),
    _word(
        "off_route",
        _ONE,
        off_route,
        "{0} is off its route",
        "{0} is on its route",
        turns_on=(Measured.SIDES,),
        bend=TightBend.CAN_CAUSE,
    ),
    _word("speeding", _ONE, speeding, "{0} is over the speed limit", "{0} is within the speed limit", turns_on=_MOVES),
    _word("right-of", ("agent or entrance or vertex",) * 2, decide=_from_right, static="agent or entrance or vertex"),
    _word(
        "opposite",
        _ENTRANCES,
        decide=lambda s, one, two: one.sort == two.sort == Sort.ENTRANCE and (one.index, two.index) in s.junction.opposite,
        static=_ENTRANCES[0],
    ),
    _word(
        "beside",
        ("entrance", "entrance"),
        decide=lambda s, one, two: one != two and s.junction.starts[one.index].arm == s.junction.starts[two.index].arm,
        static="entrance",
    ),
    _word(
        "takes_turns",
        _TWO,
        decide=lambda s, one, two: one != two and (s.by_arrival is None or (one.index, two.index) in s.by_arrival),
        static="agent",
    ),
    _word("stop_sign", ("entrance",), decide=lambda s, entrance: entrance.index in s.signs, static="entrance"),
    _word(
        "entex",
        ("entrance or vertex", "exit or vertex"),
        decide=lambda s, one, two: (
            (one.sort, two.sort) == (Sort.ENTRANCE, Sort.EXIT) and (one.index, two.index) in s.junction.entex
        ),
        static=_ENTRANCES[0],
    ),
)

_SAME, _AFTER = "{0} and {1} arrived at the same time", "{0} arrived after {1}"

ATTRIBUTES = {
    attribute.name: attribute
    for attribute in (
        Attribute(
            "wt",
            Sort.AGENT,
            "number",
            wt,
            waited=True,
            from_zones=FromZones.ALWAYS,
            standing=standing_time,
            says=(
                ("=", _SAME, "{0} and {1} did not arrive at the same time"),
                ("<", _AFTER, "{0} did not arrive after {1}"),
            ),
        ),
        Attribute(
            "waited",
            Sort.AGENT,
            "number",
            waited,
            waited=True,
            from_zones=FromZones.BLIND,
            says=(
                ("=", _SAME, "{0} and {1} did not arrive at the same time"),
                ("<", _AFTER, "{0} did not arrive after {1}"),
            ),
        ),
        Attribute("sp", Sort.AGENT, "number", speed),
        Attribute(
            "cl",
            Sort.LIGHT,
            "colour",
            colour,
            lambda name: Colour[name.upper()],
            says=(("= value", "{0} {be} {1}", "{0} {be} not {1}"), ("!= value", "{0} {be} not {1}", "{0} {be} {1}")),
        ),
    )
}


def word_of(atom: f.Atom) -> Word | None:
    """Return the definition of an atom's predicate, which a user or the package defined; None for a comparison."""
    return atom.word if isinstance(atom.word, Word) else BUILT_IN.get(atom.name)
