"""What ends a session from outside: signals, and for a worker the end of the main process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from types import FrameType
from typing import Any

import pytest

__all__ = ["end_with_parent", "heed", "leave_in_time", "put_off"]

_POLITE = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Who sends these means what Ctrl-C means."""
_PR_SET_PDEATHSIG = 1
_PATIENCE = 15.0
"""How long a process may take to exit once its session is over and its main thread has come to its end [s]."""
_statuses: list[int] = []
"""Exit statuses of the sessions that this process has finished."""


_Handler = Callable[[int, FrameType | None], None]


def heed(config: pytest.Config) -> None:
    """Have SIGTERM and SIGHUP end a session as Ctrl-C does, unless the process ignores (``nohup``) or handles these signals."""
    session = os.getpid()
    _lose_none_in_forks()

    def interrupt(number: int, _: FrameType | None) -> None:
        if os.getpid() == session:
            raise KeyboardInterrupt(signal.Signals(number).name)
        signal.signal(number, signal.SIG_DFL)  # a child that a test has forked, which nobody asked to behave otherwise
        os.kill(os.getpid(), number)

    _handle(config, [number for number in _POLITE if signal.getsignal(number) is signal.SIG_DFL], interrupt)


@cache
def _lose_none_in_forks() -> None:
    """Hold such signals back while the process forks, for Python forgets those that reach a child that early."""
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
    """Let the first signal that comes from now on wait for the end of the session, which writes its reports; not the second."""
    first = True

    def wait(*_: object) -> None:
        nonlocal first
        if not first:
            raise KeyboardInterrupt
        first = False
        os.write(2, b"\nrvads: the session ends and writes its reports; once more breaks that off\n")

    _handle(config, [number for number in (signal.SIGINT, *_POLITE) if callable(signal.getsignal(number))], wait)


def leave_in_time(status: int) -> None:
    """Have the process exit with the status of its last session, also where a thread or exit handler of a driver keeps it."""
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


def end_with_parent() -> None:
    """Have the Linux kernel kill this process as soon as its parent process ends, for whatever reason the parent ends."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
