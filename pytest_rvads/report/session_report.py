"""The report of a session: records, planned items, versions, and the changes since a baseline.

A report also holds the time and the command of the session, and the driver with its file and digest. No verdict depends on these.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta, Struct

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, RecordedItem

__all__ = [
    "NOTHING_JUDGED",
    "TOLD",
    "UNFINISHED",
    "Cell",
    "Change",
    "Comparison",
    "Drawn",
    "Extent",
    "Move",
    "Report",
    "begun",
    "cell_of",
    "exit_status",
    "in_order",
]

UNFINISHED = 2
"""Exit status of a session that did not come to its end, as of one that was interrupted."""

NOTHING_JUDGED = 5
"""Exit status where nothing was found out, as of a session that collected nothing."""


def exit_status(outcomes: Collection[Outcome], *, whole: bool = True) -> int:
    """Return the exit status of a report: 0 if all is well, 1 if something is wrong, else `UNFINISHED` or `NOTHING_JUDGED`.

    Args:
        outcomes: the outcomes that occur in the report, at least once each.
        whole: whether everything that was planned has an outcome.
    """
    if not whole:
        return UNFINISHED
    if any(outcome.bad for outcome in outcomes):
        return 1
    return 0 if any(outcome.judges for outcome in outcomes) else NOTHING_JUDGED


Cell = tuple[str, int | str, str, str, int | None, str | None]
"""Junction, class, configuration, rule, seat of the subject, traffic around it; where a test has no rule axis, its name stands
for the rule, and where a number does not tell a class, its least member for that. Of a recording, its name for the class."""
Move = tuple[tuple[int, int], tuple[int, int]]
"""A movement: arm and lane that it comes from, arm and lane that it leads to."""


class Extent(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How much there is to cover at a junction."""

    turns: Annotated[int, Meta(ge=1)]
    """How many rotations keep its lanes, movements and signs."""
    classes: dict[str, tuple[int, int, int]] = {}
    """By the occupancy that tests asked for: how many classes of full scenarios exist, how many full scenarios, and how many
    classes of scenarios with a subject."""
    partial: dict[str, int] = {}
    """By occupancy, how many classes exist with those of scenarios that leave entrances empty, where tests asked for them."""
    pairs: tuple[tuple[Move, Move], ...] = ()
    """Pairs of movements from different entrances, where they count."""
    conflicts: tuple[tuple[Move, Move], ...] = ()
    """Those of them that cross or merge."""


class Drawn(Struct, frozen=True, array_like=True):
    """The sample that a test runs of the runs or junctions that the test asks for."""

    test: str
    what: str
    """Runs or junctions."""
    taken: Annotated[int, Meta(ge=0)]
    total: Annotated[int, Meta(ge=0)]
    seed: int


_KINDS = {
    "NEW": "fails now and did not before, or is new and fails",
    "FIXED": "failed before, also as a known failure, and passes now",
    "ERODED": "passes both times, with less of a margin",
    "LOST": "was judged before, and now is NA or UNSURE, is another place, or does not exist",
    "KNOWN": "passed before and is marked as a known failure now",
    "ADDED": "is judged now and was not before",
    "UNCHANGED": "the same",
    "NOT RUN": "was selected and did not run",
    "OUTSIDE": "is in the baseline and was not selected now",
}
"""Every kind of change, in the order of the summary."""
TOLD = ("NEW", "FIXED", "ERODED", "LOST", "KNOWN")
"""Kinds that are listed item by item."""


@dataclass(frozen=True, slots=True)
class Change:
    """What became of one item."""

    kind: str
    """A key of the words above."""
    nodeid: str
    text: str = ""
    """What happened, where there is more to say than the kind."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """A session beside its baseline."""

    name: str
    """Of the baseline."""
    changes: tuple[Change, ...]
    versions: tuple[str, ...] = ()
    """A sentence for each version that differs."""

    def count(self, *kinds: str) -> int:
        """Return how many items changed in one of these ways."""
        return sum(change.kind in kinds for change in self.changes)

    @property
    def headline(self) -> str:
        """The numbers in one line."""
        found = Counter(change.kind for change in self.changes)
        return f"against {self.name}: " + (
            ", ".join(f"{found[kind]} {kind}" for kind in _KINDS if found[kind]) or "nothing to compare"
        )

    def lines(self, most: int | None = None) -> Iterator[str]:
        """Yield the changes worth telling, a line each.

        Args:
            most: per kind; the rest is counted.
        """
        yield from self.versions
        for kind in TOLD:
            told = [change for change in self.changes if change.kind == kind]
            for change in told[:most]:
                yield f"{kind:<7} {change.nodeid}" + (f"  {change.text}" if change.text else "")
            if most is not None and len(told) > most:
                yield f"{kind:<7} ... and {len(told) - most} more"


@dataclass(frozen=True, slots=True)
class Report:
    """A whole session, several merged into one, or a campaign."""

    records: Collection[Record]
    """One per selected item, in the order of the tests; what did not run has the status NOT RUN. There may be more of them than
    memory holds: who reads them goes through them once, from first to last, and keeps none."""
    totals: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Per number of ways, how many classes and how many full scenarios exist."""
    planned: tuple[Cell, ...] = ()
    """Every cell that the collected tests expand to, before ``-k`` and ``-m`` deselect."""
    versions: dict[str, str] = field(default_factory=dict)
    """Of what the verdicts depend on: name to version."""
    exitstatus: Annotated[int, Meta(ge=0, le=255)] = 0
    """Of pytest; 2 to 4: the session did not end by itself."""
    notes: tuple[str, ...] = ()
    """What is missing or doubtful, a sentence each."""
    left_out: dict[str, int] = field(default_factory=dict)
    """Test to how many points of its grid are beyond v(d)max and were left out."""
    seconds: dict[str, float] = field(default_factory=dict, compare=False)
    """Test and run, with its variant, to how long simulating and judging took on this machine [s]."""
    comparison: Comparison | None = None
    """With the baseline, where there is one."""
    complete: bool = True
    """False from the beginning of a session until it has come to its end, whatever ended it; so for ever if it died."""
    unfit: dict[str, int] = field(default_factory=dict)
    """Test to how many scenarios were left out because a vehicle has no room where it would start."""
    extents: dict[str, Extent] = field(default_factory=dict)
    """Junction to how much there is to cover, where `totals` do not tell."""
    again: str = "pytest"
    """The command that runs an item once more, when its id follows in quotes."""
    refused: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Why junctions that tests asked for among others, or movements there, are left out, to their names."""
    drawn: tuple[Drawn, ...] = ()
    """Tests that ran only a sample of their runs; the remaining runs are not planned."""
    began: str = field(default="", compare=False)
    """Date and time at which the session began, with its time zone (ISO 8601)."""
    command: str = field(default="", compare=False)
    """The command that it was started by."""
    project: str = ""
    """What tells the project of the tests from others: a digest of pytest's configuration file, or the name of the folder."""
    kept: str = field(default="", compare=False)
    """Folder in which all runs are kept, from the folder the session was started in; empty where they are not."""

    @property
    def ended(self) -> int:
        """The exit status, that of an unfinished session where the report is incomplete."""
        return self.exitstatus if self.complete else UNFINISHED


def begun(
    records: Sequence[Record],
    totals: dict[int, tuple[int, int]],
    planned: Sequence[Cell],
    extents: dict[str, Extent] | None = None,
) -> Report:
    """Return the report of a session that has not ended, with what is to run, where that is known; arguments as its fields."""
    note = "INCOMPLETE: the session that writes this report has not ended, or died; `rvads report check` says what it has judged"
    return Report(
        in_order(records),
        totals,
        tuple(planned),
        exitstatus=UNFINISHED,
        notes=(note,),
        extents=extents or {},
        complete=False,
    )


def cell_of(record: Record) -> Cell:
    """Return the cell of a table that a record belongs to; the rows of a class share it."""
    rule = record.rule or record.test
    if isinstance(record, RecordedItem):
        return record.junction, record.recording, "", rule, None, None
    return record.junction, record.orbit or record.cls, record.cfg, rule, record.seat, record.traffic


def in_order(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return records as their tests stand in the files, so that no report depends on which worker was faster."""
    return tuple(sorted(records, key=lambda record: (record.nodeid.partition("::")[0], record.line, record.nodeid)))
