"""The figures of a report: lines on rules, extreme indicators, junctions, durations, requirements and coverage.

A figure is a function of the counts of a report; `FIGURES` has them in the order of the report.

A cell is (junction, class, configuration, rule). With a subject (vehicle under test), the cell also names its entrance and the
traffic around it; if somebody walks, also the pedestrians. A cell of a recording is (junction, recording, rule). A cell is
exercised if a rule required something of the system under test in the cell, and the verdict is PASS, FAIL or OPEN, expected or
not. A cell counts once, even if several tests or several variants of a test contain the cell.

A pair is the movement of a vehicle under test and a conflicting movement of another vehicle. Pairs that a rotation of the
junction maps onto each other count as one pair, if the rotation keeps lanes, movements and signs. The difference of two arrivals
is the arrival of the other vehicle at its line minus the arrival of the vehicle under test at its line. A difference is tried if
a rule required something of the system under test in the run, and counted once per run. The largest untested gap of a pair is the
longest stretch between -6 s and 6 s without a tried difference; a pair without any tried difference has no gap and is not met.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.counting import EXERCISED, EXTREMES, TICKS, TOGETHER, UNSELECTED, Counts, Site, counts_of
from pytest_rvads.report.rollup import FEW, junction_lines, many, ranked
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.measured import APART, PairKpis
from pytest_rvads.support.installed import libraries
from pytest_rvads.support.wording import first, plural

_REASONS = 5
"""Largest number of reasons for left-out junctions in the short form."""
LISTED = 10
"""Largest number of lines of a kind in the short form, and of slowest runs in the long form."""
_NAMED = 5
"""Largest number of junctions named per reason."""
BIN = 0.5
"""Width of a bin of a histogram [s]."""
SIMULTANEOUS = (
    f"every two vehicles arrived within {TOGETHER:g} s of each other: no gap between arrivals was tried; use grid='arrivals' or "
    "@rvads.critical"
)
"""The line that a report shows if at least one difference was tried and no tried difference is above `TOGETHER`."""
_LAST, _WIDTH = round(APART * TICKS), round(BIN * TICKS)
"""The longest difference that a histogram contains, and the width of a bin [ticks]."""
_BARS = "·▁▂▃▄▅▆▇█"
"""The bars of a histogram in text, from an empty bin to the fullest bin."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """The number of planned and of exercised cells."""

    planned: int
    """Cells that the collected tests expand to, before tests are deselected."""
    exercised: int
    idle: dict[str, int]
    """Number of cells that were not exercised, by reason: the status of their test items, or ``not selected``."""

    @property
    def percent(self) -> float:
        """Percentage of the planned cells that were exercised; 0 if no cells were planned."""
        return 100 * self.exercised / self.planned if self.planned else 0.0

    def __str__(self) -> str:
        # Rounded down: 99.96 % is not 100.0 %.
        share = int(self.percent * 10) / 10
        idle = ", ".join(f"{count} {why}" for why, count in self.idle.items())
        return f"{self.exercised}/{self.planned} cells exercised ({share:.1f} %)" + (f": {idle}" if idle else "")


def cell_coverage(counts: Counts) -> Coverage:
    """Return the numbers of planned and of exercised cells."""
    ranks = Counter(counts.cells.values())
    # A cell with several outcomes counts under its worst outcome, which has the least severity.
    reasons = [(outcome.small, ranks[outcome.severity]) for outcome in Outcome.worst_first()]
    idle = {why: count for why, count in (*reasons, ("not selected", ranks[UNSELECTED])) if count}
    return Coverage(len(counts.cells), ranks[EXERCISED], idle)


def shortfall(report: Report, least: float) -> str:
    """Return a sentence if less than the share `least` of the planned cells [%] was exercised; an empty text if it is not."""
    coverage = cell_coverage(counts_of(report))
    if coverage.planned and 100 * coverage.exercised >= least * coverage.planned:
        return ""
    return f"coverage is below {least:g} %: {coverage}"


def dropped(report: Report, most: int | None = None) -> list[str]:
    """Return a line on starts faster than the braking envelope v(d)max, and a line on scenarios without room to start."""
    return [
        f"{sum(tests.values())} {what}{'' if sum(tests.values()) == 1 else 's'} {why} left out: "
        + first([f"{count} of {test}" for test, count in tests.items()], most)
        for what, why, tests in (
            ("point", "beyond v(d)max", report.left_out),
            ("scenario", "in which a vehicle has no room where it starts", report.unfit),
        )
        if tests
    ]


@dataclass(frozen=True, slots=True)
class Tried:
    """The differences between arrivals that runs have tried, for a pair of conflicting movements or for several pairs."""

    counts: Counter[int] = field(default_factory=Counter)
    """How often each difference was tried, by the difference in ticks."""

    @property
    def orders(self) -> tuple[int, int, int]:
        """Numbers of runs in which the other vehicle arrived before, together with, and after the vehicle under test."""
        tie = round(TOGETHER * TICKS)
        first = sum(count for tick, count in self.counts.items() if tick < -tie)
        later = sum(count for tick, count in self.counts.items() if tick > tie)
        return first, self.counts.total() - first - later, later

    @property
    def histogram(self) -> tuple[int, ...]:
        """Number of tried differences per bin, from -6 s to 6 s; a bin contains its lower end, and the last bin also 6 s."""
        bins = [0] * (2 * _LAST // _WIDTH)
        for tick, count in self.counts.items():
            bins[min((tick + _LAST) // _WIDTH, len(bins) - 1)] += count
        return tuple(bins)

    @property
    def gap(self) -> tuple[float, float]:
        """Begin and end of the longest stretch from -6 s to 6 s without a tried difference [s]; of equal stretches the first."""
        begin, end = max(pairwise(sorted({-_LAST, *self.counts, _LAST})), key=lambda stretch: stretch[1] - stretch[0])
        return begin / TICKS, end / TICKS

    @property
    def length(self) -> float:
        """Length of the longest stretch without a tried difference [s]."""
        begin, end = self.gap
        return round(end - begin, 2)

    def bars(self) -> str:
        """Return the histogram of tried differences as a text with a character per bin."""
        most = max(self.histogram)
        return "".join(_BARS[-(-count * (len(_BARS) - 1) // most)] for count in self.histogram)

    def bins(self) -> str:
        """Return the number of tried differences in every bin that is not empty, in words: ``3 from 0 to 0.5 s``."""
        starts = (number * BIN - APART for number in range(2 * _LAST // _WIDTH))
        filled = [(start, count) for start, count in zip(starts, self.histogram, strict=True) if count]
        return ", ".join(f"{count} from {start:g} to {start + BIN:g} s" for start, count in filled)

    def __str__(self) -> str:
        """Return the largest untested gap in words."""
        begin, end = self.gap
        return f"{self.length:g} s ({begin:g} to {end:g} s)"


def pairs_tried(counts: Counts) -> Iterator[tuple[Site, str, str, Tried]]:
    """Yield every tried pair: junction, movement of the vehicle under test, movement of the other vehicle, differences."""
    for site in counts.pairs:
        for (own, other), differences in sorted(counts.met.get(site, {}).items()):
            moves = ["{}.{} to {}.{}".format(*move[0], *move[1]) for move in (own, other)]
            yield site, moves[0], moves[1], Tried(differences)


def largest_gap(counts: Counts) -> float:
    """Return the length of the largest untested gap of all tried pairs [s]; the whole range if no pair was tried."""
    return max((tried.length for *_, tried in pairs_tried(counts)), default=2 * APART)


def simultaneous(counts: Counts) -> bool:
    """Return whether a difference between arrivals was tried, and the vehicles of every tried difference arrived together."""
    orders = [tried.orders for *_, tried in pairs_tried(counts)]
    return bool(orders) and not any(first or later for first, _, later in orders)


def arrivals_line(counts: Counts) -> str:
    """Return a line with the number of tried pairs, the orders of arrival, and the largest untested gap."""
    rows = list(pairs_tried(counts))
    head = f"arrivals: {len(rows)} of {plural(sum(counts.pairs.values()), 'pair')} of conflicting movements met"
    if not rows:
        return head
    first, together, later = (sum(tried.orders[order] for *_, tried in rows) for order in range(3))
    site, own, other, worst = max(rows, key=lambda row: row[3].length)
    return (
        f"{head}, the other vehicle {first} times first, {together} together, {later} later; largest untested gap {worst} "
        f"at {site}, vehicle under test from lane {own}, other vehicle from {other}"
    )


def untested(report: Report, most: float) -> str:
    """Return a sentence if the largest untested gap between arrivals is longer than `most` [s]; an empty text if it is not."""
    counts = counts_of(report)
    return f"the largest untested gap is above {most:g} s: {arrivals_line(counts)}" if largest_gap(counts) > most else ""


def total(counts: Counts) -> str:
    """Return a line with the numbers of verdicts by outcome, and of runs."""
    tally: Counter[Tallied] = Counter()
    for (_, _, outcome), count in counts.verdicts.items():
        tally[outcome] += count
    runs = set[str]().union(*counts.runs.values(), *counts.wrong.values())
    return f"{plural(tally.total(), 'verdict')} on {plural(len(runs), 'run')}: {counted(tally) or 'none'}"


def makers(counts: Counts) -> Iterator[tuple[str, str]]:
    """Yield a fact per system under test and per simulator: name, code or version, and number of runs."""
    for (verb, name, source), runs in sorted(counts.makers.items(), key=lambda entry: entry[0][0]):
        engine = next(iter(libraries(name)), "") if verb == "simulated" else ""
        version = counts.report.versions.get(engine)
        code = source or (f"{engine} {version}" if version else "")
        yield f"{verb} by", f"{name}{f' ({code})' if code else ''}: {plural(len(runs), 'run')}"


def _titles(counts: Counts, short: bool) -> Iterator[str]:
    titles = [f"{rule} ({title})" for rule, title in sorted(counts.titles.items())]
    if titles:
        yield f"rules: {first(titles, LISTED if short else None)}"


def _extremes(counts: Counts, _: bool) -> Iterator[str]:
    """Yield at most two lines of extremes: the nearest encounters; the hardest braking, longest wait and longest delay."""
    for word, indicators in EXTREMES:
        texts = []
        for name, key, _pick, unit in indicators:
            if key not in counts.extremes:
                continue
            value, entry, record = counts.extremes[key]
            agents = " and ".join(entry.agents) if isinstance(entry, PairKpis) else entry.agent
            touch = ""
            if key == "ttc" and value == 0.0:  # bodies are covered by discs, which reach beyond the bodies
                collision = counts.contacts.get(record.where)
                if collision in (None, Outcome.PASS, Outcome.NA):
                    touch = ": discs around the bodies touch" + (", the bodies do not" if collision else "")
                else:
                    touch = f": no_collision is {collision}"
            texts.append(f"{name} {value:.2f} {unit} ({agents} in {record.where}{touch})")
        if texts:
            yield f"{word}: {', '.join(texts)}"


def _junctions(counts: Counts, _: bool) -> Iterator[str]:
    """Yield lines on each junction; of many junctions, only on the worst."""
    sites = ranked(counts)[:FEW] if many(counts) else list(counts.first)
    for site in sites:
        yield from junction_lines(counts, site)
    if further := len(counts.first) - len(sites):
        yield f"... and {plural(further, 'more junction')}, with no worse verdicts"


def _computing(counts: Counts, _: bool) -> Iterator[str]:
    """Yield a line per driver in another process: numbers of decisions and runs, mean and longest time of a decision."""
    for stack, computed in counts.computed.items():
        decisions = sum(computing.decisions for _, computing in computed)
        mean = math.fsum(computing.compute for _, computing in computed) / max(decisions, 1)
        longest = max(0.0, *(computing.longest for _, computing in computed))
        extent = f"{plural(decisions, 'decision')} in {plural(len({run for run, _ in computed}), 'run')}"
        yield f"{stack}: {extent}, {1000 * mean:.2g} ms each, {1000 * longest:.2g} ms the longest"


def _excess(counts: Counts, _: bool) -> Iterator[str]:
    if counts.excess:
        requests, largest = zip(*counts.excess.values(), strict=True)
        extent = f"{plural(sum(requests), 'acceleration')} in {plural(len(requests), 'run')}"
        yield f"beyond the limits of the vehicle: {extent}, the largest {max(largest, key=abs):.3g} m/s^2"


def _slowest(counts: Counts, short: bool) -> Iterator[str]:
    """Yield a line that names the slowest runs; in the short form, only if a run took a second."""
    slow = sorted(counts.report.seconds.items(), key=lambda entry: -entry[1])[: 3 if short else LISTED]
    if slow and slow[0][1] >= (1.0 if short else 0.0):
        yield "slowest: " + ", ".join(f"{duration:.1f} s {run}" for run, duration in slow)


def _requirements(counts: Counts, short: bool) -> Iterator[str]:
    """Yield a line per requirement with its verdicts by status."""
    by_requirement: dict[str, Counter[Tallied]] = {}
    for (requirement, outcome), count in counts.requirements.items():
        by_requirement.setdefault(requirement, Counter())[outcome] += count
    yield from () if short else (f"requirement {name}: {counted(tally)}" for name, tally in sorted(by_requirement.items()))


def _versions(counts: Counts, short: bool) -> Iterator[str]:
    versions = ", ".join(f"{name} {version}" for name, version in counts.report.versions.items())
    if versions and not short:
        yield f"versions: {versions}"


FIGURES: tuple[tuple[Callable[[Counts, bool], Iterable[str]], int | None], ...] = (
    (_titles, None),
    (_extremes, None),
    (_junctions, None),
    (_computing, LISTED),
    (_excess, None),
    (_slowest, None),
    (_requirements, None),
    (_versions, None),
    (lambda counts, _: [f"coverage: {cell_coverage(counts)}"], None),
    (lambda counts, _: [arrivals_line(counts)] if any(counts.pairs.values()) else [], None),
    (lambda counts, short: dropped(counts.report, LISTED if short else None), None),
    (lambda counts, short: refused(counts.report, _REASONS if short else None), LISTED),
)
"""The figures in the order of a report, each with the largest number of its lines in the short form; None for no bound."""


def figures(counts: Counts, short: bool) -> Iterator[str]:
    """Yield the lines of all figures; the short form has no lines on requirements and versions, and lists are cut."""
    for figure, most in FIGURES:
        lines = list(figure(counts, short))
        few = most if short and most is not None else len(lines)
        yield from lines[:few]
        if lines[few:]:
            yield f"... and {len(lines) - few} more"


def refused(report: Report, most: int | None = None) -> list[str]:
    """Return a line per reason why junctions, movements or scenarios are left out, and a line per sampled test."""
    reasons = sorted(report.refused.items(), key=lambda entry: -len(entry[1]))
    lines = []
    for reason, names in reasons[:most]:
        what = plural(len(names), "movement" if " from entrance " in names[0] else "test" if "::" in names[0] else "junction")
        lines.append(f"{what}{'' if reason.startswith('with ') else ' left out:'} {reason}: {first(names, _NAMED)}")
    further_names = {name for _, names in reasons[len(lines) :] for name in names}
    if further_names:
        lines.append(f"{plural(len(further_names), 'junction')} left out for other reasons: reports in files say which")
    return lines + [f"{sample}: {sample.test}" for sample in report.drawn]
