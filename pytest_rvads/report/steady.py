"""One run per cell: where the rules of one start were judged on different runs, their verdicts are FLAKY."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec.structs import replace

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.runs.measured import Divergence

__all__ = ["steady"]


def steady(records: Iterable[Record]) -> Iterator[Record]:
    """Yield records, as FLAKY where items of one start, one test and one variant were judged on different runs.

    So many runs of one start come from a driver that draws at random, or that keeps state between runs: rules that follow each
    other in one process share a run, rules in different processes do not. Errors stay errors.
    """
    records = list(records)
    runs: dict[tuple[str, ...], dict[str, Record]] = {}
    for record in records:
        if record.hash and record.status is not Outcome.ERROR:
            runs.setdefault(_start(record), {}).setdefault(record.hash, record)
    for record in records:
        others = [one for run, one in runs.get(_start(record), {}).items() if run != record.hash]
        if not others or not record.hash or record.status is Outcome.ERROR:
            yield record
        else:
            parted = Divergence("hash", text=f"it was judged on another run than {others[0].nodeid}")
            yield replace(record, status=Outcome.FLAKY, flaky=record.flaky or parted, known=None)


def _start(record: Record) -> tuple[str, ...]:
    """Return what names the run of an item: its test and variant, what drives and simulates, and the id of the run."""
    test = record.nodeid.partition("[")[0]
    made = (record.driver, str(record.traffic), record.simulator) if isinstance(record, SimulatedItem) else ()
    return test, record.variant, *made, str(record.run)
