"""Decides which vehicle is to blame for a collision, or for a meeting of two vehicles on a stretch that their ways share.

The right of way decides first. A vehicle lacked the right of way if the vehicle entered on red or without a stop at a stop sign
(Vienna Convention on Road Traffic 1968, Art. 5), entered out of turn, or took a way that it owed to the other vehicle (Art. 16(2)
and 18). This vehicle is to blame as long as its rear has not left the shared stretch. The other vehicle shares the blame if it
could have stopped before the stretch, and did not (Art. 13(1)).

If the right of way does not decide between the two vehicles, their driving decides. The first of these statements that is true of
exactly one of the two vehicles names the vehicle to blame. The vehicle was in the wrong lane (Art. 10(3)). The vehicle drove into
a standing or preceding vehicle that had not cut in (Art. 13). The vehicle drove backwards (California Vehicle Code 22106). The
vehicle cut in. The vehicle entered the junction last (California Vehicle Code 21800(a)). A vehicle that braked hard without a
reason shares the blame with the vehicle that ran into it (StVO, section 4(1)). Insurers apply the same order.

A vehicle that meets a pedestrian on a crosswalk is to blame if it entered on red, or drove over the crosswalk without a stop at
its stop sign, or could have stopped since the pedestrian came, or came faster than a moderate speed to a kerb that a standing
vehicle hid (StVO, section 26(1); California Vehicle Code 21950(c)). In all other cases the pedestrian is to blame: it suddenly
left the kerb (California Vehicle Code 21950(b)), or walked into a standing vehicle. A pedestrian who stepped onto the crosswalk
against its light is to blame in any case.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.crosswalks import MODERATE, Crossing, hides
from pytest_rvads.logic.conduct.blocks import Cast, tick_of
from pytest_rvads.logic.conduct.lane import off_lane
from pytest_rvads.logic.conduct.priority import HEADWAY, MIN_GAP, WINDOW, brakes_hard, owes, unhindered
from pytest_rvads.logic.conduct.rights import comes_first, may_owe
from pytest_rvads.logic.conduct.standing import NEVER, STANDSTILL, entered, facing, stands, stopped
from pytest_rvads.logic.conduct.stretches import CrosswalkPlaces, claims, contested, places_of, shared, walkers
from pytest_rvads.logic.conduct.waiting import idles, may_go, waits_to_cross
from pytest_rvads.runs.run import Collision, Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.support.errors import RunError


@dataclass(frozen=True, slots=True)
class Cause:
    """The vehicles to blame for a collision or meeting, and the reason."""

    agents: tuple[str, ...]
    """The name of the vehicle to blame, or both names if both vehicles share the blame."""
    reason: str
    """What the vehicle did, as a phrase that follows the name of the vehicle: ``"had entered on red"``."""


STOOD = 0.5
"""Least time that a vehicle stands still before an impact to count as a standing vehicle [s]."""
REACTION = 1.0
"""Time that a driver needs to notice another vehicle and to begin to react [s]; the usual figure of accident analysis."""
BRAKING = 3.4
"""Deceleration that every vehicle can reach [m/s^2] (AASHTO, A Policy on Geometric Design: stopping sight distance)."""
IMPACT = 0.1
"""Time before an impact at which the speeds of the vehicles are read [s], because the impact changes the speeds."""
ALONG = math.pi / 4
"""Difference of headings below which two vehicles drive in the same direction, one behind the other [rad]."""


def cause_of(run: Run, collision: Collision) -> Cause:
    """Return the cause of a collision in a run: the vehicles to blame, and the reason."""
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    first, second = (columns[name] for name in collision.agents)
    return blame(run, first, second, tick_of(run, collision))


def blame(run: Run, agent: int, opponent: int, tick: int) -> Cause:
    """Return the cause (the vehicles to blame, the reason) of a meeting or collision of two agents, given by column, at `tick`.

    A criterion that needs values that the run does not record blames no vehicle.
    """
    for vehicle, walker in ((agent, opponent), (opponent, agent)):
        if (places := _crossed(run, vehicle, walker)) is not None:
            return _of_walker(run, vehicle, walker, tick, places.near[0], claims(run, vehicle, walker))
    pairs = (agent, opponent), (opponent, agent)
    # The right of way does not matter any more for an agent that shares no stretch with the other or has left the stretch.
    matters = []
    for pair in pairs:
        try:
            common = contested(run, *pair)
            clear = common is None or run.need("station")[tick, pair[0]] - run.size(pair[0])[0] > common.mine.end
        except RunError:
            clear = False
        if not clear:
            matters.append(pair)
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


def disregard(run: Run, vehicle: int, walker: int, tick: int) -> Cause | None:
    """Return the cause of taking a crosswalk at `tick` that the vehicle (a column) owes to a pedestrian who walks on it."""
    places = _crossed(run, vehicle, walker)
    return places and _of_walker(run, vehicle, walker, tick, places.begin[0], claims(run, vehicle, walker))


def disregard_at_kerb(run: Run, vehicle: int, walker: int, tick: int) -> Cause | None:
    """Return the cause as `disregard`, if the vehicle also owes the crosswalk to a pedestrian who waits at the kerb."""
    places, comes = _crossed(run, vehicle, walker), claims(run, vehicle, walker) | waits_to_cross(run, vehicle, walker)
    return places and _of_walker(run, vehicle, walker, tick, places.begin[0], comes)


def _crossed(run: Run, vehicle: int, walker: int) -> CrosswalkPlaces | None:
    """Return where a vehicle meets a pedestrian whose crossing it drives over; None for two other agents."""
    cast = Cast(run.junction, [run.agents[vehicle], run.agents[walker]], run.facts)
    return cast.static(places_of) if cast.crossing.any() and (0, 1) in cast.static(walkers).column else None


def _of_walker(run: Run, vehicle: int, walker: int, tick: int, place: float, comes: NDArray[np.bool_]) -> Cause:
    """Return the cause of a meeting of a vehicle and a pedestrian on a crosswalk, both given by column, at `tick`.

    The vehicle has to stop before the station `place` [m] while the pedestrian `comes`, shape ``(steps,)``.
    """
    driver, person = run.agents[vehicle].name, run.agents[walker].name
    starts = run.junction.starts
    own_arm = starts[run.agents[vehicle].entrance].arm == starts[run.agents[walker].entrance].arm
    # A stop at the sign would have let the vehicle see a pedestrian there, and none on the crosswalk of its exit.
    faults = _RIGHTS[: 2 if own_arm else 1]
    fault = next((reason for asks, reason in faults if asks(run, vehicle, walker, tick)), "")
    if not fault:
        if comes[tick]:
            before = np.flatnonzero(~comes[:tick])
            since = int(before[-1]) + 1 if len(before) else 0
        else:  # on the crosswalk without a claim
            entry = _entry(run, walker, tick)
            since = tick if entry is None else entry
        stood = ((run.need("station")[:, vehicle] < place) & stands(run, vehicle))[since : tick + 1].any()
        noticed = max(since + round(REACTION / run.dt), int(run.spans[vehicle, 0]))  # before, a recorded vehicle can be absent
        if stood or (noticed < tick and _can_stop(run, vehicle, noticed, place)):
            fault = f"drove on though it could have stopped for {person}"
    if not fault and (hiding := _hurried_past(run, vehicle, walker, place, tick)):
        fault = f"drove faster than {MODERATE:g} m/s past {hiding}, which hid {person}"
    if facing(run, walker)[tick] in (Colour.YELLOW, Colour.RED):  # an unrecorded light is no reason
        against = "had stepped onto the crosswalk against its light"
        share = f"share the blame: {person} {against}, and {driver} {fault}"
        return Cause((person, driver), share) if fault else Cause((person,), against)
    if fault:
        return Cause((driver,), fault)
    walked_into = _into_standing(run, walker, vehicle, tick)
    came = f"walked into {driver}, which stood" if walked_into else f"came when {driver} could no longer stop"
    return Cause((person,), came)


def _hurried_past(run: Run, vehicle: int, walker: int, place: float, tick: int) -> str:
    """Return the name of the standing vehicle past which a vehicle hurried to a meeting at `tick` with a hidden pedestrian.

    The vehicle hurried if it was faster than `MODERATE` when the pedestrian came into view, and could no longer stop before the
    station `place` [m] by braking with `BRAKING` after `REACTION`. The result is empty if the vehicle did not hurry.
    """
    if run.pose is None:
        return ""
    third_vehicles = [
        (column, agent.name, agent.size)
        for column, agent in enumerate(run.agents)
        if column not in (vehicle, walker) and agent.size is not None and not isinstance(agent.way, Crossing)
    ]
    # A pedestrian who is not recorded yet is not known to be hidden.
    first = int(run.spans[[vehicle, walker], 0].max())
    for now in range(tick, first - 1, -1):
        if _can_stop(run, vehicle, now, place, REACTION):
            return ""
        eye, target = tuple(run.pose[now, vehicle, :2]), tuple(run.pose[now, walker, :2])
        for column, name, size in third_vehicles if run.need("station")[now, vehicle] < place else ():
            standing = run.here[now, column] and _stood(run, column, now, 0.0)
            if standing and hides(eye, target, tuple(run.pose[now, column]), size):
                return name if run.need("speed")[now, vehicle] > MODERATE else ""
    return ""


def surprised(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `other` lacked the right of way and entered at most `REACTION` before it met `agent` in the junction."""
    entry = _entry(run, other, tick)
    if entry is None or (tick - entry) * run.dt > REACTION:
        return False
    for asks, _ in _RIGHTS:
        guilty = [i for i, whom in ((agent, other), (other, agent)) if asks(run, i, whom, tick)]
        if len(guilty) == 1:
            return guilty[0] == other
    return False


def pushed(run: Run, agent: int, tick: int) -> bool:
    """Return whether, less than `REACTION` before `tick`, `agent` (a column) collided with a vehicle that alone is to blame."""
    name, most = run.agents[agent].name, round(REACTION / run.dt)
    hits = (c for c in run.collisions or () if name in c.agents and 0 <= tick - tick_of(run, c) < most)
    return any(name not in cause_of(run, c).agents for c in hits)


def cut_short_by(run: Run) -> tuple[str, ...]:
    """Return the names of the vehicles that ended the run early: they left their routes, or are to blame for a collision."""
    last = [c for c in run.collisions or () if tick_of(run, c) >= run.steps - 2]
    return tuple(dict.fromkeys((*run.facts.strayed, *(name for c in last for name in cause_of(run, c).agents))))


def stuck(run: Run, agent: int) -> bool:
    """Return whether the vehicle in column `agent` is stuck in the way of all other vehicles at the end of the run.

    A stuck vehicle stands in the junction, or stands at its entrance although it can go now or has long been able to go.
    """
    where = run.zone[-1, agent]
    if where == Zone.ENTRANCE and isinstance(run.agents[agent].way, Crossing):  # at the kerb, in nobody's way
        return False
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
    """Return whether `agent` was outside its lane and therefore met `other`: the ways of the two vehicles share no stretch."""
    try:
        me, you = run.agents[agent], run.agents[other]
        if shared(run, agent, other) is not None or me.entrance == you.entrance or me.exit == you.exit:
            return False
        return bool(off_lane(run, agent)[tick])
    except RunError:
        return False


def _backs(run: Run, agent: int, _other: int, tick: int) -> bool:
    before = max(tick - round(IMPACT / run.dt), 0)
    return run.speed is not None and bool(run.speed[before, agent] < -STANDSTILL)


def _from_behind(run: Run, agent: int, other: int, tick: int) -> bool:
    return _behind(run, agent, other, tick) and not _cuts_in(run, other, agent, tick)


def _behind(run: Run, agent: int, other: int, tick: int) -> bool:
    if run.pose is None:
        return False
    (x, y, heading), (far_x, far_y, ahead) = run.pose[tick, agent], run.pose[tick, other]
    apart = abs((ahead - heading + math.pi) % (2 * math.pi) - math.pi)
    return bool(apart < ALONG and (far_x - x) * math.cos(ahead) + (far_y - y) * math.sin(ahead) > 0)


def _cuts_in(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` merged ahead of `other` less than `MIN_GAP` before `tick`, so that `other` could not make room."""
    try:
        common = shared(run, agent, other)
    except RunError:
        return False
    if common is None or not common.merges or run.station is None:
        return False
    merged = np.flatnonzero(run.station[: tick + 1, agent] >= common.mine.start)
    return len(merged) > 0 and (tick - int(merged[0])) * run.dt < MIN_GAP and _behind(run, other, agent, tick)


def _on_red(run: Run, agent: int, _other: int, tick: int) -> bool:
    """Return whether `agent` entered the junction on red.

    A turn to the near side (right, where traffic keeps right) after a full stop does not count, unless a sign forbids this turn.
    """
    entry = _entry(run, agent, tick)
    if entry is None or facing(run, agent)[entry] != Colour.RED or entry == run.spans[agent, 0]:
        return False
    who = run.agents[agent]
    return not run.junction.turns_on_red(who.entrance, who.turn) or not _had_stopped(run, agent, entry)


def _past_the_sign(run: Run, agent: int, _other: int, tick: int) -> bool:
    entry = _entry(run, agent, tick)
    sign = run.junction.starts[run.agents[agent].entrance].sign
    return sign is Sign.STOP and entry is not None and not _had_stopped(run, agent, entry)


def _had_stopped(run: Run, agent: int, entry: int) -> bool:
    """Return whether an agent stopped fully before it entered the junction; True if the run does not record enough to decide."""
    unseen = run.speed is None or run.station is None or entry == run.spans[agent, 0]
    return unseen or bool(stopped(run, agent)[entry - 1])


def _out_of_turn(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` entered an all-way stop when it was the turn of `other`, and `other` waited for no third vehicle."""
    entry = _entry(run, agent, tick)
    if run.junction.control is not JunctionControl.STOP or not entry:
        return False
    bystanders = (k for k in range(len(run.agents)) if k not in (agent, other))
    held = any(comes_first(run, other, k)[entry - 1] for k in bystanders)
    return bool(comes_first(run, agent, other)[entry - 1]) and not held


def _took_the_way(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` entered the junction, or drove on in the junction, while it had to give way to `other`."""
    entry = _entry(run, agent, tick)
    if entry is None:
        return False
    try:
        return bool(owes(run, agent, other)[max(entry - 1, 0) : tick + 1].any())
    except RunError:
        return False


def _drove_on(run: Run, agent: int, other: int, tick: int) -> bool:
    """Return whether `agent` could have stopped before the shared stretch when it noticed `other` on it, and did not stop."""
    try:
        common = contested(run, agent, other)
    except RunError:
        return False
    if common is None or run.speed is None or run.station is None:
        return False
    reached = np.flatnonzero(run.station[: tick + 1, other] >= common.yours.start)
    noticed = int(reached[0]) + round(REACTION / run.dt) if len(reached) else tick
    return noticed < tick and bool(run.here[noticed, agent]) and _can_stop(run, agent, noticed, common.mine.start)


def _can_stop(run: Run, agent: int, tick: int, place: float, delay: float = 0.0) -> bool:
    """Return whether an agent can stop before the station `place` [m] by braking with `BRAKING`, `delay` [s] after `tick`."""
    speed = max(run.need("speed")[tick, agent], 0.0)
    return bool(place - run.need("station")[tick, agent] > speed * delay + speed**2 / (2 * BRAKING))


def _braked_for_nothing(run: Run, agent: int, tick: int) -> bool:
    """Return whether `agent` braked hard within `HEADWAY` before the impact although it could have gone on.

    Braking before the line does not count for a vehicle that may have to give way there: its driver brakes in order to look.
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
    entry, other_entry = _entry(run, agent, tick), _entry(run, other, tick)
    return entry is not None and (other_entry is None or entry > other_entry)


def _entry(run: Run, agent: int, tick: int) -> int | None:
    """Return the first tick of the agent in the junction; None if the agent enters after `tick` or never."""
    entry = int(entered(run, agent)[: tick + 1].min(initial=NEVER))
    return None if entry == NEVER else entry


_RIGHTS: tuple[tuple[_Asks, str], ...] = (
    (_on_red, "had entered on red"),
    (_past_the_sign, "had not stopped at the stop sign"),
    (_took_the_way, "took the way that it owed to {}"),
    (_out_of_turn, "had entered out of turn"),
)
"""Criteria of the right of way, with the reasons that reports show; the first criterion that only one vehicle meets decides."""
_HANDLING: tuple[tuple[_Asks, str], ...] = (
    (_in_the_wrong_lane, "was outside its lane"),
    (_into_standing, "drove into {}, which stood"),
    (_backs, "drove backwards"),
    (_from_behind, "ran into {} from behind"),
    (_cuts_in, "cut in ahead of {}"),
    (_last, "entered the junction after {}"),
)
"""Criteria of driving, with the reasons that reports show, used in the same way if no criterion of `_RIGHTS` decides."""
