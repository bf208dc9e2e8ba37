"""The report of a session: records of test items, planned cells, versions, and the changes since a baseline.

A report also holds the time and the command of the session, and the driver with its file and digest. No verdict depends on these.

The records of a session lie in memory, some 10 kB each: a gigabyte holds 100,000. More runs are a campaign with results on disk,
whose report keeps only the records in memory that did not pass.

Items are compared with those of the baseline, an earlier report of the same tests, by node id. A safety margin is a time: the
time by which the vehicle that a rule obliges kept the rule, the shortest time to collision of the run, or the shortest
post-encroachment time of the run. A margin has eroded if it has fallen by more than 0.5 s and is now below its threshold from the
literature (`MATTERS`). All items of a run share the indicators of the run, so erosion is reported once per run, for its first
item, and not if an item of the run is NEW.
"""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct
from msgspec.structs import replace

from pytest_rvads.logic.outcome import BAD, Outcome
from pytest_rvads.report.record import Record, RecordedItem, SimulatedItem
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.support.wording import plural

UNFINISHED = 2
"""Exit status of a session that did not come to its end, for example of an interrupted session."""

NOTHING_JUDGED = 5
"""Exit status of a report without a judgement, for example of a session that collected no test."""

MATTERS = {"ttc": 4.0, "pet": 5.0, "margin": 5.0}
"""Threshold of each safety margin [s]; a fall of the margin to a value above the threshold does not matter.

- ``ttc``: drivers keep control of situations with a time to collision (Hayward, HRB 1972) above 4 s (van der Horst and Hogema,
  Time-to-collision and collision avoidance systems, ICTCT 1993).
- ``pet``: a post-encroachment time (Allen, Shin, Cooper, TRR 1978) above 5 s is no conflict (Gettman and others, Surrogate
  safety assessment model and validation, FHWA-HRT-08-051, 2008).
- ``margin``: the time that the obliged vehicle waited longer than its rule requires. This time is a gap between two vehicles, as
  a post-encroachment time is, so both have the same threshold.
"""
_EROSION = 0.5
"""A margin has eroded only if it fell by more than this [s]: a tenth of the largest threshold in `MATTERS`."""
_Fall = tuple[str, float, float]
"""The name of a safety margin, and the margin in the baseline and in the session [s]."""


def exit_status(outcomes: Collection[Outcome], *, complete: bool = True) -> int:
    """Return the exit status of a report: 1 if an outcome is bad, else 0 if an outcome judges the system under test."""
    if not complete:
        return UNFINISHED
    if any(outcome.bad for outcome in outcomes):
        return 1
    return 0 if any(outcome.judges for outcome in outcomes) else NOTHING_JUDGED


class Cell(NamedTuple):
    """The scenario, rule and traffic of a test item; coverage counts how many different cells were judged."""

    junction: str
    cls: int | str
    """The class of scenarios, or the least scenario of the class if the number of the class does not identify the class, or the
    name of the recording."""
    start: str
    """The pedestrians, if any, and the configuration."""
    rule: str
    """The rule, or the name of the test if the test does not run per rule."""
    seat: int | None
    """The seat of the subject."""
    traffic: str | None
    """The traffic around the subject."""


Move = tuple[tuple[int, int], tuple[int, int]]
"""A movement: arm and lane of its entrance, arm and lane of its exit."""


class Extent(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The numbers of classes, scenarios and movements at a junction that tests can cover."""

    turns: Annotated[int, Meta(ge=1)]
    """Number of rotations that keep the lanes, movements and signs of the junction."""
    classes: dict[str, tuple[int, int, int]] = {}
    """By occupancy (a vehicle per arm or lane), the numbers of classes, of full scenarios, and of classes with a subject."""
    partial: dict[str, int] = {}
    """By occupancy, number of classes of scenarios with or without empty entrances; only if tests asked for these classes."""
    pairs: tuple[tuple[Move, Move], ...] = ()
    """The pairs of movements from different entrances; empty if no test asked for pairs at the junction."""
    conflicts: tuple[tuple[Move, Move], ...] = ()
    """The pairs whose movements cross or merge."""


class Drawn(Struct, frozen=True, array_like=True):
    """A sample: the part of the requested runs or junctions that a test runs."""

    test: str
    what: str
    """The sampled things: runs or junctions."""
    taken: Annotated[int, Meta(ge=0)]
    total: Annotated[int, Meta(ge=0)]
    seed: int

    def __str__(self) -> str:
        """Return the sample in words, with the option that asks for it."""
        session, town = ("--rvads-sample", "--sample") if self.what == "runs" else ("limit= of the mark", "--limit")
        option = town if self.test == "rvads town" else session
        return f"{self.taken:,} of {self.total:,} {self.what} drawn by {option}, seed {self.seed}"


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
LISTED = ("NEW", "FIXED", "ERODED", "LOST", "KNOWN")
"""Kinds of changes that are listed item by item."""


@dataclass(frozen=True, slots=True)
class Change:
    """The change of a test item since the baseline."""

    kind: str
    """A key of `_KINDS`."""
    nodeid: str
    text: str = ""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The changes of a session since its baseline, an earlier session."""

    name: str
    changes: tuple[Change, ...]
    versions: tuple[str, ...] = ()
    """A sentence for each package whose version differs."""

    def count(self, *kinds: str) -> int:
        """Return the number of items with a change of these kinds."""
        return sum(change.kind in kinds for change in self.changes)

    @property
    def headline(self) -> str:
        """One line with the number of changes of each kind."""
        counts = Counter(change.kind for change in self.changes)
        return f"against {self.name}: " + (
            ", ".join(f"{counts[kind]} {kind}" for kind in _KINDS if counts[kind]) or "nothing to compare"
        )

    def listed(self, most: int | None = None) -> Iterator[tuple[str, str]]:
        """Yield an empty text and a sentence per package whose version differs; kind and text of each change in `LISTED`."""
        yield from (("", version) for version in self.versions)
        for kind in LISTED:
            changes = [change for change in self.changes if change.kind == kind]
            yield from ((kind, change.nodeid + (f"  {change.text}" if change.text else "")) for change in changes[:most])
            if most is not None and len(changes) > most:
                yield kind, f"... and {len(changes) - most} more"

    def lines(self) -> Iterator[str]:
        """Yield a line per package whose version differs, and a line per change of a kind in `LISTED`."""
        yield from (f"{kind:<7} {text}" if kind else text for kind, text in self.listed())


@dataclass(frozen=True, slots=True)
class Report:
    """The report of a session, of several sessions merged, or of a campaign."""

    records: Collection[Record]
    """A record per selected item, in the order of the tests; an item that did not run has the status NOT RUN. The records of a
    session lie in memory. The records of a campaign are read from disk in each pass, so a reader makes few passes."""
    totals: dict[int, tuple[int, int]] = field(default_factory=dict)
    """By number of arms, the number of classes and the number of full scenarios (a vehicle at every arm)."""
    planned: tuple[Cell, ...] = ()
    """Every cell that the collected tests expand to, before ``-k`` and ``-m`` deselect."""
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of the packages on which the verdicts depend, by name."""
    exitstatus: Annotated[int, Meta(ge=0, le=255)] = 0
    """Exit status of pytest; 2 to 4 mean that the session did not end by itself."""
    notes: tuple[str, ...] = ()
    """Missing or doubtful parts of the report, a sentence each."""
    left_out: dict[str, int] = field(default_factory=dict)
    """By test, the number of points of its grid that were left out: too fast to stop before the line, beyond v(d)max."""
    seconds: dict[str, float] = field(default_factory=dict, compare=False)
    """By test, run and variant, the time that simulating and judging took on this machine [s]."""
    comparison: Comparison | None = None
    """None without a baseline."""
    complete: bool = True
    """False from the beginning of a session until its end; False for ever if the session died."""
    unfit: dict[str, int] = field(default_factory=dict)
    """By test, the number of scenarios that were left out because a vehicle has no room at its start."""
    extents: dict[str, Extent] = field(default_factory=dict)
    """By junction, the numbers of classes and scenarios; only for junctions that `totals` does not describe."""
    again: str = "pytest"
    """The command that runs an item again if the quoted id of the item follows."""
    refused: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By reason, the names of junctions and movements that are left out, or that run with other starts than requested."""
    drawn: tuple[Drawn, ...] = ()
    """Tests that ran only a sample of their runs; the remaining runs are not planned."""
    began: str = field(default="", compare=False)
    """Date and time at which the session began, with its time zone (ISO 8601)."""
    command: str = field(default="", compare=False)
    project: str = ""
    """Identity of the project of the tests: a digest of pytest's configuration file, or the name of pytest's root folder."""
    kept: str = field(default="", compare=False)
    """Folder in which all runs are kept, relative to the working directory of the session; empty if runs are not kept."""

    @property
    def ended(self) -> int:
        """The exit status of the session; `UNFINISHED` for an incomplete report."""
        return self.exitstatus if self.complete else UNFINISHED


def begun(
    records: Sequence[Record],
    totals: dict[int, tuple[int, int]],
    planned: Sequence[Cell],
    extents: dict[str, Extent] | None = None,
) -> Report:
    """Return the report of a session that has not ended."""
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
    """Return the cell (junction, class, configuration, rule, ...) of a record; the rotations of a class share a cell."""
    rule = record.rule or record.test
    if isinstance(record, RecordedItem):
        return Cell(record.junction, record.recording, "", rule, None, None)
    start = f"{record.pedestrians} {record.cfg}" if record.pedestrians else record.cfg
    return Cell(record.junction, record.orbit or record.cls, start, rule, record.seat, record.traffic)


def in_order(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return records in the order of their tests in the files, so that no report depends on which worker was faster."""
    return tuple(sorted(records, key=lambda record: (record.nodeid.partition("::")[0], record.line, record.nodeid)))


def steady(records: Iterable[Record]) -> Iterator[Record]:
    """Yield records; items of the same start, test and variant that were judged on different runs get the status FLAKY.

    Different runs of the same start come from a driver that draws at random, or that keeps state between runs. Rules that
    one process judges directly one after the other share a run; rules in different processes do not. A record with status ERROR
    stays unchanged.
    """

    def start(record: Record) -> tuple[str, ...]:
        source = (record.driver, str(record.traffic), record.simulator) if isinstance(record, SimulatedItem) else ()
        return record.nodeid.partition("[")[0], record.variant, *source, str(record.run)

    records = list(records)
    runs: dict[tuple[str, ...], dict[str, Record]] = {}
    for record in records:
        if record.hash and record.status is not Outcome.ERROR:
            runs.setdefault(start(record), {}).setdefault(record.hash, record)
    for record in records:
        others = [item for run, item in runs.get(start(record), {}).items() if run != record.hash]
        if not others or not record.hash or record.status is Outcome.ERROR:
            yield record
        else:
            divergence = Divergence("hash", text=f"it was judged on another run than {others[0].nodeid}")
            yield replace(record, status=Outcome.FLAKY, flaky=record.flaky or divergence, known=None)


def compare(report: Report, baseline: Report, name: str, gone: Callable[[str], bool], *, same: bool = True) -> Comparison:
    """Return what changed between a baseline and a session; the items of an ERODED run after the first are UNCHANGED."""
    before = {record.nodeid: record for record in baseline.records}
    changes: list[Change] = []
    # By run, the position in `changes` and the eroded margins of every item with eroded margins.
    eroded: dict[str, list[tuple[int, list[_Fall]]]] = defaultdict(list)
    simulators: dict[tuple[str, str], None] = {}
    broken: set[str] = set()
    difference_counts: Counter[str] = Counter()
    for record in report.records:
        earlier = before.pop(record.nodeid, None)
        if isinstance(earlier, SimulatedItem) and isinstance(record, SimulatedItem):
            simulators[earlier.simulator, record.simulator] = None
        difference = _incomparable(record, earlier) if earlier else ""
        difference_counts[difference] += 1
        change = _item_change(record, earlier, difference if same else "")
        if change.kind == "NEW":
            broken.add(record.ran_as)
        elif change.kind == "UNCHANGED" and earlier and _state(record) == "passed" and (falls := _falls(record, earlier)):
            eroded[record.ran_as].append((len(changes), falls))
        changes.append(change)
    for run, items in eroded.items():
        if run not in broken:
            number = items[0][0]
            changes[number] = Change("ERODED", changes[number].nodeid, _eroded_margins([falls for _, falls in items]))
    for nodeid, record in before.items():
        if not gone(nodeid):
            changes.append(Change("OUTSIDE", nodeid))
        elif _state(record) != "idle":
            changes.append(Change("LOST", nodeid, f"was {record.status}, does not exist any more"))
    differences = [
        f"{package} was {baseline.versions[package]} and is {version}"
        for package, version in report.versions.items()
        if package in baseline.versions and baseline.versions[package] != version
    ]
    differences += [f"the simulator was {was} and is {now}" for was, now in simulators if was and now and was != now]
    how = "not compared, which rvads report compare does all the same" if same else "compared all the same"
    differences += [f"{plural(count, 'item')} {why}: {how}" for why, count in difference_counts.items() if why]
    return Comparison(name, tuple(changes), tuple(differences))


def with_baseline(report: Report, comparison: Comparison) -> Report:
    """Return the report with its comparison, and the kind of change in every record, under ``change``."""
    kinds = {change.nodeid: change.kind for change in comparison.changes}
    records = tuple(replace(record, change=kinds[record.nodeid]) for record in report.records)
    return dataclasses.replace(report, records=records, comparison=comparison)


def _state(record: Record | None) -> str:
    """Return ``absent``, ``passed``, ``known`` (a known failure), ``idle`` (not judged), ``violated``, ``error`` or ``flaky``."""
    if record is None:
        return "absent"
    if record.failed:
        # An error does not say what the verdict would be, so an error is never the same as a violation.
        return record.status.meaning if record.status.bad else "violated"
    if record.known:
        return "known"
    return "passed" if record.status.meaning == "passed" else "idle"


def _incomparable(record: Record, before: Record) -> str:
    """Return why an item can't be compared with the item of the baseline; an empty text if it can."""
    if record.place and before.place and record.place != before.place:
        return "at a junction that is not the same any more"
    drivers = [item.driver for item in (before, record) if isinstance(item, SimulatedItem) and item.driver]
    if len(set(drivers)) == 2:
        return f"driven by {drivers[0]} then and by {drivers[1]} now"
    if record.rule != before.rule or (record.formula and before.formula and record.formula != before.formula):
        return f"by a rule {record.rule} that is not the same any more"
    return ""


def _item_change(record: Record, before: Record | None, difference: str) -> Change:
    """Return the change of a test item, apart from its safety margins; `difference` is the result of `_incomparable`."""
    then, now = _state(before), _state(record)
    judged = then not in ("absent", "idle")
    if record.status is Outcome.NOT_RUN:
        # Skipping an item is a choice of its author. No author chooses that time runs out or that a session is interrupted.
        chosen = record.outcome == "skipped" and not record.late
        if before and chosen and judged:
            return Change("LOST", record.nodeid, f"was {before.status}, is skipped")
        return Change("NOT RUN", record.nodeid)
    was = before.status.value if before else ""
    then = "absent" if difference else then
    if now in BAD and then != now:
        changed = f"was {was}, is {record.status}: " if then in BAD else ""
        return Change("NEW", record.nodeid, changed + record.message.strip().partition("\n")[0])
    if difference and now not in BAD and judged:
        return Change("LOST", record.nodeid, f"was {was}, {difference}")
    match then, now:
        case (("violated" | "error" | "flaky" | "known"), "passed"):
            return Change("FIXED", record.nodeid)
        case "passed", "known":
            return Change("KNOWN", record.nodeid, str(record.known))
        case (("passed" | "violated" | "error" | "flaky" | "known"), "idle"):
            return Change("LOST", record.nodeid, f"was {was}, is {record.status}")
        case ("absent", _) | ("idle", ("passed" | "known")):
            return Change("ADDED", record.nodeid)
    return Change("UNCHANGED", record.nodeid)


def _eroded_margins(items: Sequence[Sequence[_Fall]]) -> str:
    """Return a line on the deepest fall of each safety margin among the items of a run."""
    falls: dict[str, tuple[float, float]] = {}
    for name, then, now in chain.from_iterable(items):
        if name not in falls or then - now > falls[name][0] - falls[name][1]:
            falls[name] = then, now
    margins = ", ".join(f"{name} {then:.2f} -> {now:.2f} s" for name, (then, now) in falls.items())
    return margins + (f", in {len(items)} items of its run" if len(items) > 1 else "")


def _falls(record: Record, before: Record) -> list[_Fall]:
    """Return the eroded safety margins of a test item, i.e. margins that fell below their thresholds."""
    margins: list[dict[str, float | None]] = []
    for item in (before, record):
        waits = [-i.margin for verdict in item.verdicts for i in verdict.instances if i.margin is not None]
        ttc, pet = (item.kpis.ttc, item.kpis.pet) if item.kpis else (None, None)
        margins.append({"ttc": ttc, "pet": pet, "margin": min(waits, default=None)})
    falls = []
    for name, threshold in MATTERS.items():
        then, now = (item_margins[name] for item_margins in margins)
        if then is not None and now is not None and now < threshold and then - now > _EROSION:
            falls.append((f"margin of {record.asks}" if name == "margin" else name, then, now))
    return falls
