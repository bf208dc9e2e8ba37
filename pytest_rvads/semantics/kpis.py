"""Key performance indicators of a run: how long vehicles wait, how hard they brake, how near they come to each other.

Surrogate safety measures as in the literature: time to collision (Hayward, Near miss determination through use of a scale
of danger, HRB 1972), post-encroachment time (Allen, Shin, Cooper, Analysis of traffic conflicts and collisions, TRR 1978).
What a run does not record is None.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.semantics.conduct import SPEED_LIMIT, stretches, vehicle_size
from pytest_rvads.semantics.predicates import ticks
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Zone

__all__ = ["WINDOW", "Kpis", "PairKpis", "VehicleKpis", "kpis"]

WINDOW = 0.1
"""Accelerations and jerks are differences over this time [s]: ten steps, so that single steps don't dominate."""
_DISCS = 3
"""A body is covered by this many discs for the time to collision."""


@dataclass(frozen=True, slots=True)
class VehicleKpis:
    """Indicators of one vehicle."""

    agent: str
    waiting: float
    """Time at its entrance [s]."""
    delay: float | None
    """Time to its exit vertex beyond what driving there at the speed limit takes [s]; None if it never got there."""
    deceleration: float | None
    """Hardest braking, over `WINDOW` [m/s^2]."""
    jerk: float | None
    """Largest change of acceleration, over `WINDOW` [m/s^3]."""


@dataclass(frozen=True, slots=True)
class PairKpis:
    """Indicators of two vehicles."""

    agents: tuple[str, str]
    ttc: float | None
    """Shortest time to collision, were both to keep speed and heading [s]; 0 where bodies touch; None if they never are
    on a collision course."""
    pet: float | None
    """Time from when the rear of one leaves the stretch where their movements conflict to when the other enters it [s];
    negative where both are in it; None if they don't conflict or one of them never came there."""


@dataclass(frozen=True, slots=True)
class Kpis:
    """Indicators of a run."""

    vehicles: tuple[VehicleKpis, ...]
    pairs: tuple[PairKpis, ...]

    @property
    def ttc(self) -> float | None:
        """The shortest time to collision of all pairs [s]."""
        return min((p.ttc for p in self.pairs if p.ttc is not None), default=None)

    @property
    def pet(self) -> float | None:
        """The shortest post-encroachment time of all pairs [s]."""
        return min((p.pet for p in self.pairs if p.pet is not None), default=None)

    def record(self) -> dict[str, Any]:
        """Return builtins."""
        pairs = [{**asdict(p), "agents": list(p.agents)} for p in self.pairs]
        return {"vehicles": [asdict(v) for v in self.vehicles], "pairs": pairs, "ttc": self.ttc, "pet": self.pet}


def kpis(run: Run) -> Kpis:
    """Compute the indicators of a run."""
    columns = range(len(run.agents))
    pairs = tuple(
        PairKpis((run.agents[i].name, run.agents[k].name), _ttc(run, i, k), _pet(run, i, k)) for i, k in combinations(columns, 2)
    )
    return Kpis(tuple(_vehicle(run, i) for i in columns), pairs)


def _vehicle(run: Run, column: int) -> VehicleKpis:
    waiting = float((run.zone[:, column] == Zone.ENTRANCE).sum()) * run.dt
    deceleration = jerk = None
    step = max(ticks(run, WINDOW), 1)
    if run.speed is not None and run.steps > 2 * step:
        driven = run.speed[run.zone[:, column] != Zone.GONE, column]
        acceleration = (driven[step:] - driven[:-step]) / (step * run.dt)
        if len(acceleration) > step:
            deceleration = _rounded(max(0.0, -float(acceleration.min())))
            jerk = _rounded(float(np.abs(acceleration[step:] - acceleration[:-step]).max()) / (step * run.dt))
    return VehicleKpis(run.agents[column].name, _rounded(waiting), _delay(run, column), deceleration, jerk)


def _delay(run: Run, column: int) -> float | None:
    left = np.flatnonzero(run.zone[:, column] >= Zone.EXIT)
    if run.station is None or not len(left):
        return None
    agent = run.agents[column]
    limit = float(run.meta.get("speed_limit", SPEED_LIMIT))
    way = run.junction.movements[agent.entrance, agent.exit].length - float(run.station[0, column])
    return _rounded(float(left[0]) * run.dt - way / limit)


def _ttc(run: Run, one: int, two: int) -> float | None:
    """Return the shortest time until discs that cover the two bodies touch, at constant velocity."""
    if run.pose is None or run.speed is None:
        return None
    both = (run.zone[:, one] != Zone.GONE) & (run.zone[:, two] != Zone.GONE)
    length, width = vehicle_size(run)
    reach = 2 * float(np.hypot(length / _DISCS / 2, width / 2))
    first, second = _discs(run, one, length)[both], _discs(run, two, length)[both]
    gap = second[:, None, :, :] - first[:, :, None, :]
    closing = (_velocity(run, two) - _velocity(run, one))[both][:, None, None, :]
    # |gap + t closing| = reach, solved for the first t >= 0
    a = (closing**2).sum(axis=-1)
    b = (gap * closing).sum(axis=-1)
    c = (gap**2).sum(axis=-1) - reach**2
    root = b**2 - a * c
    meets = (root >= 0) & (b < 0) & (a > 1e-12)
    time = np.where(meets, (-b - np.sqrt(np.maximum(root, 0.0))) / np.where(a > 1e-12, a, 1.0), np.inf)
    time = np.where(c <= 0, 0.0, time)
    shortest = float(time.min()) if time.size else np.inf
    return _rounded(shortest) if np.isfinite(shortest) else None


def _discs(run: Run, column: int, length: float) -> NDArray[np.float64]:
    """Return the centres of the discs of a body, shape ``(steps, discs, 2)`` [m]."""
    if run.pose is None:  # excluded by the caller; tells the type checker
        return np.empty((0, _DISCS, 2))
    pose = run.pose[:, column]
    back = -(np.arange(_DISCS) + 0.5) / _DISCS * length
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    found: NDArray[np.float64] = pose[:, None, :2] + back[None, :, None] * ahead[:, None, :]
    return found


def _velocity(run: Run, column: int) -> NDArray[np.float64]:
    """Return the velocity of an agent, shape ``(steps, 2)`` [m/s]."""
    if run.pose is None or run.speed is None:  # excluded by the caller; tells the type checker
        return np.empty((0, 2))
    heading = run.pose[:, column, 2]
    found: NDArray[np.float64] = run.speed[:, column, None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    return found


def _pet(run: Run, one: int, two: int) -> float | None:
    where = stretches(run.junction)
    if where is None or run.station is None:
        return None
    first, second = run.agents[one], run.agents[two]
    shared = where.get(((first.entrance, first.exit), (second.entrance, second.exit)))
    if shared is None:
        return None
    length, _ = vehicle_size(run)
    spans = []
    for column, (start, end) in zip((one, two), shared, strict=True):
        station = run.station[:, column]
        inside = np.flatnonzero(station >= start)
        outside = np.flatnonzero(station - length > end)
        if not len(inside):
            return None
        spans.append((int(inside[0]), int(outside[0]) if len(outside) else None))
    (_, left), (entered, _) = sorted(spans, key=lambda s: s[0])
    return None if left is None else _rounded((entered - left) * run.dt)


def _rounded(value: float) -> float:
    """Return a plain float without the noise of sums of steps."""
    return round(float(value), 6)
