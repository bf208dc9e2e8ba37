"""Saying in words what atoms, places and times mean to a user."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, log10

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.sorts import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

__all__ = ["Naming", "clock", "colour_at", "element_name", "literal", "place", "position", "say", "zone"]

Naming = Callable[[f.Element], str]
"""How to call an element: by its own name, or by the variable it stands for."""

_CONDUCT = {
    "stopped": ("{0} has stopped at the line", "{0} has not stopped at the line"),
    "inside": ("{0} is partly in the junction", "{0} is out of the junction"),
    "blocks": ("{0} blocks the junction", "{0} does not block the junction"),
    "may_go": ("{0} could go", "{0} could not go"),
    "idles": ("{0} could have gone and has not", "{0} has gone when it could"),
    "off_lane": ("{0} is outside its lane", "{0} is in its lane"),
    "off_route": ("{0} is off its route", "{0} is on its route"),
    "speeding": ("{0} is over the speed limit", "{0} is within the speed limit"),
    "collide": ("{0} and {1} collide", "{0} and {1} do not collide"),
    "meet": ("{0} and {1} meet where their ways cross or join", "{0} and {1} do not meet"),
    "conflict": ("{0} and {1} are on conflicting movements", "{0} and {1} are not on conflicting movements"),
    "owes": ("{0} has to let {1} pass", "{0} need not let {1} pass"),
    "obstructs": ("{0} gets in the way of {1}", "{0} does not get in the way of {1}"),
}


def clock(run: Run, tick: int) -> str:
    """Return the time of a tick, with as many digits as the step needs and at least two."""
    return f"{tick * run.dt:.{max(2, ceil(-log10(run.dt) - 1e-9))}f}"


def place(element: f.Element) -> str:
    """Return a place or object by its number: ``entrance 1``, ``the junction``."""
    match element.sort:
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
    """Return the user's name of an element."""
    return element.name if element.sort is Sort.AGENT else place(element)


def literal(atom: f.Atom, value: bool, name: Naming = element_name, be: str = "is") -> str:
    """Return an atom or its negation in words; `be` is the verb, ``is`` or ``was``."""
    no = "" if value else " not"
    match atom.name, atom.terms:
        case "@", (f.Element() as thing, f.Element() as where):
            if be.endswith("stays") and not value and where.sort is Sort.JUNCTION:
                return f"{name(thing)} {be} out of {name(where)}"
            word = {Sort.ENTRANCE: "at", Sort.JUNCTION: "in"}.get(where.sort, "on")
            return f"{name(thing)} {be}{no} {word} {name(where)}"
        case (("=" | "!="), (f.Attr(f.Element() as light, "cl"), f.Word(colour))):
            return f"{name(light)} {be}{' not' if value is (atom.name == '!=') else ''} {colour}"
        case "=", (f.Attr(f.Element() as one, "wt"), f.Attr(f.Element() as two, "wt")):
            return f"{name(one)} and {name(two)} {'arrived' if value else 'did not arrive'} at the same time"
        case "<", (f.Attr(f.Element() as one, "wt"), f.Attr(f.Element() as two, "wt")):
            return f"{name(one)} {'arrived' if value else 'did not arrive'} after {name(two)}"
        case word, (f.Element(), *_) if word in _CONDUCT:
            what = _CONDUCT[word][0 if value else 1].format(*(name(e) for e in atom.terms if isinstance(e, f.Element)))
            return what.replace(" has ", " had ", 1) if be == "was" else what
        case other, (one, two) if not other.isidentifier():
            return f"{no.lstrip()} {_term(one, name)} {other} {_term(two, name)}".lstrip()
    inner = ", ".join(_term(t, name) for t in atom.terms)
    return f"{no} {atom.name}({inner})".lstrip()


def _term(term: f.Term, name: Naming) -> str:
    if isinstance(term, f.Element):
        return name(term)
    return f"{name(term.of)}.{term.name}" if isinstance(term, f.Attr) and isinstance(term.of, f.Element) else str(term)


def say(formula: f.Formula, name: Naming = element_name, be: str = "is") -> str:
    """Return a formula in words: literals joined by and, or, with at most one temporal operator; any other one as it prints."""
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


def position(run: Run, agent: int, tick: int) -> str:
    """Return where an agent is: its station relative to the entrance vertex [m], or its zone where none is recorded."""
    if run.station is not None:
        return f"{run.station[tick, agent]:+.2f} m"
    return zone(run.agents[agent], Zone(int(run.zone[tick, agent])))


def zone(agent: Agent, where: Zone) -> str:
    """Return the part of its itinerary an agent is on, in words."""
    return {
        Zone.APPROACH: "approach",
        Zone.ENTRANCE: f"entrance {agent.entrance}",
        Zone.JUNCTION: "junction",
        Zone.EXIT: f"exit {agent.exit}",
        Zone.GONE: "gone",
    }[where]


def colour_at(run: Run, entrance: int, tick: int) -> str:
    """Return the colour of the light of an entrance."""
    return Colour(int(run.lights[tick, entrance])).name.lower()
