"""What ``rvads town`` leaves behind: replays, the page, the report, and the summary on standard output."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from pytest_rvads.cli.common import say, show
from pytest_rvads.logic.check import check
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.failure_page import failure_pages
from pytest_rvads.report.files import save
from pytest_rvads.report.outline import Figures, Head, Notes, outline
from pytest_rvads.report.session_report import exit_status
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.satellites.campaigns.progress_bar import progressing
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.satellites.campaigns.town import Town, tallied, town_records
from pytest_rvads.satellites.campaigns.town_page import town_page
from pytest_rvads.satellites.campaigns.town_tally import CauseTally, JunctionTally
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors import Failed, Progress, gathered
from pytest_rvads.support.storage import slug, write_file
from pytest_rvads.support.wording import quoted

__all__ = ["Order", "written"]

MOST = 100
"""Most pages that are drawn: a page is some 100 KB, and nobody looks at more."""
_OTHERWISE = "the same start gave another run when it was simulated once more, so its verdicts mean little"


@dataclass(frozen=True, slots=True)
class Order:
    """What was asked for, understood."""

    town: Town
    simulator: Simulator
    again: str
    """The command that runs some of it again; ids follow."""
    reports: tuple[Path, ...] = ()
    """Files to write reports to, beside that in the folder of the town."""


def written(order: Order, results: Results, folder: Path, executor: Executor | int | None, cut: str = "") -> int:
    """Write replays, page and report, print the summary, and return the exit status.

    Args:
        order: what was asked for.
        results: all there are.
        folder: to write to.
        executor: to simulate examples on.
        cut: why results are missing, or nothing.
    """
    town = order.town
    judged = town.judged(results)
    tallies, replays = tallied(judged), Replays()
    if not cut:
        with progressing("replays") as progress:
            replays = draw_replays(town, tallies, folder, order.again, executor, order.simulator, progress)
    missing = sum(town.counts.values()) - sum(tally.runs for tally in tallies.values())
    notes = (
        [f"INCOMPLETE: {cut or 'results are missing'}, {missing} runs have no result: run it again to go on"] if missing else []
    )
    notes += [*town.notes(), *replays.notes]
    outcomes = {outcome for tally in tallies.values() for outcome in tally.outcomes}
    status = exit_status(outcomes | ({Outcome.FLAKY} if replays.flaky else set()), whole=not missing)
    report = replace(
        results.report(again=order.again),
        records=town_records(judged, {key: f"{folder / page}" for key, page in replays.looks.items()}, replays.flaky),
        notes=tuple(notes),
        exitstatus=status,
        complete=not missing,
        extents=town.plan.extents(),
        refused=town.refused(),
        drawn=town.drawn(),
        unfit={place.name: found.scenarios for place in town.plan.places if (found := town.plan.left_out(place))},
    )
    title = f"rvads town: {', '.join(map.stem for map in town.maps)}"
    drawn = (f"{one.taken:,} of {one.total:,} {one.what} drawn, seed {one.seed}" for one in report.drawn)
    blocks = [Notes((*notes, *drawn)), *(block for block in outline(report) if isinstance(block, Head | Figures))]
    page = town_page(title, blocks, town.pictures(), town.sites(), tallies, replays.looks, order.again)
    write_file(folder / "town.html", page.encode())
    for path in (folder / "town.json", *order.reports):
        save(path, report)
    show(report)
    for note in notes:
        say(note)
    say(f"look: {folder / 'town.html'}")
    return status


@dataclass(frozen=True, slots=True)
class Replays:
    """The drawn replays."""

    looks: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """By name of a run and rule, the path of the page relative to the folder, with the time of the violation."""
    flaky: Mapping[str, Divergence] = field(default_factory=dict)
    """Runs, by name, that differed when they were simulated again."""
    notes: tuple[str, ...] = ()
    """Sentences on replays that were not drawn, with reasons."""


class _Job(NamedTuple):
    name: str
    case: Case
    rules: tuple[Rule, ...]
    notes: str
    simulator: Simulator | None


class _Drawn(NamedTuple):
    name: str
    hash: str
    pages: tuple[tuple[str, float, str], ...]
    """Triples of rule, time [s] and HTML."""


def draw_replays(  # noqa: PLR0913 - a campaign, and the place of its simulation and drawings
    town: Town,
    tallies: Mapping[str, JunctionTally],
    folder: Path,
    again: str,
    executor: Executor | int | None = None,
    simulator: Simulator | None = None,
    progress: Progress | None = None,
) -> Replays:
    """Simulate the first run of every cause again, and write replay pages of its violations.

    Args:
        town: the town.
        tallies: the results, by junction.
        folder: the folder in which the folder ``replays`` is made.
        again: the command that runs a part of the town again; the pages name the command.
        executor: the executor of the simulations, see `spread`.
        simulator: the simulator of the runs.
        progress: called after every run.

    Raises:
        OSError: a page can't be written.
    """
    examples = list(_examples(tallies))
    jobs = _jobs(town, examples[:MOST], again, simulator)
    hashes = {cause.run: cause.hash for cause in examples}
    looks: dict[tuple[str, str], str] = {}
    flaky: dict[str, Divergence] = {}
    troubles: list[str] = []
    for done, (number, answer) in enumerate(gathered(_draw, jobs, executor, batch=1), start=1):
        if progress is not None:
            progress(done, len(jobs))
        if isinstance(answer, Failed):
            troubles.append(f"{jobs[number].name}: {answer.error}")
            continue
        if hashes[answer.name] not in (None, answer.hash):
            flaky[answer.name] = Divergence("hash", text=_OTHERWISE)
        for rule, time, html in answer.pages:
            look = f"replays/{slug(f'{answer.name}-{rule}')}.html"
            write_file(folder / look, html.encode())
            looks[answer.name, rule] = f"{look}#t={time:.2f}"
    notes = []
    if len(examples) > MOST:
        notes.append(f"{len(examples) - MOST} of {len(examples)} causes have no replay: the first {MOST} were drawn")
    if troubles:
        notes.append(f"{len(troubles)} replays could not be drawn, the first: {min(troubles)}")
    if flaky:
        notes.append(f"{len(flaky)} runs came out differently when they were simulated once more, the first: {min(flaky)}")
    return Replays(looks, flaky, tuple(notes))


def _jobs(town: Town, examples: Sequence[CauseTally], again: str, simulator: Simulator | None) -> list[_Job]:
    """Return the jobs to simulate, one per run, by name."""
    wanted: dict[str, set[str]] = {}
    for cause in examples:
        wanted.setdefault(cause.run, set()).add(cause.rule)
    cases = town.case_of(wanted)
    found = []
    for name in sorted(cases):
        rules = tuple(rule for rule in town.plan.rules(cases[name].scenario.place) if rule.name in wanted[name])
        found.append(_Job(name, cases[name], rules, f"again     {again} {quoted(name)}", simulator))
    return found


def _examples(tallies: Mapping[str, JunctionTally]) -> Iterator[CauseTally]:
    """Yield the causes: first the first cause of every junction, then the second causes, so that every junction has pages."""
    groups: Sequence[list[CauseTally]] = [
        [cause for _, causes in tally.grouped() for cause in causes if cause.title != "unsure"] for tally in tallies.values()
    ]
    for turn in range(max(map(len, groups), default=0)):
        yield from (group[turn] for group in groups if turn < len(group))


def _draw(job: _Job) -> _Drawn:
    """Simulate and judge a run, and draw its violations."""
    run = simulate(job.case, job.simulator)
    pages = []
    for rule in job.rules:
        try:
            verdict = check(run, rule)
            page = next(failure_pages(run, verdict, rule, f"{verdict.explanation}\n{job.notes}"))
        except RvadsError:  # a run that a fault ended at once has no page
            continue
        pages.append((rule.name, page.time, page.html))
    return _Drawn(job.name, run.hash, tuple(pages))
