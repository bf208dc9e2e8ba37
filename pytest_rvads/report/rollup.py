"""Lines on the scenarios and verdicts at each junction, and tables that sum the verdicts over junctions.

Sums are tables with a row per kind of junctions, per rule, and per junction, worst first. A report shows sums instead of a table
per junction if it has more junctions, tables or columns than anybody reads.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pytest_rvads.logic.outcome import Outcome, Tallied, counted, told_in
from pytest_rvads.report.counting import NEAR, TOGETHER, Counts, Site
from pytest_rvads.support.wording import natural, plural

FEW = 4
"""Largest number of junctions that a report lists singly; a report on more junctions has sums, and the worst junctions."""
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
        """Yield a line of text per row."""
        for row in self.rows:
            texts = ", ".join(f"{heading} {text}" for heading, text in zip(self.headings, row.texts, strict=True))
            yield f"{self.corner} {row.name}: {texts}: {counted(dict(zip(self.kinds, row.counts, strict=True)))}"


def many(counts: Counts) -> bool:
    """Return whether the records come from more than `FEW` junctions."""
    return len({site.junction for site in counts.first}) > FEW


def ranked(counts: Counts) -> list[Site]:
    """Return the junctions, the worst first: by the share of failing runs, then by the number of failing runs, then by name."""

    def badness(site: Site) -> tuple[object, ...]:
        runs, wrong = _runs(counts, [site])
        return -wrong / max(runs, 1), -wrong, natural(site.junction)

    return sorted(counts.first, key=badness)


def _runs(counts: Counts, sites: Sequence[Site]) -> tuple[int, int]:
    """Return the number of runs at some junctions, and the number of these runs with a failure."""
    wrong = [counts.wrong.get(site, set()) for site in sites]
    runs = [counts.runs.get(site, set()) | failed for site, failed in zip(sites, wrong, strict=True)]
    return sum(map(len, runs)), sum(map(len, wrong))


def junction_lines(counts: Counts, site: Site) -> Iterator[str]:
    """Yield a line on the exercised scenarios and the verdicts at a junction, and one on the orders in which vehicles arrived."""
    by_rule: defaultdict[str, Counter[Tallied]] = defaultdict(Counter)
    for (place, rule, outcome), count in counts.verdicts.items():
        if place == site:
            by_rule[rule][outcome] += count
    verdicts = sum(by_rule.values(), Counter[Tallied]())
    runs = plural(len(counts.runs.get(site, ())), "run")
    exercised = ", ".join([*_covered(counts, site), runs, plural(verdicts.total(), "verdict")])
    idle = sorted(rule for rule, tally in by_rule.items() if set(tally) == {Outcome.NA})
    never = f"  (never applicable: {', '.join(idle)})" if idle else ""
    yield f"{site}: {exercised}: {counted(verdicts)}{never}"
    orders = counts.orders.get(site, [])
    gaps = [gap for gap in orders if gap is not None]
    texts: list[str] = []
    for order, times, wide in (
        ("together with others", [gap for gap in gaps if abs(gap) <= TOGETHER], False),
        ("after others", [-gap for gap in gaps if gap < -TOGETHER], True),
        ("before others", [gap for gap in gaps if gap > TOGETHER], True),
        ("alone", [0.0] * (len(orders) - len(gaps)), False),
    ):
        if times:
            span = " to ".join(dict.fromkeys((f"{min(times):.1f}", f"{max(times):.1f}")))
            of_all = "" if texts else f" of {plural(len(orders), 'run')}"
            texts.append(f"{order} in {len(times)}{of_all}{f' (by {span} s)' if wide else ''}")
    if texts:
        apart = counts.apart[site]
        more = f"; in {plural(apart, 'run')} no vehicles were within {NEAR:g} s on a shared stretch" if apart else ""
        yield f"{site.junction}: the subject arrived {', '.join(texts)}{more}"


def _covered(counts: Counts, site: Site) -> Iterator[str]:
    """Yield the numbers of exercised scenarios in words; also of partial scenarios and of pairs, if tests asked for these."""
    if site.recorded:
        return
    extent = counts.report.extents.get(site.junction)
    if extent is None:
        totals = counts.report.totals.get(counts.first[site].ways)
        yield from _full(counts, site, "arms", totals and (*totals, totals[1]))
        return
    for occupancy, class_totals in extent.classes.items():
        where = {"arms": " with a vehicle per arm", "lanes": " with one per lane"}[occupancy] if len(extent.classes) > 1 else ""
        yield from _full(counts, site, occupancy, class_totals, where)
    for occupancy, total in extent.partial.items():
        yield f"{len(counts.seen.get((site, f'partial {occupancy}'), ()))}/{total} classes with partial ones"
    apart = "lanes" not in extent.classes
    tried = counts.seen.get((site, "pairs"), set())
    for name, pairs in (("pairs of movements", extent.pairs), ("conflicting pairs", extent.conflicts)):
        possible = [pair for pair in pairs if not (apart and pair[0][0][0] == pair[1][0][0])]
        ruled_out = len(pairs) - len(possible)
        if possible:
            more = f" (and {ruled_out} of one arm, only with occupancy='lanes')" if ruled_out else ""
            yield f"{len(tried.intersection(possible))}/{len(possible)} {name}{more}"


def _full(counts: Counts, site: Site, occupancy: str, totals: tuple[int, int, int] | None, where: str = "") -> Iterator[str]:
    """Yield the numbers of exercised classes and full scenarios in words, with the numbers of all, if they are known."""
    of_classes, of_scenarios, of_seats = totals or (None, None, None)
    for kind, total, thing, several, what in (
        ("classes", of_classes, "class", "classes", ""),
        ("seated", of_seats, "class", "classes", " with a subject"),
        ("scenarios", of_scenarios, "scenario", "scenarios", ""),
    ):
        number = len(counts.seen.get((site, f"{kind} {occupancy}"), ()))
        if number or kind != "seated":
            yield f"{plural(number, thing, several) if total is None else f'{number}/{total} {several}'}{what}{where}"


def sums(counts: Counts) -> tuple[Sums, ...]:
    """Return tables of sums: a row per kind of junctions (by name), per rule (most failures first), per junction (`ranked`)."""
    kinds: defaultdict[str, list[Site]] = defaultdict(list)
    junctions: defaultdict[str, list[Site]] = defaultdict(list)
    for site in ranked(counts):
        kinds[counts.first[site].kind].append(site)
        junctions[site.junction].append(site)
    of_site: defaultdict[Site, Counter[Tallied]] = defaultdict(Counter)
    of_rule: defaultdict[str, Counter[Tallied]] = defaultdict(Counter)
    places: defaultdict[str, set[str]] = defaultdict(set)
    wrong_at: defaultdict[str, set[str]] = defaultdict(set)
    for (site, rule, outcome), count in counts.verdicts.items():
        of_site[site][outcome] += count
        of_rule[rule][outcome] += count
        places[rule].add(site.junction)
        if outcome and outcome.bad:
            wrong_at[rule].add(site.junction)
    occurring = tuple(told_in(sum(of_site.values(), Counter())))

    def table(corner: str, headings: Sequence[str], rows: Iterable[tuple[str, Iterable[object], Counter[Tallied]]]) -> Sums:
        made = (Row(name, tuple(map(str, texts)), tuple(map(tally.__getitem__, occurring))) for name, texts, tally in rows)
        return Sums(corner, tuple(headings), occurring, tuple(made))

    def summed(sites: Sequence[Site]) -> Counter[Tallied]:
        return sum((of_site[site] for site in sites), Counter())

    def failures(rule: str) -> int:
        return sum(count for kind, count in of_rule[rule].items() if kind and kind.bad)

    of_kinds = (
        (kind, (len({site.junction for site in sites}), *_runs(counts, sites)), summed(sites))
        for kind, sites in sorted(kinds.items(), key=lambda entry: natural(entry[0]))
    )
    by_rule = (
        (rule, (len(places[rule]), len(wrong_at[rule])), of_rule[rule])
        for rule in sorted(of_rule, key=lambda rule: (-failures(rule), natural(rule)))
    )
    by_junction = (
        (name, (counts.first[sites[0]].kind, *_runs(counts, sites)), summed(sites)) for name, sites in junctions.items()
    )
    return (
        table("kind", ("junctions", "runs", "wrong"), of_kinds),
        table("rule", ("junctions", "wrong at"), by_rule),
        table("junction", ("kind", "runs", "wrong"), by_junction),
    )
