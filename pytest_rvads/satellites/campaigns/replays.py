"""Draws the replays of a campaign's failures."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from pytest_rvads.cli.common import progress
from pytest_rvads.logic.check import check, sentence
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import Record
from pytest_rvads.report.triage import ByText, causes, provoked, unavoidable
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.satellites.pages.replay import failure_pages
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors import Failed, gathered
from pytest_rvads.support.storage import slug, write_file

MOST = 100
"""Largest number of causes whose replay pages are drawn; a page has some 100 KB, and nobody looks at more pages."""
INTERRUPTED = "INCOMPLETE: interrupted"
"""Note on results that end with an interruption by Ctrl-C or a signal."""
_OTHERWISE = "the same start gave another run when it was simulated again, so its verdicts mean little"


class Replays(NamedTuple):
    """The drawn replay pages of a campaign, and notes on replays that were not drawn."""

    looks: Mapping[str, str] = {}
    """By id of an item, the path of its page, ending in the time of the violation."""
    flaky: Mapping[str, Divergence] = {}
    """By name of a run, its difference; only runs that differed when they were simulated again for their replay pages."""
    notes: tuple[str, ...] = ()
    """Sentences on replay pages that could not be drawn, with the reasons."""


def examples(records: Collection[Record], kinds: Sequence[Callable[[], ByText]]) -> list[Record]:
    """Return the first record of every cause, if it has a run: of the gravest cause of every junction first."""
    groups: dict[str, list[ByText]] = {}
    for record in records:
        for group in groups.get(record.junction) or groups.setdefault(record.junction, [kind() for kind in kinds]):
            group.add(record)
    by_junction = [[cause.example for group in found for cause in group.causes()] for found in groups.values()]
    ids = dict.fromkeys(id for turn in zip_longest(*by_junction) for id in turn if id)
    found = {record.nodeid: record for record in records if record.nodeid in ids}
    return [found[id] for id in ids if found[id].hash]


def draw_replays(
    records: Collection[Record],
    case_of: Callable[[Collection[str]], Mapping[str, Case]],
    rules: Sequence[str | Rule],
    again: Callable[[str], str],
    folder: Path,
    executor: Executor | int | None,
    simulator: Simulator,
    kinds: Sequence[Callable[[], ByText]] = (causes, provoked, unavoidable),
) -> Replays:
    """Simulate the example run of every cause of the given kinds again, and write replay pages of its violations."""
    asked: dict[str, list[Record]] = {}
    looks: dict[str, str] = {}
    flaky: dict[str, Divergence] = {}
    chosen, jobs = list[Record](), list[tuple[Case, Sequence[Rule], str]]()
    troubles, notes = list[str](), list[str]()
    try:
        chosen = examples(records, kinds)
        for record in chosen[:MOST]:
            asked.setdefault(record.run or "", []).append(record)
        cases = case_of(asked)
        names = sorted(cases)
        for name in names:
            wanted = {record.asks for record in asked[name]}
            own_rules = tuple(rule for rule in rules_for(rules, cases[name].scenario.place) if rule.name in wanted)
            jobs.append((cases[name], own_rules, again(name)))
        for finished, (number, answer) in enumerate(gathered(partial(_draw, simulator), jobs, executor, batch=1), start=1):
            name = names[number]
            progress(finished, len(jobs), "replays")
            if isinstance(answer, Failed):
                troubles.append(f"{name}: {sentence(answer.error)}")
                continue
            hash, pages = answer
            if hash != asked[name][0].hash:
                flaky[name] = Divergence("hash", text=_OTHERWISE)
            for rule, time, html in pages:
                look = folder / "replays" / f"{slug(f'{name}-{rule}')}.html"
                write_file(look, html.encode())
                looks[f"{name}-{rule}"] = f"{look}#t={time:.2f}"
    except KeyboardInterrupt:
        notes.append(INTERRUPTED)
    if len(chosen) > MOST:
        notes.append(f"{len(chosen) - MOST} of {len(chosen)} causes have no replay: the first {MOST} were drawn")
    if troubles:
        notes.append(f"{len(troubles)} replays could not be drawn, the first: {min(troubles)}")
    if flaky:
        notes.append(f"{len(flaky)} runs were different when they were simulated again, the first: {min(flaky)}")
    return Replays(looks, flaky, tuple(notes))


def _draw(simulator: Simulator, job: tuple[Case, Sequence[Rule], str]) -> tuple[str, list[tuple[str, float, str]]]:
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
