"""Changes since a baseline, that is, since an earlier report of the same tests.

Items are compared by node id. A safety margin is a time: the margin of the bound vehicle against its rule, the shortest time to
collision of the run, or the shortest post-encroachment time of the run. All items of a run share the indicators of the run, so
erosion is reported once per run, for its first item.

A margin that has fallen has eroded only below a threshold of the literature.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from msgspec import structs

from pytest_rvads.logic.outcome import BAD, Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import Change, Comparison, Report
from pytest_rvads.support.wording import first, plural

__all__ = ["MATTERS", "compare", "with_baseline"]

MATTERS = {"ttc": 4.0, "pet": 5.0, "margin": 5.0}
"""Safety margins, and from where on they are so large that it does not matter by how much they fall [s].

- ``ttc``: drivers keep control of situations with a time to collision (Hayward, HRB 1972) above 4 s (van der Horst and Hogema,
  Time-to-collision and collision avoidance systems, ICTCT 1993).
- ``pet``: a post-encroachment time (Allen, Shin, Cooper, TRR 1978) above 5 s is no conflict (Gettman and others, Surrogate
  safety assessment model and validation, FHWA-HRT-08-051, 2008).
- ``margin``: how long the bound vehicle waited beyond what its rule asks is a gap between two vehicles as that is, so the same.
"""
_NAMED = 5
"""Margins of a run that are told; the rest is counted."""
_Fall = tuple[float, float]
"""A margin before and now [s]."""


def compare(
    report: Report, baseline: Report, name: str, erosion: float, gone: Callable[[str], bool], *, same: bool = True
) -> Comparison:
    """Return what changed between a baseline and a session.

    Args:
        report: of the session.
        baseline: the earlier report.
        name: what to call it.
        erosion: of a margin that is less than it should be, see `MATTERS`, a fall by more than this is told [s]; once per run, at
            its first item in which one fell, and not where something of the run is NEW. Its other items are UNCHANGED.
        gone: whether an item of the baseline that the session has no record of does not exist any more; otherwise it was
            not selected.
        same: compare an item only where driver, junction and formula are those of the baseline. Elsewhere an item that
            fails is NEW, and an item that was judged in the baseline and does not fail is LOST.
    """
    before = {record.nodeid: record for record in baseline.records}
    pairs = ((before[record.nodeid], record) for record in report.records if record.nodeid in before)
    simulators = dict.fromkeys(
        (was.simulator, now.simulator) for was, now in pairs if isinstance(was, SimulatedItem) and isinstance(now, SimulatedItem)
    )
    changes: list[Change] = []
    eroded: dict[str, _Eroded] = {}
    broken: set[str] = set()
    difference_counts: Counter[str] = Counter()
    for record in report.records:
        earlier = before.pop(record.nodeid, None)
        difference = _other(record, earlier) if earlier else ""
        difference_counts[difference] += 1
        change = _change(record, earlier, difference if same else "")
        if change.kind == "NEW":
            broken.add(record.ran_as)
        elif (
            change.kind == "UNCHANGED" and earlier and _state(record) == "passed" and (falls := _falls(record, earlier, erosion))
        ):
            eroded.setdefault(record.ran_as, _Eroded(len(changes))).add(falls)
        changes.append(change)
    for run, erosion_of_run in eroded.items():
        if run not in broken:
            changes[erosion_of_run.number] = Change("ERODED", changes[erosion_of_run.number].nodeid, erosion_of_run.text())
    for nodeid, record in before.items():
        if gone(nodeid):
            changes += [Change("LOST", nodeid, f"was {record.status}, does not exist any more")] if _judged(record) else []
        else:
            changes.append(Change("OUTSIDE", nodeid))
    differences = [
        f"{package} was {baseline.versions[package]} and is {version}"
        for package, version in report.versions.items()
        if package in baseline.versions and baseline.versions[package] != version
    ]
    differences += [f"the simulator was {was} and is {now}" for was, now in simulators if was and now and was != now]
    how = "not compared, which --rvads-baseline-of=any allows" if same else "compared all the same"
    differences += [
        f"{plural(count, 'item')} {difference}: {how}" for difference, count in difference_counts.items() if difference
    ]
    return Comparison(name, tuple(changes), tuple(differences))


def with_baseline(report: Report, comparison: Comparison) -> Report:
    """Return the report with its comparison, and the kind of change in every record, under ``change``."""
    kinds = {change.nodeid: change.kind for change in comparison.changes}
    records = tuple(structs.replace(record, change=kinds[record.nodeid]) for record in report.records)
    return replace(report, records=records, comparison=comparison)


def _state(record: Record | None) -> str:
    """Return the meaning of an outcome, or ``absent`` or ``known``; whatever the verdicts, a failed item is no passed one."""
    if record is None:
        return "absent"
    if record.failed:
        # An error says nothing of what the verdict would be, so it is never the same as a violation.
        return record.status.meaning if record.status.bad else "violated"
    if record.known:
        return "known"
    return "passed" if record.status.meaning == "passed" else "idle"


def _judged(record: Record | None) -> bool:
    return record is not None and _state(record) != "idle"


def _other(record: Record, before: Record) -> str:
    """Return why what an item was is no basis for what it is, where both are known; else nothing."""
    if record.place and before.place and record.place != before.place:
        return "at a junction that is not the same any more"
    drivers = [item.driver for item in (before, record) if isinstance(item, SimulatedItem) and item.driver]
    if len(set(drivers)) == 2:
        return f"driven by {drivers[0]} then and by {drivers[1]} now"
    if record.rule != before.rule or (record.formula and before.formula and record.formula != before.formula):
        return f"by a rule {record.rule} that is not the same any more"
    return ""


def _change(record: Record, before: Record | None, other: str) -> Change:
    """Return what became of an item that the session has a record of, but for its margins; `other` as of `_other`."""
    if record.status is Outcome.NOT_RUN:
        # A skip that somebody wrote into a test is a choice; being too late, or interrupted, is none.
        chosen = record.outcome == "skipped" and not record.late
        if before and chosen and _judged(before):
            return Change("LOST", record.nodeid, f"was {before.status}, is skipped")
        return Change("NOT RUN", record.nodeid)
    then, now = "absent" if other else _state(before), _state(record)
    was = before.status.value if before else ""
    if now in BAD and then != now:
        changed = f"was {was}, is {record.status}: " if then in BAD else ""
        return Change("NEW", record.nodeid, changed + record.message.strip().partition("\n")[0])
    if other and now not in BAD and _judged(before):
        return Change("LOST", record.nodeid, f"was {was}, {other}")
    kind, text = _kept(then, now)
    return Change(kind, record.nodeid, text.format(was=was, now=record.status, known=record.known))


def _kept(then: str, now: str) -> tuple[str, str]:
    """Return the kind of a change that is no new failure, and what to say of it."""
    match then, now:
        case (("violated" | "error" | "flaky" | "known"), "passed"):
            return "FIXED", ""
        case "passed", "known":
            return "KNOWN", "{known}"
        case (("passed" | "violated" | "error" | "flaky" | "known"), "idle"):
            return "LOST", "was {was}, is {now}"
        case ("absent", _) | ("idle", ("passed" | "known")):
            return "ADDED", ""
    return "UNCHANGED", ""


@dataclass(slots=True)
class _Eroded:
    """A run of which margins fell."""

    number: int
    """Of its first item in which one did, among the changes."""
    items: int = 0
    """In how many one did."""
    falls: dict[str, _Fall] = field(default_factory=dict)
    """By margin; where items differ the deepest fall."""

    def add(self, falls: Iterable[tuple[str, _Fall]]) -> None:
        """Add the fallen margins of an item."""
        self.items += 1
        for name, (then, now) in falls:
            if name not in self.falls or then - now > self.falls[name][0] - self.falls[name][1]:
                self.falls[name] = then, now

    def text(self) -> str:
        """Return which margins fell, in one line."""
        margins = first([f"{name} {then:.2f} -> {now:.2f} s" for name, (then, now) in self.falls.items()], _NAMED)
        return margins + (f", in {self.items} items of its run" if self.items > 1 else "")


def _falls(record: Record, before: Record, least: float) -> list[tuple[str, _Fall]]:
    """Return which margins that matter fell by more than `least` [s]; that of a rule with its name."""
    now, then = _margins(record), _margins(before)
    return [
        (f"margin of {record.asks}" if name == "margin" else name, (then[name], value))
        for name, value in now.items()
        if name in then and value < MATTERS[name] and then[name] - value > least
    ]


def _margins(record: Record) -> dict[str, float]:
    """Return the safety margins of an item [s], the larger the safer."""
    waits = [-i.margin for verdict in record.verdicts for i in verdict.instances if i.margin is not None]
    kpis = record.kpis
    margins = {
        "ttc": kpis.ttc if kpis else None,
        "pet": kpis.pet if kpis else None,
        "margin": min(waits, default=None),
    }
    return {name: value for name, value in margins.items() if value is not None}
