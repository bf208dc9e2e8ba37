"""Ends a session early: by signals, the end of the main process, and a time budget.

With a budget, the most informative items run first, and items after the deadline are NOT RUN. The wall clock decides only which
items start. No run depends on the wall clock.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache, partial
from types import FrameType
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.session.plan import start

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record

_POLITE = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Signals that end a session in the same way as Ctrl-C does."""
_PR_SET_PDEATHSIG = 1
_PATIENCE = 15.0
"""Longest time between the end of the main thread and the exit of the process [s]."""
_Handler = Callable[[int, FrameType | None], None]
_STARTED = "rvads_started"
_HISTORY = "rvads/exercised"
"""Key under which pytest's cache holds, per item, the number of sessions with a time budget in which the item ran."""
_FAILED = "cache/lastfailed"
"""Key under which pytest's cache holds the failures of the last session."""


def heed(config: pytest.Config) -> None:
    """Let SIGTERM and SIGHUP end a session as Ctrl-C does, unless the process ignores (``nohup``) or handles these signals."""
    session = os.getpid()
    _block_signals_in_forks()

    def interrupt(number: int, _: FrameType | None) -> None:
        if os.getpid() == session:
            raise KeyboardInterrupt(signal.Signals(number).name)
        signal.signal(number, signal.SIG_DFL)  # a forked child of a test ends by the signal as usual
        os.kill(os.getpid(), number)

    _handle(config, [number for number in _POLITE if signal.getsignal(number) is signal.SIG_DFL], interrupt)


@cache
def _block_signals_in_forks() -> None:
    """Block the signals of `_POLITE` while the process forks, because Python loses signals that reach a new child."""
    if hasattr(os, "register_at_fork"):
        masks: list[set[int]] = []

        def release() -> None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masks.pop())

        os.register_at_fork(
            before=lambda: masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, _POLITE)),
            after_in_parent=release,
            after_in_child=release,
        )


def put_off(config: pytest.Config) -> None:
    """Ignore the next signal, so that the session writes its reports; a second signal interrupts the session."""
    first = True

    def wait(*_: object) -> None:
        nonlocal first
        if not first:
            raise KeyboardInterrupt
        first = False
        os.write(2, b"\nrvads: the session ends and writes its reports; once more breaks that off\n")

    _handle(config, [number for number in (signal.SIGINT, *_POLITE) if callable(signal.getsignal(number))], wait)


def leave_in_time(status: int) -> None:
    """End the process with the status of its last session, even if a thread or exit handler of a driver hangs."""
    waiting = next((thread for thread in threading.enumerate() if isinstance(thread, _Exit)), None)
    if waiting:
        waiting.status = status
        return
    with suppress(RuntimeError):  # no thread can be started
        _Exit(status).start()


class _Exit(threading.Thread):
    """Ends the process a while after its main thread."""

    def __init__(self, status: int) -> None:
        super().__init__(name="rvads exit", daemon=True)
        self.status = status

    def run(self) -> None:
        threading.main_thread().join()
        time.sleep(_PATIENCE)
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
        with suppress(OSError):
            told = b"rvads: the session is over, but a thread, child or exit handler keeps its process, which ends now\n"
            os.write(2, told)
        os._exit(self.status)


def _handle(config: pytest.Config, numbers: list[int], handler: _Handler) -> None:
    """Handle signals until the session ends; a session outside the main thread can't handle signals and leaves them unchanged."""
    if threading.current_thread() is threading.main_thread():
        for number in numbers:
            config.add_cleanup(partial(_restore, number, signal.signal(number, handler)))


def _restore(number: int, handler: Any) -> None:
    signal.signal(number, handler)


def end_with_parent() -> None:
    """Ask the Linux kernel to kill this process as soon as its parent process ends."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class OutOfTime(pytest.skip.Exception):  # type: ignore[name-defined,misc]
    """The time budget of the session was used up before the item started."""


class Budget:
    """Runs the test items of this plugin first, the most informative items at the front, and skips items after the deadline."""

    def __init__(self, config: pytest.Config, seconds: float) -> None:
        self._config = config
        self._started: float = getattr(config, "workerinput", {}).get(_STARTED) or time.time()
        self._deadline = self._started + seconds
        self.reason = f"NOT RUN: the time budget of {seconds:g} s is used up"

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort the items by `priority`; every worker gets the same order."""
        records = {item.nodeid: record for item in items if (record := start(item))}
        order = {nodeid: i for i, nodeid in enumerate(priority(records.values(), self._cached(_FAILED), self._cached(_HISTORY)))}
        items.sort(key=lambda item: order.get(item.nodeid, len(order)))

    def check_deadline(self) -> None:
        """Skip the current test item if the deadline of the time budget is over."""
        if time.time() > self._deadline:
            raise OutOfTime(self.reason)

    def remember(self, records: Iterable[Record]) -> None:
        """Count how often each item has run, so that the next session begins with the items that ran least often."""
        cache = getattr(self._config, "cache", None)
        if cache is not None:
            history = Counter(self._cached(_HISTORY))
            history.update(record.nodeid for record in records if record.status is not Outcome.NOT_RUN)
            cache.set(_HISTORY, dict(history))

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Send the start time of the session to a worker."""
        node.workerinput[_STARTED] = self._started

    def _cached(self, key: str) -> dict[str, Any]:
        cache = getattr(self._config, "cache", None)
        entry = cache.get(key, {}) if cache is not None else {}
        return entry if isinstance(entry, dict) else {}


BUDGET: pytest.StashKey[Budget | None] = pytest.StashKey()


def priority(records: Iterable[Record], failed: Mapping[str, Any], history: Mapping[str, int]) -> list[str]:
    """Return the node ids of test items in the order in which the items should run.

    The items of one run stay together. The variants of a test (values of its other parameters) with one start also stay
    together, so that a start runs for every variant or for none. Runs with a failure in the last session come first. One run of
    every class comes second, in the configuration that ran least so far; among configurations that ran equally often, the choice
    changes from class to class. All remaining runs come last, the least often executed runs first, and the classes take turns.
    """
    from pytest_rvads.report.record import RecordedItem

    runs: dict[tuple[Any, ...], list[str]] = {}
    classes: dict[tuple[Any, ...], list[tuple[Any, ...]]] = {}
    for record in records:
        group: tuple[Any, ...] = record.junction, None if isinstance(record, RecordedItem) else record.cls
        if isinstance(record, RecordedItem):
            start: tuple[Any, ...] = (record.recording,)
        else:
            start = record.scenario, record.cfg, record.rotation, record.seat, record.pedestrians
        run = record.nodeid.partition("[")[0], *group, *start
        if run not in runs:
            classes.setdefault(group, []).append(run)
        runs.setdefault(run, []).append(record.nodeid)
    ranks: dict[tuple[Any, ...], tuple[int, ...]] = {}
    for turn, members in enumerate(classes.values()):
        executions = {run: min(history.get(nodeid, 0) for nodeid in runs[run]) for run in members}
        shifted = members[turn % len(members) :] + members[: turn % len(members)]
        for place, run in enumerate(sorted(shifted, key=executions.__getitem__)):
            failed_before = any(nodeid in failed for nodeid in runs[run])
            ranks[run] = (0, 0, 0) if failed_before else (1, 0, 0) if place == 0 else (2, executions[run], place)
    return [nodeid for run in sorted(runs, key=ranks.__getitem__) for nodeid in runs[run]]
