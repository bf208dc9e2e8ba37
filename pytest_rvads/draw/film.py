"""What an animated picture shows of a run: from when to when, and where it stands still; and how much of the junction."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.draw.scene import Scene, size
from pytest_rvads.runs.run import Run

__all__ = ["Film", "filmed", "framed"]

_RATE = 10
"""Keyframes per second; browsers draw straight lines between them."""
_HOLD, _REST = 2.0, 1.0
"""How long the picture stands still when it happens, and at its end, in seconds of whoever watches."""
_LONGEST = 60.0
"""How much of a run is shown at most [s]: a picture stays below a megabyte."""
_NEAR, _SPAN = 11.0, 16.0
"""How far from the junction, and from where it is when it happens, a vehicle is in view that the picture is about [m]."""
_BESIDE, _AROUND = 26.0, 3.5
"""How far from such a vehicle others are in view, and how much is around all that [m]."""
_SHAPE = 0.62
"""Height of the view, at least, as a share of its width."""


@dataclass(frozen=True, slots=True)
class Film:
    """Which states are shown, and when."""

    ticks: Sequence[int]
    """Of the run, in order."""
    times: Sequence[float]
    """When each is shown [s], in seconds of whoever watches."""
    still: int
    """The state that is shown where nothing moves."""
    pause: float
    """When that is reached [s]."""
    length: float
    """Until it begins again [s]."""

    def share(self, time: float) -> str:
        """Return a time as keyframes have it."""
        return f"{100 * min(time / self.length, 1.0):.2f}%"


def filmed(run: Run, scene: Scene, responsible: Collection[str], around: float | None, before: float, after: float) -> Film:
    """Return what is shown: of the time before only that in which somebody it is about is near."""
    last = run.steps - 1
    still = last if around is None else min(max(round((around - run.start) / run.dt), 0), last)
    begin = 0
    if around is not None:
        begin = max(still - round(min(before, _LONGEST) / run.dt), 0)
        near = [
            _near(run, scene, column, still)[begin:still] for column, agent in enumerate(run.agents) if agent.name in responsible
        ]
        came = np.any(near, axis=0)
        begin += int(came.argmax()) if near and len(came) else 0  # 0 as well where nobody came
    end = min(last, round(_LONGEST / run.dt)) if around is None else min(still + round(min(after, _LONGEST) / run.dt), last)
    still = min(still, end)
    every = max(round(1 / _RATE / run.dt), 1)
    ticks = sorted({*range(begin, end + 1, every), still, end})
    hold = 0.0 if around is None else _HOLD
    times = [(tick - begin) * run.dt + (hold if tick > still else 0.0) for tick in ticks]
    # It stands still between two keyframes of the same state.
    place = ticks.index(still)
    if hold:
        ticks.insert(place, still)
        times.insert(place + 1, times[place] + hold)
    return Film(ticks, times, still, times[place], times[-1] + _REST)


def _near(run: Run, scene: Scene, column: int, still: int) -> NDArray[np.bool_]:
    """Return when a vehicle that the picture is about is in view, shape ``(steps,)``.

    That is near the junction, and not far from where it is when it happens.
    """
    low, high = scene.core
    way = run.need("pose")[:, column, :2]
    found: NDArray[np.bool_] = run.here[:, column] & ((way > low - _NEAR) & (way < high + _NEAR)).all(axis=1)
    if run.here[still, column]:
        found &= np.hypot(*(way - way[still]).T) < _SPAN
    return found


def framed(run: Run, scene: Scene, film: Film, responsible: Collection[str]) -> tuple[float, float, float, float]:
    """Return left, top, width and height of the visible part, in SVG coordinates [m].

    The visible part holds the responsible vehicles and the vehicles near them. Without a responsible vehicle it is
    the whole junction.
    """
    pose, ticks = run.need("pose"), list(film.ticks)
    about = [column for column, agent in enumerate(run.agents) if agent.name in responsible and run.here[ticks, column].any()]
    points = [] if about else list(scene.core)
    for column in about:
        points += list(pose[ticks, column, :2][_near(run, scene, column, film.still)[ticks]])
    centres = [pose[film.still, column, :2] for column in about if run.here[film.still, column]]
    for column, agent in enumerate(run.agents):
        if agent.name not in responsible and run.here[film.still, column]:
            place = pose[film.still, column]
            rear = place[:2] - size(run, column)[0] * np.array([np.cos(place[2]), np.sin(place[2])])
            points += [place[:2], rear] if any(np.hypot(*(place[:2] - centre)) < _BESIDE for centre in centres) else []
    points = points or list(scene.core)
    (x0, y0), (x1, y1) = np.min(points, axis=0) - _AROUND, np.max(points, axis=0) + _AROUND
    wide, tall = float(x1 - x0), float(y1 - y0)
    wide = max(wide, tall / 0.85)
    tall = max(tall, _SHAPE * wide)
    return float(x0 + x1 - wide) / 2, -float(y0 + y1 + tall) / 2, wide, tall
