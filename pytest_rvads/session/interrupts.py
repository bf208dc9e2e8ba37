"""What ends a session or a run early: signals, the end of the main process, and limits of real time."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from types import FrameType
from typing import Any

import pytest

from pytest_rvads.session.options import OPTIONS
from pytest_rvads.simulators.patience import Limits

__all__ = ["end_with_parent", "heed", "leave_in_time", "limits", "put_off"]


_POLITE = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Signals that end a session as Ctrl-C does."""
_PR_SET_PDEATHSIG = 1
_PATIENCE = 15.0
"""Longest time between the end of the main thread and the exit of the process [s]."""
_statuses: list[int] = []
"""Exit statuses of the sessions that this process has finished."""


_Handler = Callable[[int, FrameType | None], None]


def heed(config: pytest.Config) -> None:
    """Have SIGTERM and SIGHUP end a session as Ctrl-C does, unless the process ignores (``nohup``) or handles these signals."""
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
    """Exit with the status of the last session of the process, even if a thread or exit handler of a driver hangs."""
    _statuses.append(status)
    if len(_statuses) == 1:
        with suppress(RuntimeError):  # no thread can be started
            threading.Thread(target=_leave, name="rvads exit", daemon=True).start()


def _leave() -> None:
    threading.main_thread().join()
    time.sleep(_PATIENCE)
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    with suppress(OSError):
        os.write(
            2,
            b"rvads: the session is over, but a thread, child or exit handler keeps its process, which ends now\n",
        )
    os._exit(_statuses[-1])


def _handle(config: pytest.Config, numbers: list[int], handler: _Handler) -> None:
    """Handle signals until the session ends; a session outside the main thread can't handle signals and leaves them unchanged."""
    if threading.current_thread() is threading.main_thread():
        for number in numbers:
            config.add_cleanup(partial(_restore, number, signal.signal(number, handler)))


def _restore(number: int, handler: Any) -> None:
    signal.signal(number, handler)


@contextmanager
def limits(config: pytest.Config) -> Iterator[Limits]:
    """Yield the limits of real time of the session's options.

    The timer of faulthandler exists once per process. If pytest uses this timer (``faulthandler_timeout``), the limits of the
    session end no process.
    """
    options = config.stash[OPTIONS]
    dump = None if _timer_in_use(config) else _standard_error()
    try:
        yield Limits(options.decision_limit, options.run_limit, dump)
    finally:
        if dump is not None:
            os.close(dump)


def _timer_in_use(config: pytest.Config) -> bool:
    try:
        return float(config.getini("faulthandler_timeout") or 0) > 0
    except ValueError:  # the faulthandler plugin of pytest is switched off
        return False


def _standard_error() -> int | None:
    """Return a duplicate of the descriptor of standard error, because pytest redirects the original while items run."""
    try:
        return os.dup(2)
    except OSError:
        return None


def end_with_parent() -> None:
    """Have the Linux kernel kill this process as soon as its parent process ends, for whatever reason the parent ends."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
