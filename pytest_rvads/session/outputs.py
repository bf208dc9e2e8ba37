"""What a session writes: its journal, its reports from beginning to end, its page, the summary of a CI job."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.options import OPTIONS
from pytest_rvads.session.folder import FOLDER
from pytest_rvads.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.report.journal import Journal
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Cell, Extent, Report
    from pytest_rvads.session.plan import Planner

__all__ = ["Outputs", "claim", "told", "totals"]

_QUESTIONS = ("cacheshow", "collectonly", "help", "markers", "show_fixtures_per_test", "showfixtures", "version")
"""Options with which pytest runs nothing."""


def claim(early_config: pytest.Config) -> None:
    """Leave a journal before code of users is loaded, so that an earlier report is not taken for one of this session."""
    known = early_config.known_args_namespace
    names = known.rvads_report or early_config.getini("rvads_report")
    first = _first_json([early_config.invocation_params.dir / name for name in names])
    if first and not _runs_nothing(known):
        from pytest_rvads.report.journal import claim

        claim(first)


def told(error: BaseException) -> str:
    """Return an error of code that is not ours as part of a sentence."""
    return one_line(f"{type(error).__name__}: {error}")


def totals(records: Iterable[Record]) -> dict[int, tuple[int, int]]:
    """Return how many classes and scenarios there are at junctions of so many ways, for each kind that has records."""
    from pytest_rvads.report.record import SimulatedItem
    from pytest_rvads.scenarios.classes import count_classes, count_scenarios

    found = sorted({record.ways for record in records if isinstance(record, SimulatedItem)})
    return {ways: (count_classes(ways), count_scenarios(ways)) for ways in found}


class Outputs:
    """Writes what a session is asked for; what can't be written costs nothing else."""

    def __init__(self, config: pytest.Config) -> None:
        options, self._config = config.stash[OPTIONS], config
        self._artefacts = options.artefacts
        self._reports = () if _runs_nothing(config.option) else options.report
        self._announced = False
        """Whether the reports say what is to run."""
        self.index = ""
        """Where the page of the session is, if it could be written."""
        self._troubles: list[str] = []
        """What went wrong while reports of what is to run were written."""

    @cached_property
    def journal(self) -> Journal:
        """The journal: the record of an item is appended when the item ends."""
        from pytest_rvads.report.journal import Journal

        journal = Journal(_first_json(self._reports))
        self._config.add_cleanup(journal.close)
        return journal

    def begin(self) -> None:
        """Replace what an earlier session has left: until this one has ended, the reports say so."""
        if self._reports:
            _ = self.journal  # comes first: that of an earlier session has other items
            self._provide((), ())

    def announce(self, planner: Planner) -> None:
        """Say in the reports what is to run, so that nothing of it can be missing unnoticed; once, as soon as it is known."""
        if self._reports and not self._announced and (plan := planner.plan()).items:
            self._announced = True
            self._provide(plan.items.values(), plan.cells, plan.extents)

    def _provide(self, records: Collection[Record], planned: Iterable[Cell], extents: dict[str, Extent] | None = None) -> None:
        from pytest_rvads.report.session_report import begun

        self._troubles = self._save(begun(list(records), totals(records), list(planned), extents), lambda _: True)

    def end(self, report: Report, ran: bool) -> tuple[list[str], bool]:
        """Write all that is to stay, what programs read last: it tells what else could not be written.

        Returns:
            What went wrong, a sentence each, and whether all is there that was asked for.
        """
        told = self._troubles
        if self._artefacts and ran:
            told = told + _attempt("the index of the session", partial(self._write_index, report))
        lacking = self._save(report, lambda path: path.suffix != ".json")
        if (summary := os.environ.get("GITHUB_STEP_SUMMARY")) and report.records:
            from pytest_rvads.report.files import append_summary

            lacking += _attempt("the report", partial(append_summary, Path(summary), report))
        if lacking:
            report = replace(
                report, exitstatus=report.exitstatus or pytest.ExitCode.TESTS_FAILED, notes=(*report.notes, *lacking)
            )
        lost = self._save(report, lambda path: path.suffix == ".json")
        if not lost:
            self.journal.remove()
        return list(dict.fromkeys([*told, *lacking, *lost])), not (lacking or lost)

    def annotate(self, report: Report | None, reporter: pytest.TerminalReporter) -> None:
        """Print what GitHub Actions shows beside the lines of a change, in one of its jobs; each begins a line."""
        if report is None or os.environ.get("GITHUB_ACTIONS") != "true":
            return
        from pytest_rvads.report.annotations import annotate

        root = self._config.rootpath
        found: list[str] = []
        workspace = Path(os.environ.get("GITHUB_WORKSPACE") or root)
        troubles = _attempt("the annotations of the job", lambda: found.extend(annotate(report, root, workspace)))
        for line in (*(f"rvads: {trouble}" for trouble in troubles), *found):
            reporter.ensure_newline()
            reporter.write_line(line)

    def _save(self, report: Report, wanted: Callable[[Path], bool]) -> list[str]:
        if not self._reports:
            return []
        from pytest_rvads.report.files import save

        jobs = [partial(save, path, report) for path in self._reports if wanted(path)]
        return [trouble for job in jobs for trouble in _attempt("the report", job)]

    def _write_index(self, report: Report) -> None:
        """Write the page that leads from the verdicts to the replays, and the report that `rvads replay` reads."""
        from pytest_rvads.report.files import save
        from pytest_rvads.report.folders import INDEX, REPORT

        folder = self._config.stash[FOLDER]
        path = folder.made() / INDEX
        save(path, report)
        self.index = folder.told(path)
        save(path.with_name(REPORT), report)


def _attempt(what: str, write: Callable[[], None]) -> list[str]:
    """Write something, and return the sentence on why that failed, if it did."""
    try:
        write()
    except OSError as error:
        return [f"{what} could not be written: {error}"]
    except Exception as error:  # what drivers and hooks put into a record costs this file only
        return [f"{what} could not be written: {told(error)}"]
    return []


def _runs_nothing(options: argparse.Namespace) -> bool:
    return any(getattr(options, name, False) for name in _QUESTIONS)


def _first_json(reports: Sequence[Path]) -> Path | None:
    return next((path for path in reports if path.suffix == ".json"), None)
