"""Puts parts of a judgement into words for users: atoms of formulas, places, times, events, and doubts."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, isinf, log10

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import UTURN, turn_word
from pytest_rvads.geometry.ways import Way
from pytest_rvads.logic.conduct.rights import Ground
from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.judging.judgement import Debt, InstanceJudgement
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.rule import Form
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

Naming = Callable[[f.Element], str]
"""A function that returns the name of an element (vehicle or place) in a text: its own name, or the name of a variable."""


def clock(run: Run, tick: int) -> str:
    """Return the time of a tick on the clock of the recording as text, with the decimals of the step and at least two [s]."""
    return f"{run.start + tick * run.dt:.{max(2, ceil(-log10(run.dt) - 1e-9))}f}"


def place(element: f.Element) -> str:
    """Return the name of a place or object for texts, with its number: ``entrance 1``, ``the junction``."""
    match Sort(element.sort):
        case Sort.JUNCTION:
            return "the junction"
        case Sort.LIGHT:
            return f"light {element.index}"
        case Sort.ROAD:
            return f"road {element.index}"
        case Sort.ENTRANCE | Sort.EXIT:
            return f"{element.sort} {element.index}"
    return element.name


def element_name(element: f.Element) -> str:
    """Return the name of a vehicle, place or value for texts that users read."""
    return element.name if element.sort == Sort.AGENT else place(element)


def literal(atom: f.Atom, value: bool, name: Naming = element_name, be: str = "is") -> str:
    """Return an atom or its negation in words; `be` is the verb, ``is`` or ``was``."""
    no = "" if value else " not"
    if atom.name == "@" and isinstance(place := atom.terms[1], f.Element):
        thing, location = _term(atom.terms[0], name), name(place)
        if be.endswith("stays") and not value and place.sort == Sort.JUNCTION:
            return f"{thing} {be} out of {location}"
        return f"{thing} {be}{no} {_PREPOSITIONS.get(place.sort, 'on')} {location}"
    word, text = word_of(atom), ""
    if word is not None:
        text = word.says if value else word.denies
    else:
        match atom.terms:
            case (f.Attr(_, attribute), f.Attr() | f.Value() as other):
                comparison = atom.name if isinstance(other, f.Attr) else f"{atom.name} value"
                phrases = {compared: (says, denies) for compared, says, denies in ATTRIBUTES[attribute].says}
                text = phrases.get(comparison, ("", ""))[0 if value else 1]
    if text:
        owners = (t.of if isinstance(t, f.Attr) else t for t in atom.terms)
        words = text.format(*(_term(owner, name) for owner in owners), be=be)
        return words.replace(" has ", " had ", 1) if be == "was" else words
    terms = [_term(t, name) for t in atom.terms]
    if len(terms) == 2 and not atom.name.isidentifier():
        return f"{no} {terms[0]} {atom.name} {terms[1]}".lstrip()
    return f"{no} {atom.name}({', '.join(terms)})".lstrip()


_PREPOSITIONS: dict[str, str] = {Sort.ENTRANCE: "at", Sort.JUNCTION: "in"}


def _term(term: f.Term, name: Naming) -> str:
    if isinstance(term, f.Element):
        return name(term)
    return f"{name(term.of)}.{term.name}" if isinstance(term, f.Attr) and isinstance(term.of, f.Element) else str(term)


def say(formula: f.Formula, name: Naming = element_name, be: str = "is") -> str:
    """Return a formula in words, or the text of the formula if it is too complex for words."""
    match formula:
        case f.Atom():
            return literal(formula, True, name, be)
        case f.Not(f.Atom() as atom):
            return literal(atom, False, name, be)
        case f.And(parts):
            return " and ".join(say(p, name, be) for p in parts)
        case f.Or(parts):
            return " or ".join(say(p, name, be) for p in parts)
        case f.Eventually(body) | f.Always(body) if f.is_boolean(body):
            return f"{'eventually' if isinstance(formula, f.Eventually) else 'always'} {say(body, name, be)}"
        case f.Until(left, right) if f.is_boolean(left) and f.is_boolean(right):
            return f"{say(left, name, be)} until {say(right, name, be)}"
    return str(formula)


def why(run: Run, debt: Debt | None, seat: Callable[[int], str] = str) -> str:
    """Return in words why a vehicle has to give way to another vehicle; empty if lights or the order of arrival decide."""
    if debt is None:
        return ""
    junction, me, you = run.junction, run.agents[debt.agent], run.agents[debt.other]
    own_entrance, other_entrance = (f"entrance {seat(agent.entrance)}" for agent in (me, you))
    signs = [junction.entrances[agent.entrance].sign for agent in (me, you)]
    match debt.ground:
        case Ground.PRIORITY if (me.way.key, you.way.key) in junction.stated:
            return f"by the map the way from {other_entrance} has priority over the one from {own_entrance}"
        case Ground.SIGN | Ground.PRIORITY:
            return f"{own_entrance} has {_SIGNS[signs[0]]}, {other_entrance} {_SIGNS[signs[1]]}"
        case Ground.SIDE:
            return f"{other_entrance} is on the {junction.near} of {own_entrance}, and neither has priority by a sign"
        case Ground.TURN:
            word = turn_word(junction, me.way)
            turn = f"makes a {word}" if word == UTURN else f"turns {word}"
            return f"who comes from {own_entrance} {turn} across the way from {other_entrance}"
        case Ground.MERGE:
            return f"by the map the lane from {own_entrance} joins the one from {other_entrance}"


_SIGNS = {
    Sign.STOP: "a stop sign",
    Sign.YIELD: "a yield sign",
    Sign.PRIORITY: "a priority sign",
    Sign.LIGHTS: "a light",
    Sign.NONE: "no sign",
}


def position(run: Run, agent: int, tick: int) -> str:
    """Return the place of an agent as text: its station from the entrance vertex [m], or its zone if no station is recorded."""
    if run.station is not None:
        return f"{run.station[tick, agent]:+.2f} m"
    return zone(run.agents[agent], Zone(int(run.zone[tick, agent])))


def origin(junction: Junction, agent: Agent) -> str:
    """Return where an agent comes from, and its turn or the kind of its way, in words."""
    if agent.way.key in junction.movements:
        return f"from entrance {agent.entrance}, {turns(junction, agent)}"
    return f"{aside(agent.way)} of arm {junction.starts[agent.entrance].arm}"


def turns(junction: Junction, agent: Agent) -> str:
    """Return the turn of a vehicle in words; the turns of all its possible ways if its way is not decided."""
    ways = (agent.way, *(junction.movements[agent.entrance, exit] for exit in agent.other_exits))
    return " or ".join(dict.fromkeys(turn_word(junction, way) for way in ways))


def aside(way: Way) -> str:
    """Return in words where an agent on a way that is no movement is."""
    return "on the crosswalk" if isinstance(way, Crossing) else f"on a {way.kind}"


def zone(agent: Agent, where: Zone) -> str:
    """Return in words the zone (part of its itinerary) in which an agent is."""
    if isinstance(agent.way, Crossing):
        return _ON_FOOT[where]
    return {
        Zone.APPROACH: "approach",
        Zone.ENTRANCE: f"entrance {agent.entrance}",
        Zone.JUNCTION: "junction",
        Zone.EXIT: f"exit {agent.exit}",
        Zone.GONE: "gone",
        Zone.ABSENT: "absent",
    }[where]


_ON_FOOT = {
    Zone.APPROACH: "sidewalk",
    Zone.ENTRANCE: "kerb",
    Zone.JUNCTION: "crosswalk",
    Zone.EXIT: "far kerb",
    Zone.GONE: "gone",
    Zone.ABSENT: "absent",
}
"""The zones of a pedestrian in words."""


def colour_at(run: Run, entrance: int, tick: int) -> str:
    """Return in words the colour of the light of an entrance at a tick."""
    return Colour(int(run.lights[tick, entrance])).name.lower()


def bound_names(template: Template) -> tuple[tuple[str, str], ...]:
    """Return the variables of a rule, and the names of the vehicles and places that the variables stand for in an instance."""
    return tuple((name, element_name(e)) for name, e in template.binding)


def happened(j: InstanceJudgement, name: Naming = element_name) -> str:
    """Return in words the events of the tick in which an instance of a rule failed."""
    shape, broken = j.template.shape, dict(j.broken)
    match shape.waits:
        case f.Atom("@", (f.Element() as agent, f.Element() as entrance)) if shape.goes and broken.get(shape.waits) is False:
            goes = say(shape.goes, name, "was")
            if j.together:
                return f"{name(agent)} left {name(entrance)} in the first step in which {goes}, not after it"
            return f"{name(agent)} left {name(entrance)} before {goes}"
        case f.Not(f.Atom("@", (f.Element() as agent, _)) as entered) if shape.goes and broken.get(entered) is True:
            goes = say(shape.goes, lambda e: "it" if e == agent else name(e), "was")
            return f"{name(agent)} entered the junction before {goes}"
    parts = j.template.atoms
    inside = [
        a.terms[0] for a in parts if a.name == "@" and isinstance(a.terms[1], f.Element) and a.terms[1].sort == Sort.JUNCTION
    ]
    if shape.form is Form.STATE and len(inside) == len(parts) == 2:
        return f"{', '.join(name(e) for e in inside if isinstance(e, f.Element))} both in junction"
    return ", ".join(literal(a, v, name) for a, v in j.broken)


_CAME = {
    Zone.ENTRANCE: ("arrived", "had arrived"),
    Zone.JUNCTION: ("entered", "had entered"),
    Zone.EXIT: ("was through", "was through"),
    Zone.GONE: ("was gone", "was gone"),
}
"""Per zone, the verb for a vehicle that came to the zone, and the verb for a vehicle that possibly never came to the zone."""


def hangs(run: Run, j: InstanceJudgement) -> str:
    """Return in words the uncertain events or measurement on which an UNSURE instance depends, with the accuracy.

    An example is ``a4 arrived at 12.31 s, a7 arrived at 12.34 s: 0.03 s apart, known to 0.05 s``.
    """
    hinge = j.hinge
    if hinge is None:
        return ""
    if hinge.reading:
        who = " and ".join(dict.fromkeys(element.name for _, element in j.template.binding if element.sort == Sort.AGENT))
        return f"it depends on {hinge.reading}" + (f" ({who})" if who else "")
    told = []
    for happening in hinge.what:
        if happening.agent is None:
            what, ended = f"light {happening.light} turned {Colour(happening.code).name.lower()}", ""
        else:
            did, had = _CAME[Zone(happening.code)]
            name = run.agents[happening.agent].name
            what, ended = f"{name} {did}", f"nothing tells whether {name} {had} when its recording ends"
        told.append(ended if happening.time is None else f"{what} at {run.start + happening.time:.2f} s")
    events = ", ".join(told)
    if isinf(hinge.known):
        return f"{events}; how long before is not known"
    if hinge.apart is None:
        return f"{events}, known to {hinge.known:.2f} s"
    tie = f", where up to {hinge.tie:.2f} s count as at the same time" if hinge.tie else ""
    return f"{events}: {abs(hinge.apart):.2f} s apart, known to {hinge.known:.2f} s{tie}"


def since(run: Run, j: InstanceJudgement) -> float | None:
    """Return the time of the uncertain events, or of the beginning of the obligation, on the clock of the recording [s]."""
    times = [h.time for h in j.hinge.what if h.time is not None] if j.hinge else []
    tick = None if j.trigger is None else j.trigger * run.dt
    time = max(times) if times else tick
    return None if time is None else round(run.start + time, 9)
