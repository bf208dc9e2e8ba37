"""What ``rvads check`` prints, run by run: for people, or as JSON."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from typing import Any

from pytest_rvads.cli.check_totals import Totals
from pytest_rvads.cli.common import say
from pytest_rvads.cli.run_answers import NOTABLE, Batch, RunAnswer
from pytest_rvads.conduct.kpis import describe
from pytest_rvads.failure_page import when
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict

__all__ = ["VERSION", "Output", "line", "measured", "output", "unsure"]

VERSION = 1
"""Version of the object of ``--json`` and of the lines of ``--jsonl``."""
_KPIS = "(kpis)"
"""Where the indicators of a run stand beside its rules in JSON; no rule can be called so."""
_LISTED = {Status.FAIL: "violated", Status.OPEN: "open", Status.UNSURE: "unsure"}
"""What instances are listed under in JSON."""


class Output:
    """What is printed; some outputs leave the rest to standard error."""

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


def line(verdict: Verdict) -> str:
    """Return the status of a verdict and its message, which names the rule, in one line."""
    text = verdict.message.removeprefix(f"{verdict.rule} {verdict.status}: ")
    return f"{verdict.status.value:5} {text if text.startswith(verdict.rule) else f'{verdict.rule}: {text}'}"


def unsure(verdict: Verdict) -> Iterator[str]:
    """Yield who is in each unsure instance and what it hangs on, where the line of the verdict does not say it."""
    doubts = [instance for instance in verdict.instances if instance.status is Status.UNSURE]
    if len(doubts) > 1 or verdict.status is not Status.UNSURE or not verdict.reason:
        yield from (": ".join(filter(None, (", ".join(name for _, name in i.binding), i.hangs))) for i in doubts)


class _Text(Output):
    """For people: of one file everything, of several what is not as it should be, unless they want all."""

    def __init__(self, alone: bool, verbose: bool, totals: Totals) -> None:
        self._alone, self._verbose, self._totals, self._excerpts = alone, verbose, totals, False

    def run(self, label: str, answer: RunAnswer) -> None:
        self._excerpts |= answer.excerpt
        whole = self._verbose or (self._alone and not answer.excerpt)
        lines: list[str] = []
        for verdict in answer.verdicts:
            if whole or verdict.status in NOTABLE:
                lines += [line(verdict), *(f"       UNSURE {what}" for what in unsure(verdict))]
        indicators = [] if answer.kpis is None else list(describe(answer.kpis))
        if lines or whole or indicators:
            say("\n  ".join((label, *lines, *indicators)))

    def close(self) -> None:
        if self._totals.runs and (self._excerpts or not self._alone):
            say("\n".join(self._totals.lines()))


def measured(verdict: Verdict, instance: InstanceVerdict) -> dict[str, Any]:
    """Return when an instance was violated, by what margin, and what it hangs on, as JSON can have it."""
    margin = instance.margin if instance.margin is not None and math.isfinite(instance.margin) else None
    hangs = {"hangs": instance.hangs} if instance.hangs else {}
    return {"time": when(verdict, instance), "margin": margin, **hangs}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """Return the status and the instances that are violated, open, unsure; ``open`` only where there are some."""
    listed: dict[str, list[dict[str, Any]]] = {word: [] for word in _LISTED.values()}
    for instance in verdict.instances:
        if instance.status in _LISTED:
            listed[_LISTED[instance.status]].append({**dict(instance.binding), **measured(verdict, instance)})
    return {"status": verdict.status.value} | {word: found for word, found in listed.items() if found or word != "open"}


def _verdicts(answer: RunAnswer) -> dict[str, Any]:
    return {verdict.rule: _verdict(verdict) for verdict in answer.verdicts}


class _Object(Output):
    """One JSON object, written piece by piece: runs are not held until the last is judged."""

    def __init__(self) -> None:
        self._put(f'{{"version": {VERSION}')

    def run(self, label: str, answer: RunAnswer) -> None:
        told = _verdicts(answer) | ({} if answer.kpis is None else {_KPIS: answer.kpis.record()})
        self._put(f",\n{json.dumps(label)}: {json.dumps(told)}")

    def close(self) -> None:
        self._put("\n}\n")

    def _put(self, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


class _Lines(Output):
    """A JSON object per run and line."""

    def run(self, label: str, answer: RunAnswer) -> None:
        told: dict[str, Any] = {"run": label, "file": answer.file, "start": answer.start, "vehicles": answer.vehicles}
        told |= {"verdicts": _verdicts(answer)}
        told |= {} if answer.kpis is None else {"kpis": answer.kpis.record()}
        self._put(told | ({"errors": list(answer.errors)} if answer.errors else {}))

    def unread(self, batch: Batch) -> None:
        self._put({"file": batch.file, "errors": [batch.error]})

    def _put(self, told: dict[str, Any]) -> None:
        print(json.dumps({"version": VERSION} | told), flush=True)
