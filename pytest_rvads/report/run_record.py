"""Makes the record of a run (verdicts of all rules, agents, computing times of drivers), and a record per rule."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import AgentRecord, Computing, Excess, Record, RecordedItem, SimulatedItem, conclude
from pytest_rvads.runs.run import Run
from pytest_rvads.support.storage import slug


def summed(verdicts: Iterable[Verdict]) -> tuple[tuple[str, str, str], ...]:
    """Return rule, outcome and message of each verdict, the worst verdict first, as `Beside.others` holds them."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.outcome.severity)
    return tuple((verdict.rule, verdict.outcome.value, verdict.message) for verdict in ordered)


def of_run(run: Run) -> dict[str, Any]:
    """Return the fields of a record that follow from its run, except verdicts and indicators, by name."""
    fields = {"hash": run.hash, "place": run.junction.digest[:12], "duration": run.duration, "agents": took_part(run)}
    return fields | measured(run)


def took_part(run: Run) -> tuple[AgentRecord, ...]:
    """Return the agents of a run, each with arm and lane of its entrance and of its exit."""
    junction = run.junction
    entrances, exits = ([(lane.arm, lane.lane) for lane in lanes] for lanes in (junction.starts, junction.ends))
    return tuple(
        AgentRecord(name=agent.name, kind=agent.kind.value, entrance=entrances[agent.entrance], exit=exits[agent.exit])
        for agent in run.agents
    )


def kept_run(folder: Path, record: Record) -> Path:
    """Return the path of the file in which `folder` keeps a run: the id of the test item without the rule."""
    before, run, after = record.nodeid.partition(record.run or record.nodeid)
    if record.rule:
        after = after.replace(f"-{record.rule}", "", 1)
    return folder / f"{slug(before + run + after)}.npz"


def measured(run: Run) -> dict[str, Any]:
    """Return the fields of a record on the drivers of a run: ``timing`` and ``excess``, each None if no driver has entries."""
    fields: dict[str, Any] = {}
    for name, kind in (("timing", Computing), ("excess", Excess)):
        entry, by_vehicle = run.provenance.get(name), {}
        for vehicle, value in entry.items() if isinstance(entry, Mapping) else ():
            with suppress(msgspec.ValidationError):
                by_vehicle[str(vehicle)] = msgspec.convert(value, kind)
        fields[name] = by_vehicle or None
    return fields


def by_rule(run_record: Record) -> Iterator[Record]:
    """Yield a record per verdict on a run, like the records of test items in a session."""
    kind: type[Record] = RecordedItem if isinstance(run_record, RecordedItem) else SimulatedItem
    shared = {name: getattr(run_record, name) for name in kind.__struct_fields__}
    for verdict in run_record.verdicts:
        result, requirements = verdict.outcome, (verdict.requirement,) if verdict.requirement else ()
        nodeid = f"{run_record.nodeid}-{verdict.rule}"
        start = kind(**shared | {"nodeid": nodeid, "rule": verdict.rule, "requirements": requirements})
        idle = result in (Outcome.NA, Outcome.UNSURE, Outcome.NOT_RUN)
        outcome = "failed" if result.bad else "skipped" if idle else "passed"
        error = Outcome.ERROR if result is Outcome.ERROR else None
        # The reason for a missing verdict has the same text for every rule, so that all such failures of a run have one cause.
        text = verdict.reason or verdict.message if error else verdict.message
        yield conclude(start, [verdict], "call", outcome, text=text, error=error)
