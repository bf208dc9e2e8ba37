"""What is known of a case that was simulated and judged: a line of a file of results, and a record per rule."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import msgspec

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.outcome import Outcome
from pytest_rvads.report.record import AgentRecord, Computing, Count, Record, conclude, planned_record
from pytest_rvads.runs.measured import Kpis

__all__ = ["Glance", "Judged", "records"]

_SKIPPED = (Outcome.NA, Outcome.UNSURE, Outcome.NOT_RUN)
_KEYS = ("junction", "control", "cls", "scenario", "cfg", "rotation", "seat", "traffic", "orbit")
_TOLD = ("driver", "simulator", "hash", "place", "duration", "agents", "kpis", "timing")
"""What a record begins with and what it is told of its run, of the same names in a `Judged`."""


class Judged(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A case, its run, and what every rule says of it."""

    case: str
    """Hash of the case: who has it already need not run it again."""
    number: Count = 0
    """Its place among the cases of the campaign."""
    name: str
    """Id of the run as in ids of items, without a rule."""
    junction: str
    control: str
    """What regulates the junction."""
    ways: Count
    """Number of arms of the junction."""
    cls: Count
    scenario: str
    cfg: str
    rotation: Count = 0
    seat: Count | None = None
    traffic: str | None = None
    orbit: str = ""
    driver: str
    simulator: str
    hash: str | None = None
    """Of the run; None where there is none."""
    place: str | None = None
    """Digest of the junction."""
    duration: float | None = None
    """Of the run [s]."""
    agents: tuple[AgentRecord, ...] = ()
    kpis: Kpis | None = None
    timing: dict[str, Computing] | None = None
    verdicts: tuple[Verdict, ...]
    """One per rule, in the order of the rules; of a case without a run every one is an ERROR."""
    requirements: tuple[tuple[str, ...], ...] = ()
    """Per verdict what its rule traces to, where any does."""
    shape: str = ""
    """Junction of the same shape at which the run was simulated, where it was not this one."""


class _Judgement(msgspec.Struct):
    status: Outcome
    unavoidable: bool = False
    provoked: bool = False


class Glance(msgspec.Struct):
    """What of a `Judged` is needed to know which ones a file has."""

    case: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    number: Count = 0
    verdicts: tuple[_Judgement, ...] = ()


def records(judged: Judged) -> Iterator[Record]:
    """Yield a record per verdict, as sessions have one per item; its id is that of the run and the rule."""
    keys = {name: getattr(judged, name) for name in _KEYS}
    told = {name: getattr(judged, name) for name in _TOLD}
    for number, verdict in enumerate(judged.verdicts):
        traced = judged.requirements[number] if judged.requirements else ()
        start = planned_record(f"{judged.name}-{verdict.rule}", 0, "", {**keys, "rule": verdict.rule}, judged.ways, traced)
        given = verdict.outcome
        outcome = "failed" if given.bad else "skipped" if given in _SKIPPED else "passed"
        error = Outcome.ERROR if given is Outcome.ERROR else None
        # Why there is no verdict is the same by every rule, so that it is one cause.
        text = verdict.reason or verdict.message if error else verdict.message
        done = conclude(start, [verdict], "call", outcome, text=text, error=error)
        yield msgspec.structs.replace(done, run=judged.name, **told)
