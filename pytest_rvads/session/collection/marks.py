"""The marks ``@rvads.scenario``, ``@rvads.recorded`` and ``@rvads.known``, which are expanded at collection.

`Ask`, in the module `ask`, has the arguments of ``@rvads.scenario``. `Recordings` has those of ``@rvads.recorded``: files of
recorded runs, which are opened at collection. A recorded run has no driver and no simulator. Collection gives the arguments for
driver, vehicle and simulator the value None, so that pytest does not set up the fixtures of these names. The record of an item
that judges a recorded run names the recording in place of class, scenario and configuration. Collection reads only the parts of a
file that ids and rules need.
"""

from __future__ import annotations

import glob
import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, count
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, Never, ParamSpec

import pytest

from pytest_rvads.runs.readers import READERS, files_of, matching, read_runs
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.runfile import glance
from pytest_rvads.session.collection.ask import Ask, judged_at, one_or_several
from pytest_rvads.session.collection.cells import Known, RecordedCell, named
from pytest_rvads.session.collection.misuse import caller, refuse_unknown, told_at
from pytest_rvads.support.errors import RvadsError, ScenarioError
from pytest_rvads.support.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

_UNKNOWN = "unknown"
"""The name that stands for the junction of a file that can't be read."""


class OpenFiles:
    """Cache of the runs of the two files that were read last; test items of one file are collected and run in succession.

    A speed limit [m/s] replaces the speed limits in the files.
    """

    def __init__(self, limit: float | None = None) -> None:
        def limited(runs: Any) -> Any:
            if limit is None:
                return runs
            if isinstance(runs, list | tuple):
                return [limited(run) for run in runs]
            return replace(runs, junction=runs.junction.limited(limit), facts=replace(runs.facts, speed_limit=limit))

        self._read = lru_cache(2)(lambda path: limited(read_runs(path)))

    def runs(self, path: str) -> Sequence[Run]:
        """Return the runs of a file as a sequence; a sequence of recorded traffic makes a run only when the run is accessed."""
        runs: Sequence[Run] = self._read(path)
        return runs


@dataclass(frozen=True, slots=True, kw_only=True)
class Recordings:
    """The arguments of a mark ``@rvads.recorded``, see `pytest_rvads.recorded`."""

    place: str
    """File and line of the mark."""
    patterns: tuple[str, ...]
    rules: tuple[str | Rule, ...] | None
    requirement: tuple[str, ...]

    @classmethod
    def of(cls, place: str, patterns: Sequence[Any], rules: Any, requirement: Any, misspelt: Iterable[str]) -> Recordings:
        """Check the arguments of a mark as far as possible without access to files."""
        refuse_unknown("@rvads.recorded takes patterns,", misspelt, ("rules", "requirement"))
        if not patterns:
            raise ScenarioError("@rvads.recorded needs files to judge: give it one or several, such as 'drives/*.npz'")
        for pattern in patterns:
            if not isinstance(pattern, str | os.PathLike) or os.fspath(pattern) in ("", b"") or "\0" in str(pattern):
                raise ScenarioError(
                    f"write @rvads.recorded('drives/*.npz', ...) with files, folders or patterns in quotes, got {pattern!r}"
                )
        return cls(
            place=place,
            patterns=tuple(str(os.fspath(pattern)) for pattern in patterns),
            rules=one_or_several("rules", rules),
            requirement=one_or_several("requirement", requirement) or (),
        )

    def files(self, folder: Path) -> dict[Path, str]:
        """Return the recorded files that the mark selects for a test in `folder`, each with its name in ids."""
        names: dict[Path, str] = {}
        for pattern in self.patterns:
            matches = _matches(pattern, folder) or _matches(pattern, Path.cwd())
            if not matches:
                raise ScenarioError(
                    f"no file matches {pattern!r}, looked for in {folder} and in the working directory: expected files of runs "
                    f"({', '.join(READERS)}), a folder of them, or a pattern such as 'drives/*.npz'"
                )
            for path, name in matches.items():
                names.setdefault(path, name)
        return names

    def cells(self, files: Iterable[tuple[Path, str]], opened: OpenFiles, takes_rule: bool) -> Iterator[RecordedCell]:
        """Yield a cell per recorded run and rule; an unreadable file gives one cell with an error.

        A run is named by its file; if the file holds several runs, also by its label or the time of its busy period.
        """
        for path, name in files:
            try:
                place, labels = glance(path), [""]
                if place is None:
                    runs = opened.runs(str(path))
                    if not len(runs):
                        raise RvadsError(f"{path}: holds no run, so there is nothing to judge: nobody came near the junction")
                    place = runs.junction if isinstance(runs, Recording) else runs[0].junction
                    if len(runs) > 1 and isinstance(runs, Recording):  # the runs of a recording are not made here
                        labels = _distinct(f"t{period.busy:06.1f}" for period in runs.periods)
                    elif len(runs) > 1:
                        labels = _distinct(_id_text(run.label) for run in runs)
            except RvadsError as error:
                naming = named(name, {"junction": _UNKNOWN, "recording": name}, None, self.requirement)
                yield RecordedCell(str(path), 0, None, str(error), 0, "", *naming)
                continue
            rules = judged_at(self.rules or ("road",), place) if takes_rule else (None,)
            for index, of_run in enumerate(labels):
                label = f"{name}-{of_run}" if of_run else name
                keys: dict[str, str | int] = {"junction": place.name, "recording": label}
                for rule in rules:
                    naming = named(label, keys, rule, self.requirement)
                    yield RecordedCell(str(path), index, rule, "", place.ways, place.control.value, *naming)


def _distinct(names: Iterable[str]) -> list[str]:
    """Return names made distinct: a repeated name gets the first free suffix of ``.2``, ``.3``, ...."""
    distinct: dict[str, None] = {}
    for name in names:
        numbered = (f"{name}.{number}" for number in count(2))
        distinct[next(candidate for candidate in chain((name,), numbered) if candidate not in distinct)] = None
    return list(distinct)


def _id_text(text: str) -> str:
    """Return a text with ``_`` in place of the characters that ids can't contain."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", one_line(text))


def _matches(pattern: str, folder: Path) -> dict[Path, str]:
    """Return the files that a pattern matches in a folder, in order, with a name for each file.

    The name is the path below the part of the pattern without wildcards, without the file's ending. So a file that is added
    later does not change the names of the present files.
    """
    literal = folder / pattern
    if os.path.exists(literal):
        base, paths = literal if literal.is_dir() else literal.parent, files_of(literal)
    else:
        parts = Path(pattern).parts
        fixed = next((k for k, part in enumerate(parts) if glob.has_magic(part)), len(parts))
        base = folder.joinpath(*parts[:fixed])
        paths = matching(pattern, folder)
    files = {path.resolve(): path for path in paths}
    return {real: ".".join(map(_id_text, path.relative_to(base).with_suffix("").parts)) for real, path in files.items()}


P = ParamSpec("P")


def _parameters_of(
    ask: Callable[Concatenate[str, P], Ask],
) -> Callable[[Callable[..., pytest.MarkDecorator]], Callable[P, pytest.MarkDecorator]]:
    """Give a mark the parameters of `ask` without the place, for type checkers and for `inspect.signature`."""

    def decorate(mark: Callable[..., pytest.MarkDecorator]) -> Callable[P, pytest.MarkDecorator]:
        _, *parameters = inspect.signature(ask).parameters.values()
        mark.__signature__ = inspect.signature(mark).replace(parameters=parameters)  # type: ignore[attr-defined]
        return mark

    return decorate


@_parameters_of(Ask)
def scenario(junction: Any = None, **arguments: Any) -> pytest.MarkDecorator:
    """Run a test over the scenarios of a junction, or of several junctions.

    If several junctions are selected, junctions that can't be used or that do not fit the other arguments are left out. The
    summary and the reports state the number of left-out junctions and the reasons. A single junction that does not fit is an
    error, and so is a mark for which no junction fits.

    Args:
        junction: built-in name (``stop4``), id of a junction in `map`, a type such as ``"4-way stop"`` for all junctions of this
            type in `map`, ``"*"`` for all junctions in `map`, a place in `map` such as ``"nearest to 52, 149"``, or several of
            these. Without a map a type stands for the first built-in junction of this type, ``"*"`` for all built-in junctions.
        map: map file; by default the file of ``rvads_map``. The path is relative to the folder of the test file or, if that
            folder has no such file, to the working directory.
        junctions: kinds of junctions to select, ``{"control": ["stop", "lights"], "arms": (3, 4), "approach": 40}``: control,
            number of arms, and least length of every approach [m]. Without `junction`, all junctions are selected from.
        limit: greatest number of junctions; if more fit, a sample is drawn by ``rvads_seed``, spread evenly over the kinds
            (control and number of arms).
        classes: numbers of structural equivalence classes; all by default.
        scenarios: direction strings such as ``"1133"``, or ``"13_2_0_31"`` where arms have several lanes, instead of `classes`.
            Each of these scenarios is run in place of the first scenario of its class.
        cover: ``"class"`` runs one scenario per class, ``"scenario"`` every distinct scenario of a class, ``"rotation"`` every
            rotation of a scenario, even if several rotations are equal. ``"partial"`` runs one scenario per class of scenarios
            with or without empty entrances: 69 classes at four ways. ``"pairs"`` runs few scenarios that together contain every
            pair of movements from different entrances; ``"conflicts"`` runs few scenarios that together contain every pair of
            movements that cross or merge.
        occupancy: the vehicles of a full scenario: ``"arms"``, one vehicle on every arm, on any of its lanes; or ``"lanes"``, one
            vehicle on every lane. With one lane per arm, the two values mean the same.
        followers: number of vehicles that queue behind each vehicle, 0 to 9, or several numbers.
        grid: ``"paper"``, or letters of the paper's configurations such as ``"CD"``. A test with a subject can also take
            ``"staggered"``: the subject and the traffic arrive one after the other. A single staggered configuration is named
            ``"S21"``: the traffic starts 21 m before its stopping lines. ``"arrivals"`` runs equal starts and some staggered
            starts. Default: ``"arrivals"`` with a subject, ``"paper"`` without a subject.
        distances: distances to the stopping line [m], instead of `grid`: a number for all vehicles, a tuple with a number
            per entrance, or a list or array of numbers or tuples.
        speeds: initial speeds [m/s], with `distances` and in the same forms; 0 by default.
        probe: whether to keep points of the grid beyond the braking envelope v(d)max; by default these points are left out.
        rules: a rulebook, rules, or both; from a rulebook only the rules about the control of the junction run. By default
            ``"paper"``, and ``"road"`` with a subject.
        subject: entrance of the vehicle under test, or ``"all"`` for every entrance in turn. The other vehicles are traffic, and
            only violations by the subject fail the test. By default all vehicles are under test. With a subject,
            ``cover="class"`` runs every class of (scenario, entrance of the subject): 81 classes at four ways and 8 at three.
        traffic: with a subject, the driver of the other vehicles: a policy by name (``"reference"`` by default, ``"hesitant"``,
            ``"rolling_stop"``, ``"late_yielder"``, ``"red_light_runner"``, ``"stopped"``, ``"lgsvl"``), an autopilot or
            traffic system of yours, or several of these.
        pedestrians: every scenario runs once with each pedestrian, alone on a crosswalk that the vehicle under test, or without a
            subject any vehicle, drives over. A behaviour by name (``"steady"``, ``"yields"``, ``"darts"``, ``"stops"``,
            ``"returns"``, ``"against"``, ``"group"``, ``"waits"``, ``"hidden"``), a `Pedestrian`, a dict of the fields of a
            `Pedestrian` such as ``{"behaviour": ["steady", "darts"], "side": "near", "difference": [-1, 0, 1]}``, whose lists are
            multiplied out, or several of these. By default, pedestrians walk steadily at every such crosswalk from both sides,
            and arrive from 4 s before to 4 s after the vehicle, in steps of 0.5 s. Pedestrians who would have crossed before the
            run begins are left out and counted. ``cover="class"`` takes scenarios as equal if a rotation maps vehicles and
            crosswalk onto each other; ``"conflicts"`` contains every movement of the subject over a crosswalk, too.
        senses: imperfections of the vehicle under test: `Senses`, several `Senses`, or a dict of their fields such as
            ``{"delay": [0, 0.1, 0.2], "range": 40}``, whose lists are multiplied out. Ideal senses by default.
        duration: longest run [s]; 60 by default, or a cycle of the lights and 30 s for lights with more than two phases.
        aggression: braking level 1, 2 or 3.
        wait: waiting time that autopilots with a random waiting time use [s].
        requirement: identifier of the requirement that the scenario traces to, or several; see `--rvads-report=FILE.csv`.

    Raises:
        ScenarioError: an argument is wrong; pytest shows the message with the line of the mark and without a traceback.
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_scenario(Ask.of(place, {"junction": junction, **arguments}))
    return mark


def recorded(
    *patterns: str | PathLike[str],
    rules: str | Rule | Iterable[str | Rule] | None = None,
    requirement: str | Iterable[str] | None = None,
    **misspelt: Never,
) -> pytest.MarkDecorator:
    """Run a test over recorded runs: files of runs, or busy periods of recorded traffic.

    The test takes ``run``, ``rule`` and ``monitor`` as for scenarios; ``rvads_recorded`` is the same run. Nothing is simulated.
    The items of a file that can't be read are errors; the items of all other files run.

    Args:
        patterns: files, folders that are searched with their subfolders for files of runs, or patterns such as
            ``"drives/**/*.npz"``. Paths are relative to the folder of the test file or, without a match in that folder, to the
            working directory. A pattern without any match is refused.
        rules: a rulebook, rules, or both; from a rulebook only the rules about the control of the junction run. By default
            ``"road"``.
        requirement: identifier of the requirement that the recordings trace to, or several; see `--rvads-report=FILE.csv`.
        misspelt: any other keyword, which is refused.

    Raises:
        ScenarioError: an argument is wrong; pytest shows the message with the line of the mark and without a traceback.

    Example:
        >>> @recorded("drives/*.npz", rules="road")
        ... def test_drives(monitor, rule):
        ...     monitor.check(rule)
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_recorded(Recordings.of(place, patterns, rules, requirement, misspelt))
    return mark


def known(name: str, *, reason: str = "", **where: str | int | Iterable[str | int]) -> pytest.MarkDecorator:
    """Mark the test items that must fail because of a known deficiency (a strict xfail); an item that passes fails the session.

    Args:
        name: name of the deficiency in reports.
        reason: the deficiency in words.
        where: keys that select items, each with a value or several values: junction, cls, scenario, cfg, rotation, seat, traffic,
            recording, rule.

    Raises:
        ScenarioError: a key is unknown.
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_known(Known.of(place, name, reason, where))
    return mark
