"""An earlier run of the same scenario, to be drawn faintly below another one: outlines, and where the two part."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.draw.scene import inks, placed, size
from pytest_rvads.runs.divergence import diverge
from pytest_rvads.runs.run import Run

__all__ = ["ghost_data", "motion", "outlines"]

_SEEN = 0.1
"""How far a vehicle has to be from where it was in the earlier run for the picture to show it [m]."""


def outlines(ghost: Run | None) -> str:
    """Return the outlines of the vehicles of an earlier run, nothing where it holds no positions."""
    if ghost is None or not _drawn(ghost):
        return ""
    parts = []
    for column, colour in enumerate(inks(ghost.agents)):
        length, width = size(ghost, column)
        parts.append(
            f'<g class="ghost" stroke="{colour}" transform="{placed(_first(ghost, column))}">'
            f'<rect x="{-length:g}" y="{-width / 2:g}" width="{length:g}" height="{width:g}" rx="0.4"/>'
            f'<path d="M-1.3 {-width / 2 + 0.25:g}L-0.3 0L-1.3 {width / 2 - 0.25:g}"/></g>'
        )
    return "".join(parts)


def ghost_data(run: Run, ghost: Run | None, name: str, every: int) -> dict[str, Any] | None:
    """Return what the page needs of an earlier run, None without one.

    Args:
        run: that the page is about.
        ghost: the earlier one.
        name: what that is called.
        every: positions are stored every so many states.
    """
    if ghost is None:
        return None
    drawn = _drawn(ghost)
    name = name or "the earlier run"
    said, times = _parted(run, ghost, name)
    return {
        "name": name,
        "agents": [agent.name for agent in ghost.agents],
        "said": said if drawn else f"{said} Positions of {name} are not recorded, so it is not shown.",
        "times": times,
        "start": ghost.start,
        "dt": ghost.dt,
        "every": every,
        "motion": motion(ghost, every, ghost.here, "pose") if drawn else [],
    }


def motion(run: Run, every: int, there: NDArray[np.bool_], *names: str) -> list[list[list[float] | None]]:
    """Return some states of every vehicle, headings unwound, every so many of them; None where it is not there."""
    series = [run.need(name) for name in names]
    together = np.concatenate([values if values.ndim == 3 else values[..., None] for values in series], axis=2)
    for column, (begin, end) in enumerate(run.spans.tolist()):
        together[begin:end, column, 2] = np.unwrap(together[begin:end, column, 2])
    # Who is gone may have no place.
    stored: list[list[list[float] | None]] = np.nan_to_num(together[::every].round(3)).tolist()
    for row, column in np.argwhere(~there[::every]).tolist():
        stored[row][column] = None
    return stored


def _drawn(ghost: Run) -> bool:
    return ghost.pose is not None and ghost.steps > 0


def _first(ghost: Run, column: int) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.nan_to_num(ghost.need("pose")[ghost.spans[column, 0], column])
    return found


def _parted(run: Run, ghost: Run, name: str) -> tuple[str, list[tuple[float, str]]]:
    """Return in words where two runs part, and the times [s] to go to with what is to be seen then."""
    found = diverge(run, ghost)
    if found is None:
        return f"This run and {name} are the same, state for state.", []
    times: list[tuple[float, str]] = []
    said = f"This run and {name} differ in {found.what}: {found.one} here, {found.other} there."
    if found.time is not None:
        at = found.time + run.start
        one, other = _short(found.one, found.other)
        said = f"This run and {name} part at t = {at:.2f} s: {found.what} is {one} here, {other} there."
        times.append((at, f"where they part: {at:.2f} s"))
    seen = _seen_apart(run, ghost)
    if seen is not None:
        times.append((seen, f"{_SEEN:g} m apart: {seen:.2f} s"))
    return said, times


def _short(one: str, other: str) -> tuple[str, str]:
    """Return two numbers as text, with as few digits as distinguish the two; return words unchanged."""
    try:
        pair = float(one), float(other)
    except ValueError:
        return one, other
    for digits in range(3, 17):
        short = f"{pair[0]:.{digits}g}", f"{pair[1]:.{digits}g}"
        if short[0] != short[1]:
            return short
    return one, other


def _seen_apart(run: Run, ghost: Run) -> float | None:
    """Return when a vehicle is first so far from where it was in the earlier run that it can be seen [s]."""
    if run.pose is None or ghost.pose is None or run.dt != ghost.dt:
        return None
    steps = min(run.steps, ghost.steps)
    columns = {agent.name: column for column, agent in enumerate(ghost.agents)}
    pairs = [(column, columns[agent.name]) for column, agent in enumerate(run.agents) if agent.name in columns]
    first = steps
    for here, there in pairs:
        both = run.here[:steps, here] & ghost.here[:steps, there]
        gap = np.hypot(*(run.pose[:steps, here, :2] - ghost.pose[:steps, there, :2]).T)
        apart = np.flatnonzero(both & (gap > _SEEN))
        first = min(first, int(apart[0]) if len(apart) else steps)
    return None if first == steps else round(run.start + first * run.dt, 9)
