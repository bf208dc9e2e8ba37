"""The random draw: which runs have one, over which range, and the one value of the tables."""

from __future__ import annotations

import numpy as np

from pytest_rvads.drivers.lgsvl.constants import RED_WAIT, TURN_WAIT
from pytest_rvads.errors import RunError
from pytest_rvads.maps.segment import Turn
from pytest_rvads.paper.experiment import LIGHT, Entry, Setup, run_entry
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["crossing_wait", "draw_range"]

_CLASS = 4
"""Its configuration J is the only place where the paper's verdict needs a certain draw."""


def draw_range(entry: Entry) -> tuple[float, float] | None:
    """Return the range that the draw of a run is made from [s], or None where nobody draws.

    A right turn that faces red draws how long to wait, a left turn that faces red how long to wait after green.
    """
    if entry.table is not LIGHT:
        return None
    scenario = entry.scenario()
    junction = scenario.place
    colours = scenario.signals().colours(0.0, len(junction.entrances))
    turns = {agent.turn for agent in scenario.agents() if colours[agent.entrance] is Colour.RED}
    ranges = [span for turn, span in ((Turn.RIGHT, RED_WAIT), (Turn.LEFT, TURN_WAIT)) if turn in turns]
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def crossing_wait(setup: Setup | None = None) -> float:
    """Return the wait [s] after which a right turn on red enters while a crossing vehicle is at its entrance.

    In configuration J of class 4, p5 is violated only by a draw from a narrow window: the right turn has to set off so
    that it enters while the vehicle with green passes its entrance zone. A dry run with the longest draw tells when the
    crossing vehicle is at its entrance, and how long the right turn needs from the end of its wait to the line.

    Raises:
        RunError: the vehicles of the dry run do not get that far.
    """
    setup = setup or Setup()
    longest = RED_WAIT[1]
    dry = run_entry(Entry(LIGHT, _CLASS, 0, "J"), Setup(setup.constants, setup.off, longest))
    crossing = np.flatnonzero(dry.zone[:, 0] == Zone.ENTRANCE)
    entry = dry.entry(1)
    if not len(crossing) or entry is None:
        raise RunError(f"the dry run {dry.label} ended before a vehicle crossed, so it tells no wait")
    # At its entrance it stands from the start.
    standing = float(np.flatnonzero(dry.need("speed")[:, 1] < 0.05)[0]) * dry.dt
    start_up = entry - longest - standing
    # An entry breaks the rule from one step after the other's arrival up to the step in which the other enters.
    middle = int(crossing[0] + crossing[-1] + 2) // 2
    return round(middle * dry.dt - start_up, 2)
