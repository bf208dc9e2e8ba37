"""What ``rvads check`` says of the runs of files, as plain values that cross processes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Any

from pytest_rvads.cli.answers import named_rules
from pytest_rvads.conduct.kpis import describe, kpis
from pytest_rvads.conduct.validate import damage, validate
from pytest_rvads.draw.replay import Beside
from pytest_rvads.errors import RvadsError
from pytest_rvads.failure_page import failure_pages, when
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.storage import slug, write_file
from pytest_rvads.wording import one_line

__all__ = ["NOTABLE", "Batch", "Judge", "Part", "Question", "RunAnswer", "VerdictAnswer", "finite"]

_LISTED = {Status.FAIL: "violated", Status.OPEN: "open", Status.UNSURE: "unsure"}
"""What instances are listed under in JSON."""
_Summed = tuple[tuple[str, str, str], ...]
"""Rule, status and message of every verdict of a run."""
NOTABLE = (*_LISTED, Status.ERROR)
"""What is not as it should be."""


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of every run."""

    rules: tuple[str, ...]
    """As they are named on the command line."""
    kpis: bool = False
    """Whether indicators are asked for; without, they are told of runs that are complete in themselves and alone."""
    alone: bool = False
    """Whether there is one file."""
    pages: str | None = None
    """Folder of the pages of failures."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some runs of a file."""

    file: str
    begin: int
    end: int

    def rest(self, total: int) -> list[Part]:
        """Return what comes after the first part of a file of so many runs, in parts of the same size."""
        size = self.end - self.begin
        return [Part(self.file, k, k + size) for k in range(self.end, total, size)] if self.begin == 0 else []


@dataclass(frozen=True, slots=True)
class VerdictAnswer:
    """What a rule says of a run."""

    rule: str
    status: Status
    line: str
    """For people."""
    instances: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """For programs: those that are violated, open, unsure, by these words."""
    unsure: tuple[str, ...] = ()
    """What unsure instances hang on, for people."""
    pages: tuple[tuple[str, float], ...] = ()
    """Files in the folder of pages, and the times at which they open [s]."""
    undrawn: str = ""
    """Explanation, and why there is no page."""


@dataclass(frozen=True, slots=True)
class RunAnswer:
    """What all rules say of a run."""

    file: str
    label: str
    start: float
    """Of the run on the clock of its recording [s]."""
    excerpt: bool
    """Whether the run is a part of a recording."""
    vehicles: int
    """How many were judged."""
    verdicts: tuple[VerdictAnswer, ...] = ()
    kpis: dict[str, Any] | None = None
    indicators: tuple[str, ...] = ()
    """The same for people."""
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    """Why rules could not judge it, a sentence each."""


@dataclass(frozen=True, slots=True)
class Batch:
    """What is said of a part of a file."""

    file: str
    total: int
    """How many runs the file holds."""
    answers: tuple[RunAnswer, ...] = ()
    error: str = ""
    """Why the file could not be read."""


class Judge:
    """Answers a question about runs, one after the other; the file that was read last is kept where it holds several."""

    def __init__(self, question: Question) -> None:
        self._question = question
        self._rules = named_rules(question.rules)
        self._kept: tuple[str, Sequence[Run]] | None = None

    def answer(self, part: Part) -> Batch:
        """Return what is said of a part of a file; what can't be read or judged is told in it, whatever it is."""
        try:
            runs = self._runs(part.file)
            total = len(runs)
        except Exception as error:
            return Batch(part.file, 0, error=_told(error))
        return Batch(part.file, total, tuple(self._answers(part, runs, range(part.begin, min(part.end, total)))))

    def _runs(self, file: str) -> Sequence[Run]:
        if self._kept is None or self._kept[0] != file:
            self._kept = None  # what was read before goes first: two files need not fit
            runs = read_runs(file)
            if len(runs) < 2:
                return runs
            self._kept = file, runs
        return self._kept[1]

    def _answers(self, part: Part, runs: Sequence[Run], numbers: range) -> Iterator[RunAnswer]:
        for number in numbers:
            try:
                yield self._one(part.file, number, runs[number])
            except Exception as error:
                yield RunAnswer(part.file, f"run {number + 1}", 0.0, False, 0, errors=(f"can't be judged: {_told(error)}",))

    def _one(self, file: str, number: int, run: Run) -> RunAnswer:
        reasons: dict[str, list[str]] = {}
        given: list[tuple[Rule, Verdict]] = []
        for rule in self._rules:
            try:
                verdict = check(run, rule)
            except Exception as error:
                verdict = Verdict(rule.name, Status.ERROR, f"{rule.name} ERROR: {_told(error)}", reason=_told(error))
            if verdict.status is Status.ERROR:
                reasons.setdefault(verdict.reason, []).append(rule.name)
            given.append((rule, verdict))
        others = _summed(verdict for _, verdict in given)
        verdicts = [self._verdict(file, number, run, rule, verdict, others) for rule, verdict in given]
        asked = self._question.kpis or (self._question.alone and run.excerpt is None)
        found = kpis(run) if asked and not damage(run) else None
        judged = None if run.excerpt is None else run.excerpt.judged
        return RunAnswer(
            file,
            run.label,
            run.start,
            run.excerpt is not None,
            len(run.agents if judged is None else judged),
            tuple(verdicts),
            None if found is None else found.record(),
            () if found is None else tuple(describe(found)),
            tuple(map(str, validate(run))),
            tuple(self._unfit(reason, names) for reason, names in reasons.items()),
        )

    def _unfit(self, reason: str, names: Sequence[str]) -> str:
        by = "" if len(names) == len(self._rules) else f" by {', '.join(names)}"
        return f"can't be judged{by}: {reason}"

    def _verdict(self, file: str, number: int, run: Run, rule: Rule, verdict: Verdict, all: _Summed) -> VerdictAnswer:
        told = verdict.message.removeprefix(f"{verdict.rule} {verdict.status}: ")
        listed: dict[str, list[dict[str, Any]]] = {word: [] for word in _LISTED.values()}
        for instance in verdict.instances:
            if instance.status in _LISTED:
                listed[_LISTED[instance.status]].append(_record(verdict, instance))
        doubts = [instance for instance in verdict.instances if instance.status is Status.UNSURE]
        if len(doubts) == 1 and verdict.status is Status.UNSURE and verdict.reason:
            doubts = []  # the line says it
        unsure = (": ".join(filter(None, (", ".join(name for _, name in i.binding), i.hangs))) for i in doubts)
        pages, undrawn = self._pages(file, number, run, rule, verdict, all) if verdict.status in _LISTED else ((), "")
        line = f"{verdict.status.value:5} {told if told.startswith(verdict.rule) else f'{verdict.rule}: {told}'}"
        return VerdictAnswer(rule.name, verdict.status, line, listed, tuple(unsure), pages, undrawn)

    def _pages(
        self, file: str, number: int, run: Run, rule: Rule, verdict: Verdict, all: _Summed
    ) -> tuple[tuple[tuple[str, float], ...], str]:
        """Write the pages of a verdict; return their names and times, and what there is to say where one can't be drawn."""
        if self._question.pages is None:
            return (), ""
        again = f"rvads check {quote(file)} --rules {rule.name}"
        notes = f"{verdict.explanation}\nrecorded  {file}\nrerun     {again}"
        facts = ("recorded", file), ("rule", f"{rule.name}: {rule.title}" if rule.title else rule.name), ("rerun", again)
        beside = Beside(facts, tuple(told for told in all if told[0] != rule.name), "index.html")
        pages: list[tuple[str, float]] = []
        try:
            for page in failure_pages(run, verdict, rule, notes, beside):
                name = f"{slug(f'{run.label}-{rule.name}-{number}.{len(pages)}-{file}')}.html"
                write_file(Path(self._question.pages) / name, page.html.encode())
                pages.append((name, page.time))
        except Exception as error:
            return tuple(pages), f"{notes}\n(no page: {_told(error)})"
        return tuple(pages), ""


def _summed(verdicts: Iterable[Verdict]) -> _Summed:
    """Return rule, status and message of verdicts, the worst first."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.outcome.severity)
    return tuple((verdict.rule, verdict.outcome.value, verdict.message) for verdict in ordered)


def _record(verdict: Verdict, instance: InstanceVerdict) -> dict[str, Any]:
    """Return an instance for programs: what its variables stand for, when it was violated, by what margin."""
    found: dict[str, Any] = dict(instance.binding)
    found |= {"time": when(verdict, instance), "margin": finite(instance.margin)}
    return {**found, "hangs": instance.hangs} if instance.hangs else found


def finite(margin: float | None) -> float | None:
    """Return a margin as JSON can have it, None where it is infinite [s]."""
    return margin if margin is not None and math.isfinite(margin) else None


def _told(error: Exception) -> str:
    """Return an error in one sentence; of one that nobody raised on purpose, also its kind."""
    text = str(error) if isinstance(error, RvadsError | OSError) else f"{type(error).__name__}: {error}"
    return one_line(text)
