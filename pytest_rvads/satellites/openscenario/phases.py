"""Lights as OpenSCENARIO has them: what the signals of the map show, phase by phase."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.lights import CLEARANCE, GREEN, YELLOW, SignalPlan
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.openscenario.document import Phase
from pytest_rvads.satellites.tracks.lightlog import ENTRANCE, signal_ids

__all__ = ["phases_of_plan", "phases_of_run"]


def phases_of_run(junction: Junction, lights: NDArray[np.int8], dt: float) -> tuple[Phase, ...]:
    """Return what the signals of a junction showed, shape of `lights` ``(steps, entrances)``; nothing where there are none."""
    if not lights.any():
        return ()
    names = _names(junction, lights)
    bounds = [0, *(np.flatnonzero((np.diff(lights, axis=0) != 0).any(axis=1)) + 1).tolist(), len(lights)]
    return tuple(_phase(names, lights[begin], round((end - begin) * dt, 9)) for begin, end in pairwise(bounds))


def phases_of_plan(junction: Junction, plan: SignalPlan) -> tuple[Phase, ...]:
    """Return the cycle of a signal plan; nothing where there is none."""
    count, times = len(junction.entrances), (0.0, GREEN, GREEN + YELLOW)
    slot = GREEN + YELLOW + CLEARANCE
    steps = [(turn * slot + time) for turn in range(len(plan.groups)) for time in times]
    shown = np.array([plan.colours(time, count) for time in steps], dtype=np.int8).reshape(-1, count)
    names = _names(junction, shown)
    lasting = (GREEN, YELLOW, CLEARANCE) * len(plan.groups)
    return tuple(_phase(names, colours, seconds) for colours, seconds in zip(shown, lasting, strict=True))


def _names(junction: Junction, lights: NDArray[np.int8]) -> dict[str, int]:
    """Return the signals to write, each with an entrance whose light shows the signal's colours.

    The signals are those of the map. An entrance is written as a signal itself if the map has no light for the entrance, or if
    the light also controls entrances with other colours.
    """
    ids = signal_ids(junction)
    found: dict[str, int] = {}
    for entrance in np.flatnonzero(lights.any(axis=0)).tolist():
        mine = [id for id, at in ids.items() if entrance in at and _alike(lights, at)]
        label = junction.vehicle_at(entrance).removeprefix("a")
        found |= dict.fromkeys(mine or [f"{ENTRANCE}{label}"], entrance)
    return found


def _alike(lights: NDArray[np.int8], entrances: Sequence[int]) -> bool:
    columns = lights[:, list(entrances)]
    return bool((columns == columns[:, :1]).all())


def _phase(names: dict[str, int], colours: NDArray[np.int8], seconds: float) -> Phase:
    return Phase(seconds, {name: Colour(int(colours[entrance])) for name, entrance in names.items()})
