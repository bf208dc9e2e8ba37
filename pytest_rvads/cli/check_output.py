"""What ``rvads check`` prints, run by run: for people, or as JSON."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any, Protocol

from pytest_rvads.cli.check_totals import Totals
from pytest_rvads.cli.common import say
from pytest_rvads.cli.run_answers import NOTABLE, Batch, RunAnswer

__all__ = ["Output", "output"]

_KPIS = "(kpis)"
"""Where the indicators of a run stand beside its rules in JSON; no rule can be called so."""


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
            if whole or verdict.status in NOTABLE:
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
        told = _verdicts(answer) | ({} if answer.kpis is None else {_KPIS: answer.kpis})
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
