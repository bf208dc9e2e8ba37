"""What drove: the system under test of every run, by name."""

from __future__ import annotations

from collections.abc import Sequence

from pytest_rvads.report.record import Record

__all__ = ["drivers"]


def drivers(records: Sequence[Record]) -> list[str]:
    """Return a line per system under test: what it is called, and in how many runs it drove."""
    runs: dict[str, set[str]] = {}
    for record in records:
        if record["driver"]:
            runs.setdefault(record["driver"], set()).add(record.get("hash") or record["nodeid"])
    return [f"driven by {name}: {len(found)} run{'' if len(found) == 1 else 's'}" for name, found in runs.items()]
