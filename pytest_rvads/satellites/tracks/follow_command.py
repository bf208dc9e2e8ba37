"""``rvads check --follow``: judging traffic while it is being recorded."""

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

from pytest_rvads.cli.common import LINE_LIMIT, say, warn
from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.intake_options import INTAKE, add_intake, intake_of

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

__all__ = ["declare", "follow"]

_SHOWN = 20
"""So many lines that are left out are told, and then how many there were."""
_POLL = 0.2
"""A file that has not grown is looked at again after this time [s]."""


def declare(check: argparse.ArgumentParser) -> None:
    """Add what following asks for to the command ``check``."""
    check.add_argument(
        "--follow",
        action="store_true",
        help="FILE grows, or is - for standard input: a state per line, in JSON; each verdict is told as soon as it is final",
    )
    check.add_argument("--map", metavar="FILE", help="with --follow, the OpenDRIVE file of a junction given by id")
    check.add_argument("--junction", metavar="NAME", help="with --follow, where: a built-in name, or an id in --map")
    add_intake(check.add_argument_group("with --follow, as with rvads import"))
    check.add_argument("--strict", action="store_true", help="with --follow, end at the first line that is no state")


def refuse_without(options: argparse.Namespace) -> None:
    """Check that no option of ``--follow`` is given without ``--follow``: files of runs hold their junction and their accuracy.

    Raises:
        RunError: such an option is given.
    """
    names = ("map", "junction", "strict", *INTAKE)
    said = [f"--{name.replace('_', '-')}" for name in names if getattr(options, name) not in (None, False)]
    if said:
        raise RunError(
            f"{', '.join(said)} can't be given without --follow: a file of runs has its junction in it; "
            "rvads import brings in tracks of a log"
        )


def follow(options: argparse.Namespace) -> int:
    """Judge states until there are no more, or until Ctrl-C, and return the exit status."""
    from pytest_rvads.cli.answers import named_rules
    from pytest_rvads.junctions.finder import find
    from pytest_rvads.satellites.tracks.streaming import Stream

    if not options.junction:
        raise RunError("--follow needs to know where: give --junction, and --map where that is the id of one in a file")
    place = find(options.junction, options.map)
    rules = named_rules(options.rules or ["road"])
    if len(options.files) > 1:
        raise RunError(f"--follow reads one file, or - for standard input, got {len(options.files)}")
    (file,) = options.files
    source = "standard input" if file == "-" else file
    stream = Stream(Path(source).stem, place, intake_of(options, "front"))
    tell = _Teller(rules, told=options.json or options.jsonl or not sys.stdout.isatty())
    refused = 0
    with _Interrupt() as interrupt:
        for number, line in enumerate(interrupt.until(_lines(file)), start=1):
            if not line.strip():
                continue
            try:
                runs = stream.read(line, f"{source}, line {number}")
            except RunError as error:
                if options.strict:
                    raise
                refused += 1
                if refused <= _SHOWN:
                    warn(f"warning: {error}; the line is left out")
                continue
            tell.judge(runs)
        tell.judge(stream.end())
    if refused > _SHOWN:
        warn(f"warning: {refused} lines are left out, the first {_SHOWN} are told above")
    left = "; ".join(f"{count} left out, {why}" for why, count in sorted(stream.left_out.items()))
    counts = ", ".join(f"{count} {status}" for status, count in sorted(tell.counts.items())) or "no verdicts"
    warn(f"{stream.judged} vehicles: {counts}{'; ' + left if left else ''}")
    return tell.status()


class _Interrupt:
    """Has Ctrl-C end the reading, but nothing that is being judged or written."""

    def __init__(self) -> None:
        self._reading = self._asked = False

    def __enter__(self) -> _Interrupt:
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True
        if self._reading:
            raise KeyboardInterrupt

    def until(self, lines: Iterator[bytes]) -> Iterator[bytes]:
        """Yield lines until there are no more, or Ctrl-C."""
        while not self._asked:
            self._reading = True
            try:
                line = next(lines)
            except (StopIteration, KeyboardInterrupt):
                break
            finally:
                self._reading = False
            yield line
        if self._asked:
            warn("interrupted: who is there is judged by what was seen")


class _Teller:
    """Judges runs and writes what their instances say."""

    def __init__(self, rules: Sequence[Rule], *, told: bool) -> None:
        self._rules = rules
        self._write: Callable[[dict[str, Any]], None] = _as_json if told else _as_text
        self.counts: Counter[str] = Counter()
        """Instances by status."""

    def judge(self, runs: Iterator[Run]) -> None:
        """Judge every run as soon as the iterator yields it."""
        from pytest_rvads.logic.check import check

        for run in runs:
            for rule in self._rules:
                self._tell(check(run, rule), run)

    def _tell(self, verdict: Verdict, run: Run) -> None:
        if verdict.status == "ERROR":
            warn(f"warning: {run.label} can't be judged by {verdict.rule}: {verdict.reason}")
            self.counts["ERROR"] += 1
        from pytest_rvads.cli.check_output import measured

        for instance in verdict.instances:
            if instance.status == "NA":
                continue
            self.counts[instance.status.value] += 1
            who = {"rule": verdict.rule, "status": instance.status.value, "binding": dict(instance.binding)}
            self._write(who | measured(verdict, instance))

    def status(self) -> int:
        """Return the exit status, as of ``rvads check``."""
        if self.counts["ERROR"]:
            return 2
        if not self.counts.keys() - {"UNSURE"}:
            why = "every verdict that applies is UNSURE" if self.counts else "no rule applies to any of these vehicles"
            warn(f"rvads: nothing was judged: {why}")
            return 5
        return 1 if self.counts["FAIL"] or self.counts["OPEN"] else 0


def _as_json(answer: dict[str, Any]) -> None:
    print(json.dumps(answer), flush=True)


def _as_text(answer: dict[str, Any]) -> None:
    who = ", ".join(f"{name} = {what}" for name, what in answer["binding"].items())
    when = "" if answer["time"] is None else f" at {answer['time']:.2f} s"
    margin = "" if answer["margin"] is None else f", margin {answer['margin']:.2f} s"
    hangs = f", hangs on {answer['hangs']}" if "hangs" in answer else ""
    say(f"{answer['status']:6} {answer['rule']}{when}: {who}{margin}{hangs}")


def _lines(file: str) -> Iterator[bytes]:
    """Yield whole lines: of standard input until it ends, of a file as it grows, for ever.

    Raises:
        RunError: the file can't be read, or a line is too long.
    """
    if file == "-":
        yield from _cut(lambda: sys.stdin.buffer.readline(LINE_LIMIT + 1), "standard input")
        return
    try:
        with Path(file).open("rb") as source:

            def read() -> bytes:
                while not (line := source.readline(LINE_LIMIT + 1)):
                    time.sleep(_POLL)
                return line

            yield from _cut(read, file)
    except OSError as error:
        raise RunError(f"{file} can't be read: {error.strerror}") from error


def _cut(read: Callable[[], bytes], where: str) -> Iterator[bytes]:
    """Yield lines put together from what was written of them so far."""
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
