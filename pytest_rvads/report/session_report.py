"""The report of a session: records, planned items, versions, and the changes since a baseline.

A report also holds the time and the command of the session, and the driver with its file and digest. No verdict depends on these.

Memory may not hold all records of a report. A report therefore goes through its records once, and each part of the outline is a
tally that keeps only what it reports.
"""

from __future__ import annotations

import weakref
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from tempfile import TemporaryFile
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, RecordedItem, SimulatedItem
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.support.decoding import encode

__all__ = [
    "NOTHING_JUDGED",
    "TOLD",
    "UNFINISHED",
    "Anew",
    "Cell",
    "Change",
    "Comparison",
    "Drawn",
    "Extent",
    "Move",
    "Report",
    "Spool",
    "begun",
    "cell_of",
    "exit_status",
    "in_order",
    "steady",
]


UNFINISHED = 2
"""Exit status of a session that did not come to its end, as of one that was interrupted."""

NOTHING_JUDGED = 5
"""Exit status of a report without a judgement, as of a session that collected no test."""


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
    """Numbers of classes, scenarios and movements that tests can cover at a junction."""

    turns: Annotated[int, Meta(ge=1)]
    """Number of rotations that keep the lanes, movements and signs of the junction."""
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
    """The change of an item since the baseline."""

    kind: str
    """A key of `_KINDS`."""
    nodeid: str
    text: str = ""
    """Details of the change; may be empty."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The changes of a session since its baseline."""

    name: str
    """Name of the baseline."""
    changes: tuple[Change, ...]
    versions: tuple[str, ...] = ()
    """A sentence for each version that differs."""

    def count(self, *kinds: str) -> int:
        """Return how many items changed in one of these ways."""
        return sum(change.kind in kinds for change in self.changes)

    @property
    def headline(self) -> str:
        """The numbers in one line."""
        counts = Counter(change.kind for change in self.changes)
        return f"against {self.name}: " + (
            ", ".join(f"{counts[kind]} {kind}" for kind in _KINDS if counts[kind]) or "nothing to compare"
        )

    def lines(self, most: int | None = None) -> Iterator[str]:
        """Yield the changes worth telling, a line each.

        Args:
            most: most lines per kind; further changes are counted.
        """
        yield from self.versions
        for kind in TOLD:
            changes = [change for change in self.changes if change.kind == kind]
            for change in changes[:most]:
                yield f"{kind:<7} {change.nodeid}" + (f"  {change.text}" if change.text else "")
            if most is not None and len(changes) > most:
                yield f"{kind:<7} ... and {len(changes) - most} more"


@dataclass(frozen=True, slots=True)
class Report:
    """A whole session, several merged into one, or a campaign."""

    records: Collection[Record]
    """One per selected item, in the order of the tests; what did not run has the status NOT RUN. Memory may
    not hold all records: readers go through them once, from first to last, and keep none."""
    totals: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Per number of ways, how many classes and how many full scenarios exist."""
    planned: tuple[Cell, ...] = ()
    """Every cell that the collected tests expand to, before ``-k`` and ``-m`` deselect."""
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of the packages on which the verdicts depend, by name."""
    exitstatus: Annotated[int, Meta(ge=0, le=255)] = 0
    """Of pytest; 2 to 4: the session did not end by itself."""
    notes: tuple[str, ...] = ()
    """Missing or doubtful parts of the report, a sentence each."""
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
    """The command that started the session."""
    project: str = ""
    """Identity of the project of the tests: a digest of pytest's configuration file, or the name of the folder."""
    kept: str = field(default="", compare=False)
    """Folder in which all runs are kept, from the folder the session was started in; empty where they are not."""

    @property
    def ended(self) -> int:
        """The exit status; `UNFINISHED` for an incomplete report."""
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
        others = [item for run, item in runs.get(_start(record), {}).items() if run != record.hash]
        if not others or not record.hash or record.status is Outcome.ERROR:
            yield record
        else:
            divergence = Divergence("hash", text=f"it was judged on another run than {others[0].nodeid}")
            yield replace(record, status=Outcome.FLAKY, flaky=record.flaky or divergence, known=None)


def _start(record: Record) -> tuple[str, ...]:
    """Return what names the run of an item: its test and variant, what drives and simulates, and the id of the run."""
    test = record.nodeid.partition("[")[0]
    source = (record.driver, str(record.traffic), record.simulator) if isinstance(record, SimulatedItem) else ()
    return test, record.variant, *source, str(record.run)


class Anew(Collection[Record]):
    """Records that are made anew in every pass, because memory may not hold all of them.

    Args:
        made: makes the records of a pass.
        count: returns the number of records.
    """

    def __init__(self, made: Callable[[], Iterable[Record]], count: Callable[[], int]) -> None:
        self._made, self._count = made, count

    def __iter__(self) -> Iterator[Record]:
        return iter(self._made())

    def __len__(self) -> int:
        return self._count()

    def __contains__(self, record: object) -> bool:
        return any(item == record for item in self)


class Spool(Anew):
    """Records in a file without a name, a line of JSON each; every pass reads them."""

    def __init__(self) -> None:
        self._file = TemporaryFile()  # noqa: SIM115 - closed with the last reference to these records
        self._lines = 0
        weakref.finalize(self, self._file.close)
        super().__init__(self._read, lambda: self._lines)

    def add(self, record: Record) -> None:
        """Append a record; the passes begin after the last record."""
        self._file.write(encode(record) + b"\n")
        self._lines += 1

    def _read(self) -> Iterator[Record]:
        self._file.seek(0)
        yield from map(msgspec.json.Decoder(Record).decode, self._file)
