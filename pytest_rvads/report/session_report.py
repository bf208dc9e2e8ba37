"""What a session leaves behind: its records, what its tests asked for, and under which versions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pytest_rvads.report.record import Record

if TYPE_CHECKING:
    from pytest_rvads.report.baseline import Comparison

__all__ = ["Cell", "Report", "cell_from", "cell_of", "in_order"]

Cell = tuple[str, int, str, str, int | None, str | None]
"""Junction, class, configuration, rule, seat of the subject, traffic around it; where a test has no rule axis, its name stands
for the rule."""


@dataclass(frozen=True, slots=True)
class Report:
    """A whole session, or several merged into one."""

    records: tuple[Record, ...]
    """One per selected item, in the order of the tests; what did not run has the status NOT RUN."""
    totals: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Per number of ways, how many classes and how many full scenarios exist."""
    planned: tuple[Cell, ...] = ()
    """Every cell that the collected tests expand to, before ``-k`` and ``-m`` deselect."""
    versions: dict[str, str] = field(default_factory=dict)
    """Of what the verdicts depend on: name to version."""
    exitstatus: int = 0
    """Of pytest; above 1 the session did not end by itself."""
    notes: tuple[str, ...] = ()
    """What is missing or doubtful, a sentence each."""
    left_out: dict[str, int] = field(default_factory=dict)
    """Test to how many points of its grid are beyond v(d)max and were left out."""
    seconds: dict[str, float] = field(default_factory=dict, compare=False)
    """Test and run to how long simulating and judging took on this machine [s]; for the terminal only, in no file."""
    comparison: Comparison | None = None
    """With the baseline, where there is one; JSON keeps the kind of change of every record."""


def cell_of(record: Record) -> Cell:
    """Return the cell of a table that a record belongs to; the rows of a class share it."""
    rule = record["rule"] or record["test"]
    return record["junction"], record["cls"], record["cfg"], rule, record["seat"], record["traffic"]


def cell_from(entry: Sequence[Any]) -> Cell:
    """Return the cell that was written as a list.

    Raises:
        ValueError: it has another length.
    """
    junction, cls, cfg, rule, seat, traffic = entry
    return junction, cls, cfg, rule, seat, traffic


def in_order(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return records as their tests stand in the files, so that no report depends on which worker was faster."""
    return tuple(sorted(records, key=lambda r: (r["nodeid"].partition("::")[0], r["line"], r["nodeid"])))
