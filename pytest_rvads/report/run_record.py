"""The record of a run: its verdicts, who took part, how long stacks computed, and the records by the rules that judge it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import msgspec

from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import AgentRecord, Computing, Record, RecordedItem, SimulatedItem, conclude
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

__all__ = ["by_rule", "computing", "of_run", "sentence", "summed", "took_part", "unjudged", "verdict_by"]

_SKIPPED = (Outcome.NA, Outcome.UNSURE, Outcome.NOT_RUN)


def verdict_by(run: Run, rule: str | Rule) -> Verdict:
    """Return the verdict of a rule on a run; where the rule can't judge the run, an ERROR that says why."""
    try:
        return check(run, rule)
    except Exception as error:  # a predicate of users may raise anything
        return unjudged(rule, sentence(error))


def unjudged(rule: str | Rule, reason: str) -> Verdict:
    """Return the ERROR of a rule where there is no other verdict."""
    name, requirement = (rule, None) if isinstance(rule, str) else (rule.name, rule.requirement)
    return Verdict(name, Status.ERROR, f"{name} ERROR: {reason}", reason=reason, requirement=requirement)


def sentence(error: Exception) -> str:
    """Return an error in one sentence; of an error that nobody raised on purpose, also its kind."""
    return one_line(str(error) if isinstance(error, RvadsError | OSError) else f"{type(error).__name__}: {error}")


def summed(verdicts: Iterable[Verdict]) -> tuple[tuple[str, str, str], ...]:
    """Return rule, outcome and message of verdicts, the worst first; for `Beside.others`."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.outcome.severity)
    return tuple((verdict.rule, verdict.outcome.value, verdict.message) for verdict in ordered)


def of_run(run: Run) -> dict[str, Any]:
    """Return the fields of a record that come from its run, but for verdicts and indicators."""
    return {
        "hash": run.hash,
        "place": run.junction.digest[:12],
        "duration": run.duration,
        "agents": took_part(run),
        "timing": computing(run),
    }


def took_part(run: Run) -> tuple[AgentRecord, ...]:
    """Return who took part in a run."""
    junction = run.junction
    entrances, exits = ([(lane.arm, lane.lane) for lane in lanes] for lanes in (junction.starts, junction.ends))
    return tuple(
        AgentRecord(name=agent.name, kind=agent.kind.value, entrance=entrances[agent.entrance], exit=exits[agent.exit])
        for agent in run.agents
    )


def computing(run: Run) -> dict[str, Computing] | None:
    """Return what stacks in other processes computed, by vehicle; what others measured is in the run alone."""
    computed = {}
    timing = run.provenance.get("timing")
    for name, measured in timing.items() if isinstance(timing, Mapping) else ():
        with suppress(msgspec.ValidationError):
            computed[str(name)] = msgspec.convert(measured, Computing)
    return computed or None


def by_rule(whole: Record) -> Iterator[Record]:
    """Yield a record per verdict on a run, as sessions have one record per item.

    Args:
        whole: the record of the run, with the verdict of every rule; each id is its id, followed by the rule.
    """
    kind: type[Record] = RecordedItem if isinstance(whole, RecordedItem) else SimulatedItem
    shared = {name: getattr(whole, name) for name in kind.__struct_fields__}
    for verdict in whole.verdicts:
        result = verdict.outcome
        requirements = (verdict.requirement,) if verdict.requirement else ()
        start = kind(**shared | {"nodeid": f"{whole.nodeid}-{verdict.rule}", "rule": verdict.rule, "requirements": requirements})
        outcome = "failed" if result.bad else "skipped" if result in _SKIPPED else "passed"
        error = Outcome.ERROR if result is Outcome.ERROR else None
        # Why there is no verdict is the same by every rule, so that it is one cause.
        text = verdict.reason or verdict.message if error else verdict.message
        yield conclude(start, [verdict], "call", outcome, text=text, error=error)
