"""What road users are held to beyond the paper's predicates: stopping before the line, the limit of speed.

Every function takes a run and the column of an agent and returns one value per state, shape ``(steps,)``. What a run
does not record makes them raise, so that nothing is guessed. The numbers are parameters of the road rulebook.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.presence import window
from pytest_rvads.errors import RunError
from pytest_rvads.maps.control import Sign
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = [
    "LINE_TOLERANCE",
    "SIGN_ZONE",
    "SPEED_TOLERANCE",
    "STANDSTILL",
    "TIE",
    "drives",
    "leads",
    "speeding",
    "standing_time",
    "stopped",
    "stops",
]

TIE = 0.5
"""Who arrives within this time of each other arrives at about the same time [s]; statutes give no number."""
STANDSTILL = 0.1
"""A vehicle at most this fast, forwards or backwards, stands still [m/s]; wheel-speed sensors resolve about as much."""
LINE_TOLERANCE = 0.1
"""How far over the stopping line a bumper may stand and still have stopped before it [m]."""
SIGN_ZONE = 5.0
"""A full stop counts from so far before a stop sign on [m]: about a car length; statutes ask for one before the line, the
crosswalk or the junction, and give no distance."""
SPEED_TOLERANCE = 0.5
"""How much faster than the limit is still within what a speed control holds [m/s]."""


def stopped(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent is where a full stop counts, see `stops`, and has stood still there in the present approach."""
    here, still = stops(run, agent, np.logical_or.accumulate(run.here[:, agent] & ~_stands(run, agent)))
    tick = np.arange(run.steps)
    last_still = np.maximum.accumulate(np.where(still, tick, -1))
    last_away = np.maximum.accumulate(np.where(here, -1, tick))
    found: NDArray[np.bool_] = here & (last_still > last_away)
    return found


def stops(run: Run, agent: int, driven: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where the agent is before the junction and a full stop counts, and where it makes one, each of shape ``(steps,)``.

    At a stop sign that is from `SIGN_ZONE` before the sign on, elsewhere from the entrance zone on, up to the entrance vertex. It
    stops where it stands still with its front not beyond the stopping line, and first in its lane: who queues stops again. Who
    begins the run at rest before the entrance zone has not stopped there.

    Args:
        run: the run.
        agent: its column.
        driven: whether it has driven by then, likewise.
    """
    entrance = run.junction.entrances[run.agents[agent].entrance]
    station, zone = run.need("station")[:, agent], run.zone[:, agent]
    here = zone == Zone.ENTRANCE
    if entrance.sign is Sign.STOP:
        sign = max(entrance.setback, entrance.sign_setback or 0.0)
        here = (zone <= Zone.ENTRANCE) & (station >= -sign - SIGN_ZONE)
    still: NDArray[np.bool_] = here & _stands(run, agent) & (driven | (zone == Zone.ENTRANCE))
    return here, still & (station <= LINE_TOLERANCE - entrance.setback) & leads(run, agent)


def leads(run: Run, agent: int) -> NDArray[np.bool_]:
    """Nobody is ahead of the agent in its lane before the junction."""
    found = np.ones(run.steps, dtype=np.bool_)
    for other, who in enumerate(run.agents):
        begin, end = window(run, (agent, other))
        if other != agent and who.entrance == run.agents[agent].entrance and begin < end:
            station, when = run.need("station"), slice(begin, end)
            found[when] &= ~((run.zone[when, other] <= Zone.ENTRANCE) & (station[when, other] > station[when, agent]))
    return found


def standing_time(run: Run, agent: int) -> NDArray[np.int32]:
    """Return for how many steps the agent has been standing at its entrance, shape ``(steps,)``.

    This is the waiting time as the text of the paper has it, "since its speed became zero"; it restarts when the vehicle moves.
    """
    tick = np.arange(run.steps, dtype=np.int32)
    still = (run.zone[:, agent] == Zone.ENTRANCE) & _stands(run, agent)
    found: NDArray[np.int32] = tick - np.maximum.accumulate(np.where(still, 0, tick))
    return found


def drives(run: Run, agent: int) -> bool:
    """Return whether the agent moves at all, as far as the run records speeds; one that does not has kept no rule by acting."""
    return run.speed is None or bool((np.abs(run.speed[:, agent]) > STANDSTILL).any())


def speeding(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent drives faster than the limit and the tolerance.

    Raises:
        RunError: the run does not record speeds, or no limit.
    """
    if run.facts.speed_limit is None:
        raise RunError("the run holds no speed limit")
    found: NDArray[np.bool_] = np.abs(run.need("speed")[:, agent]) > run.facts.speed_limit + SPEED_TOLERANCE
    return found


def _stands(run: Run, agent: int) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.abs(run.need("speed")[:, agent]) <= STANDSTILL
    return found
