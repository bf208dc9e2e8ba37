"""What commands share: options, and the driver and executor that options name; signals, progress, finding rules and printing.

The library distributed (Dask) is imported only for ``-j ADDRESS``. Callers of `rvads.campaign` pass an executor.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from pytest_rvads.support.errors import AutopilotError, RvadsError, ScenarioError, needs
from pytest_rvads.support.executors import Apart
from pytest_rvads.support.wording import printable

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.report.session_report import Report

LINE_LIMIT = 2**20
"""Longest line of input that is read [bytes]; the output for a line can take a hundred times as much memory."""

MAP_FORMATS = "OpenDRIVE, Lanelet2 or CommonRoad"
"""The formats of maps that are read, for the help of options."""
Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""The object of argparse to which a module adds its commands."""
_SHARED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "autopilot": (("--autopilot",), {"metavar": "NAME", "help": "driver: module:name, reference, or a traffic policy"}),
    "sut": (("--sut",), {"metavar": "COMMAND", "help": "driver: a program that speaks the protocol of stacks"}),
    "simulator": (("--simulator",), {"metavar": "NAME", "help": "simulator of the runs, a name or module:name"}),
    "traffic": (("--traffic",), {"metavar": "POLICY", "help": "driver of the other vehicles (default: reference)"}),
    "occupancy": (
        ("--occupancy",),
        {"choices": ("arms", "lanes"), "default": "arms", "help": "a vehicle per arm or per lane (default: arms)"},
    ),
    "rules": (
        ("--rules",),
        {"action": "append", "metavar": "RULE", "help": "a rule, rulebook or file of rules; repeatable (default: road)"},
    ),
    "map": (("--map",), {"metavar": "FILE", "help": f"map file ({MAP_FORMATS}) of the junction"}),
    "junction": (("--junction",), {"metavar": "ID", "help": "junction: an id in the map, or a built-in name"}),
    "workers": (
        ("-j", "--workers"),
        {
            "metavar": "N|ADDRESS",
            "help": "number of processes (default: one per processor), or the Dask scheduler whose workers are used, such as "
            "tcp://10.0.0.1:8786",
        },
    ),
    "baseline": (("--baseline",), {"metavar": "FILE.json", "help": "report of an earlier session, to compare with"}),
    "strict": (("--strict",), {"action": "store_true", "help": "stop at the first line that can't be read"}),
    "json": (("--json",), {"action": "store_true", "help": "print one JSON object"}),
    "svg": (("--svg",), {"metavar": "OUT", "help": "also draw the answer into this file"}),
    "output": (("-o", "--output"), {"metavar": "OUT", "help": "file to write"}),
}
"""The options that several commands have, each declared once: flags, and settings of `argparse`."""
_PATIENCE = 20
"""Longest time for a scheduler to answer, at the beginning and after a lost connection [s]."""


def number(name: str, least: float, most: float, kind: type = float) -> Callable[[str], Any]:
    """Return the type of a number of an option; argparse prints `name` in its messages."""

    def read(text: str) -> Any:
        value = kind(text)
        if not least <= value <= most:
            raise ValueError
        return value

    read.__name__ = name
    return read


@contextmanager
def terminable() -> Iterator[None]:
    """Let the first SIGTERM or SIGHUP raise KeyboardInterrupt, unless the process ignores or handles these signals."""
    main = threading.current_thread() is threading.main_thread()
    names = [name for name in ("SIGTERM", "SIGHUP") if main and hasattr(signal, name)]
    numbers = [number for name in names if signal.getsignal(number := signal.Signals[name]) is signal.SIG_DFL]

    def interrupt(*_: object) -> None:
        for number in numbers:  # the command ends and writes what it has; `timeout` of coreutils sends the signal twice
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in numbers:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def progress(done: int, total: int, what: str = "runs") -> None:
    """Draw a progress bar on standard error; print a line per quarter if standard error is no terminal."""
    if sys.stderr.isatty():
        full = 40 * done // total
        end = "\n" if done == total else ""
        print(f"\r[{'#' * full}{' ' * (40 - full)}] {done}/{total} {what}", end=end, file=sys.stderr, flush=True)
    elif 4 * done // total > 4 * (done - 1) // total:
        print(f"{done}/{total} {what}", file=sys.stderr)


def progress_for(options: argparse.Namespace) -> Callable[[int, int], None] | None:
    """Return a function that shows progress; None if a program reads JSON, because the program can read standard error, too."""
    return None if options.json and not sys.stderr.isatty() else progress


def clear() -> None:
    """Erase the progress bar, so that a line can be printed in its place."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def listed_rules(names: Sequence[str]) -> tuple[str | Rule, ...]:
    """Return names of rules and rulebooks as they are, with the rules of files (``.rules``) in place of the names of files."""
    from pytest_rvads.logic.rules.book import load_rules, rules_for

    rules = tuple(rule for name in names for rule in (load_rules(name) if name.endswith(".rules") else [name]))
    rules_for(rules)
    return rules


def named_rules(names: Sequence[str]) -> tuple[Rule, ...]:
    """Return the rules that names of rules, rulebooks or files of rules (``.rules``) denote, each rule once."""
    from pytest_rvads.logic.rules.book import rules_for

    return rules_for(listed_rules(names))


def make_folder(option: str, folder: Path) -> None:
    """Make the folder that an option names, unless the folder exists."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RvadsError(
            f"{option} must name a folder to write to, got {str(folder)!r}, which can't be made ({error.strerror}): name another "
            "folder"
        ) from error


def say(text: str) -> None:
    """Print a text on standard output, with control characters escaped."""
    print(printable(text, len(text)), flush=True)


def show(report: Report) -> None:
    """Print the summary of a report in the width of the terminal."""
    from pytest_rvads.report.terminal import summary

    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    print(summary(report, colour=sys.stdout.isatty(), width=shutil.get_terminal_size().columns, unicode=unicode), end="")


def warn(text: str) -> None:
    """Print a text on standard error, without control characters."""
    print(printable(text, len(text)), file=sys.stderr)


def share(parser: argparse._ActionsContainer, *names: str, **changed: Any) -> None:
    """Add options that several commands have; `changed` replaces settings of `argparse` that differ at this command."""
    for name in names:
        flags, settings = _SHARED[name]
        parser.add_argument(*flags, **(settings | changed))


def declare_driver(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--autopilot`` and ``--sut``, which name the driver of the vehicle under test, to a command."""
    share(parser.add_mutually_exclusive_group(), "autopilot", "sut")


@contextmanager
def opened_driver(options: argparse.Namespace) -> Iterator[Any]:
    """Yield the driver that the options name; a program that drives is ended when the context ends."""
    from pytest_rvads.drivers.naming import chosen

    if options.sut is not None:
        from pytest_rvads.drivers.stacks.process import Process

        with Process(options.sut) as stack:
            if shutil.which(stack.command[0]) is None:
                raise AutopilotError(
                    f"--sut must be the command of a program that exists and may be executed, got {options.sut!r}"
                )
            yield stack
    elif options.autopilot is not None:
        yield chosen(options.autopilot, Path.cwd(), "--autopilot")
    else:
        raise AutopilotError(
            "no driver is named: name the driver by --autopilot module:name or --sut COMMAND (--autopilot reference for the "
            "reference driver)"
        )


@contextmanager
def opened_executor(options: argparse.Namespace) -> Iterator[Executor | int]:
    """Yield the executor that the options name, for `spread` and `campaign`; a connection to a scheduler is closed at the end."""
    if options.workers is None or options.workers.lstrip("-").isdecimal():
        yield Apart(processes(options))
        return
    if not find_spec("distributed"):
        raise RvadsError(needs("-j ADDRESS", "distributed", "dask"))
    from distributed import Client

    try:
        client = Client(options.workers, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RvadsError(
            f"no Dask scheduler answers at {options.workers!r} ({type(error).__name__}: {error}): expected an address such as "
            "tcp://10.0.0.1:8786, as `dask scheduler` prints it"
        ) from error
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=_PATIENCE)


def declare_rules(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--rules`` to a command whose other arguments stand before its options: it takes several rules at once."""
    help = "rules, rulebooks or files of rules (default: road)"
    share(parser, "rules", action="extend", nargs="+", help=help)


def processes(options: argparse.Namespace, usual: int | None = None) -> int:
    """Return the number of processes that ``-j`` states, by default `usual` or one per processor."""
    text = options.workers or str(usual or os.cpu_count() or 1)
    if not text.lstrip("-").isdecimal():
        raise ScenarioError(f"--workers must be a number of processes for this command, got {text!r}")
    if int(text) < 1:
        raise ScenarioError(f"--workers must be at least 1, got {text}")
    return int(text)


def conflicting(map: str) -> list[str]:
    """Return the ids of the junctions of a map in which ways conflict."""
    from pytest_rvads.geometry.conflicts import JunctionKind
    from pytest_rvads.geometry.road_map import describe, read_map

    return [one["id"] for one in describe(read_map(map))["junctions"] if one["kind"] not in (None, JunctionKind.CONFLICT_FREE)]


def program(options: argparse.Namespace) -> list[str]:
    """Return the first words of a command line that repeats a command, with the side of traffic if one was stated."""
    return ["rvads", *(["--hand", options.hand] if getattr(options, "hand", None) else [])]
