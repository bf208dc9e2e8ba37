"""The record of a run: who took part, how long stacks computed, and the records by the rules that judge it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import msgspec

from pytest_rvads.outcome import Outcome
from pytest_rvads.report.record import AgentRecord, Computing, Record, RecordedItem, SimulatedItem, conclude
from pytest_rvads.runs.run import Run

__all__ = ["by_rule", "computing", "took_part"]

_SKIPPED = (Outcome.NA, Outcome.UNSURE, Outcome.NOT_RUN)


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


def by_rule(whole: Record) -> Iterator[Record]:
    """Yield a record per verdict on a run, as sessions have one record per item.

    Args:
        whole: the record of the run, with the verdict of every rule; each id is its id, followed by the rule.
    """
    kind: type[Record] = RecordedItem if isinstance(whole, RecordedItem) else SimulatedItem
    shared = {name: getattr(whole, name) for name in kind.__struct_fields__}
    for verdict in whole.verdicts:
        given = verdict.outcome
        traced = (verdict.requirement,) if verdict.requirement else ()
        start = kind(**shared | {"nodeid": f"{whole.nodeid}-{verdict.rule}", "rule": verdict.rule, "requirements": traced})
        outcome = "failed" if given.bad else "skipped" if given in _SKIPPED else "passed"
        error = Outcome.ERROR if given is Outcome.ERROR else None
        # Why there is no verdict is the same by every rule, so that it is one cause.
        text = verdict.reason or verdict.message if error else verdict.message
        yield conclude(start, [verdict], "call", outcome, text=text, error=error)
