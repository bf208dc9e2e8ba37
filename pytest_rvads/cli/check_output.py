"""The output of ``rvads check``: the verdicts on each run, as text or JSON, and the reports at the end."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from msgspec.structs import replace

from pytest_rvads.cli.common import clear, progress, say, warn
from pytest_rvads.cli.run_answers import NOTABLE, Batch, RunAnswer
from pytest_rvads.logic.conduct.kpis import describe
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.counting import Counts
from pytest_rvads.report.failure_page import when
from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import sums
from pytest_rvads.report.session_report import NOTHING_JUDGED, UNFINISHED, Report, exit_status
from pytest_rvads.support.wording import plural

VERSION = 1
"""Version of the object of ``--json`` and of the lines of ``--jsonl``."""
_KPIS = "(kpis)"
"""Member of a JSON object with the indicators of a run, beside the rules; no rule can have this name."""
_LISTED = {Status.FAIL: "violated", Status.OPEN: "open", Status.UNSURE: "unsure"}
"""By status, the member of a JSON object that lists the instances."""
_MOST_DOUBTS = 20
"""Largest number of warnings that are printed without ``--verbose``."""


class Output:
    """Base class of the formats in which verdicts on runs are printed; a format overrides the methods for what it prints."""

    def run(self, label: str, answer: RunAnswer) -> None:
        """Print the verdicts on a run."""

    def unread(self, batch: Batch) -> None:
        """Print that a file could not be read."""

    def close(self) -> None:
        """Print the end of the output."""


def output(options: argparse.Namespace, alone: bool, totals: Totals) -> Output:
    """Return the output (text, JSON object or JSON lines) that the options choose."""
    if options.json:
        return _Object()
    return _Lines() if options.jsonl else _Text(alone, options.verbose, totals)


def line(verdict: Verdict) -> str:
    """Return a line with the status of a verdict and its message, which names the rule."""
    text = verdict.message.removeprefix(f"{verdict.rule} {verdict.status}: ")
    return f"{verdict.status.value:5} {text if text.startswith(verdict.rule) else f'{verdict.rule}: {text}'}"


def unsure(verdict: Verdict) -> Iterator[str]:
    """Yield a line per unsure instance of a rule, with its agents and its doubt, unless the line of the verdict names both."""
    doubts = [instance for instance in verdict.instances if instance.status is Status.UNSURE]
    if len(doubts) > 1 or verdict.status is not Status.UNSURE or not verdict.reason:
        yield from (": ".join(filter(None, (", ".join(name for _, name in i.binding), i.hangs))) for i in doubts)


class _Text(Output):
    """Prints text: all verdicts for a single file or with ``--verbose``, and otherwise only the `NOTABLE` verdicts."""

    def __init__(self, alone: bool, verbose: bool, totals: Totals) -> None:
        self._alone, self._verbose, self._totals, self._excerpts = alone, verbose, totals, False

    def run(self, label: str, answer: RunAnswer) -> None:
        self._excerpts |= answer.excerpt
        complete = self._verbose or (self._alone and not answer.excerpt)
        lines: list[str] = []
        for verdict in answer.verdicts:
            if complete or verdict.status in NOTABLE:
                lines += [line(verdict), *(f"       UNSURE {what}" for what in unsure(verdict))]
        indicators = [] if answer.kpis is None else list(describe(answer.kpis))
        if lines or complete or indicators:
            say("\n  ".join((label, *lines, *indicators)))

    def close(self) -> None:
        if self._totals.runs and (self._excerpts or not self._alone):
            say("\n".join(self._totals.lines()))


def measured(verdict: Verdict, instance: InstanceVerdict) -> dict[str, Any]:
    """Return a JSON object with time and margin of an instance of a rule, and the event on which an unsure instance depends."""
    margin = instance.margin if instance.margin is not None and math.isfinite(instance.margin) else None
    hangs = {"hangs": instance.hangs} if instance.hangs else {}
    return {"time": when(verdict, instance), "margin": margin, **hangs}


def _verdicts(answer: RunAnswer) -> dict[str, Any]:
    by_rule: dict[str, Any] = {}
    for verdict in answer.verdicts:
        instances_by_word: dict[str, list[dict[str, Any]]] = {word: [] for word in _LISTED.values()}
        for instance in verdict.instances:
            if instance.status in _LISTED:
                instances_by_word[_LISTED[instance.status]].append({**dict(instance.binding), **measured(verdict, instance)})
        listed = {word: instances for word, instances in instances_by_word.items() if instances or word != "open"}
        by_rule[verdict.rule] = {"status": verdict.status.value} | listed
    return by_rule


class _Object(Output):
    """Prints one JSON object for all runs piece by piece, so that memory does not hold all runs."""

    def __init__(self) -> None:
        self._write(f'{{"version": {VERSION}')

    def run(self, label: str, answer: RunAnswer) -> None:
        content = _verdicts(answer) | ({} if answer.kpis is None else {_KPIS: answer.kpis.record()})
        self._write(f",\n{json.dumps(label)}: {json.dumps(content)}")

    def close(self) -> None:
        self._write("\n}\n")

    def _write(self, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


class _Lines(Output):
    """Prints a line with a JSON object per run."""

    def run(self, label: str, answer: RunAnswer) -> None:
        content: dict[str, Any] = {"run": label, "file": answer.file, "start": answer.start, "vehicles": answer.vehicles}
        content |= {"verdicts": _verdicts(answer)}
        content |= {} if answer.kpis is None else {"kpis": answer.kpis.record()}
        self._write(content | ({"errors": list(answer.errors)} if answer.errors else {}))

    def unread(self, batch: Batch) -> None:
        self._write({"file": batch.file, "errors": [batch.error]})

    def _write(self, content: dict[str, Any]) -> None:
        print(json.dumps({"version": VERSION} | content), flush=True)


class Totals:
    """Counts the verdicts on all runs, and the files and runs that could not be judged."""

    def __init__(self) -> None:
        self._counts = Counts(Report(()))
        self._statuses: set[Status] = set()
        self.troubles: list[str] = []
        """A sentence per file or run that could not be read or judged."""
        self.runs = self.vehicles = self.files = self._doubts = 0

    def trouble(self, sentence: str) -> None:
        """Count and print a file or run that could not be read or judged."""
        self.troubles.append(sentence)
        warn(f"rvads: {sentence}")

    def doubt(self, sentence: str, *, every: bool) -> None:
        """Print a warning about a run; only the first few warnings are printed, unless `every` is set."""
        self._doubts += 1
        if every or self._doubts <= _MOST_DOUBTS:
            warn(f"warning: {sentence}")
        elif self._doubts == _MOST_DOUBTS + 1:
            warn("warning: further warnings are not printed, --verbose prints them")

    def add(self, answer: RunAnswer) -> None:
        """Count the verdicts on a run."""
        self.runs += 1
        self.vehicles += answer.vehicles
        self._statuses.update(verdict.status for verdict in answer.verdicts)
        for record in answer.records:
            self._counts.add(record)

    def lines(self) -> list[str]:
        """Return the lines of a table of the numbers of verdicts by rule, and a line on the number of judged runs."""
        _, rules, _ = sums(self._counts)
        kinds = [kind.value for kind in rules.kinds if kind]
        table = [("", *kinds), *((row.name, *(str(count or "") for count in row.counts)) for row in rules.rows)]
        name = max((len(row.name) for row in rules.rows), default=0)
        lines = []
        for first, *counts in table if rules.rows else ():
            cells = (f"{text:>{max(8, len(kind) + 2)}}" for text, kind in zip(counts, kinds, strict=False))
            lines.append(f"{first:{name}}{''.join(cells)}".rstrip())
        extent = f"{plural(self.runs, 'run')}, {plural(self.vehicles, 'vehicle')} judged"
        if self.troubles:
            extent += f"; {plural(len(self.troubles), 'thing')} could not be read or judged"
        return [*lines, extent]

    @property
    def status(self) -> int:
        """The exit status of the command for the counted verdicts."""
        # An unavoidable violation counts as a violation.
        return exit_status({Outcome(status.value) for status in self._statuses}, complete=not self.troubles)

    def exit_status(self, *, for_program: bool) -> int:
        """Return the exit status; 0 in place of 1 and 5 if a program reads the verdicts (`for_program`)."""
        if for_program and not self.troubles:
            return 0
        if self.status == NOTHING_JUDGED:
            unsure = "every verdict that applies is UNSURE"
            why = unsure if Status.UNSURE in self._statuses else "no rule applies to any of these runs"
            warn(f"rvads: nothing was judged: {why}")
        return self.status


class Teller:
    """Prints the verdicts on parts of files, in order, and writes the reports at the end, even after an error.

    Args:
        options: the options of the command.
        totals: counts the verdicts of all runs.
        files: number of files.
        reports: paths of the reports to write.
        alone: whether a single file is checked, so that all its warnings are printed.
    """

    def __init__(self, options: argparse.Namespace, totals: Totals, files: int, reports: Sequence[Path], *, alone: bool) -> None:
        self._totals, self._files, self._alone, self._verbose = totals, files, alone, options.verbose
        self._labels = {"version"}  # the member of the JSON object that is no run
        self._output = output(options, alone, totals)
        self._reports, self._records = reports, list[Record]()
        # A program that reads JSON can read standard error as well.
        self._bar = sys.stderr.isatty() or not (options.json or options.jsonl)

    def __enter__(self) -> Teller:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._output.close()
        finally:
            if self._reports:
                from pytest_rvads.report.files import save
                from pytest_rvads.support.installed import versions

                whole = kind is None
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
        """Print the verdicts on a part of a file."""
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
        label, number = answer.label, 1
        while label in self._labels:
            label = f"{answer.file}: {answer.label}" + (f" ({number})" if number > 1 else "")
            number += 1
        self._labels.add(label)
        for warning in answer.warnings:
            self._totals.doubt(f"{label}: {warning}", every=self._verbose or (self._alone and not answer.excerpt))
        for error in answer.errors:
            self._totals.trouble(f"{label} {error}")
        self._totals.add(answer)
        self._output.run(label, answer)
        for record in answer.records if self._reports else ():
            self._records.append(replace(record, nodeid=f"{label}-{record.rule}", recording=label))
