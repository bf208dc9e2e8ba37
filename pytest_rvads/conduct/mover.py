"""The present state of a vehicle, in plain numbers."""

from __future__ import annotations

import math

from pytest_rvads.conduct.motion import NEVER
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.states import ABSENT, GONE, Agent

__all__ = ["Mover"]


class Mover:
    """The present state of a vehicle, with those parts of its past that the predicates need.

    Args:
        agent: the agent, with its name, way and size.
        slot: the column of the vehicle.
        junction: the junction of the agent's way.
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
        """Whether the vehicle is neither absent nor gone."""
        return self.zone != GONE and self.zone != ABSENT
