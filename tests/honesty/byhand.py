"""Runs written by hand where one vehicle follows another: the fixture `drive` makes one vehicle per entrance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

__all__ = ["CROSS", "GREEN", "joined", "until_contact"]

G, R = Colour.GREEN, Colour.RED
GREEN = {e: [(0, G)] for e in range(4)}
"""Lights that are green for everybody, so that nobody is to blame by them."""
CROSS = {e: [(0, R if e % 2 else G)] for e in range(4)}
"""Green at entrances 0 and 2, red at 1 and 3."""


def joined(one: Run, other: Run) -> Run:
    """Return a run with the vehicles of both, those of the other one renamed from a0 to b0; bodies that touch count."""
    agents = (*one.agents, *(replace(agent, name=agent.name.replace("a", "b")) for agent in other.agents))
    names = "zone", "station", "speed", "pose"
    arrays: dict[str, Any] = {name: np.concatenate((getattr(one, name), getattr(other, name)), axis=1) for name in names}
    return replace(one, agents=agents, collisions=None, **arrays)


def until_contact(run: Run) -> Run:
    """Return a run up to the first contact of two bodies, as a simulation would end."""
    from pytest_rvads.logic.conduct.bodies import contacts

    run = replace(run, collisions=None)
    (first, *_) = contacts(run)
    end = round(first.time / run.dt) + 2
    arrays: dict[str, Any] = {name: getattr(run, name)[:end] for name in ("zone", "lights", "station", "speed", "pose")}
    return replace(run, collisions=(first,), **arrays)
