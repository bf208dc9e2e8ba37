"""What a record tells of a run beside verdicts and indicators: who took part, and how long stacks computed."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import msgspec

from pytest_rvads.report.record import AgentRecord, Computing
from pytest_rvads.runs.run import Run

__all__ = ["computing", "took_part"]


def took_part(run: Run) -> tuple[AgentRecord, ...]:
    """Return who took part in a run."""
    junction = run.junction
    entrances, exits = ([(lane.arm, lane.lane) for lane in lanes] for lanes in (junction.entrances, junction.exits))
    return tuple(
        AgentRecord(name=agent.name, kind=agent.kind.value, entrance=entrances[agent.entrance], exit=exits[agent.exit])
        for agent in run.agents
    )


def computing(run: Run) -> dict[str, Computing] | None:
    """Return what stacks in other processes computed, by vehicle; what others measured is in the run alone."""
    found = {}
    timing = run.provenance.get("timing")
    for name, told in timing.items() if isinstance(timing, Mapping) else ():
        with suppress(msgspec.ValidationError):
            found[str(name)] = msgspec.convert(told, Computing)
    return found or None
