"""Explains the words in tables of verdicts for readers without the manual."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pytest_rvads.outcome import Outcome
from pytest_rvads.report.outline import RollUp, Verdicts

__all__ = ["legend"]

_MEANINGS = {
    Outcome.NA: "the rule did not apply",
    Outcome.UNAVOIDABLE: "nobody could have kept the rule",
    Outcome.PROVOKED: "broken by the doing of the traffic, not of the vehicle under test",
    Outcome.OPEN: "still owed at the end of the run",
    Outcome.UNSURE: "the recording is not exact enough to tell",
    Outcome.FLAKY: "the same start gave another run, or the same run another verdict",
    Outcome.NOT_JUDGED: "the test judged nothing",
}
"""The explanations of outcomes in tables."""


def legend(found: Iterable[RollUp | Verdicts]) -> Iterator[str]:
    """Yield an explanation for each word in the tables that needs one."""
    kinds: set[Outcome] = set()
    known = shares = summed = False
    for block in found:
        match block:
            case Verdicts(matrix):
                entries = {entry for _, row in matrix.rows for entry in row if entry.outcome}
                kinds |= {entry.outcome for entry in entries if entry.outcome and not entry.known}
                known = known or any("xfail" in entry.text for entry in entries)
                shares = shares or any("/" in entry.text for entry in entries)
            case RollUp(sums):
                summed = True
                kinds |= {kind for table in sums for kind in table.kinds if kind}
                known = known or any(None in table.kinds for table in sums)
    if summed:
        yield "wrong: runs with a failure that is not known, wrong at: junctions with one"
    if shares:
        yield "1/4: one of four items"
    yield from (f"{kind.small}: {told}" for kind, told in _MEANINGS.items() if kind in kinds)
    if known:
        yield "known, xfail: a failure that the tests expect, by the reason that they give"
