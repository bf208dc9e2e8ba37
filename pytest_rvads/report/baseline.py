"""What changed since a baseline: an earlier report of the same tests.

Items are compared by node id. A safety margin is time, so that one threshold serves them all: how long the bound vehicle
waited beyond what its rule asks for, and of the item's run the shortest time to collision and post-encroachment time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Report

__all__ = ["Change", "Comparison", "compare", "with_baseline"]

_WORDS = {
    "NEW": "fails now and did not before, or is new and fails",
    "FIXED": "failed before, also as a known failure, and passes now",
    "ERODED": "passes both times, with less of a margin",
    "LOST": "was judged before, and now is NA, is another place, or does not exist",
    "KNOWN": "passed before and is marked as a known failure now",
    "ADDED": "is judged now and was not before",
    "UNCHANGED": "the same",
    "NOT RUN": "was selected and did not run",
    "OUTSIDE": "is in the baseline and was not selected now",
}
"""Every kind of change, in the order of the summary."""
_TOLD = ("NEW", "FIXED", "ERODED", "LOST", "KNOWN")
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
            ", ".join(f"{found[kind]} {kind}" for kind in _WORDS if found[kind]) or "nothing to compare"
        )

    def lines(self, most: int | None = None) -> Iterator[str]:
        """Yield the changes worth telling, a line each.

        Args:
            most: per kind; the rest is counted.
        """
        yield from self.versions
        for kind in _TOLD:
            told = [change for change in self.changes if change.kind == kind]
            for change in told[:most]:
                yield f"{kind:<7} {change.nodeid}" + (f"  {change.text}" if change.text else "")
            if most is not None and len(told) > most:
                yield f"{kind:<7} ... and {len(told) - most} more"


def compare(report: Report, baseline: Report, name: str, erosion: float, gone: Callable[[str], bool]) -> Comparison:
    """Return what changed between a baseline and a session.

    Args:
        report: of the session.
        baseline: the earlier report.
        name: what to call it.
        erosion: a margin that falls by more than this is told [s].
        gone: whether an item of the baseline that the session has no record of does not exist any more; otherwise it was
            not selected.
    """
    before = {record["nodeid"]: record for record in baseline.records}
    changes = [_change(record, before.pop(record["nodeid"], None), erosion) for record in report.records]
    for nodeid, record in before.items():
        if gone(nodeid):
            changes += [Change("LOST", nodeid, f"was {record['status']}, does not exist any more")] if _judged(record) else []
        else:
            changes.append(Change("OUTSIDE", nodeid))
    differences = (
        f"{package} was {baseline.versions[package]} and is {version}"
        for package, version in report.versions.items()
        if package in baseline.versions and baseline.versions[package] != version
    )
    return Comparison(name, tuple(changes), tuple(differences))


def with_baseline(report: Report, comparison: Comparison) -> Report:
    """Return the report with its comparison, and the kind of change in every record, under ``change``."""
    kinds = {change.nodeid: change.kind for change in comparison.changes}
    records = tuple(record | {"change": kinds[record["nodeid"]]} for record in report.records)
    return replace(report, records=records, comparison=comparison)


_FAILED = ("violated", "error", "flaky")


def _state(record: Record | None) -> str:
    if record is None:
        return "absent"
    if record["outcome"] == "failed":
        # An error says nothing of what the verdict would be, so it is never the same as a violation.
        return {"ERROR": "error", "NOT JUDGED": "error", "FLAKY": "flaky"}.get(record["status"], "violated")
    if record["known"]:
        return "known"
    return "passed" if record["status"] in ("PASS", "PROVOKED", "UNAVOIDABLE") else "idle"


def _judged(record: Record) -> bool:
    return _state(record) != "idle"


def _elsewhere(record: Record, before: Record | None) -> bool:
    """Tell whether the junction of an item is not the one it was: another map under the same name."""
    places = [found.get("place") for found in (record, before or {})]
    return None not in places and places[0] != places[1]


def _change(record: Record, before: Record | None, erosion: float) -> Change:
    """Return what became of an item that the session has a record of."""
    nodeid, now = record["nodeid"], _state(record)
    if record["status"] == "NOT RUN":
        # A skip that somebody wrote into a test is a choice; being too late, or interrupted, is none.
        chosen = record["outcome"] == "skipped" and not record["message"].startswith("NOT RUN: ")
        if chosen and before is not None and _judged(before):
            return Change("LOST", nodeid, f"was {before['status']}, is skipped")
        return Change("NOT RUN", nodeid)
    moved = _elsewhere(record, before)
    then = "absent" if moved else _state(before)
    was = "" if before is None else before["status"]
    match then, now:
        case _, ("violated" | "error" | "flaky") if then == now:
            return Change("UNCHANGED", nodeid)
        case _, ("violated" | "error" | "flaky"):
            changed = f"was {was}, is {record['status']}: " if then in _FAILED else ""
            return Change("NEW", nodeid, changed + record["message"].strip().partition("\n")[0])
        case "absent", _ if moved and before is not None and _judged(before):
            return Change("LOST", nodeid, f"was {was}, at a junction that is not the same any more")
        case (("violated" | "error" | "flaky" | "known"), "passed"):
            return Change("FIXED", nodeid)
        case "passed", "known":
            return Change("KNOWN", nodeid, record["known"])
        case (("passed" | "violated" | "error" | "flaky" | "known"), "idle"):
            return Change("LOST", nodeid, f"was {was}, is {record['status']}")
        case (("absent" | "idle"), ("passed" | "known")):
            return Change("ADDED", nodeid)
        case "absent", _:
            return Change("ADDED", nodeid)
    lost = _erosion(record, before or {}, erosion) if now == "passed" else ""
    return Change("ERODED", nodeid, lost) if lost else Change("UNCHANGED", nodeid)


def _erosion(record: Record, before: Record, least: float) -> str:
    """Return which margins fell by more than `least` [s], or nothing."""
    now, then = _margins(record), _margins(before)
    return ", ".join(
        f"{name} {then[name]:.2f} -> {value:.2f} s" for name, value in now.items() if name in then and then[name] - value > least
    )


def _margins(record: Record) -> dict[str, float]:
    """Return the safety margins of an item [s], the larger the safer."""
    waits = [-i["margin"] for v in record["verdicts"] for i in v.get("instances", ()) if i["margin"] is not None]
    found = {"margin": min(waits, default=None)} | {name: record.get("kpis", {}).get(name) for name in ("ttc", "pet")}
    return {name: value for name, value in found.items() if value is not None}
