"""The command ``rvads check --follow``: judges traffic while the traffic is being recorded."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import LINE_LIMIT, MAP_FORMATS, named_rules, say, share, warn
from pytest_rvads.satellites.tracks.import_command import INTAKE, add_intake, intake_of
from pytest_rvads.support.errors import RunError

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

_MOST_SHOWN = 20
"""Largest number of messages about omitted lines; further omitted lines are only counted."""


def declare(check: argparse.ArgumentParser) -> None:
    """Add ``--follow`` and its options to the command ``check``."""
    check.add_argument(
        "--follow",
        action="store_true",
        help="judge states as FILE grows (- for standard input): a state per line, in JSON; print each verdict when it is final",
    )
    share(check, "map", help=f"with --follow, the map file ({MAP_FORMATS}) of a junction given by id")
    share(check, "junction", help="with --follow, the junction: a built-in name, or an id in --map")
    add_intake(check.add_argument_group("with --follow, as with rvads import"))
    share(check, "strict", help="with --follow, stop at the first line that is no state")


def refuse_without(options: argparse.Namespace) -> None:
    """Check that no option of ``--follow`` is given for files of runs, which hold the junction and the accuracy themselves."""
    names = ("map", "junction", "strict", *INTAKE)
    given_options = [f"--{name.replace('_', '-')}" for name in names if getattr(options, name) not in (None, False)]
    if given_options:
        raise RunError(
            f"{', '.join(given_options)} can't be given without --follow, because a file of runs contains its junction: "
            "leave the option out, or use rvads import for tracks of a log"
        )


def follow(options: argparse.Namespace) -> int:
    """Judge states until the end of the input or until Ctrl-C, and return the exit status."""
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.satellites.tracks.streaming import Stream

    if not options.junction:
        raise RunError("--follow needs a junction: give --junction, and --map if the junction is an id in a map file")
    place = find(options.junction, options.map)
    rules = named_rules(options.rules or ["road"])
    if len(options.files) > 1:
        raise RunError(f"--follow reads a single file, or - for standard input, got {len(options.files)} files")
    (file,) = options.files
    source = "standard input" if file == "-" else file
    stream = Stream(Path(source).stem, place, intake_of(options, "front"))
    judge = _Judge(rules, as_json=options.json or options.jsonl or not sys.stdout.isatty())
    refused_lines = 0
    with _Interrupt() as interrupt:
        for number, line in enumerate(interrupt.until(_lines(file)), start=1):
            if not line.strip():
                continue
            try:
                runs = stream.read(line, f"{source}, line {number}")
            except RunError as error:
                if options.strict:
                    raise
                refused_lines += 1
                if refused_lines <= _MOST_SHOWN:
                    warn(f"warning: {error}; the line is left out")
                continue
            judge.judge(runs)
        judge.judge(stream.end())
    if refused_lines > _MOST_SHOWN:
        warn(f"warning: {refused_lines} lines are left out, the first {_MOST_SHOWN} are listed above")
    left_out = "; ".join(f"{count} left out, {why}" for why, count in sorted(stream.left_out.items()))
    counts = ", ".join(f"{count} {status}" for status, count in sorted(judge.counts.items())) or "no verdicts"
    warn(f"{stream.judged} vehicles: {counts}{'; ' + left_out if left_out else ''}")
    return judge.status()


class _Interrupt:
    """A context in which Ctrl-C ends the reading of lines, but does not interrupt the judging and printing of verdicts."""

    def __init__(self) -> None:
        self._reading = self._interrupted = False

    def __enter__(self) -> _Interrupt:
        self._before = signal.signal(signal.SIGINT, self._note_interrupt)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note_interrupt(self, _signal: int, _frame: FrameType | None) -> None:
        self._interrupted = True
        if self._reading:
            raise KeyboardInterrupt

    def until(self, lines: Iterator[bytes]) -> Iterator[bytes]:
        """Yield the given lines until they end, or until Ctrl-C."""
        while not self._interrupted:
            self._reading = True
            try:
                line = next(lines)
            except (StopIteration, KeyboardInterrupt):
                break
            finally:
                self._reading = False
            yield line
        if self._interrupted:
            warn("interrupted: vehicles at the junction are judged by their samples so far")


class _Judge:
    """Judges runs by rules, and prints a line per instance of a rule (the rule for certain vehicles) that is not NA."""

    def __init__(self, rules: Sequence[Rule], *, as_json: bool) -> None:
        self._rules = rules
        self._as_json = as_json
        self.counts: Counter[str] = Counter()
        """Number of printed instances by status, and of runs without a verdict as ``ERROR``."""

    def judge(self, runs: Iterator[Run]) -> None:
        """Judge runs as they arrive: the verdicts on a run are printed before the iterator is asked for another run."""
        from pytest_rvads.cli.check_output import measured
        from pytest_rvads.logic.check import check

        for run in runs:
            for rule in self._rules:
                verdict = check(run, rule)
                if verdict.status == "ERROR":
                    warn(f"warning: {run.label} can't be judged by {verdict.rule}: {verdict.reason}")
                    self.counts["ERROR"] += 1
                for instance in verdict.instances:
                    if instance.status == "NA":
                        continue
                    self.counts[instance.status.value] += 1
                    facts: dict[str, Any] = {"rule": verdict.rule, "status": instance.status.value}
                    facts |= {"binding": dict(instance.binding), **measured(verdict, instance)}
                    if self._as_json:
                        print(json.dumps(facts), flush=True)
                        continue
                    binding = ", ".join(f"{name} = {vehicle}" for name, vehicle in instance.binding)
                    when = "" if facts["time"] is None else f" at {facts['time']:.2f} s"
                    margin = "" if facts["margin"] is None else f", margin {facts['margin']:.2f} s"
                    hinge = f", depends on {facts['hangs']}" if "hangs" in facts else ""
                    say(f"{facts['status']:6} {verdict.rule}{when}: {binding}{margin}{hinge}")

    def status(self) -> int:
        """Return the exit status of ``rvads check`` for the counted verdicts."""
        if self.counts["ERROR"]:
            return 2
        if not self.counts.keys() - {"UNSURE"}:
            why = "every verdict that applies is UNSURE" if self.counts else "no rule applies to any of these vehicles"
            warn(f"rvads: nothing was judged: {why}")
            return 5
        return 1 if self.counts["FAIL"] or self.counts["OPEN"] else 0


def _lines(file: str) -> Iterator[bytes]:
    """Yield whole lines: of standard input until its end, or of a growing file without end."""
    if file == "-":
        yield from _whole_lines(lambda: sys.stdin.buffer.readline(LINE_LIMIT + 1), "standard input")
        return
    try:
        with Path(file).open("rb") as source:

            def read() -> bytes:
                while not (line := source.readline(LINE_LIMIT + 1)):
                    time.sleep(0.2)
                return line

            yield from _whole_lines(read, file)
    except OSError as error:
        raise RunError(f"{file} can't be read: {error.strerror}") from error


def _whole_lines(read: Callable[[], bytes], where: str) -> Iterator[bytes]:
    """Yield whole lines, joined from the parts of lines that `read` returns while a line is being written."""
    line = b""
    while part := read():
        line += part
        if len(line) > LINE_LIMIT:
            raise RunError(f"a line of {where} is too long, expected at most {LINE_LIMIT:,} bytes")
        if line.endswith(b"\n"):
            yield line
            line = b""
    if line:
        yield line
