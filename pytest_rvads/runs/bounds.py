"""Bounds on runs that are read from files, so that reading and judging a run takes seconds and fits into memory."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from msgspec import Meta

from pytest_rvads.support.errors import RunError

__all__ = ["FARTHEST", "MOST_LANES", "Name", "Size", "Step", "check_size"]

FARTHEST = 1e9
"""Largest number in an array of places, speeds or commands."""
MOST_LANES = _MOST_AGENTS = 100
"""Most vehicles of a run, and most entrances, or exits, of a junction."""
_MOST_WORK = 320_000_000
"""Five million ticks where four vehicles meet at four entrances: judging them takes half a gigabyte and some seconds."""

Name = Annotated[str, Meta(min_length=1, max_length=1000, pattern="^[^\x00-\x1f\x7f-\x9f\ud800-\udfff]+$")]
"""Name of a run, a vehicle or a junction: a text without control characters."""
Step = Annotated[float, Meta(ge=1e-6, le=3600.0)]
"""Time between two states [s]."""
Size = Annotated[float, Meta(gt=0.0, le=1e4)]
"""Length or width of a vehicle, width of a lane [m]."""


def check_size(where: str, sizes: Iterable[tuple[int, int, int]]) -> None:
    """Raise a `RunError` about runs that are too large to be judged together.

    Args:
        where: the beginning of the message.
        sizes: ticks, vehicles and entrances of every run.
    """
    ticks = work = 0
    for steps, agents, entrances in sizes:
        if agents > _MOST_AGENTS or entrances > MOST_LANES:
            raise RunError(
                f"{where}: {agents:,} vehicles at {entrances:,} entrances, at most {_MOST_AGENTS} of either are read: cut it up"
            )
        ticks, work = ticks + steps, work + steps * (agents + entrances) ** 2
    if work > _MOST_WORK:
        raise RunError(
            f"{where}: {ticks:,} ticks of so many vehicles and entrances are {work:,} pairs of them, at most {_MOST_WORK:,} are "
            "read: cut it into several files, or record in longer steps"
        )
