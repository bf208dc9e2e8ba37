"""How long stacks in other processes computed: real time, which no verdict depends on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pytest_rvads.report.record import Record

__all__ = ["timing"]


def timing(records: Sequence[Record]) -> list[str]:
    """Return a line per stack: in how many runs it made how many decisions, and how long they took."""
    runs = {(r["run"], r["traffic"], r["hash"]): r["timing"] for r in records if r.get("timing")}
    stacks: dict[str, list[dict[str, Any]]] = {}
    for timed in runs.values():
        for one in timed.values():
            stacks.setdefault(one["stack"], []).append(one)
    return [_line(stack, found) for stack, found in stacks.items()]


def _line(stack: str, found: Sequence[dict[str, Any]]) -> str:
    count = sum(one["decisions"] for one in found)
    mean = sum(one["compute"] for one in found) / max(count, 1)
    longest = max(one["longest"] for one in found)
    return f"{stack}: {count} decisions in {len(found)} runs, {1000 * mean:.2g} ms each, {1000 * longest:.2g} ms the longest"
