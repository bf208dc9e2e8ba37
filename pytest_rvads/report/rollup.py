"""Counts the scenarios and verdicts at each junction in one pass over the records of a report, and sums them over junctions.

Sums are tables with a row per kind of junctions, per rule, and per junction, worst first. A report shows sums instead of a table
per junction if it has more junctions, tables or columns than anybody reads.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from pytest_rvads.logic.outcome import Outcome, Tallied, counted, told_in
from pytest_rvads.report.coverage import TOGETHER
from pytest_rvads.report.record import Record, RecordedItem, SimulatedItem
from pytest_rvads.report.session_report import Extent, Move
from pytest_rvads.support.wording import plural

FEW = 4
"""Largest number of junctions that a report lists singly; a report on more junctions has sums, and the worst junctions."""

_NEAR = 2.0
"""Two vehicles met if less than this time passed between their stays on a shared stretch [s]."""
_TOGETHER, _AFTER, _BEFORE, _ALONE = "together with others", "after others", "before others", "alone"
"""How the subject arrived, compared with the vehicle whose arrival was nearest in time."""


class AtJunctions:
    """Counts records by junction; simulated and recorded runs at a junction are counted separately."""

    def __init__(self, totals: Mapping[int, tuple[int, int]], extents: Mapping[str, Extent] | None = None) -> None:
        self._totals, self._extents = totals, extents or {}
        self._junctions: dict[tuple[str, bool], AtJunction] = {}

    def add(self, record: Record) -> None:
        """Count a record at its junction and among the simulated or the recorded runs."""
        key = record.junction, isinstance(record, RecordedItem)
        if key not in self._junctions:
            recorded = isinstance(record, RecordedItem)
            totals = None if recorded else self._totals.get(record.ways)
            extent = None if recorded else self._extents.get(record.junction)
            self._junctions[key] = AtJunction(record, totals, extent)
        self._junctions[key].add(record)

    @property
    def many(self) -> bool:
        """Whether the records come from more than `FEW` junctions."""
        return len({junction for junction, _ in self._junctions}) > FEW

    @property
    def junctions(self) -> list[AtJunction]:
        """The junctions in the order of their first records."""
        return list(self._junctions.values())


class AtJunction:
    """The scenarios and verdicts at a junction, of simulated or of recorded runs.

    `totals` are the numbers of classes and of full scenarios (a vehicle at every arm), if they are known. An `extent` has the
    numbers of a junction that no `totals` describe.
    """

    def __init__(self, first: Record, totals: tuple[int, int] | None = None, extent: Extent | None = None) -> None:
        self.junction, self.kind = first.junction, first.kind
        self.counts: dict[str, Counter[Tallied]] = {}
        """By rule, the number of verdicts of each kind."""
        self.runs: set[str] = set()
        """Hashes of the judged runs."""
        self.wrong: set[str] = set()
        """Runs with an unexpected failure."""
        self._recorded, self._totals, self._extent = isinstance(first, RecordedItem), totals, extent
        self._turns = extent.turns if extent else first.ways
        self._full = {"arms": _Full(), "lanes": _Full()}
        """Full scenarios by occupancy (a vehicle per arm or per lane); a junction with one lane per arm has only ``arms``."""
        self._partial: dict[str, set[int | str]] = {"arms": set(), "lanes": set()}
        self._pairs: set[tuple[Move, Move]] = set()
        self._arrivals = Arrivals()

    def add(self, record: Record) -> None:
        """Count a record of this junction."""
        counts = self.counts.get(record.asks) or self.counts.setdefault(record.asks, Counter())
        counts[record.counts_as] += 1
        if record.status.bad and not record.known:
            self.wrong.add(record.ran_as)
        if not record.hash or record.status is Outcome.ERROR:
            return
        if record.hash not in self.runs:
            self._arrivals.add(record)
        self.runs.add(record.hash)
        if not isinstance(record, SimulatedItem):
            return
        if record.cls:
            # The scenarios of a class that its number alone identifies have a vehicle per arm.
            self._full["lanes" if self._extent and record.orbit else "arms"].add(record, self._turns)
        if not self._extent:
            return
        name = record.orbit or record.cls
        # No two vehicles start on the same arm.
        alone = "_" not in record.scenario or all(len(arm.replace("0", "")) <= 1 for arm in record.scenario.split("_"))
        for occupancy, names in self._partial.items():
            if occupancy == "lanes" or alone:
                names.add(name)
        vehicles = [agent for agent in record.agents if agent.name.startswith("a")]  # others are pedestrians and parked
        self._pairs.update(combinations(sorted({(agent.entrance, agent.exit) for agent in vehicles}), 2))

    @property
    def tally(self) -> Counter[Tallied]:
        """The number of verdicts of each kind."""
        return sum(self.counts.values(), Counter())

    @property
    def share(self) -> float:
        """The share of the runs at the junction with an unexpected failure, from 0 to 1."""
        return len(self.wrong) / max(len(self.runs | self.wrong), 1)

    def lines(self) -> list[str]:
        """Return a line on scenarios and verdicts, and a line on the orders in which the vehicles arrived."""
        return [self.line(), *self._arrivals.lines(self.junction)]

    def line(self) -> str:
        """Return a line on the exercised scenarios at the junction, and on the verdicts by status."""
        verdicts = self.tally
        name = f"{self.junction} as recorded" if self._recorded else self.junction
        exercised = ", ".join([*self._covered(), plural(len(self.runs), "run"), plural(verdicts.total(), "verdict")])
        idle = sorted(rule for rule, counts in self.counts.items() if set(counts) == {Outcome.NA})
        return f"{name}: {exercised}: {counted(verdicts)}" + (f"  (never applicable: {', '.join(idle)})" if idle else "")

    def _covered(self) -> Iterator[str]:
        """Yield the numbers of exercised scenarios in words; also of partial scenarios and of pairs, if tests asked for these."""
        if self._extent is None:
            if not self._recorded:
                totals = self._totals and (*self._totals, self._totals[1])
                yield from self._full["arms"].texts(totals)
            return
        extent = self._extent
        for occupancy, class_totals in extent.classes.items():
            where = (
                {"arms": " with a vehicle per arm", "lanes": " with one per lane"}[occupancy] if len(extent.classes) > 1 else ""
            )
            yield from self._full[occupancy].texts(class_totals, where)
        for occupancy, total in extent.partial.items():
            yield f"{len(self._partial[occupancy])}/{total} classes with partial ones"
        apart = "lanes" not in extent.classes
        for name, pairs in (("pairs of movements", extent.pairs), ("conflicting pairs", extent.conflicts)):
            possible = [pair for pair in pairs if not (apart and pair[0][0][0] == pair[1][0][0])]
            ruled_out = len(pairs) - len(possible)
            if possible:
                more = f" (and {ruled_out} of one arm, only with occupancy='lanes')" if ruled_out else ""
                yield f"{len(self._pairs.intersection(possible))}/{len(possible)} {name}{more}"


class _Full:
    """Counts the exercised full scenarios (a vehicle at every arm, or at every lane) of a junction."""

    def __init__(self) -> None:
        self._classes: set[int] = set()
        self._scenarios: set[str] = set()
        self._seated: set[tuple[str, int]] = set()
        """Scenarios with the entrance of the subject; scenarios that are equal up to rotation are one entry (see `_seated`)."""

    def add(self, record: SimulatedItem, turns: int) -> None:
        """Add the record of a run at a junction with `turns` rotations."""
        self._classes.add(record.cls)
        self._scenarios.add(record.scenario)
        if record.seat is not None:
            self._seated.add(_seated(record.scenario, record.seat, turns))

    def texts(self, totals: tuple[int, int, int] | None, where: str = "") -> Iterator[str]:
        """Yield the numbers of exercised classes and scenarios in words."""
        classes, scenarios, seats = (f"/{total}" for total in totals) if totals else ("", "", "")
        yield f"{_share_of(self._classes, classes, 'class', 'classes')}{where}"
        if self._seated:
            yield f"{_share_of(self._seated, seats, 'class', 'classes')} with a subject{where}"
        yield f"{_share_of(self._scenarios, scenarios, 'scenario')}{where}"


def _share_of(exercised: Sized, total: str, thing: str, several: str = "") -> str:
    """Return the number of exercised things and the number of all things: ``7/24 classes``; ``1 class`` if the total is empty."""
    return f"{len(exercised)}{total} {several or f'{thing}s'}" if total else plural(len(exercised), thing, several)


def _seated(scenario: str, seat: int, turns: int) -> tuple[str, int]:
    """Return the first in sort order of all rotations of a scenario with its subject; all rotations have the same result."""
    code = scenario.replace("_", "")
    rows = range(0, len(code), len(code) // turns)
    return min((code[len(code) - row :] + code[: len(code) - row], (seat + row) % len(code)) for row in rows)


class Arrivals:
    """Counts runs by whether the subject (vehicle under test) arrived before or after the vehicle with the nearest arrival."""

    def __init__(self) -> None:
        self._gaps: dict[str, list[float]] = defaultdict(list)
        """By order of arrival, the time between the arrivals of the subject and of the vehicle nearest in time, per run [s]."""
        self._apart = 0

    def add(self, record: Record) -> None:
        """Count the order of arrival in the run of a record, once per run."""
        subject = next((verdict.subject for verdict in record.verdicts if verdict.subject), None)
        kpis = record.kpis
        times = {vehicle.agent: vehicle.arrival for vehicle in kpis.vehicles if vehicle.arrival is not None} if kpis else {}
        if kpis is None or subject not in times:
            return
        gaps = [time - times[subject] for agent, time in times.items() if agent != subject]
        gap = min(gaps, key=abs, default=0.0)
        order = _AFTER if gap < -TOGETHER else _BEFORE if gap > TOGETHER else _TOGETHER
        self._gaps[order if gaps else _ALONE].append(abs(gap))
        self._apart += bool(gaps) and (kpis.pet is None or kpis.pet >= _NEAR)

    def lines(self, junction: str) -> list[str]:
        """Return a line on the orders of arrival at a junction, with the gaps; no line if no run has a subject."""
        total = sum(map(len, self._gaps.values()))
        texts: list[str] = []
        for order in (_TOGETHER, _AFTER, _BEFORE, _ALONE):
            if gaps := self._gaps.get(order):
                least, most = f"{min(gaps):.1f}", f"{max(gaps):.1f}"
                wide = f" (by {least if least == most else f'{least} to {most}'} s)" if order in (_AFTER, _BEFORE) else ""
                of_all = "" if texts else f" of {plural(total, 'run')}"
                texts.append(f"{order} in {len(gaps)}{of_all}{wide}")
        line = f"{junction}: the subject arrived {', '.join(texts)}"
        if self._apart:
            line += f"; in {plural(self._apart, 'run')} no vehicles were within {_NEAR:g} s on a shared stretch"
        return [line] if texts else []


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
