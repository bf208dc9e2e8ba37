"""Writes the output of ``rvads town``: replays, the page, the report, the summary, and the progress on standard error.

The progress is a bar with the remaining time, or a line per tenth of the jobs if there is no terminal. This module is imported
only when a town is judged, because it imports rich.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar

from pytest_rvads.cli.common import say, show, warn
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check, sentence
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.failure_page import failure_pages
from pytest_rvads.report.files import save
from pytest_rvads.report.outline import Figures, Head, Notes, outline
from pytest_rvads.report.session_report import exit_status
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.satellites.campaigns.town import Town, tallied, town_records
from pytest_rvads.satellites.campaigns.town_page import town_page
from pytest_rvads.satellites.campaigns.town_tally import CauseTally, Tally
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors import Progress, gathered
from pytest_rvads.support.executors.teams import Failed
from pytest_rvads.support.storage import slug, write_file
from pytest_rvads.support.wording import quoted

MOST = 100
"""Largest number of runs whose replay pages are drawn; a page has some 100 KB, and nobody looks at more pages."""
INTERRUPTED = "INCOMPLETE: interrupted"
"""Note on results that end with an interruption by Ctrl-C or a signal."""
_OTHERWISE = "the same start gave another run when it was simulated again, so its verdicts mean little"


def written(
    town: Town,
    simulator: Simulator,
    again: str,
    results: Results,
    folder: Path,
    executor: Executor | int | None,
    cut: str = "",
) -> int:
    """Write replays, page and report, print the summary, and return the exit status; ids after `again` repeat runs."""
    tallies, replays = tallied(results), Replays()
    if not cut:
        with progressing("replays") as progress:
            replays = draw_replays(
                tallies,
                town.case_of,
                town.plan.rules,
                lambda name: f"{again} {quoted(name)}",
                folder,
                executor,
                simulator,
                progress,
            )
    missing = town.runs - sum(tally.runs for tally in tallies.values())
    notes = (
        [f"INCOMPLETE: {cut or 'results are missing'}, {missing} runs have no result: run it again to continue"]
        if missing
        else []
    )
    notes += [*town.notes(), *replays.notes]
    complete = not missing and INTERRUPTED not in notes
    outcomes = {outcome for tally in tallies.values() for outcome in tally.outcomes}
    status = exit_status(outcomes | ({Outcome.FLAKY} if replays.flaky else set()), complete=complete)
    report = replace(
        results.report(again=again),
        records=town_records(results, {key: f"{folder / page}" for key, page in replays.looks.items()}, replays.flaky),
        notes=tuple(notes),
        exitstatus=status,
        complete=complete,
        extents=town.plan.extents(),
        refused=town.refused(),
        drawn=town.drawn(),
        unfit={place.name: left_out.scenarios for place in town.plan.places if (left_out := town.plan.left_out(place))},
    )
    title = f"rvads town: {', '.join(map.stem for map in town.maps)}"
    blocks = [
        Notes((*notes, *map(str, report.drawn))),
        *(block for block in outline(report) if isinstance(block, Head | Figures)),
    ]
    page = town_page(title, blocks, town.pictures(), town.sites(), tallies, replays.looks, again)
    write_file(folder / "town.html", page.encode())
    save(folder / "town.json", report)
    show(report)
    for note in notes:
        say(note)
    say(f"look: {folder / 'town.html'}")
    return status


@dataclass(frozen=True, slots=True)
class Replays:
    """The drawn replay pages of a town or of a driver in a league, and notes on replays that were not drawn."""

    looks: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """By name of a run and rule, the path of the page relative to the folder of the town, ending in the time of the violation."""
    flaky: Mapping[str, Divergence] = field(default_factory=dict)
    """By name of a run, its difference; only runs that differed when they were simulated again for their replay pages."""
    notes: tuple[str, ...] = ()
    """Sentences on replay pages that could not be drawn, with the reasons."""


def draw_replays(
    tallies: Mapping[str, Tally],
    case_of: Callable[[Collection[str]], Mapping[str, Case]],
    rules_at: Callable[[Junction], tuple[Rule, ...]],
    again: Callable[[str], str],
    folder: Path,
    executor: Executor | int | None = None,
    simulator: Simulator | None = None,
    progress: Progress | None = None,
) -> Replays:
    """Simulate the example run of every cause of failures again, and write replay pages of its violations."""
    examples = list(_examples(tallies))
    rules_of_run: dict[str, set[str]] = {}
    for cause in examples[:MOST]:
        rules_of_run.setdefault(cause.run, set()).add(cause.rule)
    cases = case_of(rules_of_run)
    names = sorted(cases)
    jobs = [
        (
            cases[name],
            tuple(rule for rule in rules_at(cases[name].scenario.place) if rule.name in rules_of_run[name]),
            again(name),
        )
        for name in names
    ]
    hashes = {cause.run: cause.hash for cause in examples}
    looks: dict[tuple[str, str], str] = {}
    flaky: dict[str, Divergence] = {}
    troubles: list[str] = []
    notes = []
    try:
        for finished, (number, answer) in enumerate(gathered(partial(_draw, simulator), jobs, executor, batch=1), start=1):
            name = names[number]
            if progress is not None:
                progress(finished, len(jobs))
            if isinstance(answer, Failed):
                troubles.append(f"{name}: {sentence(answer.error)}")
                continue
            hash, pages = answer
            if hash != hashes[name]:
                flaky[name] = Divergence("hash", text=_OTHERWISE)
            for rule, time, html in pages:
                look = f"replays/{slug(f'{name}-{rule}')}.html"
                write_file(folder / look, html.encode())
                looks[name, rule] = f"{look}#t={time:.2f}"
    except KeyboardInterrupt:
        notes.append(INTERRUPTED)
    if len(examples) > MOST:
        notes.append(f"{len(examples) - MOST} of {len(examples)} causes have no replay: the first {MOST} were drawn")
    if troubles:
        notes.append(f"{len(troubles)} replays could not be drawn, the first: {min(troubles)}")
    if flaky:
        notes.append(f"{len(flaky)} runs were different when they were simulated again, the first: {min(flaky)}")
    return Replays(looks, flaky, tuple(notes))


def _examples(tallies: Mapping[str, Tally]) -> Iterator[CauseTally]:
    """Yield the gravest cause with a run of every junction, then the second gravest, so that every junction gets a replay."""
    groups = [[c for _, found in tally.grouped() for c in found if c.title != "unsure" and c.hash] for tally in tallies.values()]
    for turn in range(max(map(len, groups), default=0)):
        yield from (group[turn] for group in groups if turn < len(group))


def _draw(simulator: Simulator | None, job: tuple[Case, Sequence[Rule], str]) -> tuple[str, list[tuple[str, float, str]]]:
    """Simulate and judge a run; return its hash, and per replay page the rule, the time of the violation [s] and the HTML."""
    case, rules, again = job
    run = simulate(case, simulator)
    pages = []
    for rule in rules:
        try:
            verdict = check(run, rule)
            page = next(failure_pages(run, verdict, rule, f"{verdict.explanation}\nagain     {again}"))
        except RvadsError:  # a run that a fault ended at its start has no page
            continue
        pages.append((rule.name, page.time, page.html))
    return run.hash, pages


@contextmanager
def progressing(what: str) -> Iterator[Progress]:
    """Yield a function that shows progress on standard error, called with the number of finished jobs and of all jobs."""
    if not sys.stderr.isatty():
        yield _Lines(what)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with ProgressBar(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(what, total=None)

        def show(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield show


class _Lines:
    def __init__(self, what: str) -> None:
        self._what, self._last_tenth = what, -1

    def __call__(self, done: int, total: int) -> None:
        tenth = 10 * done // max(total, 1)
        if tenth > self._last_tenth and done:
            self._last_tenth = tenth
            warn(f"{done}/{total} {self._what}")
