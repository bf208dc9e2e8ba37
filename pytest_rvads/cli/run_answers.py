"""Judges the runs of files for ``rvads check``, and returns the verdicts as records that can be sent between processes.

The verdicts come in the order of the files, on any number of processes, with one run in memory per process. A run that can't be
read or judged, or that kills its process, costs no other verdict.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from glob import has_magic
from pathlib import Path
from shlex import quote

from msgspec.structs import replace

from pytest_rvads.cli.common import named_rules
from pytest_rvads.logic.check import sentence, verdict_by
from pytest_rvads.logic.conduct.kpis import arrival_differences, kpis
from pytest_rvads.logic.conduct.validate import damage, validate
from pytest_rvads.logic.judging.judge import undecided
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.failures import TROUBLE, Beside, summed
from pytest_rvads.report.record import Record, by_rule, of_run, planned_record
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.runs.readers import READERS, files_of, matching, read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Kind
from pytest_rvads.support.executors import Failed, gathered
from pytest_rvads.support.installed import load
from pytest_rvads.support.storage import slug, write_file

NOTABLE = (*TROUBLE, Status.ERROR)
"""The statuses of verdicts that people have to look at."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of a file: some of its runs."""

    file: str
    begin: int
    end: int

    def further(self, total: int) -> list[_Part]:
        """Return the parts after the first part of a file with `total` runs; all parts have the same size."""
        size = self.end - self.begin
        return [_Part(self.file, k, k + size) for k in range(self.end, total, size)] if self.begin == 0 else []


@dataclass(frozen=True, slots=True)
class RunAnswer:
    """The verdicts of all rules on a run of a file."""

    file: str
    label: str
    start: float
    """Start of the run, on the clock of its recording [s]."""
    excerpt: bool
    """Whether the run is a part of a recording."""
    vehicles: int
    """Number of judged vehicles."""
    records: tuple[Record, ...] = ()
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    """Reasons why rules could not judge the run, a sentence each."""

    @property
    def verdicts(self) -> Iterator[Verdict]:
        """The verdict of each rule."""
        return (verdict for record in self.records for verdict in record.verdicts)

    @property
    def kpis(self) -> Kpis | None:
        """The performance indicators of the run; None if the command did not request indicators."""
        return self.records[0].kpis if self.records else None


@dataclass(frozen=True, slots=True)
class Batch:
    """The verdicts on the runs of a part of a file."""

    file: str
    total: int
    """Number of runs in the file."""
    answers: tuple[RunAnswer, ...] = ()
    error: str = ""
    last: bool = True
    """Whether no further part of the file comes."""


class _Parts(Iterator[_Part]):
    """Iterator over the parts of files in the order of judging; the parts in `waiting` come before the next file."""

    def __init__(self, files: Sequence[str], size: int) -> None:
        self.waiting: deque[_Part] = deque()
        self.issued: list[_Part] = []
        self._first = (_Part(file, 0, size) for file in files)

    def __next__(self) -> _Part:
        self.issued.append(self.waiting.popleft() if self.waiting else next(self._first))
        return self.issued[-1]


def judged(files: Sequence[str], judge: Judge, processes: int = 1) -> Generator[Batch, None, None]:
    """Yield the verdicts on the runs of files in order, as soon as possible; closing the iterator ends the processes."""
    size = 4 if processes > 1 else 1  # a single process answers after each run
    parts, batches = _Parts(files, size), dict[_Part, Batch]()
    awaited = deque(_Part(file, 0, size) for file in files)
    with closing(gathered(judge, parts, processes, batch=1)) as answers:
        for number, answer in answers:
            part = parts.issued[number]
            batches[part] = Batch(part.file, 0, error=f"{part.file}: {answer.error}") if isinstance(answer, Failed) else answer
            parts.waiting.extend(part.further(batches[part].total))
            while awaited and awaited[0] in batches:
                part = awaited.popleft()
                batch = batches.pop(part)
                awaited.extendleft(reversed(part.further(batch.total)))
                yield batch


@dataclass
class Judge:
    """Judges the runs of parts of files; the runs of the last file stay in memory."""

    rules: tuple[str, ...]
    """Names of rules, as on the command line."""
    kpis: bool = False
    """Whether performance indicators are computed for every run."""
    alone: bool = False
    """Whether a single file is checked; then indicators are computed for every run that is no excerpt of a recording."""
    pages: str | None = None
    """Folder of the pages of failures."""
    _last_read: tuple[str, Sequence[Run]] = ("", ())

    @cached_property
    def _rules(self) -> tuple[Rule, ...]:
        return named_rules(self.rules)

    def __call__(self, part: _Part) -> Batch:
        """Return the verdicts on the runs in a part of a file; for an unreadable file or run, return the error."""
        try:
            if self._last_read[0] != part.file:
                self._last_read = "", ()  # the runs of two files can be larger than memory
                self._last_read = part.file, read_runs(part.file)
            runs = self._last_read[1]
            total = len(runs)
        except Exception as error:
            return Batch(part.file, 0, error=sentence(error))
        answers = []
        for number in range(part.begin, min(part.end, total)):
            try:
                answers.append(self._answer(part.file, number, runs[number]))
            except Exception as error:
                errors = (f"can't be judged: {sentence(error)}",)
                answers.append(RunAnswer(part.file, f"run {number + 1}", 0.0, False, 0, errors=errors))
        return Batch(part.file, total, tuple(answers), last=part.end >= total)

    def _answer(self, file: str, number: int, run: Run) -> RunAnswer:
        reasons: dict[str, list[str]] = {}
        verdicts: list[tuple[Rule, Verdict]] = []
        for rule in self._rules:
            if not (rule.walked_at(run.junction) or rule.name in self.rules):
                continue
            verdict = verdict_by(run, rule)
            if verdict.status is Status.ERROR:
                reasons.setdefault(verdict.reason, []).append(rule.name)
            verdicts.append((rule, verdict))
        wants_kpis = self.kpis or (self.alone and run.excerpt is None)
        place, fit = run.junction, not damage(run)
        keys = {"junction": place.name, "control": place.control.value, "recording": run.label}
        run_record = replace(
            planned_record(run.label, 0, "", keys, place.ways),
            verdicts=tuple(verdict for _, verdict in verdicts),
            run=run.label,
            kpis=kpis(run) if wants_kpis and fit else None,
            arrivals=arrival_differences(run) if fit else None,
            **of_run(run),
        )
        records = []
        for record, (rule, verdict) in zip(by_rule(run_record), verdicts, strict=True):
            pages = self._pages(file, number, run, rule, verdict, verdicts)
            records.append(replace(record, look=pages[0], looks=pages[1:]) if pages else record)
        errors = []
        for reason, names in reasons.items():
            by = "" if len(names) == len(verdicts) else f" by {', '.join(names)}"
            errors.append(f"can't be judged{by}: {reason}")
        judged, ways = None if run.excerpt is None else run.excerpt.judged, undecided(run)
        return RunAnswer(
            file,
            run.label,
            run.start,
            run.excerpt is not None,
            sum(agent.kind is not Kind.PEDESTRIAN and (judged is None or agent.name in judged) for agent in run.agents),
            tuple(records),
            (*map(str, validate(run)), *([f"verdicts that depend on {ways} are UNSURE"] if ways else [])),
            tuple(errors),
        )

    def _pages(
        self, file: str, number: int, run: Run, rule: Rule, verdict: Verdict, verdicts: Sequence[tuple[Rule, Verdict]]
    ) -> tuple[str, ...]:
        """Write the replay pages of a verdict; return their names with their opening times, or the reason why no page exists."""
        if self.pages is None or verdict.status not in TROUBLE:
            return ()
        again = f"rvads check {quote(file)} --rules {rule.name}"
        notes = f"{verdict.explanation}\nrecorded  {file}\nrerun     {again}"
        facts = ("recorded", file), ("rule", f"{rule.name}: {rule.title}" if rule.title else rule.name), ("rerun", again)
        beside = Beside(facts, summed(further for _, further in verdicts if further is not verdict), "index.html")
        pages: list[str] = []
        try:
            for page in load("pages", "failure")(run, verdict, rule, notes, beside):
                name = f"{slug(f'{run.label}-{rule.name}-{number}.{len(pages)}-{file}')}.html"
                write_file(Path(self.pages) / name, page.html.encode())
                pages.append(f"{Path(self.pages) / name}#t={page.time:.2f}")
        except Exception as error:
            pages.append(f"not drawn: {sentence(error)}\n{notes}")
        return tuple(pages)


def run_files(names: Sequence[str], complain: Callable[[str], None]) -> list[str]:
    """Return the files that some names denote, each file once, in the order of the names; files of a folder are sorted."""
    by_path: dict[str, str] = {}
    for name in names:
        is_folder = os.path.isdir(name)
        if is_folder or not (os.path.lexists(name) or not has_magic(name)):
            files = list(map(str, files_of(Path(name)) if is_folder else matching(name)))
        else:
            files = [name]  # the reader reports a file that can't be read
        if not files:
            kinds = f"expected files of runs ({', '.join(READERS)}) in it"
            complain(f"{name}: the folder is empty, {kinds}" if is_folder else f"{name}: no file matches this pattern")
        for file in files:
            by_path.setdefault(os.path.abspath(file), file)
    return list(by_path.values())
