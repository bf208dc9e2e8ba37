"""Key performance indicators of a run: waiting times, braking, and distances between vehicles in time.

The surrogate safety measures are those of the literature: time to collision (Hayward, Near miss determination through use of a
scale of danger, HRB 1972), post-encroachment time (Allen, Shin, Cooper, Analysis of traffic conflicts and collisions, TRR 1978).
An indicator is None if the run does not record the values that the indicator needs; `Kpis.unavailable` names such indicators.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import combinations

import numpy as np

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import tick_of, ticks
from pytest_rvads.logic.conduct.bodies import contacts, velocity
from pytest_rvads.logic.conduct.standing import arrived, limits_of
from pytest_rvads.logic.conduct.static_model import judged
from pytest_rvads.logic.conduct.stretches import shared
from pytest_rvads.runs.measured import APART, ArrivalDifferences, Kpis, PairKpis, VehicleKpis
from pytest_rvads.runs.run import Run, once
from pytest_rvads.runs.states import Zone
from pytest_rvads.support.errors import RunError, require

WINDOW = 0.1
"""Length of the windows over which accelerations and jerks are averaged [s]: ten steps, so that no single step dominates."""
_DISCS = 3
"""Number of discs that cover a body for the time to collision."""


def kpis(run: Run) -> Kpis:
    """Compute the key performance indicators of a run; an indicator is listed as unavailable if the run lacks its inputs.

    An excerpt (a part of a recording) has the indicators of the vehicles that are judged in the excerpt. The excerpt has the
    indicators of a pair if the later of the two vehicles to appear is judged in the excerpt. Therefore no indicator appears in
    two excerpts of a recording.

    Args:
        run: the run; a recorded run may lack positions, speeds or sizes.

    Returns:
        The indicators, times in s and lengths in m.
    """
    require(run, Run, "kpis takes a run, such as rvads.simulate(case) returns", RunError)
    sized = all(agent.size for agent in run.agents)
    recorded = {
        "delay": run.station is not None and run.facts.speed_limit is not None,
        "deceleration": run.speed is not None,
        "jerk": run.speed is not None,
        "ttc": run.pose is not None and run.speed is not None and sized,
        "pet": run.station is not None and run.junction.drivable and sized,
    }
    missing = tuple(name for name, available in recorded.items() if not available)
    columns, judged_columns = range(len(run.agents)), judged(run)

    def measure(name: str, function: Callable[..., float | None], *where: int) -> float | None:
        return None if name in missing else function(run, *where)

    vehicles = tuple(
        VehicleKpis(
            run.agents[i].name,
            _arrival(run, i),
            _rounded(float((run.zone[:, i] == Zone.ENTRANCE).sum()) * run.dt),
            measure("delay", _delay, i),
            *((None, None) if run.speed is None else _braking(run, i)),
        )
        for i in columns
        if judged_columns is None or i in judged_columns
    )
    pairs = tuple(
        PairKpis((run.agents[i].name, run.agents[k].name), measure("ttc", _ttc, i, k), measure("pet", _pet, i, k))
        for i, k in combinations(columns, 2)
        if judged_columns is None or k in judged_columns
    )
    ttc, pet = (
        min((time for time in times if time is not None), default=None)
        for times in ([pair.ttc for pair in pairs], [pair.pet for pair in pairs])
    )
    return Kpis(vehicles, pairs, missing, ttc, pet)


def arrival_differences(run: Run) -> ArrivalDifferences | None:
    """Measure how much later or earlier than a vehicle under test each other vehicle arrived at its stopping line.

    In a run without a subject every vehicle is under test, and two vehicles give two differences. A difference is measured for
    two vehicles whose movements conflict and that arrived at most `APART` after each other. The result is None if the conflicts
    of the junction are not known, because its centre lines are not recorded.
    """
    if run.junction.conflicts is None:
        return None
    conflicts, symmetry, pairs = _conflicting_movements(run.junction)
    judged_columns = judged(run)
    arrivals = [_arrival(run, column) for column in range(len(run.agents))]
    times = np.array([math.nan if time is None else time for time in arrivals])
    tried: list[tuple[int, int, float]] = []
    for own, agent in enumerate(run.agents):
        if run.subject not in (None, agent.name):
            continue
        for other in np.flatnonzero(np.abs(times - times[own]) <= APART).tolist():
            conflict = (agent.way.key, run.agents[other].way.key) in conflicts
            if conflict and (judged_columns is None or max(own, other) in judged_columns):
                tried.append((own, other, round(float(times[other] - times[own]), 2)))
    return ArrivalDifferences(symmetry, pairs, tuple(tried))


@lru_cache(maxsize=256)
def _conflicting_movements(junction: Junction) -> tuple[frozenset[tuple[Key, Key]], int, int]:
    """Return the pairs of conflicting movements in both orders, and ``symmetry`` and ``pairs`` of `ArrivalDifferences`."""
    conflicts = frozenset(pair for pair in junction.conflicts or () if junction.movements.keys() >= {*pair})
    images = [image for arms in junction.rotations if (image := junction.image(arms))]
    kinds = {min(tuple((entrances[way[0]], exits[way[1]]) for way in pair) for entrances, exits in images) for pair in conflicts}
    return conflicts, junction.ways // len(images), len(kinds)


_NAMES = {
    "waiting": ("waiting", "s"),
    "delay": ("delay", "s"),
    "deceleration": ("braking", "m/s^2"),
    "jerk": ("jerk", "m/s^3"),
    "ttc": ("time to collision", "s"),
    "pet": ("post-encroachment time", "s"),
}


def describe(indicators: Kpis) -> list[str]:
    """Return key performance indicators as text: a line per available indicator, and a last line that names unavailable ones."""
    record = indicators.record()
    lines = []
    for key, (name, unit) in _NAMES.items():
        entries = [e for e in (*record["vehicles"], *record["pairs"]) if e.get(key) is not None]
        shown = (f"{e.get('agent') or ' '.join(e['agents'])} {e[key]:.2f}" for e in entries)
        if entries:
            lines.append(f"{name} [{unit}]  {', '.join(shown)}")
    if indicators.unavailable:
        lines.append(f"not recorded: {', '.join(_NAMES[key][0] for key in indicators.unavailable)}")
    return lines


def _braking(run: Run, column: int) -> tuple[float | None, float | None]:
    """Return a vehicle's hardest deceleration [m/s^2] and jerk [m/s^3] up to its first contact, averaged over `WINDOW`."""
    step, name = max(ticks(run, WINDOW), 1), run.agents[column].name
    try:
        end = min((tick_of(run, contact) for contact in once(run, contacts) if name in contact.agents), default=run.steps)
    except RunError:  # no positions or no sizes: contacts are unknown
        end = run.steps
    driven = run.need("speed")[:end, column][run.here[:end, column]]
    acceleration = (driven[step:] - driven[:-step]) / (step * run.dt)
    change = np.abs(acceleration[step:] - acceleration[:-step])
    deceleration = _rounded(max(0.0, -float(acceleration.min()))) if len(acceleration) else None
    return deceleration, _rounded(float(change.max()) / (step * run.dt)) if len(change) else None


def _arrival(run: Run, column: int) -> float | None:
    at_line = np.flatnonzero(arrived(run)[:, column])
    return _rounded(float(at_line[0]) * run.dt) if len(at_line) else None


def _delay(run: Run, column: int) -> float | None:
    exits = np.flatnonzero(run.zone[:, column] >= Zone.EXIT)
    if run.facts.speed_limit is None or not len(exits):
        return None
    begin, way = int(run.spans[column, 0]), run.agents[column].way
    limits, start = limits_of(run.junction, way.key, run.facts), float(run.need("station")[begin, column])
    starts = [start, *(max(station, start) for station, _ in limits[1:])]
    ends = (min(station, way.length) for station in (*starts[1:], way.length))
    fastest = math.fsum((b - min(a, b)) / limit for a, b, (_, limit) in zip(starts, ends, limits, strict=True))
    return _rounded(float(exits[0] - begin) * run.dt - fastest)


def _ttc(run: Run, agent: int, other: int) -> float | None:
    """Return the shortest time to collision of two vehicles at constant velocity, with bodies covered by discs [s]."""
    present = run.here[:, agent] & run.here[:, other]
    sizes = run.size(agent), run.size(other)
    reach = math.fsum(float(np.hypot(length / _DISCS / 2, width / 2)) for length, width in sizes)
    discs = []  # the centres of the discs that cover each body, shape (steps, discs, 2) [m]
    for column, (length, _) in zip((agent, other), sizes, strict=True):
        pose = run.need("pose")[:, column]
        back = -(np.arange(_DISCS) + 0.5) / _DISCS * length
        ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
        discs.append((pose[:, None, :2] + back[None, :, None] * ahead[:, None, :])[present])
    gap = discs[1][:, None, :, :] - discs[0][:, :, None, :]
    closing = (velocity(run, other) - velocity(run, agent))[present][:, None, None, :]
    # The earliest time t >= 0 that solves |gap + t closing| = reach.
    a = (closing**2).sum(axis=-1)
    b = (gap * closing).sum(axis=-1)
    c = (gap**2).sum(axis=-1) - reach**2
    root = b**2 - a * c
    meets = (root >= 0) & (b < 0) & (a > 1e-12)
    time = np.where(meets, (-b - np.sqrt(np.maximum(root, 0.0))) / np.where(a > 1e-12, a, 1.0), np.inf)
    time = np.where(c <= 0, 0.0, time)
    shortest = float(time.min()) if time.size else np.inf
    return _rounded(shortest) if np.isfinite(shortest) else None


def _pet(run: Run, agent: int, other: int) -> float | None:
    common = shared(run, agent, other)
    if common is None:
        return None
    spans = []
    for column, (start, end) in zip((agent, other), (common.mine, common.yours), strict=True):
        station = run.need("station")[:, column]
        inside = np.flatnonzero(station >= start)
        outside = np.flatnonzero(station - run.size(column)[0] > end)
        if not len(inside):
            return None
        spans.append((int(inside[0]), int(outside[0]) if len(outside) else int(run.spans[column, 1])))
    (_, departure), (entry, _) = sorted(spans)
    return _rounded((entry - departure) * run.dt)


def _rounded(value: float) -> float:
    """Return a number as a float, rounded to remove the rounding errors of sums of steps."""
    return round(float(value), 6)
