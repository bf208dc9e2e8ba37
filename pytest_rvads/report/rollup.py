"""Sums of verdicts over many junctions: tables with a row per kind of junctions, per rule, and per junction, worst first.

A report shows sums instead of a table per junction if it has more junctions, tables or columns than anybody reads.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pytest_rvads.logic.outcome import Tallied, counted, told_in
from pytest_rvads.report.at_junctions import AtJunction

__all__ = ["WORST", "Row", "Sums", "natural", "ranked", "sums"]

WORST = 20
"""Largest number of rows of a table of sums in short outputs."""


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table of sums: the verdicts at a kind of junctions, by a rule, or at a junction."""

    name: str
    texts: tuple[str, ...]
    """The texts between the name of the row and its verdicts, one per heading."""
    counts: tuple[int, ...]
    """Number of verdicts of each kind."""


@dataclass(frozen=True, slots=True)
class Sums:
    """A table with sums of verdicts, a row per kind of junctions, rule or junction."""

    corner: str
    """Heading of the first column: kind, rule, or junction."""
    headings: tuple[str, ...]
    """Headings of the columns between the name of a row and its verdicts."""
    kinds: tuple[Tallied, ...]
    """The kinds of verdicts that occur, a column for each kind; None stands for known failures."""
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The headings of all columns."""
        return (self.corner, *self.headings, *("known" if kind is None else kind.small for kind in self.kinds))

    @property
    def styles(self) -> tuple[str, ...]:
        """The style of each column on a terminal."""
        plain = [""] * (1 + len(self.headings))
        return (*plain, *("" if kind is None else kind.style.removeprefix("bold ") for kind in self.kinds))

    @property
    def sides(self) -> tuple[Literal["left", "right"], ...]:
        """The alignment of each column; numbers are aligned right."""
        return tuple("left" if heading in (self.corner, "kind") else "right" for heading in self.columns)

    def cells(self, row: Row) -> tuple[str, ...]:
        """Return the texts of the row, one per column; a text is empty for a kind without verdicts."""
        return (row.name, *row.texts, *(str(count) if count else "" for count in row.counts))

    def plain(self) -> Iterator[str]:
        """Yield the table as text, a line per row."""
        for row in self.rows:
            texts = ", ".join(f"{heading} {text}" for heading, text in zip(self.headings, row.texts, strict=True))
            yield f"{self.corner} {row.name}: {texts}: {counted(dict(zip(self.kinds, row.counts, strict=True)))}"


def sums(at_junctions: Sequence[AtJunction]) -> tuple[Sums, ...]:
    """Return tables of sums: a row per kind of junctions (by name), per rule (most failures first), per junction (`ranked`)."""
    kinds: dict[str, list[AtJunction]] = {}
    junctions: dict[str, list[AtJunction]] = {}
    rules: dict[str, dict[str, Counter[Tallied]]] = {}
    for at_junction in ranked(at_junctions):
        kinds.setdefault(at_junction.kind, []).append(at_junction)
        junctions.setdefault(at_junction.junction, []).append(at_junction)
        for rule, counts in at_junction.counts.items():
            by_junction_of_rule = rules.setdefault(rule, {})
            by_junction_of_rule[at_junction.junction] = by_junction_of_rule.get(at_junction.junction, Counter()) + counts
    occurring = told_in(_total(at_junction.tally for at_junction in at_junctions))
    of_rules = {rule: _total(by_junction_of_rule.values()) for rule, by_junction_of_rule in rules.items()}

    def row(name: str, texts: Iterable[object], counts: Counter[Tallied]) -> Row:
        return Row(name, tuple(map(str, texts)), tuple(counts[kind] for kind in occurring))

    of_kinds = [
        row(
            kind,
            (len({at_junction.junction for at_junction in group}), *_runs(group)),
            _total(at_junction.tally for at_junction in group),
        )
        for kind, group in sorted(kinds.items(), key=lambda entry: natural(entry[0]))
    ]
    by_rule = [
        row(rule, (len(by_junction_of_rule), sum(_bad(counts) > 0 for counts in by_junction_of_rule.values())), of_rules[rule])
        for rule, by_junction_of_rule in sorted(rules.items(), key=lambda entry: (-_bad(of_rules[entry[0]]), natural(entry[0])))
    ]
    by_junction = [
        row(name, (group[0].kind, *_runs(group)), _total(at_junction.tally for at_junction in group))
        for name, group in junctions.items()
    ]
    return (
        Sums("kind", ("junctions", "runs", "wrong"), tuple(occurring), tuple(of_kinds)),
        Sums("rule", ("junctions", "wrong at"), tuple(occurring), tuple(by_rule)),
        Sums("junction", ("kind", "runs", "wrong"), tuple(occurring), tuple(by_junction)),
    )


def ranked(at_junctions: Iterable[AtJunction]) -> list[AtJunction]:
    """Return the junctions, the worst first: by the share of failing runs, then by the number of failing runs, then by name."""
    return sorted(at_junctions, key=lambda junction: (-junction.share, -len(junction.wrong), natural(junction.junction)))


def _runs(junctions: Sequence[AtJunction]) -> tuple[int, int]:
    """Return the number of runs at some junctions, and the number of these runs with a failure."""
    return sum(len(junction.runs | junction.wrong) for junction in junctions), sum(len(junction.wrong) for junction in junctions)


def _total(counts: Iterable[Counter[Tallied]]) -> Counter[Tallied]:
    return sum(counts, Counter())


def _bad(counts: Counter[Tallied]) -> int:
    return sum(count for kind, count in counts.items() if kind and kind.bad)


def natural(name: str) -> list[tuple[bool, int, str, str]]:
    """Return a sort key that puts name 26 before name 124; a number can have more digits than Python's int() accepts."""
    parts = [(part, part.lstrip("0") if part.isdecimal() else "") for part in re.split(r"(\d+)", name)]
    return [(part.isdecimal(), len(digits), digits, part) for part, digits in parts]
