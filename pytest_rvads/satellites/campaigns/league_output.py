"""Judges the drivers of a league one after the other, and writes the page and the JSON of the league."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.cli.common import make_folder, say, warn
from pytest_rvads.cli.shared_options import opened_driver
from pytest_rvads.drivers.identity import identity
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.report.coverage import ArrivalCoverage
from pytest_rvads.report.outline import FAILURES, Block, Notes, Section
from pytest_rvads.report.page import rendered
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.session_report import exit_status
from pytest_rvads.satellites.campaigns.campaign import Keys, campaign
from pytest_rvads.satellites.campaigns.league import Config, League, about
from pytest_rvads.satellites.campaigns.resultsfile import Judged, Results
from pytest_rvads.satellites.campaigns.town_output import INTERRUPTED, Replays, draw_replays, progressing
from pytest_rvads.satellites.campaigns.town_tally import Tally, cell
from pytest_rvads.search.critical import Order, critical_starts
from pytest_rvads.search.trials import Fault, Setting
from pytest_rvads.simulators.simulator import Simulator, meant, named
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.installed import code, versions
from pytest_rvads.support.storage import read_file, slug, write_file
from pytest_rvads.support.wording import plural

_LARGEST = 2**26
"""Largest file of critical starts that is read [bytes]."""


def judge_league(path: Path, folder: Path, executor: Executor | int | None) -> int:
    """Judge the drivers of a league, print a line per driver, write the page, and return the exit status."""
    config = Config.read(path)
    league = League(config, path)
    simulators = {}
    for name, entry in config.drivers.items():  # a driver that can't be imported is an error before anything runs
        with about(f"{path}: drivers.{name}"), opened_driver(entry.words()):
            simulators[name] = named(entry.simulator, Path.cwd()) if entry.simulator else meant()
    count = len(league.cells)
    drawn = f"{plural(count, 'cell')} and {plural(len(league.lines), 'line')} of starts"
    warn(f"{plural(len(simulators), 'driver')}, each with {drawn}")
    for reason in league.refused:
        warn(f"left out: {reason}")
    make_folder("-o", folder)
    drivers: list[dict[str, Any]] = []
    for name, simulator in simulators.items():
        stopped = any(INTERRUPTED in driver["notes"] for driver in drivers)
        drivers.append(_judged(league, name, simulator, folder, None if stopped else executor))
        say(summary(drivers[-1]))
    content = {
        "format": "rvads-league",
        "version": 1,
        "config": msgspec.to_builtins(config),
        "cells": count,
        "lines": len(league.lines),
        "junctions": [place.name for place in league.places],
        "rules": [rule.name for rule in rules_for(league.rules) if any(rule.name in driver["verdicts"] for driver in drivers)],
        "versions": versions(),
        "drivers": drivers,
    }
    write_file(folder / "league.html", league_page(content, f"rvads league: {path.stem}").encode())
    write_file(folder / "league.json", msgspec.json.format(encode(content), indent=1) + b"\n")
    say(f"look: {folder / 'league.html'}")
    statuses = {outcome for driver in drivers for counts in driver["verdicts"].values() for outcome in counts}
    statuses |= {Outcome(side["status"]) for driver in drivers for side in driver["sides"]}
    statuses |= {Outcome.FLAKY for driver in drivers if driver["flaky"]}
    wanted = count, 2 * len(league.lines)
    complete = all((driver["runs"], len(driver["sides"])) == wanted and INTERRUPTED not in driver["notes"] for driver in drivers)
    return exit_status(statuses, complete=complete)


def _judged(league: League, name: str, simulator: Simulator, folder: Path, executor: Executor | int | None) -> dict[str, Any]:
    """Return the results of a driver as a JSON object; without an executor, which means an interruption, nothing is simulated."""
    notes, sides = list[str](), list[dict[str, Any]]()
    results: AbstractContextManager[Iterable[Judged]]
    with opened_driver(league.config.drivers[name].words()) as driver:
        cases, tally = league.cases(driver), Tally()
        key = f"{slug(name)}-{_digest(league, driver, simulator)}"
        file = folder / f"results-{key}.jsonl"
        try:
            if executor is None:
                raise KeyboardInterrupt
            with progressing(f"runs of {name}") as progress:
                results = campaign(
                    list(cases.values()), league.rules, executor=executor, results=file, simulator=simulator, progress=progress
                )
        except (KeyboardInterrupt, RvadsError) as error:
            notes.append(_cut(error))
            executor = None
            try:
                results = Results(file)
            except (RvadsError, OSError):  # nothing was judged
                results = nullcontext(())
        with results as judged:
            try:
                sides.extend(_sides(league, name, driver, simulator, folder / f"critical-{key}.json", executor))
            except (KeyboardInterrupt, RvadsError, OSError) as error:
                notes.append(_cut(error))
            for result in judged:
                if result.nodeid not in cases:
                    raise RvadsError(f"{file} is damaged: {result.nodeid!r:.60} is no run of this league: remove the file")
                tally.add(result)
            replays = Replays()
            if executor is not None and INTERRUPTED not in notes:
                with progressing(f"replays of {name}") as progress:
                    replays = draw_replays(
                        {name: tally},
                        lambda names: {run: cases[run] for run in names},
                        lambda place: rules_for(league.rules, place),
                        lambda run: league.again(name, run),
                        folder / key,
                        executor,
                        simulator,
                        progress,
                    )
            replays = replace(replays, notes=(*dict.fromkeys(notes), *replays.notes))
            return _standing(league, name, judged, tally, replays, sides, key)


def _cut(error: BaseException) -> str:
    return INTERRUPTED if isinstance(error, KeyboardInterrupt) else f"INCOMPLETE: {error}"


def _sides(
    league: League, name: str, driver: Factory, simulator: Simulator, path: Path, executor: Executor | int | None
) -> Iterator[dict[str, Any]]:
    """Yield both sides of every line of starts; without an executor, only the sides in the file."""
    known = decode(read_file(path, _LARGEST), list[_Side], f"{path} is damaged", RvadsError) if path.exists() else []
    due = [(line.id, order) for line in league.lines for order in Order]
    if len(known) % 2 or [(side.line, side.order) for side in known] != due[: len(known)]:
        raise RvadsError(f"{path} is damaged: expected the sides of lines of this league: remove the file")
    sides: list[dict[str, Any]] = msgspec.to_builtins(known)
    yield from tuple(sides)
    groups = [[line] for line in league.lines[len(sides) // 2 :]] if executor is not None else []
    traffic = league.config.traffic[0]
    setting = Setting.of(driver, rules_for(league.rules), traffic, simulator=simulator)
    with progressing(f"lines of starts of {name}") as progress:
        for side in critical_starts(groups, setting, executor, progress):
            id = setting.id(side.line.scenario(side.failed.lead)) if side.failed else ""
            sides.append(
                {
                    "line": side.line.id,
                    "order": side.order,
                    "started": side.start is not None,
                    "status": side.status,
                    "fault": side.fault,
                    "rule": side.rule,
                    "rerun": league.rerun(name, side.line.place, id, traffic) if id else "",
                    "error": side.error,
                }
            )
            if len(sides) % 2 == 0:
                write_file(path, encode(sides))
            yield sides[-1]


class _Side(msgspec.Struct, kw_only=True):
    """A side of a line of starts in the file of critical starts."""

    line: str
    order: Order
    started: bool
    status: Outcome
    fault: Fault | None
    rule: str
    rerun: str
    error: str


def _digest(league: League, driver: Factory, simulator: Simulator) -> str:
    """Return a digest of everything on which the results of a driver depend, for the names of its files."""
    keys = Keys(simulator)
    rules = [rule if isinstance(rule, str) else f"{rule.name} {identity(rule)}" for rule in league.rules]
    cases = [keys.of(case) for case in league.cases(driver).values()]
    key_parts = [code(), rules, cases, [line.id for line in league.lines]]
    return sha256(json.dumps(key_parts).encode("utf-8", "surrogatepass")).hexdigest()[:12]


def _standing(
    league: League,
    name: str,
    results: Iterable[Judged],
    tally: Tally,
    replays: Replays,
    sides: Sequence[dict[str, Any]],
    folder: str,
) -> dict[str, Any]:
    """Return the results of a driver as a JSON object, given also their sums, and the folder of its replays."""
    coverage, seconds = ArrivalCoverage(), 0.0
    for result in results:
        seconds += result.duration or 0.0
        for record in by_rule(result):
            coverage.add(record)
    verdicts: dict[str, Counter[Outcome]] = {}
    for (rule, _, outcome), count in sorted(tally.table.items()):
        verdicts.setdefault(rule, Counter())[outcome] += count
    return {
        "name": name,
        "runs": tally.runs,
        "hours": round(seconds / 3600, 3),
        "verdicts": verdicts,
        "causes": [
            {
                "title": title,
                "text": cause.text,
                "rules": cause.rules,
                "count": cause.count,
                "run": cause.run,
                "rerun": league.again(name, cause.run),
                "look": f"{folder}/{look}" if (look := replays.looks.get((cause.run, cause.rule))) else "",
            }
            for title, group in tally.grouped()
            for cause in group
        ],
        "met": sum(met for _, met, *_ in coverage.at_junctions()),
        "pairs": coverage.pairs,
        "gap": coverage.length,
        "sides": sides,
        "flaky": sorted(replays.flaky),
        "notes": replays.notes,
    }


_MARKS = {"good": "good", "bad": "bad", "error": "bad"}
"""Marks of cells in sections, by the mark of a cell of a tally."""
_FAULTS = (Fault.IRRATIONAL, Fault.BOLD, Fault.TIMID, Fault.MANNERS)
_FIGURES = ("driver", "runs", "simulated", "pairs of movements met", "untested gap", "critical starts", *_FAULTS)
_CAUSES = ("verdicts", "rules", "cause", "replay", "first again")


def summary(driver: Mapping[str, Any]) -> str:
    """Return the results of a driver, a JSON object, in a line."""
    counts = sum((_counts(driver, rule) for rule in driver["verdicts"]), Counter[Tallied]())
    faults = Counter(side["fault"] for side in driver["sides"] if side["fault"])
    parts = [f"{driver['name']}: {plural(driver['runs'], 'run')}, {counted(counts) or 'no verdict'}"]
    parts += [f"{count} {fault} at critical starts" for fault, count in faults.items()]
    return "; ".join([*parts, *driver["notes"]])


def sections(league: Mapping[str, Any]) -> Iterator[Section]:
    """Yield the tables of a league, given its JSON object; the tables of causes of drivers without failures are left out."""
    rules = [rule for rule in league["rules"] if _applied(league, rule)]
    verdicts, figures = [], []
    for driver in league["drivers"]:
        cells = [(driver["name"], "")]
        for rule in rules:
            counts = _counts(driver, rule)
            del counts[Outcome.NA]
            text, mark = cell(counts)
            text = f"{text} ({counts.total()})" if text and "/" not in text else text
            cells.append((text, _MARKS.get(mark, "")))
        verdicts.append(tuple(cells))
        faults = Counter(side["fault"] for side in driver["sides"])
        met, hours, gap = f"{driver['met']} of {driver['pairs']}", f"{driver['hours']:.2f} h", f"{driver['gap']:g} s"
        started = sum(side["started"] for side in driver["sides"])
        figures.append(_plain((driver["name"], driver["runs"], hours, met, gap, started, *(faults[fault] for fault in _FAULTS))))
    yield Section("verdicts", (), ("driver", *rules), tuple(verdicts))
    yield Section("figures", (), _FIGURES, tuple(figures))
    for driver in league["drivers"]:
        rows = []
        for cause in driver["causes"]:
            text = cause["text"] if cause["title"] == FAILURES else f"{cause['title']}: {cause['text']}"
            *plain, command = _plain((cause["count"], ", ".join(cause["rules"]), text, cause["rerun"]))
            rows.append((*plain, (cause["look"], "look"), command))
        for side in driver["sides"]:
            if side["fault"] or side["error"]:
                text = side["error"] or f"{side['fault']} at a critical start where it {side['order']}"
                rows.append(_plain((1, side["rule"], text, "", side["rerun"] or side["line"])))
        if rows:
            yield Section(f"causes: {driver['name']}", (), _CAUSES, tuple(rows))


def _applied(league: Mapping[str, Any], rule: str) -> bool:
    return any(outcome is not Outcome.NA for driver in league["drivers"] for outcome in _counts(driver, rule))


def _counts(driver: Mapping[str, Any], rule: str) -> Counter[Any]:
    return Counter({Outcome(outcome): count for outcome, count in driver["verdicts"].get(rule, {}).items()})


def _plain(texts: Iterable[object]) -> tuple[tuple[str, str], ...]:
    return tuple((str(text), "") for text in texts)


def league_page(league: Mapping[str, Any], title: str) -> str:
    """Return the HTML page of a league, given its JSON object."""
    drawn = f"{plural(league['cells'], 'cell')} and {plural(league['lines'], 'line')} of starts for every driver"
    setup = f"{drawn}, at {', '.join(league['junctions'])}, among {' and '.join(league['config']['traffic'])} traffic"
    notes = tuple(f"{driver['name']}: {note}" for driver in league["drivers"] for note in driver["notes"])
    reading = [
        "A cell of the verdicts has the worst outcome of a rule: FAIL (4) if all 4 runs to which the rule applied failed, "
        "2/4 fail if 2 of 4 failed, pass (4) if all 4 passed. A cell is empty if the rule applied to no run of the driver."
    ]
    if idle := [rule for rule in league["rules"] if not _applied(league, rule)]:
        reading.append(f"The table leaves out rules that applied to no run: {', '.join(idle)}.")
    reading.append(
        "The untested gap is the longest stretch of arrival differences that no run tried. At a critical start a driver turns "
        "from waiting to going. A driver there is too bold if it breaks a rule about other vehicles, too timid if it breaks "
        "progress, wrong by itself if it breaks a rule about the vehicle alone, and irrational if it passes there and fails at a "
        "less critical start."
    )
    read = Section("how to read the tables", tuple(reading))
    blocks: list[Block | Section] = [Notes(notes), Section("cells", (setup,)), read, *sections(league)]
    return rendered(title, blocks, {})
