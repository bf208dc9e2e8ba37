"""The verdict matrix and the coverage of a session, as plain values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pytest_rvads.report.record import Record

__all__ = ["Matrix", "coverage", "group_of", "matrices"]


_CLASS = re.compile(r"-class(\d{2,})-")


@dataclass(frozen=True, slots=True)
class Matrix:
    """The verdicts of one test at one junction, like a table of the paper."""

    title: str
    columns: tuple[tuple[str, str], ...]
    """(configuration, rule) of each column."""
    rows: tuple[tuple[str, tuple[str, ...]], ...]
    """Classes with equal verdicts, and a text per column: ``pass``, ``3/4 fail``, ``NA``, ``xfail I3``."""

    def shortened(self, most: int) -> Matrix:
        """Return the matrix with at most so many rows: those in which something is wrong, then the first ones."""
        wrong = [any(bad in cell.upper() for cell in cells for bad in _BAD) for _, cells in self.rows]
        kept = sorted(sorted(range(len(self.rows)), key=lambda i: not wrong[i])[:most])
        return replace(self, rows=tuple(self.rows[i] for i in kept))


def matrices(records: Sequence[Record]) -> list[Matrix]:
    """Return a matrix per test file, test function, junction and kind of traffic, in the order of the items."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(group_of(record), []).append(record)
    return [_matrix(title, group) for title, group in groups.items()]


def group_of(record: Record) -> str:
    """Return the title of the matrix that a record belongs to."""
    among = f" among {record['traffic']} traffic" if record.get("traffic") else ""
    return f"{record['junction']}{among}   {record['nodeid'].partition('[')[0]}"


def _matrix(title: str, records: Sequence[Record]) -> Matrix:
    columns = tuple(sorted({(r["cfg"], _rule(r)) for r in records}, key=lambda c: (c[0], c[1])))
    cells: dict[int, dict[tuple[str, str], list[Record]]] = {}
    for record in records:
        cells.setdefault(record["cls"], {}).setdefault((record["cfg"], _rule(record)), []).append(record)
    alike: dict[tuple[str, ...], list[int]] = {}
    for number in sorted(cells):
        row = tuple(_text(cells[number].get(column, [])) for column in columns)
        alike.setdefault(row, []).append(number)
    width = max(map(_width, records))
    return Matrix(title, columns, tuple((_spans(numbers, width), row) for row, numbers in alike.items()))


def _width(record: Record) -> int:
    """Return how many digits the number of a class has in ids, at least two."""
    found = _CLASS.search(record["nodeid"])
    return len(found[1]) if found else 2


def _rule(record: Record) -> str:
    return record["rule"] or "run"


def _text(records: Sequence[Record]) -> str:
    """Return what a cell says: its status, or where the rows differ the bad ones with their share; known failures apart."""
    if not records:
        return ""
    kinds = Counter(_kind(r) for r in records)
    if len(kinds) == 1:
        return next(iter(kinds))
    bad = [kind for kind in _BAD if kinds[kind]] + sorted(kind for kind in kinds if kind.startswith("xfail"))
    shown = bad or [kind for kind in ("NOT RUN", "unavoidable", "provoked", "pass", "NA") if kinds[kind]]
    return ", ".join(f"{kinds[kind]}/{len(records)} {kind.lower() if kind in _BAD else kind}" for kind in shown)


_BAD = ("ERROR", "FLAKY", "FAIL", "NOT JUDGED", "OPEN")


def _kind(record: Record) -> str:
    known: str | None = record["known"]
    status: str = record["status"]
    if known:
        return f"xfail {known.partition(':')[0]}"
    return status.lower() if status in ("PASS", "PROVOKED", "UNAVOIDABLE") else status


def _spans(numbers: Sequence[int], width: int) -> str:
    """Return class numbers as ranges: ``01-04, 07``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a:0{width}d}" if a == b else f"{a:0{width}d}-{b:0{width}d}" for a, b in spans)


def coverage(records: Sequence[Record], totals: dict[int, tuple[int, int]]) -> list[str]:
    """Return a line per junction: what was exercised of it, and the verdicts by status.

    Args:
        records: of a session.
        totals: per number of ways, how many classes and how many full scenarios exist.
    """
    lines = []
    for junction in dict.fromkeys(r["junction"] for r in records):
        here = [r for r in records if r["junction"] == junction]
        classes, scenarios = totals[here[0]["ways"]]
        ran = [r for r in here if r.get("hash") and r["status"] != "ERROR"]
        seen = {r["cls"] for r in ran} - {0}
        members = {r["scenario"] for r in ran if r["cls"]}
        seated = {_from(r["scenario"], r["seat"]) for r in ran if r["cls"] and r["seat"] is not None}
        # With a vehicle under test among traffic there are as many classes as scenarios.
        seats = f"{len(seated)}/{scenarios} classes with a subject, " if seated else ""
        runs = {r["hash"] for r in ran}
        counts = Counter("known" if r["known"] else r["status"] for r in here)
        verdicts = ", ".join(f"{counts[s]} {w}" for s, w in _WORDS if counts[s])
        idle = sorted({_rule(r) for r in here} - {_rule(r) for r in here if r["status"] != "NA"})
        lines.append(
            f"{junction}: {len(seen)}/{classes} classes, {seats}{len(members)}/{scenarios} scenarios, {len(runs)} runs, "
            f"{len(here)} verdicts: {verdicts}" + (f"  (never applicable: {', '.join(idle)})" if idle else "")
        )
    return lines


def _from(scenario: str, seat: int) -> str:
    """Return a scenario as seen from a seat: equal ones are rotations of each other."""
    return scenario[seat:] + scenario[:seat]


_WORDS = (
    ("PASS", "pass"),
    ("FAIL", "fail"),
    ("OPEN", "open"),
    ("UNAVOIDABLE", "unavoidable"),
    ("PROVOKED", "provoked by traffic"),
    ("known", "known failures"),
    ("NA", "NA"),
    ("ERROR", "error"),
    ("FLAKY", "flaky"),
    ("NOT JUDGED", "not judged"),
    ("NOT RUN", "not run"),
)
