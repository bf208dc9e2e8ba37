"""Prints the answers of ``rvads check`` as they arrive, on standard output and standard error, and writes reports at the end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from msgspec.structs import replace

from pytest_rvads.cli.check_output import output
from pytest_rvads.cli.check_totals import Totals
from pytest_rvads.cli.common import clear, progress
from pytest_rvads.cli.run_answers import Batch, RunAnswer
from pytest_rvads.report.anew import Spool
from pytest_rvads.report.session_report import UNFINISHED, Report

__all__ = ["Teller"]


class Teller:
    """Takes the answers on parts of files, in order; the reports are written even after an error.

    Args:
        options: the options of the command.
        totals: the counts of all answers.
        files: number of files.
        reports: paths of the reports to write.
        alone: whether a single file is checked, so that all its warnings are printed.
    """

    def __init__(self, options: argparse.Namespace, totals: Totals, files: int, reports: Sequence[Path], *, alone: bool) -> None:
        self._totals, self._files, self._alone, self._verbose = totals, files, alone, options.verbose
        self._labels = {"version"}  # the member of the JSON object that is no run
        self._output = output(options, alone, totals)
        self._reports, self._records = reports, Spool()
        # A program that reads JSON may read standard error together with it.
        self._bar = sys.stderr.isatty() or not (options.json or options.jsonl)

    def __enter__(self) -> Teller:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._output.close()
        finally:
            self._report(whole=kind is None)

    def _report(self, *, whole: bool) -> None:
        if not self._reports:
            return
        from pytest_rvads.report.files import save
        from pytest_rvads.versions import versions

        notes = () if whole else ("INCOMPLETE: rvads check did not come to its end, so runs are missing",)
        report = Report(
            self._records,
            versions=versions(),
            exitstatus=self._totals.status if whole else UNFINISHED,
            notes=(*notes, *self._totals.troubles),
            complete=whole,
            again="",
        )
        for path in self._reports:
            save(path, report)

    def tell(self, batch: Batch) -> None:
        """Print the answers on a part of a file."""
        clear()
        if batch.error:
            self._totals.trouble(batch.error)
            self._output.unread(batch)
        for answer in batch.answers:
            self._run(answer)
        self._totals.files += batch.last
        if self._bar and self._files > 1 and batch.last:
            progress(self._totals.files, self._files, "files")
        elif self._bar and self._files == 1 < batch.total and any(answer.excerpt for answer in batch.answers):
            progress(self._totals.runs, batch.total, "busy periods")

    def _run(self, answer: RunAnswer) -> None:
        label = self._label(answer)
        for warning in answer.warnings:
            self._totals.doubt(f"{label}: {warning}", every=self._verbose or (self._alone and not answer.excerpt))
        for error in answer.errors:
            self._totals.trouble(f"{label} {error}")
        self._totals.add(answer)
        self._output.run(label, answer)
        for record in answer.records if self._reports else ():
            self._records.add(replace(record, nodeid=f"{label}-{record.rule}", recording=label))

    def _label(self, answer: RunAnswer) -> str:
        """Return what a run is called; a label that comes again, in another file or the same, has the file before it."""
        label, number = answer.label, 1
        while label in self._labels:
            label = f"{answer.file}: {answer.label}" + (f" ({number})" if number > 1 else "")
            number += 1
        self._labels.add(label)
        return label
