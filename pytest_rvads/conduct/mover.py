"""A vehicle as it is now, in plain numbers."""

from __future__ import annotations

import math

from pytest_rvads.conduct.motion import NEVER
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.states import ABSENT, GONE, Agent

__all__ = ["Mover"]


class Mover:
    """A vehicle as it is now, and what the words need of its past.

    Args:
        agent: its name, way and size.
        slot: its column.
        junction: that it comes to.
    """

    __slots__ = (
        "agent",
        "arrived",
        "arrived_at",
        "entered",
        "entrance",
        "facing",
        "length",
        "line",
        "slot",
        "speed",
        "spread",
        "station",
        "wt",
        "zone",
    )

    def __init__(self, agent: Agent, slot: int, junction: Junction) -> None:
        self.agent, self.slot, self.entrance = agent, slot, agent.entrance
        self.line = -junction.setbacks[agent.entrance]
        self.length = math.nan if agent.size is None else agent.size[0]
        self.zone = int(ABSENT)
        self.station = self.speed = math.nan
        self.spread = math.nan
        self.wt = 0
        self.entered, self.facing = NEVER, 0
        self.arrived = False
        self.arrived_at = -1

    @property
    def here(self) -> bool:
        """Whether it is neither absent nor gone."""
        return self.zone != GONE and self.zone != ABSENT
