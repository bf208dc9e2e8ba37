"""A league: several drivers are judged on the same drawn cells, and on the same lines of starts of two vehicles."""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta, Struct

from pytest_rvads.cli.common import listed_rules, make_folder, opened_driver, progress, say, warn
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.naming import stand_in
from pytest_rvads.drivers.traffic import Policy, policy_name
from pytest_rvads.geometry.finder import choose
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.report.counting import Counts, counts_of
from pytest_rvads.report.figures import largest_gap, total
from pytest_rvads.report.outline import Block, Notes, Section
from pytest_rvads.report.session_report import Report, exit_status
from pytest_rvads.report.side_by_side import json_of, sections, side_by_side
from pytest_rvads.report.triage import causes
from pytest_rvads.satellites.campaigns.campaign import continued, digest, reopened
from pytest_rvads.satellites.campaigns.replays import INTERRUPTED, Replays, draw_replays
from pytest_rvads.satellites.campaigns.town import Plan, Request
from pytest_rvads.satellites.pages.page import rendered
from pytest_rvads.satellites.starts.critical import Order, critical_starts
from pytest_rvads.satellites.starts.critical_command import again
from pytest_rvads.satellites.starts.lines import Fault, Line, Setting, lines_at
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import Simulator, named
from pytest_rvads.support.decoding import decode, encode, typed
from pytest_rvads.support.errors import RvadsError, ScenarioError
from pytest_rvads.support.installed import versions
from pytest_rvads.support.storage import read_file, slug, write_file
from pytest_rvads.support.stratified import draw
from pytest_rvads.support.wording import plural

_LARGEST_CONFIG, _LARGEST = 2**20, 2**26
"""Largest configuration and largest file of critical starts that are read [bytes]."""
_Positive = Annotated[int, Meta(ge=1, le=10**6)]
_FAULTS = (Fault.IRRATIONAL, Fault.BOLD, Fault.TIMID, Fault.MANNERS)
_FIGURES = ("driver", "runs", "simulated", "pairs of movements met", "untested gap", "critical starts", *_FAULTS)
_READING = (
    "A cell of the verdicts has the numbers of verdicts on a rule by outcome, and a cause the numbers of failures.",
    "The untested gap is the longest stretch of arrival differences that no run tried.",
    "At a critical start a driver turns from waiting to going. A driver there is too bold if it breaks a rule about other "
    "vehicles, too timid if it breaks progress, wrong by itself if it breaks a rule about the vehicle alone, and irrational if "
    "it passes there and fails at a less critical start.",
)


class DriverConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A driver of a league: either an autopilot or a program."""

    autopilot: str | None = None
    """``module:name`` or a traffic policy, as for ``--autopilot``."""
    sut: str | None = None
    """A program that speaks the protocol of stacks, as for ``--sut``."""
    simulator: str | None = None
    """Simulator of the driver's runs; None for the default simulator."""

    def words(self, **more: object) -> argparse.Namespace:
        """Return the options of a command that name the driver, and further options."""
        return argparse.Namespace(autopilot=self.autopilot, sut=self.sut, simulator=self.simulator, **more)


class MapConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A map, and the number of its junctions to draw."""

    file: str
    junctions: _Positive


class Config(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The configuration of a league. Paths are relative to the working directory."""

    drivers: Annotated[dict[Annotated[str, Meta(min_length=1, max_length=100)], DriverConfig], Meta(min_length=1)]
    cells: _Positive
    """Number of runs of each driver, spread evenly over traffic policies, seats, junctions, classes and configurations."""
    junctions: tuple[str, ...] = ()
    """Names of built-in junctions."""
    maps: tuple[MapConfig, ...] = ()
    """Maps of which junctions are drawn."""
    seats: tuple[int, ...] = ()
    """Entrances of the vehicle under test; empty for all entrances."""
    traffic: Annotated[tuple[str, ...], Meta(min_length=1)] = ("reference",)
    """Traffic policies."""
    critical: Annotated[int, Meta(ge=0, le=10**6)] = 0
    """Number of lines of starts on which critical starts are searched."""
    rules: Annotated[tuple[str, ...], Meta(min_length=1)] = ("road",)
    """Rules, rulebooks or files of rules."""
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    """Seed of all draws."""

    @classmethod
    def read(cls, path: Path) -> Config:
        """Return the configuration in a TOML file."""
        try:
            content = tomllib.loads(read_file(path, _LARGEST_CONFIG).decode())
        except OSError as error:
            raise RvadsError(
                f"{path} can't be read: {error.strerror or error}, expected the configuration of a league in TOML"
            ) from error
        except (ValueError, RecursionError) as error:
            raise RvadsError(f"{path} must hold a league in TOML: {error}") from error
        config = typed(content, cls, str(path), RvadsError)
        for name, driver in config.drivers.items():
            if (driver.autopilot is None) is (driver.sut is None):
                given = "none" if driver.sut is None else "both"
                raise RvadsError(f"{path}: the field 'drivers.{name}' must have an autopilot or a sut, got {given}: give one")
        return config


@contextmanager
def about(place: str) -> Iterator[None]:
    """Let errors of the package begin with the place in the configuration that they are about."""
    try:
        yield
    except RvadsError as error:
        raise RvadsError(f"{place}: {error}") from error


@dataclass(eq=False)
class League:
    """The drawn cells and lines of starts of a league, on which every driver is judged."""

    config: Config
    path: Path

    def __post_init__(self) -> None:
        config = self.config
        with about(f"{self.path}: junctions"):
            chosen = [*choose(config.junctions).junctions] if config.junctions else []
        with about(f"{self.path}: maps"):
            for map in config.maps:
                chosen += choose("*", map.file, limit=map.junctions, seed=config.seed).junctions
        with about(f"{self.path}: rules"):
            self.rules = listed_rules(config.rules)
        with about(f"{self.path}: traffic"):
            policies = [Policy.of(name) for name in dict.fromkeys(config.traffic)]
        seats: list[int | str] = [*dict.fromkeys(config.seats)] or ["all"]
        requests = [Request(stand_in(), self.rules, subject=seat, traffic=policy) for policy, seat in product(policies, seats)]
        sizes = [len(range(number, config.cells, len(requests))) for number in range(len(requests))]
        self.plans = [
            Plan(chosen, request, sample=size, seed=config.seed) for request, size in zip(requests, sizes, strict=True) if size
        ]
        if not self.cells:
            raise RvadsError(f"{self.path}: no cell is possible: {next(iter(self.refused), 'name junctions or maps')}")

    @property
    def refused(self) -> list[str]:
        """The reasons why none of the requested cells is possible at a junction."""
        return list(dict.fromkeys(f"{name}: {reason}" for plan in self.plans for name, reason in plan.refused.items()))

    @cached_property
    def cells(self) -> dict[str, Case]:
        """The cases of the stand-in for the drivers, by name of the run."""
        return {planned.name: planned.case for plan in self.plans for planned in plan}

    @property
    def places(self) -> list[Junction]:
        """The junctions of the cells."""
        return list(dict.fromkeys(case.scenario.place for case in self.cells.values()))

    def cases(self, driver: Factory) -> dict[str, Case]:
        """Return the cases of a driver, by name of the run."""
        return {name: Case(case.scenario, driver, case.traffic, case.fleet) for name, case in self.cells.items()}

    def again(self, driver: str, run: str) -> str:
        """Return the command that simulates a run of a driver again, given the names of both."""
        case = self.cells[run]
        assert case.traffic is not None
        return self.rerun(driver, case.scenario.place, run, policy_name(case.traffic))

    def rerun(self, driver: str, place: Junction, id: str, traffic: str) -> str:
        """Return the command that simulates a scenario of a driver again, given its id and its traffic policy."""
        options = self.config.drivers[driver].words(
            place=str(place.map or place.name), traffic=traffic, rules=list(self.config.rules)
        )
        return again(options, place, id)

    @cached_property
    def lines(self) -> list[Line]:
        """The drawn lines of starts, among the lines that differ by more than a rotation."""
        lines: list[Line] = []
        for place in self.places if self.config.critical else ():
            try:
                lines += [group[0] for group in lines_at(place, self.config.seats or None)]
            except ScenarioError:  # no two ways conflict, or a junction lacks a seat: it has no lines
                continue
        if not lines:
            return []
        return draw(
            lines, self.config.critical, self.config.seed, lambda line: (line.place.name, line.vista), lambda line: line.id
        )


class Side(msgspec.Struct, kw_only=True):
    """A side of a line of starts in the file of critical starts."""

    line: str
    order: Order
    started: bool
    status: Outcome
    fault: Fault | None
    rule: str
    rerun: str
    error: str


class Standing(NamedTuple):
    """The results of a driver."""

    name: str
    report: Report
    counts: Counts
    sides: list[Side]

    def row(self) -> dict[str, Any]:
        """Return figures on the runs of the driver, by name."""
        seconds = {record.run: record.duration or 0.0 for record in self.report.records}
        verdicts: dict[str, Counter[str]] = {}
        for (_, rule, outcome), count in self.counts.verdicts.items():
            verdicts.setdefault(rule, Counter())[str(outcome)] += count
        return {
            "name": self.name,
            "runs": len(seconds),
            "hours": round(sum(seconds.values()) / 3600, 3),
            "verdicts": verdicts,
            "met": sum(map(len, self.counts.met.values())),
            "pairs": sum(self.counts.pairs.values()),
            "gap": largest_gap(self.counts),
            "sides": self.sides,
            "notes": self.report.notes,
        }


def judge_league(path: Path, folder: Path, executor: Executor | int | None) -> int:
    """Judge the drivers of a league, print a line per driver, write the page, and return the exit status."""
    config = Config.read(path)
    league = League(config, path)
    simulators = {}
    for name, entry in config.drivers.items():  # a driver that can't be imported is an error before anything runs
        with about(f"{path}: drivers.{name}"), opened_driver(entry.words()):
            simulators[name] = named(entry.simulator, Path.cwd())
    warn(f"{plural(len(simulators), 'driver')}, each with {_drawn(league)}")
    for reason in league.refused:
        warn(f"left out: {reason}")
    make_folder("-o", folder)
    standings: list[Standing] = []
    with ExitStack() as opened_results:
        for name, simulator in simulators.items():
            stopped = any(INTERRUPTED in standing.report.notes for standing in standings)
            standings.append(_judged(league, name, simulator, folder, None if stopped else executor, opened_results))
            standing = standings[-1]
            faults = Counter(side.fault for side in standing.sides if side.fault)
            critical = [f"{count} {fault} at critical starts" for fault, count in faults.items()]
            say("; ".join([f"{name}: {total(standing.counts)}", *critical, *standing.report.notes]))
        _write(league, standings, folder)
    say(f"look: {folder / 'league.html'}")
    wanted = 2 * len(league.lines)
    complete = all(standing.report.complete and len(standing.sides) == wanted for standing in standings)
    statuses = {side.status for standing in standings for side in standing.sides}
    outcome_of = {0: Outcome.PASS, 1: Outcome.FAIL}
    statuses |= {outcome_of.get(standing.report.exitstatus, Outcome.NA) for standing in standings}
    return exit_status(statuses, complete=complete)


def _judged(
    league: League, name: str, simulator: Simulator, folder: Path, executor: Executor | int | None, opened_results: ExitStack
) -> Standing:
    """Return the results of a driver; without an executor, which means an interruption, nothing is simulated."""
    notes, sides = list[str](), list[Side]()
    with opened_driver(league.config.drivers[name].words()) as driver:
        cases = league.cases(driver)
        key = f"{slug(name)}-{digest(cases.values(), league.rules, simulator, *(line.id for line in league.lines))}"
        file = folder / f"results-{key}.jsonl"
        stopped: BaseException | None
        if executor is None:
            results, stopped = reopened(file), KeyboardInterrupt()
        else:
            shown = partial(progress, what=f"runs of {name}")
            results, stopped = continued(cases.values(), league.rules, file, simulator, executor, shown, len(cases))
        if stopped:
            notes.append(_cut(stopped))
            executor = None
        try:
            sides.extend(_sides(league, name, driver, simulator, folder / f"critical-{key}.json", executor))
        except (KeyboardInterrupt, RvadsError, OSError) as error:
            notes.append(_cut(error))
        if results is None:
            report = Report((), notes=tuple(notes), complete=False)
            return Standing(name, report, counts_of(report), sides)
        opened_results.enter_context(results)
        stranger = next((result.nodeid for result in results if result.nodeid not in cases), None)
        if stranger is not None:
            raise RvadsError(f"{file} is damaged: {stranger!r:.60} is no run of this league: remove the file")
        replays = Replays()
        if executor is not None and INTERRUPTED not in notes:
            replays = draw_replays(
                results.records(),
                lambda names: {run: cases[run] for run in names},
                league.rules,
                lambda run: league.again(name, run),
                folder / key,
                executor,
                simulator,
                (causes,),
            )
    outcomes = results.outcomes | ({Outcome.FLAKY} if replays.flaky else set())
    complete = len(results) == len(cases) and INTERRUPTED not in (*notes, *replays.notes)
    report = replace(
        results.report(),
        records=results.records(replays.looks, replays.flaky),
        notes=(*dict.fromkeys(notes), *replays.notes),
        exitstatus=exit_status(outcomes),
        complete=complete,
    )
    return Standing(name, report, counts_of(report), sides)


def _cut(error: BaseException) -> str:
    return INTERRUPTED if isinstance(error, KeyboardInterrupt) else f"INCOMPLETE: {error}"


def _drawn(league: League) -> str:
    return f"{plural(len(league.cells), 'cell')} and {plural(len(league.lines), 'line')} of starts"


def _sides(
    league: League, name: str, driver: Factory, simulator: Simulator, path: Path, executor: Executor | int | None
) -> Iterator[Side]:
    """Yield both sides of every line of starts; without an executor, only the sides in the file."""
    sides = decode(read_file(path, _LARGEST), list[Side], f"{path} is damaged", RvadsError) if path.exists() else []
    due = [(line.id, order) for line in league.lines for order in Order]
    if len(sides) % 2 or [(side.line, side.order) for side in sides] != due[: len(sides)]:
        raise RvadsError(f"{path} is damaged: expected the sides of lines of this league: remove the file")
    yield from tuple(sides)
    groups = [[line] for line in league.lines[len(sides) // 2 :]] if executor is not None else []
    traffic = league.config.traffic[0]
    setting = Setting.of(driver, rules_for(league.rules), traffic, simulator=simulator)
    for found in critical_starts(groups, setting, executor, partial(progress, what=f"lines of starts of {name}")):
        id = setting.id(found.line.scenario(found.failed.lead)) if found.failed else ""
        side = Side(
            line=found.line.id,
            order=found.order,
            started=found.start is not None,
            status=found.status,
            fault=found.fault,
            rule=found.rule,
            rerun=league.rerun(name, found.line.place, id, traffic) if id else "",
            error=found.error,
        )
        sides.append(side)
        if len(sides) % 2 == 0:
            write_file(path, encode(sides))
        yield side


def figure_sections(rows: Sequence[Mapping[str, Any]]) -> Iterator[Section]:
    """Yield a table of figures and a table of faults at critical starts, given the `row` of each driver."""
    figures, critical = [], []
    for row in rows:
        faults = Counter(side.fault for side in row["sides"])
        met, started = f"{row['met']} of {row['pairs']}", sum(side.started for side in row["sides"])
        texts = (row["name"], row["runs"], f"{row['hours']:.2f} h", met, f"{row['gap']:g} s", started)
        figures.append(tuple((str(text), "") for text in (*texts, *(faults[fault] for fault in _FAULTS))))
        for side in row["sides"]:
            if side.fault or side.error:
                text = side.error or f"{side.fault} where it {side.order}"
                critical.append(((row["name"], ""), (side.rule, ""), (text, ""), (side.rerun or side.line, "code")))
    yield Section("figures", (), _FIGURES, tuple(figures))
    if critical:
        yield Section("critical starts", (), ("driver", "rule", "fault", "first again"), tuple(critical))


def _write(league: League, standings: Sequence[Standing], folder: Path) -> None:
    """Write the comparison of the drivers that have results, with figures and critical starts, as a page and as JSON."""
    judged = [standing for standing in standings if standing.report.records]
    names = [standing.name for standing in judged]
    compared = side_by_side([(standing.name, standing.report) for standing in judged], names) if judged else None
    rows = [standing.row() for standing in standings]
    parts = list(sections(compared, again=lambda cause: league.again(names[cause.side], cause.run))) if compared else []
    parts += figure_sections(rows)
    drawn = f"{_drawn(league)} for every driver"
    where = f"at {', '.join(place.name for place in league.places)}, among {' and '.join(league.config.traffic)} traffic"
    notes = tuple(f"{standing.name}: {note}" for standing in standings for note in standing.report.notes)
    blocks: list[Block] = [
        Notes(notes),
        Section("cells", (f"{drawn}, {where}",)),
        Section("how to read the tables", _READING),
        *parts,
    ]
    write_file(folder / "league.html", rendered(f"rvads league: {league.path.stem}", blocks, {}, folder).encode())
    content = {
        "format": "rvads-league",
        "version": 1,
        "config": msgspec.to_builtins(league.config),
        "cells": len(league.cells),
        "lines": len(league.lines),
        "junctions": [place.name for place in league.places],
        "versions": versions(),
        "drivers": rows,
        "causes": [asdict(cause) for cause in compared.causes] if compared else [],
        "sections": [asdict(part) for part in parts],
    }
    write_file(folder / "league.json", json_of(content).encode())
