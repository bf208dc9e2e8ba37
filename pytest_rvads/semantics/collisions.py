"""Who caused a collision: the traffic rules give the order in which a road user is to blame.

The order is that of everyday insurance practice and of the codes behind it: whoever drives into somebody who stands or
is ahead (Vienna Convention on Road Traffic 1968, Art. 13); else whoever entered on red or past a stop sign (Art. 5); else
the left turn among oncoming traffic (Art. 16(2)); else whoever entered the junction last (California Vehicle Code 21800(a)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pytest_rvads.maps.junction import JunctionControl
from pytest_rvads.maps.segment import Turn
from pytest_rvads.semantics.conduct import STANDSTILL, stopped
from pytest_rvads.semantics.run import Collision, Run
from pytest_rvads.semantics.states import Colour, Zone

__all__ = ["STOOD", "Cause", "cause_of", "stuck", "surprised"]

STOOD = 0.5
"""A vehicle that has stood still for this long before the impact was stood into [s]."""
REACTION = 1.0
"""Time in which a driver notices somebody and stops or does not set off [s]; the usual figure of accident analysis."""
ALONG = math.pi / 4
"""Two vehicles whose headings differ by less than this drive one behind the other [rad]."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Who is to blame for a collision, and why."""

    agents: tuple[str, ...]
    """One vehicle, or both where nothing tells them apart."""
    reason: str
    """What it did, to be read after its name."""


def cause_of(run: Run, collision: Collision) -> Cause:
    """Return who caused `collision`, a collision of `run`.

    What the run does not record decides nothing.
    """
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    one, two = (columns[name] for name in collision.agents)
    tick = min(max(round(collision.time / run.dt), 0), run.steps - 1)
    for asks, reason in _ORDER:
        guilty = [i for i, other in ((one, two), (two, one)) if asks(run, i, other, tick)]
        if len(guilty) == 1:
            who, whom = run.agents[guilty[0]].name, run.agents[two if guilty[0] == one else one].name
            return Cause((who,), reason.format(whom))
    return Cause(collision.agents, "are equally to blame")


def surprised(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent`, a column, met `other` in the junction at `tick` without a chance to let it in.

    It was `other` that had to wait, and it entered less than `REACTION` before.
    """
    entered = _entered(run, other, tick)
    if entered is None or (tick - entered) * run.dt > REACTION:
        return False
    for asks, _ in _RIGHTS:
        guilty = [i for i, whom in ((agent, other), (other, agent)) if asks(run, i, whom, tick)]
        if len(guilty) == 1:
            return guilty[0] == other
    return False


def stuck(run: Run, agent: int) -> bool:
    """Return whether the vehicle in column `agent` stands at its entrance or in the junction when the run ends."""
    where = run.zone[-1, agent]
    return bool(where in (Zone.ENTRANCE, Zone.JUNCTION)) and _stood(run, agent, run.steps - 1)


_Asks = Callable[[Run, int, int, int], bool]


def _into_standing(run: Run, agent: int, other: int, tick: int) -> bool:
    return _stood(run, other, tick) and not _stood(run, agent, tick)


def _stood(run: Run, agent: int, tick: int) -> bool:
    since = tick - round(STOOD / run.dt)
    return run.speed is not None and since >= 0 and bool((np.abs(run.speed[since : tick + 1, agent]) <= STANDSTILL).all())


def _from_behind(run: Run, agent: int, other: int, tick: int) -> bool:
    if run.pose is None:
        return False
    (x, y, heading), (far_x, far_y, ahead) = run.pose[tick, agent], run.pose[tick, other]
    apart = abs((ahead - heading + math.pi) % (2 * math.pi) - math.pi)
    return bool(apart < ALONG and (far_x - x) * math.cos(ahead) + (far_y - y) * math.sin(ahead) > 0)


def _on_red(run: Run, agent: int, _other: int, tick: int) -> bool:
    entered = _entered(run, agent, tick)
    return entered is not None and run.lights[entered, run.agents[agent].entrance] == Colour.RED


def _past_the_sign(run: Run, agent: int, _other: int, tick: int) -> bool:
    entered = _entered(run, agent, tick)
    if run.junction.control is not JunctionControl.STOP or not entered or run.speed is None or run.station is None:
        return False
    return not stopped(run, agent)[entered - 1]


def _turning(run: Run, agent: int, other: int, tick: int) -> bool:
    """Whether `agent` turns across the way of `other`, which comes from the opposite entrance."""
    me, you = run.agents[agent], run.agents[other]
    far = Turn.RIGHT if run.junction.left_hand else Turn.LEFT
    facing = (me.entrance, you.entrance) in run.junction.opposite
    return run.junction.control is JunctionControl.LIGHTS and facing and me.turn is far and _entered(run, agent, tick) is not None


def _last(run: Run, agent: int, other: int, tick: int) -> bool:
    mine, yours = _entered(run, agent, tick), _entered(run, other, tick)
    return mine is not None and (yours is None or mine > yours)


def _entered(run: Run, agent: int, tick: int) -> int | None:
    """Return the first tick in the junction, up to `tick`."""
    inside = np.flatnonzero(run.zone[: tick + 1, agent] == Zone.JUNCTION)
    return int(inside[0]) if len(inside) else None


_RIGHTS: tuple[tuple[_Asks, str], ...] = (
    (_on_red, "had entered on red"),
    (_past_the_sign, "had not stopped at the stop sign"),
    (_turning, "turned across the way of {}"),
)
"""Who had to wait, the first question that exactly one of both answers with yes."""
_ORDER: tuple[tuple[_Asks, str], ...] = (
    (_into_standing, "drove into {}, which stood"),
    (_from_behind, "ran into {} from behind"),
    *_RIGHTS,
    (_last, "entered the junction after {}"),
)
"""Who is to blame, likewise."""
