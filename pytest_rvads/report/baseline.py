"""Changes since a baseline, that is, since an earlier report of the same tests. Test items are compared by node id.

A safety margin is a time: the time by which the vehicle that a rule obliges kept the rule, the shortest time to collision of the
run, or the shortest post-encroachment time of the run. All items of a run share the indicators of the run, so erosion is reported
once per run, for its first item, and not if an item of the run is NEW.

A margin has eroded if it has fallen by more than 0.5 s and is now below its threshold from the literature (`MATTERS`).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain

from msgspec import structs

from pytest_rvads.logic.outcome import BAD, Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import Change, Comparison, Report
from pytest_rvads.support.wording import plural

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
    records = tuple(structs.replace(record, change=kinds[record.nodeid]) for record in report.records)
    return replace(report, records=records, comparison=comparison)


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
