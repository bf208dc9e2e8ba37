"""Judging the runs of files for ``rvads check``: records, as plain values that cross processes.

Answers come in the order of the files, on any number of processes, with one run in memory per process. A run that can't be read
or judged, or that kills its process, costs no other verdict.
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

from pytest_rvads.cli.answers import named_rules
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.conduct.validate import damage, validate
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.draw.replay import Beside
from pytest_rvads.report.failure_page import failure_pages
from pytest_rvads.report.record import Record, planned_record
from pytest_rvads.report.run_record import by_rule, of_run, sentence, summed, verdict_by
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.runs.readers import READERS, files_of, matching, read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.support.executors import Failed, gathered
from pytest_rvads.support.storage import slug, write_file

__all__ = ["NOTABLE", "Batch", "Question", "RunAnswer", "judged"]

_SIZE = 4
"""Number of runs of a file that a process gets at a time, if there are several processes."""
_SHOWN = (Status.FAIL, Status.OPEN, Status.UNSURE)
"""The statuses of verdicts that have replay pages."""
NOTABLE = (*_SHOWN, Status.ERROR)
"""What is not as it should be."""


@dataclass(frozen=True, slots=True)
class Question:
    """The question of a command about every run."""

    rules: tuple[str, ...]
    """Names of rules, as on the command line."""
    kpis: bool = False
    """Whether indicators are asked for."""
    alone: bool = False
    """Whether a single file is checked; then a run that is no excerpt has indicators."""
    pages: str | None = None
    """Folder of the pages of failures."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Some runs of a file."""

    file: str
    begin: int
    end: int

    def rest(self, total: int) -> list[_Part]:
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
    """A record per rule."""
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    """Reasons why rules could not judge the run, a sentence each."""

    @property
    def verdicts(self) -> Iterator[Verdict]:
        """The verdict of each rule."""
        return (verdict for record in self.records for verdict in record.verdicts)

    @property
    def kpis(self) -> Kpis | None:
        """The indicators of the run, where they are asked for."""
        return self.records[0].kpis if self.records else None


@dataclass(frozen=True, slots=True)
class Batch:
    """The answers on a part of a file."""

    file: str
    total: int
    """Number of runs in the file."""
    answers: tuple[RunAnswer, ...] = ()
    error: str = ""
    """Reason why the file could not be read."""
    last: bool = True
    """Whether no further part of the file comes."""


class _Parts(Iterator[_Part]):
    """The parts of files in the order of judging; added parts come before the next file."""

    def __init__(self, files: Sequence[str], size: int) -> None:
        self.rest: deque[_Part] = deque()
        self.begun: list[_Part] = []
        self._first = (_Part(file, 0, size) for file in files)

    def __next__(self) -> _Part:
        self.begun.append(self.rest.popleft() if self.rest else next(self._first))
        return self.begun[-1]


def judged(files: Sequence[str], question: Question, processes: int = 1) -> Generator[Batch, None, None]:
    """Yield the answers on the runs of files, in order, as soon as they are known; closing ends the processes early."""
    size = _SIZE if processes > 1 else 1  # a single process answers after each run
    parts, done = _Parts(files, size), dict[_Part, Batch]()
    due = deque(_Part(file, 0, size) for file in files)
    with closing(gathered(_Judge(question), parts, processes, batch=1)) as answers:
        for number, answer in answers:
            part = parts.begun[number]
            done[part] = Batch(part.file, 0, error=f"{part.file}: {answer.error}") if isinstance(answer, Failed) else answer
            parts.rest.extend(part.rest(done[part].total))
            while due and due[0] in done:
                part = due.popleft()
                batch = done.pop(part)
                due.extendleft(reversed(part.rest(batch.total)))
                yield batch


class _Judge:
    """Answers a question about runs, one after the other; the file that was read last is kept where it holds several."""

    def __init__(self, question: Question) -> None:
        self._question = question
        self._kept: tuple[str, Sequence[Run]] | None = None

    @cached_property
    def _rules(self) -> tuple[Rule, ...]:
        return named_rules(self._question.rules)

    def __call__(self, part: _Part) -> Batch:
        """Return the answers on a part of a file; an unreadable file or run gives an answer with the error."""
        try:
            runs = self._runs(part.file)
            total = len(runs)
        except Exception as error:
            return Batch(part.file, 0, error=sentence(error))
        answers = self._answers(part, runs, range(part.begin, min(part.end, total)))
        return Batch(part.file, total, tuple(answers), last=part.end >= total)

    def _runs(self, file: str) -> Sequence[Run]:
        if self._kept is None or self._kept[0] != file:
            self._kept = None  # what was read before goes first: two files need not fit
            runs = read_runs(file)
            if len(runs) < 2:
                return runs
            self._kept = file, runs
        return self._kept[1]

    def _answers(self, part: _Part, runs: Sequence[Run], numbers: range) -> Iterator[RunAnswer]:
        for number in numbers:
            try:
                yield self._one(part.file, number, runs[number])
            except Exception as error:
                yield RunAnswer(part.file, f"run {number + 1}", 0.0, False, 0, errors=(f"can't be judged: {sentence(error)}",))

    def _one(self, file: str, number: int, run: Run) -> RunAnswer:
        reasons: dict[str, list[str]] = {}
        verdicts: list[tuple[Rule, Verdict]] = []
        for rule in self._rules:
            verdict = verdict_by(run, rule)
            if verdict.status is Status.ERROR:
                reasons.setdefault(verdict.reason, []).append(rule.name)
            verdicts.append((rule, verdict))
        wants_kpis = self._question.kpis or (self._question.alone and run.excerpt is None)
        place = run.junction
        keys = {"junction": place.name, "control": place.control.value, "recording": run.label}
        whole = replace(
            planned_record(run.label, 0, "", keys, place.ways),
            verdicts=tuple(verdict for _, verdict in verdicts),
            run=run.label,
            kpis=kpis(run) if wants_kpis and not damage(run) else None,
            **of_run(run),
        )
        records = [
            self._shown(record, self._pages(file, number, run, rule, verdict, verdicts))
            for record, (rule, verdict) in zip(by_rule(whole), verdicts, strict=True)
        ]
        judged = None if run.excerpt is None else run.excerpt.judged
        return RunAnswer(
            file,
            run.label,
            run.start,
            run.excerpt is not None,
            len(run.agents if judged is None else judged),
            tuple(records),
            tuple(map(str, validate(run))),
            tuple(self._unfit(reason, names) for reason, names in reasons.items()),
        )

    def _unfit(self, reason: str, names: Sequence[str]) -> str:
        by = "" if len(names) == len(self._rules) else f" by {', '.join(names)}"
        return f"can't be judged{by}: {reason}"

    def _shown(self, record: Record, pages: tuple[str, ...]) -> Record:
        return replace(record, look=pages[0], looks=pages[1:]) if pages else record

    def _pages(
        self, file: str, number: int, run: Run, rule: Rule, verdict: Verdict, verdicts: Sequence[tuple[Rule, Verdict]]
    ) -> tuple[str, ...]:
        """Write the replay pages of a verdict; return their names with their opening times, or the reason for having no page."""
        if self._question.pages is None or verdict.status not in _SHOWN:
            return ()
        again = f"rvads check {quote(file)} --rules {rule.name}"
        notes = f"{verdict.explanation}\nrecorded  {file}\nrerun     {again}"
        facts = ("recorded", file), ("rule", f"{rule.name}: {rule.title}" if rule.title else rule.name), ("rerun", again)
        beside = Beside(facts, summed(further for _, further in verdicts if further is not verdict), "index.html")
        pages: list[str] = []
        try:
            for page in failure_pages(run, verdict, rule, notes, beside):
                name = f"{slug(f'{run.label}-{rule.name}-{number}.{len(pages)}-{file}')}.html"
                write_file(Path(self._question.pages) / name, page.html.encode())
                pages.append(f"{Path(self._question.pages) / name}#t={page.time:.2f}")
        except Exception as error:
            pages.append(f"not drawn: {sentence(error)}\n{notes}")
        return tuple(pages)


def run_files(names: Sequence[str], lament: Callable[[str], None]) -> list[str]:
    """Return the files that names denote, each once: in the order of the names, the files of a folder or pattern sorted.

    Args:
        names: names of files; of folders, which are searched for files of runs at any depth; and patterns, which some shells do
            not expand.
        lament: called with a sentence for each folder or pattern without files.
    """
    by_path: dict[str, str] = {}
    for name in names:
        files = _meant(name)
        if not files:
            kinds = f"expected files of runs ({', '.join(READERS)}) in it"
            lament(f"{name}: the folder is empty, {kinds}" if os.path.isdir(name) else f"{name}: no file matches this pattern")
        for file in files:
            by_path.setdefault(os.path.abspath(file), file)
    return list(by_path.values())


def _meant(name: str) -> list[str]:
    if not os.path.isdir(name) and (os.path.lexists(name) or not has_magic(name)):
        return [name]  # the reader reports a file that can't be read
    return list(map(str, files_of(Path(name)) if os.path.isdir(name) else matching(name)))
