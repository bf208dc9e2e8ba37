"""Decides which vehicle is to blame for a collision or meeting: right of way first, the order of entry last.

The vehicle that lacked the right of way is to blame, until it is clear of the shared stretch: the vehicle that entered on red or
past a stop sign (Vienna Convention on Road Traffic 1968, Art. 5), out of turn, or took a way that it owed to the other vehicle
(Art. 16(2), 18). The other vehicle shares the blame if it could still have stopped before the stretch, and did not (Art. 13(1)).
If the rights do not distinguish the two vehicles, the vehicle in the wrong lane is to blame (Art. 10(3)); then the vehicle that
drove into a standing or preceding vehicle (Art. 13), unless that vehicle cut in; then the vehicle that drove backwards
(California Vehicle Code 22106); then the vehicle that entered the junction last (California Vehicle Code 21800(a)). A vehicle
that braked hard without a reason shares the blame of the vehicle that ran into it (StVO, section 4(1)). This is also the order of
insurance practice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pytest_rvads.geometry.conflicts import Shared
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.logic.conduct.blocks import tick_of
from pytest_rvads.logic.conduct.grounds import may_owe
from pytest_rvads.logic.conduct.lane import off_lane
from pytest_rvads.logic.conduct.priority import HEADWAY, MIN_GAP, WINDOW, brakes_hard, owes, unhindered
from pytest_rvads.logic.conduct.progress import idles, may_go
from pytest_rvads.logic.conduct.rights import comes_first
from pytest_rvads.logic.conduct.standing import STANDSTILL, stopped
from pytest_rvads.logic.conduct.stretches import contested, shared
from pytest_rvads.runs.run import Collision, Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.support.errors import RunError

__all__ = ["STOOD", "Cause", "blame", "cause_of", "cut_short_by", "pushed", "stuck", "surprised"]

STOOD = 0.5
"""Least time that a vehicle stands still before an impact to count as a standing vehicle [s]."""
REACTION = 1.0
"""Time in which a driver notices another vehicle and stops or stays [s]; the usual figure of accident analysis."""
BRAKING = 3.4
"""Deceleration that every vehicle reaches [m/s^2] (AASHTO, A Policy on Geometric Design: stopping sight distance)."""
IMPACT = 0.1
"""Motions are read this long before the impact, because the impact changes them [s]."""
ALONG = math.pi / 4
"""Two vehicles whose headings differ by less than this angle drive behind each other [rad]."""


@dataclass(frozen=True, slots=True)
class Cause:
    """The vehicles to blame, and the reason."""

    agents: tuple[str, ...]
    """The vehicle to blame, or both vehicles if nothing distinguishes them."""
    reason: str
    """The action of the vehicle, a phrase to be read after its name."""


def cause_of(run: Run, collision: Collision) -> Cause:
    """Return the cause of a collision of `run`."""
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    first, second = (columns[name] for name in collision.agents)
    return blame(run, first, second, tick_of(run, collision))


def blame(run: Run, agent: int, opponent: int, tick: int) -> Cause:
    """Return the cause of a meeting or collision of two agents, given by column, at `tick`.

    A question about values that the run does not record is answered with no.
    """
    pairs = (agent, opponent), (opponent, agent)
    matters = [pair for pair in pairs if not _clear(run, *pair, tick)]
    for asks, reason in (*_RIGHTS, *_HANDLING):
        guilty = [
            (guilty_agent, other)
            for guilty_agent, other in (matters if (asks, reason) in _RIGHTS else pairs)
            if asks(run, guilty_agent, other, tick)
        ]
        if len(guilty) == 1:
            who, whom = (run.agents[k].name for k in guilty[0])
            action = reason.format(whom)
            if (asks, reason) in _RIGHTS and _drove_on(run, *guilty[0][::-1], tick):
                return Cause((who, whom), f"share the blame: {who} {action}, and {whom} drove on though it could have stopped")
            if asks is _from_behind and _braked_for_nothing(run, guilty[0][1], tick):
                return Cause((who, whom), f"share the blame: {who} {action}, and {whom} braked hard without a reason")
            return Cause((who,), action)
    return Cause((run.agents[agent].name, run.agents[opponent].name), "are equally to blame")


def surprised(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent`, a column, met `other` in the junction at `tick` without a chance to let `other` pass.

    This holds if `other` lacked the right of way, and entered less than `REACTION` before.
    """
    entered = _entered(run, other, tick)
    if entered is None or (tick - entered) * run.dt > REACTION:
        return False
    for asks, _ in _RIGHTS:
        guilty = [i for i, whom in ((agent, other), (other, agent)) if asks(run, i, whom, tick)]
        if len(guilty) == 1:
            return guilty[0] == other
    return False


def pushed(run: Run, agent: int, tick: int) -> bool:
    """Return whether another vehicle, alone to blame, ran into `agent`, a column, less than `REACTION` before `tick`."""
    name, most = run.agents[agent].name, round(REACTION / run.dt)
    hits = (c for c in run.collisions or () if name in c.agents and 0 <= tick - tick_of(run, c) < most)
    return any(name not in cause_of(run, c).agents for c in hits)


def cut_short_by(run: Run) -> tuple[str, ...]:
    """Return the vehicles to blame for an early end of the run, by a collision or by leaving the route; empty if none."""
    last = [c for c in run.collisions or () if tick_of(run, c) >= run.steps - 2]
    return tuple(dict.fromkeys((*run.facts.strayed, *(name for c in last for name in cause_of(run, c).agents))))


def stuck(run: Run, agent: int) -> bool:
    """Return whether the vehicle in column `agent` stands in the way of all others at the end of the run.

    The vehicle does if it stands in the junction, or at its entrance although it can go or could have gone for long.
    """
    where = run.zone[-1, agent]
    if where not in (Zone.ENTRANCE, Zone.JUNCTION) or not _stood(run, agent, run.steps - 1, STOOD):
        return False
    try:
        return bool(where == Zone.JUNCTION or may_go(run, agent)[-1] or idles(run, agent)[-1])
    except RunError:
        return True


_Asks = Callable[[Run, int, int, int], bool]


def _into_standing(run: Run, agent: int, other: int, tick: int) -> bool:
    return _stood(run, other, tick, STOOD) and not _stood(run, agent, tick, STOOD)


def _stood(run: Run, agent: int, tick: int, seconds: float) -> bool:
    since = tick - round(seconds / run.dt)
    return run.speed is not None and since >= 0 and bool((np.abs(run.speed[since : tick + 1, agent]) <= STANDSTILL).all())


def _in_the_wrong_lane(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` was outside its lane; inside the lane it would not have met `other`, as the ways don't meet."""
    try:
        me, you = run.agents[agent], run.agents[other]
        if shared(run, agent, other) is not None or me.entrance == you.entrance or me.exit == you.exit:
            return False
        return bool(off_lane(run, agent)[tick])
    except RunError:
        return False


def _backs(run: Run, agent: int, _other: int, tick: int) -> bool:
    """Return whether `agent` drove backwards just before the impact."""
    before = max(tick - round(IMPACT / run.dt), 0)
    return run.speed is not None and bool(run.speed[before, agent] < -STANDSTILL)


def _from_behind(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` was behind `other`, and `other` did not cut in."""
    return _behind(run, agent, other, tick) and not _cuts_in(run, other, agent, tick)


def _behind(run: Run, agent: int, other: int, tick: int) -> bool:
    if run.pose is None:
        return False
    (x, y, heading), (far_x, far_y, ahead) = run.pose[tick, agent], run.pose[tick, other]
    apart = abs((ahead - heading + math.pi) % (2 * math.pi) - math.pi)
    return bool(apart < ALONG and (far_x - x) * math.cos(ahead) + (far_y - y) * math.sin(ahead) > 0)


def _cuts_in(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` came into the lane of `other`, ahead of `other`, too late for `other` to make room."""
    try:
        common = shared(run, agent, other)
    except RunError:
        return False
    since = None if common is None else _merged(run, agent, common, tick)
    return since is not None and (tick - since) * run.dt < MIN_GAP and _behind(run, other, agent, tick)


def _on_red(run: Run, agent: int, _other: int, tick: int) -> bool:
    """Return whether `agent` entered on red; a turn to the near side after a full stop does not count."""
    entered = _entered(run, agent, tick)
    if entered is None or run.facing[entered, agent] != Colour.RED or entered == run.spans[agent, 0]:
        return False
    return run.agents[agent].turn is not run.junction.near or not _had_stopped(run, agent, entered)


def _past_the_sign(run: Run, agent: int, _other: int, tick: int) -> bool:
    entered = _entered(run, agent, tick)
    sign = run.junction.starts[run.agents[agent].entrance].sign
    return sign is Sign.STOP and entered is not None and not _had_stopped(run, agent, entered)


def _had_stopped(run: Run, agent: int, entered: int) -> bool:
    """Return whether the agent came to a full stop before it entered, or the run does not record enough to decide."""
    unseen = run.speed is None or run.station is None or entered == run.spans[agent, 0]
    return unseen or bool(stopped(run, agent)[entered - 1])


def _out_of_turn(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` entered when it was the turn of `other`, which waited for no vehicle."""
    entered = _entered(run, agent, tick)
    if run.junction.control is not JunctionControl.STOP or not entered:
        return False
    bystanders = (k for k in range(len(run.agents)) if k not in (agent, other))
    held = any(comes_first(run, other, k)[entered - 1] for k in bystanders)
    return bool(comes_first(run, agent, other)[entered - 1]) and not held


def _took_the_way(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` owed the way to `other` at or after its entry, and went on."""
    entered = _entered(run, agent, tick)
    if entered is None:
        return False
    try:
        return bool(owes(run, agent, other)[max(entered - 1, 0) : tick + 1].any())
    except RunError:
        return False


def _drove_on(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` could still have stopped before the shared stretch after it had noticed `other` there."""
    try:
        common = contested(run, agent, other)
    except RunError:
        return False
    if common is None or run.speed is None or run.station is None:
        return False
    reached = np.flatnonzero(run.station[: tick + 1, other] >= common.yours.start)
    noticed = int(reached[0]) + round(REACTION / run.dt) if len(reached) else tick
    if noticed >= tick or not run.here[noticed, agent]:
        return False
    room = common.mine.start - run.station[noticed, agent]
    return bool(room > max(run.speed[noticed, agent], 0.0) ** 2 / (2 * BRAKING))


def _braked_for_nothing(run: Run, agent: int, tick: int) -> bool:
    """Return whether `agent`, which could have gone on, braked hard within `HEADWAY` before the impact.

    A vehicle that may owe the way brakes for its line in order to look, before any other vehicle is due.
    """
    if run.speed is None:
        return False
    back, until = round(WINDOW / run.dt) or 1, tick - round(IMPACT / run.dt)
    try:
        looks = any(may_owe(run, agent, other) for other in range(len(run.agents)))
        free = may_go(run, agent) & unhindered(run, agent) & ((run.zone[:, agent] >= Zone.JUNCTION) | (not looks))
    except RunError:
        return False
    braking = range(max(until - round(HEADWAY / run.dt), back), until + 1)
    return any(free[now - back] and brakes_hard(run, agent)[now] for now in braking)


def _last(run: Run, agent: int, other: int, tick: int) -> bool:
    entry, other_entry = _entered(run, agent, tick), _entered(run, other, tick)
    return entry is not None and (other_entry is None or entry > other_entry)


def _clear(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether the rights of the agent no longer matter: the two share no stretch, or the agent has left the stretch."""
    try:
        common = contested(run, agent, other)
        return common is None or bool(run.need("station")[tick, agent] - run.size(agent)[0] > common.mine.end)
    except RunError:
        return False


def _merged(run: Run, agent: int, common: Shared, tick: int) -> int | None:
    """Return the tick at which the agent came into the lane in which both ways end; None before the agent's arrival."""
    if not common.merges or run.station is None:
        return None
    merged = np.flatnonzero(run.station[: tick + 1, agent] >= common.mine.start)
    return int(merged[0]) if len(merged) else None


def _entered(run: Run, agent: int, tick: int) -> int | None:
    """Return the first tick of the agent in the junction; None if it is after `tick`."""
    entered = int(run.entered[agent])
    return entered if entered <= tick and entered < run.steps else None


_RIGHTS: tuple[tuple[_Asks, str], ...] = (
    (_on_red, "had entered on red"),
    (_past_the_sign, "had not stopped at the stop sign"),
    (_took_the_way, "took the way that it owed to {}"),
    (_out_of_turn, "had entered out of turn"),
)
"""Questions about the right of way, with reasons: the first question answered with yes for exactly one vehicle decides."""
_HANDLING: tuple[tuple[_Asks, str], ...] = (
    (_in_the_wrong_lane, "was outside its lane"),
    (_into_standing, "drove into {}, which stood"),
    (_backs, "drove backwards"),
    (_from_behind, "ran into {} from behind"),
    (_cuts_in, "cut in ahead of {}"),
    (_last, "entered the junction after {}"),
)
"""Questions about driving, with reasons, for vehicles that the rights do not distinguish; the first decisive question counts."""
