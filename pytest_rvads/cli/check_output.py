"""What ``rvads check`` prints, run by run: for people, or as JSON; and what all of it comes to."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from typing import Any, Protocol

from pytest_rvads.cli.common import say, warn
from pytest_rvads.cli.run_answers import Batch, RunAnswer
from pytest_rvads.logic.judging.verdicts import Status

__all__ = ["KPIS", "Labels", "Output", "Totals", "output"]

KPIS = "(kpis)"
"""Where the indicators of a run stand beside its rules in JSON; no rule can be called so."""
_MOST_DOUBTS = 20
_NOTABLE = (Status.FAIL, Status.OPEN, Status.UNSURE, Status.ERROR)


class Labels:
    """What runs are called; where a label comes again, in another file or the same, it is told apart."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def of(self, answer: RunAnswer) -> str:
        """Return the label of a run, that no other one has got."""
        label, number = answer.label, 1
        while label in self._known:
            label = f"{answer.file}: {answer.label}" + (f" ({number})" if number > 1 else "")
            number += 1
        self._known.add(label)
        return label


class Totals:
    """Counts what was said of all runs."""

    def __init__(self) -> None:
        self.verdicts: Counter[tuple[str, Status]] = Counter()
        """By rule and status."""
        self.runs = self.vehicles = self.files = self.troubles = self._doubts = 0
        self._left: dict[str, int] = {}

    def trouble(self, sentence: str) -> None:
        """Tell what could not be read or judged."""
        self.troubles += 1
        warn(f"rvads: {sentence}")

    def doubt(self, sentence: str, *, every: bool) -> None:
        """Tell what is doubtful in a run; of many runs the first few of all doubts, unless `every` one is wanted."""
        self._doubts += 1
        if every or self._doubts <= _MOST_DOUBTS:
            warn(f"warning: {sentence}")
        elif self._doubts == _MOST_DOUBTS + 1:
            warn("warning: further warnings are not printed, --verbose prints them")

    def add(self, answer: RunAnswer) -> None:
        """Count what is said of a run."""
        self.runs += 1
        self.vehicles += answer.vehicles
        self.verdicts.update((v.rule, v.status) for v in answer.verdicts)

    def finish(self, batch: Batch) -> bool:
        """Return whether a file is finished with a part of it."""
        left = self._left.pop(batch.file, batch.total) - len(batch.answers)
        if left > 0 and not batch.error:
            self._left[batch.file] = left
            return False
        self.files += 1
        return True

    def lines(self) -> list[str]:
        """Return the numbers of verdicts as a table, and the sums."""
        statuses = [status for status in Status if any(s is status for _, s in self.verdicts)]
        rules = list(dict.fromkeys(rule for rule, _ in self.verdicts))
        wide = max(map(len, rules), default=0)
        lines = [" " * wide + "".join(f"{status.value:>8}" for status in statuses)] if rules else []
        lines += [f"{rule:{wide}}" + "".join(f"{self.verdicts[rule, s] or '':>8}" for s in statuses) for rule in rules]
        return [*map(str.rstrip, lines), self.sums]

    @property
    def sums(self) -> str:
        """How much was judged, in a sentence."""
        told = f"{self.runs:,} runs, {self.vehicles:,} vehicles judged"
        return f"{told}; {self.troubles:,} times something could not be read or judged, told above" if self.troubles else told

    def exit_status(self, *, told: bool) -> int:
        """Return the exit status; what is `told` to a program is not also told by 1 and 5."""
        found = {status for _, status in self.verdicts}
        if self.troubles:
            return 2
        if told:
            return 0
        if not found & {Status.PASS, Status.FAIL, Status.OPEN}:
            why = "every verdict that applies is UNSURE" if Status.UNSURE in found else "no rule applies to any of these runs"
            warn(f"rvads: nothing was judged: {why}")
            return 5
        return 1 if found & {Status.FAIL, Status.OPEN} else 0


class Output(Protocol):
    """What is printed."""

    def run(self, label: str, answer: RunAnswer) -> None:
        """Print what is said of a run."""

    def unread(self, batch: Batch) -> None:
        """Print that a file could not be read."""

    def close(self) -> None:
        """Print what comes last."""


def output(options: argparse.Namespace, alone: bool, totals: Totals) -> Output:
    """Return what prints as the options say; `alone` when there is one file, `totals` of all that is counted."""
    if options.json:
        return _Object()
    return _Lines() if options.jsonl else _Text(alone, options.verbose, totals)


class _Text:
    """For people: of one file everything, of several what is not as it should be, unless they want all."""

    def __init__(self, alone: bool, verbose: bool, totals: Totals) -> None:
        self._alone, self._verbose, self._totals, self._excerpts = alone, verbose, totals, False

    def run(self, label: str, answer: RunAnswer) -> None:
        self._excerpts |= answer.excerpt
        whole = self._verbose or (self._alone and not answer.excerpt)
        lines: list[str] = []
        for verdict in answer.verdicts:
            if whole or verdict.status in _NOTABLE:
                lines += [verdict.line, *(f"       UNSURE {what}" for what in verdict.unsure)]
        if lines or whole or answer.indicators:
            say("\n  ".join((label, *lines, *answer.indicators)))

    def unread(self, batch: Batch) -> None:
        """It is told on standard error."""

    def close(self) -> None:
        if self._totals.runs and (self._excerpts or not self._alone):
            say("\n".join(self._totals.lines()))


def _verdicts(answer: RunAnswer) -> dict[str, Any]:
    """Return by rule the status and the instances that are violated, open, unsure; ``open`` only where there are some."""
    return {
        verdict.rule: {"status": verdict.status.value}
        | {word: found for word, found in verdict.instances.items() if found or word != "open"}
        for verdict in answer.verdicts
    }


class _Object:
    """One JSON object, written piece by piece: runs are not held until the last is judged."""

    def __init__(self) -> None:
        self._before = "{"

    def run(self, label: str, answer: RunAnswer) -> None:
        told = _verdicts(answer) | ({} if answer.kpis is None else {KPIS: answer.kpis})
        self._put(f"{self._before}\n{json.dumps(label)}: {json.dumps(told)}")
        self._before = ","

    def unread(self, batch: Batch) -> None:
        """It is told on standard error: the object has a member per run."""

    def close(self) -> None:
        self._put("{}\n" if self._before == "{" else "\n}\n")

    def _put(self, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


class _Lines:
    """A JSON object per run and line."""

    def run(self, label: str, answer: RunAnswer) -> None:
        told: dict[str, Any] = {"run": label, "file": answer.file, "start": answer.start, "vehicles": answer.vehicles}
        told |= {"verdicts": _verdicts(answer)}
        told |= {} if answer.kpis is None else {"kpis": answer.kpis}
        self._put(told | ({"errors": list(answer.errors)} if answer.errors else {}))

    def unread(self, batch: Batch) -> None:
        self._put({"file": batch.file, "errors": [batch.error]})

    def close(self) -> None:
        """Every line is printed."""

    def _put(self, told: dict[str, Any]) -> None:
        print(json.dumps(told), flush=True)
