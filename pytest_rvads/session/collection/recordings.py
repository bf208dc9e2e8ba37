"""The arguments of ``@rvads.recorded``: files of recorded runs, which are opened at collection.

A recorded run has no driver and no simulator. Collection gives the arguments for driver, vehicle and simulator the value None, so
that pytest does not set up the fixtures of these names. The record of an item that judges a recorded run names the recording in
place of class, scenario and configuration. Collection reads only the parts of a file that ids and rules need.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.runs.readers import READERS, files_of, matching, read_runs
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.runfile import glance
from pytest_rvads.session.collection.ask import judged_at, one_or_several
from pytest_rvads.session.collection.cells import RecordedCell, named
from pytest_rvads.session.collection.misuse import refuse_unknown
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
