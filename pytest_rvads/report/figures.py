"""The figures of a report: lines on rules, extreme indicators, junctions, durations, requirements and coverage.

A figure is a function of the counts of a report; `FIGURES` has them in the order of the report.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.counting import EXTREMES, Counts
from pytest_rvads.report.coverage import arrivals_line, cell_coverage, dropped
from pytest_rvads.report.rollup import FEW, junction_lines, many, ranked
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.measured import PairKpis
from pytest_rvads.support.wording import first, plural

_ENGINES = {"bullet": "pybullet", "mujoco": "mujoco", "sumo": "libsumo"}
"""By name of a simulator, the package on which the simulator is built."""
_REASONS = 5
"""Largest number of reasons for left-out junctions in the short form."""
LISTED = 10
"""Largest number of lines of a kind in the short form, and of slowest runs in the long form."""
_NAMED = 5
"""Largest number of junctions named per reason."""


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
        engine = _ENGINES.get(name, "") if verb == "simulated" else ""
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
        mean = math.fsum(computed.seconds) / max(computed.decisions, 1)
        extent = f"{plural(computed.decisions, 'decision')} in {plural(len(computed.runs), 'run')}"
        yield f"{stack}: {extent}, {1000 * mean:.2g} ms each, {1000 * computed.longest:.2g} ms the longest"


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
