"""Sums over many junctions, in place of a table for each: per kind of junction, per rule, and the junctions, the worst first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pytest_rvads.report.outcome import Tallied, counted, told_in
from pytest_rvads.report.places import Place

__all__ = ["WORST", "Row", "Sums", "ranked", "sums"]

WORST = 20
"""Rows of a table of sums that short forms show."""


@dataclass(frozen=True, slots=True)
class Row:
    """A kind of junction, a rule, or a junction, and what was found there."""

    name: str
    told: tuple[str, ...]
    """What stands between its name and its verdicts, a text per heading."""
    counts: tuple[int, ...]
    """How many verdicts there are of each kind."""


@dataclass(frozen=True, slots=True)
class Sums:
    """A table of sums."""

    corner: str
    """What a row is: kind, rule, or junction."""
    headings: tuple[str, ...]
    """Of what stands between the name of a row and its verdicts."""
    kinds: tuple[Tallied, ...]
    """Of verdicts, those that there are, a column each; None: known failures."""
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The headings of all columns."""
        return (self.corner, *self.headings, *("known" if kind is None else kind.small for kind in self.kinds))

    @property
    def styles(self) -> tuple[str, ...]:
        """How a terminal shows each column."""
        plain = [""] * (1 + len(self.headings))
        return (*plain, *("" if kind is None else kind.style.removeprefix("bold ") for kind in self.kinds))

    @property
    def sides(self) -> tuple[Literal["left", "right"], ...]:
        """On which side the texts of each column begin: numbers end below each other."""
        return tuple("left" if heading in (self.corner, "kind") else "right" for heading in self.columns)

    def cells(self, row: Row) -> tuple[str, ...]:
        """Return a text per column; none where there are no such verdicts."""
        return (row.name, *row.told, *(str(count) if count else "" for count in row.counts))

    def plain(self) -> Iterator[str]:
        """Yield a line per row."""
        for row in self.rows:
            told = ", ".join(f"{heading} {text}" for heading, text in zip(self.headings, row.told, strict=True))
            yield f"{self.corner} {row.name}: {told}: {counted(dict(zip(self.kinds, row.counts, strict=True)))}"


def sums(places: Sequence[Place]) -> tuple[Sums, ...]:
    """Return a row per kind of junction, by name; per rule, what went wrong most often first; and per junction, as `ranked`."""
    kinds: dict[str, list[Place]] = {}
    junctions: dict[str, list[Place]] = {}
    rules: dict[str, dict[str, Counter[Tallied]]] = {}
    for place in ranked(places):
        kinds.setdefault(place.kind, []).append(place)
        junctions.setdefault(place.junction, []).append(place)
        for rule, counts in place.counts.items():
            found = rules.setdefault(rule, {})
            found[place.junction] = found.get(place.junction, Counter()) + counts
    told = told_in(_total(place.tally for place in places))

    def table(corner: str, headings: Sequence[str], rows: Iterable[tuple[str, tuple[object, ...], Counter[Tallied]]]) -> Sums:
        made = (Row(name, tuple(map(str, texts)), tuple(counts[kind] for kind in told)) for name, texts, counts in rows)
        return Sums(corner, tuple(headings), tuple(told), tuple(made))

    def runs(found: Sequence[Place]) -> tuple[int, int]:
        return sum(len(place.runs | place.wrong) for place in found), sum(len(place.wrong) for place in found)

    of_rules = {rule: _total(found.values()) for rule, found in rules.items()}
    by_kind = sorted(kinds.items(), key=lambda entry: _natural(entry[0]))
    by_rule = sorted(rules.items(), key=lambda entry: (-_bad(of_rules[entry[0]]), _natural(entry[0])))
    return (
        table(
            "kind",
            ("junctions", "runs", "wrong"),
            ((kind, (len({p.junction for p in found}), *runs(found)), _total(p.tally for p in found)) for kind, found in by_kind),
        ),
        table(
            "rule",
            ("junctions", "wrong at"),
            ((rule, (len(found), sum(_bad(c) > 0 for c in found.values())), of_rules[rule]) for rule, found in by_rule),
        ),
        table(
            "junction",
            ("kind", "runs", "wrong"),
            ((name, (found[0].kind, *runs(found)), _total(p.tally for p in found)) for name, found in junctions.items()),
        ),
    )


def ranked(places: Iterable[Place]) -> list[Place]:
    """Return places, the worst first: where something went wrong in a larger share of the runs, then in more, then by name."""
    return sorted(places, key=lambda place: (-place.share, -len(place.wrong), _natural(place.junction)))


def _total(counts: Iterable[Counter[Tallied]]) -> Counter[Tallied]:
    return sum(counts, Counter())


def _bad(counts: Counter[Tallied]) -> int:
    return sum(count for kind, count in counts.items() if kind and kind.bad)


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """Return what names are sorted by so that 26 comes before 124."""
    parts = re.split(r"(\d+)", name)
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]
