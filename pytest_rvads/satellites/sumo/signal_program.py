"""The signal plan of a scenario as a signal program of SUMO (page "Simulation/Traffic Lights")."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.lights import CLEARANCE, GREEN, YELLOW, SignalPlan
from pytest_rvads.runs.states import Colour

__all__ = ["COLOURS", "program"]

COLOURS = {"G": Colour.GREEN, "g": Colour.GREEN, "y": Colour.YELLOW, "r": Colour.RED}
"""What SUMO's letters show; ``g`` is green for who gives way to somebody else with green."""
_LETTERS = {Colour.YELLOW: "y", Colour.RED: "r"}


def program(junction: Junction, plan: SignalPlan, links: Sequence[Key]) -> Element:
    """Return the element ``tlLogic`` that shows a plan from time 0 on.

    Args:
        junction: with lights at all entrances.
        plan: what they show.
        links: the movement of every link, in the order of their numbers.
    """
    logic = Element("tlLogic", id="J", type="static", programID="rvads", offset="0")
    slot = GREEN + YELLOW + CLEARANCE
    for turn in range(len(plan.groups)):
        for duration, since in ((GREEN, 0.0), (YELLOW, GREEN), (CLEARANCE, GREEN + YELLOW)):
            colours = plan.colours(turn * slot + since, len(junction.entrances))
            state = "".join(_letter(junction, colours, key) for key in links)
            SubElement(logic, "phase", duration=f"{duration:g}", state=state)
    return logic


def _letter(junction: Junction, colours: Sequence[Colour], key: Key) -> str:
    colour = colours[key[0]]
    if colour is not Colour.GREEN:
        return _LETTERS[colour]
    yields = junction.yields or {}
    return "g" if any(one == key and colours[other[0]] is Colour.GREEN for one, other in yields) else "G"
