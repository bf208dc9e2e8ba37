"""A vehicle as it is now, in plain numbers, and what is static about two of them."""

from __future__ import annotations

import math
from collections import deque

from pytest_rvads.conduct.grounds import ground_of, in_turn, lit, may_owe
from pytest_rvads.conduct.motion import NEVER
from pytest_rvads.conduct.priority import WINDOW
from pytest_rvads.conduct.stretches import contested, parting, shared
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import JunctionControl, Sign
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, GONE, Agent

__all__ = ["Mover", "Pair"]


class Mover:
    """A vehicle as it is now, and what the words need of its past.

    Args:
        agent: its name, way and size.
        slot: its column.
        junction: that it comes to.
        dt: time between two instants [s].
    """

    __slots__ = (
        "advance",
        "agent",
        "arrived",
        "arrived_at",
        "entered",
        "entrance",
        "facing",
        "free",
        "held_at",
        "is_held",
        "last_ready",
        "length",
        "line",
        "lit",
        "next_to_go",
        "reach",
        "ready",
        "slot",
        "slow_at_entry",
        "speed",
        "speeds",
        "spread",
        "station",
        "stop_sign",
        "wt",
        "zone",
    )

    def __init__(self, agent: Agent, slot: int, junction: Junction, dt: float) -> None:
        place = junction.entrances[agent.entrance]
        self.agent, self.slot, self.entrance = agent, slot, agent.entrance
        self.lit = lit(junction, agent.entrance)
        self.line = -junction.setbacks[agent.entrance]
        self.stop_sign = place.sign is Sign.STOP
        self.length = math.nan if agent.size is None else agent.size[0]
        self.zone = int(ABSENT)
        self.station = self.speed = self.advance = math.nan
        self.spread = math.nan
        self.wt = 0
        self.entered, self.facing = NEVER, 0
        self.arrived = self.next_to_go = False
        self.arrived_at = self.last_ready = -1
        self.ready = self.free = 0
        self.slow_at_entry: frozenset[Mover] = frozenset()
        self.speeds: deque[float] = deque(maxlen=max(round(WINDOW / dt), 1) + 1)
        self.reach = 20.0 + 100.0 * dt
        self.held_at, self.is_held = -1, False

    @property
    def here(self) -> bool:
        """Whether it is neither absent nor gone."""
        return self.zone != GONE and self.zone != ABSENT


class Pair:
    """What is static about two vehicles: what they share, and whether the first may owe the way to the second.

    Args:
        run: of one state, in which both have their columns.
        me: the first.
        you: the second.
    """

    __slots__ = ("always", "common", "contested", "from_right", "in_turn", "me", "near", "owing", "parting", "you")

    def __init__(self, run: Run, me: Mover, you: Mover) -> None:
        self.me, self.you, junction = me, you, run.junction
        self.common: Shared | None = shared(run, me.slot, you.slot)
        self.contested: Shared | None = contested(run, me.slot, you.slot)
        self.owing = may_owe(run, me.slot, you.slot)
        self.near = me.agent.turn is junction.near
        ways = me.agent.route.key, you.agent.route.key
        self.always = me.lit and self.near and not you.lit and ground_of(junction, *ways) is not None
        self.in_turn = junction.control is JunctionControl.STOP and in_turn(junction, *ways)
        self.from_right = (you.entrance, me.entrance) in junction.right_of
        self.parting = parting(junction, *ways) if me.entrance == you.entrance else 0.0
