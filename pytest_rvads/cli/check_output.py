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
from pytest_rvads.cli.run_answers import NOTABLE, Batch, RunAnswer, run_files
from pytest_rvads.logic.conduct.kpis import describe
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.counting import Counts
from pytest_rvads.report.failures import when
from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import sums
from pytest_rvads.report.session_report import NOTHING_JUDGED, UNFINISHED, Report, exit_status
from pytest_rvads.support.wording import plural

VERSION = 1
"""Version of the object of ``--json`` and of the lines of ``--jsonl``."""
_LISTED = {Status.FAIL: "violated", Status.OPEN: "open", Status.UNSURE: "unsure"}
"""By status, the member of a JSON object that lists the instances."""
_MOST_DOUBTS = 20
"""Largest number of warnings that are printed without ``--verbose``."""


def line(verdict: Verdict) -> str:
    """Return a line with the status of a verdict and its message, which names the rule."""
    text = verdict.message.removeprefix(f"{verdict.rule} {verdict.status}: ")
    return f"{verdict.status.value:5} {text if text.startswith(verdict.rule) else f'{verdict.rule}: {text}'}"


def unsure(verdict: Verdict) -> Iterator[str]:
    """Yield a line per unsure instance of a rule, with its agents and its doubt, unless the line of the verdict names both."""
    doubts = [instance for instance in verdict.instances if instance.status is Status.UNSURE]
    if len(doubts) > 1 or verdict.status is not Status.UNSURE or not verdict.reason:
        yield from (": ".join(filter(None, (", ".join(name for _, name in i.binding), i.hangs))) for i in doubts)


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


class Teller:
    """Prints the verdicts on the runs of files, in order, counts them, and writes the reports at the end, even after an error.

    Args:
        options: the options of the command.
        reports: paths of the reports to write.
    """

    def __init__(self, options: argparse.Namespace, reports: Sequence[Path]) -> None:
        self._options, self._reports = options, reports
        self.troubles: list[str] = []
        """A sentence per file or run that could not be read or judged."""
        self.files = run_files(options.files, self._trouble)
        self.alone = len(options.files) == len(self.files) == 1
        """Whether a single file is checked, so that all its verdicts and warnings are printed."""
        self.for_program = options.json or options.jsonl
        """Whether a program reads the verdicts."""
        self._counts, self._statuses, self._records = Counts(Report(())), set[Status](), list[Record]()
        self._labels = {"version"}  # the member of the JSON object that is no run
        self._runs = self._vehicles = self._files = self._doubts = 0
        self._excerpts = False
        self._bar = sys.stderr.isatty() or not self.for_program  # a program can read standard error as well

    def __enter__(self) -> Teller:
        if self._options.json:
            print(f'{{"version": {VERSION}', end="", flush=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        whole = kind is None
        try:
            if whole and self._options.json:
                print("\n}", flush=True)
            elif whole and not self.for_program and self._runs and (self._excerpts or not self.alone):
                say("\n".join(self._totals()))
        finally:
            if self._reports:
                from pytest_rvads.report.files import save
                from pytest_rvads.support.installed import versions

                notes = () if whole else ("INCOMPLETE: rvads check did not come to its end, so runs are missing",)
                report = Report(
                    self._records,
                    versions=versions(),
                    exitstatus=self._status if whole else UNFINISHED,
                    notes=(*notes, *self.troubles),
                    complete=whole,
                    again="",
                )
                for path in self._reports:
                    save(path, report)

    def tell(self, batch: Batch) -> None:
        """Print the verdicts on a part of a file."""
        clear()
        if batch.error:
            self._trouble(batch.error)
            if self._options.jsonl:
                self._write_line({"file": batch.file, "errors": [batch.error]})
        for answer in batch.answers:
            self._run(answer)
        self._files += batch.last
        if self._bar and len(self.files) > 1 and batch.last:
            progress(self._files, len(self.files), "files")
        elif self._bar and len(self.files) == 1 < batch.total and any(answer.excerpt for answer in batch.answers):
            progress(self._runs, batch.total, "busy periods")

    def exit_status(self) -> int:
        """Return the exit status of the command; 0 in place of 1 and 5 if a program reads the verdicts."""
        if self.for_program and not self.troubles:
            return 0
        if self._status == NOTHING_JUDGED:
            unsure = "every verdict that applies is UNSURE"
            why = unsure if Status.UNSURE in self._statuses else "no rule applies to any of these runs"
            warn(f"rvads: nothing was judged: {why}")
        return self._status

    @property
    def _status(self) -> int:
        # An unavoidable violation counts as a violation.
        return exit_status({Outcome(status.value) for status in self._statuses}, complete=not self.troubles)

    def _trouble(self, sentence: str) -> None:
        self.troubles.append(sentence)
        warn(f"rvads: {sentence}")

    def _run(self, answer: RunAnswer) -> None:
        label, number = answer.label, 1
        while label in self._labels:
            label = f"{answer.file}: {answer.label}" + (f" ({number})" if number > 1 else "")
            number += 1
        self._labels.add(label)
        complete = self._options.verbose or (self.alone and not answer.excerpt)
        for warning in answer.warnings:
            self._doubts += 1
            if complete or self._doubts <= _MOST_DOUBTS:
                warn(f"warning: {label}: {warning}")
            elif self._doubts == _MOST_DOUBTS + 1:
                warn("warning: further warnings are not printed, --verbose prints them")
        for error in answer.errors:
            self._trouble(f"{label} {error}")
        self._runs += 1
        self._vehicles += answer.vehicles
        self._excerpts |= answer.excerpt
        self._statuses.update(verdict.status for verdict in answer.verdicts)
        for record in answer.records:
            self._counts.add(record)
            if self._reports:
                self._records.append(replace(record, nodeid=f"{label}-{record.rule}", recording=label))
        kpis = answer.kpis
        if self._options.json:
            content = _verdicts(answer) | ({} if kpis is None else {"(kpis)": kpis.record()})  # no rule can have this name
            # The object is printed piece by piece, so that memory does not hold all runs.
            print(f",\n{json.dumps(label)}: {json.dumps(content)}", end="", flush=True)
        elif self._options.jsonl:
            content = {"run": label, "file": answer.file, "start": answer.start, "vehicles": answer.vehicles}
            content |= {"verdicts": _verdicts(answer)} | ({} if kpis is None else {"kpis": kpis.record()})
            self._write_line(content | ({"errors": list(answer.errors)} if answer.errors else {}))
        else:
            lines: list[str] = []
            for verdict in answer.verdicts:
                if complete or verdict.status in NOTABLE:
                    lines += [line(verdict), *(f"       UNSURE {what}" for what in unsure(verdict))]
            lines += [] if kpis is None else describe(kpis)
            if lines or complete:
                say("\n  ".join((label, *lines)))

    def _write_line(self, content: dict[str, Any]) -> None:
        print(json.dumps({"version": VERSION} | content), flush=True)

    def _totals(self) -> Iterator[str]:
        """Yield the lines of a table of the numbers of verdicts by rule, and a line on the number of judged runs."""
        _, rules, _ = sums(self._counts)
        kinds = [kind.value for kind in rules.kinds if kind]
        table = [("", *kinds), *((row.name, *(str(count or "") for count in row.counts)) for row in rules.rows)]
        name = max((len(row.name) for row in rules.rows), default=0)
        for first, *counts in table if rules.rows else ():
            cells = (f"{text:>{max(8, len(kind) + 2)}}" for text, kind in zip(counts, kinds, strict=False))
            yield f"{first:{name}}{''.join(cells)}".rstrip()
        extent = f"{plural(self._runs, 'run')}, {plural(self._vehicles, 'vehicle')} judged"
        if self.troubles:
            extent += f"; {plural(len(self.troubles), 'thing')} could not be read or judged"
        yield extent
