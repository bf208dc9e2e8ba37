"""Prints and writes the answers of ``rvads check`` as they arrive: on standard output, on standard error, and on the page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import TracebackType

from pytest_rvads.cli.check_index import Index
from pytest_rvads.cli.check_output import output
from pytest_rvads.cli.check_totals import Labels, Totals
from pytest_rvads.cli.common import clear, progress
from pytest_rvads.cli.run_answers import Batch, RunAnswer

__all__ = ["Teller"]


class Teller:
    """Takes the answers on parts of files, in order; the page is written even after an error.

    Args:
        options: the options of the command.
        totals: the counts of all answers.
        files: number of files.
        alone: whether a single file is checked, so that all its warnings are printed.
    """

    def __init__(self, options: argparse.Namespace, totals: Totals, files: int, *, alone: bool) -> None:
        self._totals, self._files, self._alone, self._verbose = totals, files, alone, options.verbose
        self._labels, self._output = Labels(), output(options, alone, totals)
        self._index = None if options.html is None else Index(Path(options.html))
        # A program that reads JSON may read standard error together with it.
        self._bar = sys.stderr.isatty() or not (options.json or options.jsonl)

    def __enter__(self) -> Teller:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._output.close()
        finally:
            if self._index:
                self._index.write(self._totals)

    def tell(self, batch: Batch) -> None:
        """Print the answers on a part of a file."""
        clear()
        if batch.error:
            self._totals.trouble(batch.error)
            self._output.unread(batch)
        for answer in batch.answers:
            self._run(answer)
        finished = self._totals.finish(batch)
        if self._bar and self._files > 1 and finished:
            progress(self._totals.files, self._files, "files")
        elif self._bar and self._files == 1 < batch.total and any(answer.excerpt for answer in batch.answers):
            progress(self._totals.runs, batch.total, "busy periods")

    def _run(self, answer: RunAnswer) -> None:
        label = self._labels.of(answer)
        for warning in answer.warnings:
            self._totals.doubt(f"{label}: {warning}", every=self._verbose or (self._alone and not answer.excerpt))
        for error in answer.errors:
            self._totals.trouble(f"{label} {error}")
        self._totals.add(answer)
        self._output.run(label, answer)
        if self._index:
            self._index.add(label, answer)
