"""Patience: how long drivers and runs may take, in real time.

What happens in a run depends on simulated time alone. Limits of real time only keep a driver that never answers from holding up
all that would come after it. A thread looks at the runs under way and raises `TooLate` into what takes too long: in the main
thread by a signal, which also ends waiting, elsewhere by the interpreter. Where that gets a driver to stop neither, because it
catches everything or is stuck in C, the process ends, if the limits say so, and leaves its stacks on standard error.

The signal is SIGURG, which is ignored by default, and no timer is used. So alarms stay free for drivers and plugins, and no
system call is interrupted while a run is in time. The last resort is the timer of faulthandler, in sessions only.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from contextvars import ContextVar, Token
from pathlib import Path
from types import FrameType, TracebackType
from typing import NamedTuple

__all__ = ["Limits", "TooLate", "Watch", "watch"]

_TICK = 0.5
"""How often runs under way are looked at, at least [s]."""
_GRACE = 3.0
"""How much longer than a limit a driver may take to stop, and to let go of what runs elsewhere [s]."""
_SIGNAL = getattr(signal, "SIGURG", None)
"""A signal whose default action is to be ignored, so that a thread without a handler survives it; None on Windows."""
_LIBRARY = str(Path(os.__file__).parent)
_DEBUGGERS = {"bdb", "pdb", "pydevd", "_pydevd_bundle"}
"""Packages of debuggers: a run in a debugger has no time limit."""


class Limits(NamedTuple):
    """How long drivers and runs may take, in real time; 0 sets no limit."""

    decision: float = 15.0
    """One call into a driver [s]."""
    run: float = 300.0
    """All of a run [s]."""
    dump: int | None = None
    """File descriptor that the stacks are written to before the process ends, because nothing else got a driver to stop; None
    lets it go on for ever."""


class TooLate(BaseException):
    """Raised in the thread of a run when a time limit is over; only the code that opened the watch may catch the exception."""


class Watch:
    """The watch over one run, a context in the thread that makes it; there may be one within another."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.asked: object = None
        """What a driver is being asked with, another object in every call; None while none is."""
        self.late = ""
        """Which limit was over, in words; a driver that caught `TooLate` is late all the same."""
        self.thread, self._process = threading.get_ident(), os.getpid()
        self.signalled = _SIGNAL is not None and self.thread == threading.main_thread().ident
        self._latest: object = None
        self._since = self._began = 0.0
        self._over: object = None
        """What was asked with when a limit was over, or the watch itself where it is the run's."""

    @property
    def overdue(self) -> bool:
        """Whether a limit is over and what exceeds it has not ended."""
        return self._over is self or (self._over is not None and self._over is self.asked)

    def __enter__(self) -> Watch:
        self._token: Token[Watch] = _CURRENT.set(self)
        if self.signalled:
            self._before = signal.signal(_SIGNAL, _interrupt)  # type: ignore[arg-type]
        if self.limits.decision or self.limits.run:
            self._since = self._began = _WATCHDOG.clock
            _WATCHDOG.add(self)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.end_in_child(error)
        try:
            _WATCHDOG.remove(self)
            if self.late and not self.signalled:
                for _ in range(100):  # what the watchdog raised last arrives here at the latest
                    pass
        except TooLate:
            _WATCHDOG.remove(self)
        if self.signalled:
            signal.signal(_SIGNAL, self._before or signal.SIG_DFL)  # type: ignore[arg-type]
        _CURRENT.reset(self._token)

    def end_in_child(self, error: BaseException | None) -> None:
        """End a process that a driver has forked and that comes back from its code, perhaps by `error`: no run is its own."""
        if os.getpid() != self._process:
            code = error.code if isinstance(error, SystemExit) else error and 1
            os._exit(code if isinstance(code, int) else 1 if code else 0)

    def look(self, now: float) -> bool:
        """Note which limit is over at time `now` [s]; return whether the run got on since the last look, within its limits."""
        asked = self.asked
        got_on = asked is None or asked is not self._latest
        if got_on:
            self._latest, self._since = asked, now
        decision = min(self.limits.decision, _GRACE) if self.late else self.limits.decision
        self._over, late = None, ""
        if decision and not got_on and now - self._since >= decision:
            self._over, late = asked, f"no answer within {decision:g} s of real time (--rvads-decision-limit)"
        elif self.limits.run and now - self._began >= self.limits.run:
            self._over, late = self, f"the run took longer than {self.limits.run:g} s of real time (--rvads-run-limit)"
            self._began += _GRACE
        if late and not self.late:
            stack = sys._current_frames().get(self.thread)
            if _debugged(stack):
                self._over, self._since, self._began = None, now, now
                return True
            self.late = f"{late}, it was at {_place(stack)}"
        return got_on and not self.late


class _Watchdog:
    """Checks the time limits of all watches in a separate thread, which ends when the last watch closes."""

    def __init__(self, *, last_resort: bool = True) -> None:
        self._last_resort = last_resort
        self.clock = 0.0
        """Time that the process was running for [s]: not while it was stopped."""
        self._watches: list[Watch] = []
        self._lock = threading.Lock()
        self._runs = False

    def add(self, watch: Watch) -> None:
        with self._lock:
            self._watches.append(watch)
            self._put_off(watch.limits)
            if not self._runs:
                with suppress(RuntimeError):  # no thread can be started: there are no limits then
                    threading.Thread(target=self._patrol, name="rvads limits", daemon=True).start()
                    self._runs = True

    def remove(self, watch: Watch) -> None:
        with self._lock, suppress(ValueError):
            self._watches.remove(watch)
            if watch.limits.dump is not None and not self._watches and self._last_resort:
                faulthandler.cancel_dump_traceback_later()

    def late(self, thread: int) -> bool:
        """Tell whether a run in a thread is overdue."""
        return any(watch.overdue for watch in self._watches if watch.thread == thread)

    def _patrol(self) -> None:
        last = time.monotonic()
        while True:
            with self._lock:
                if not self._watches:
                    self._runs = False
                    return
                tick = min(_TICK, *(limit / 4 for watch in self._watches for limit in watch.limits[:2] if limit))
            time.sleep(tick)
            now = time.monotonic()
            self.clock += min(now - last, 2 * tick)
            last = now
            with self._lock:
                for watch in self._watches:
                    if watch.look(self.clock):
                        self._put_off(watch.limits)
                    elif watch.overdue:
                        _stop(watch)

    def _put_off(self, limits: Limits) -> None:
        """Have the process end some time after the limit, unless this is called again before, or taken back."""
        if limits.dump is not None and self._last_resort:
            seconds = (limits.decision or limits.run) + _GRACE
            with suppress(RuntimeError, OSError):  # no thread can be started, or standard error is gone
                faulthandler.dump_traceback_later(seconds, file=limits.dump, exit=True)


_WATCHDOG = _Watchdog()
_CURRENT: ContextVar[Watch] = ContextVar("rvads_watch")


def _forked() -> None:
    """Start anew in a child process, which has no thread but the one that forked."""
    global _WATCHDOG
    _WATCHDOG = _Watchdog(last_resort=False)  # its timer may be locked by a thread that the child does not have


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def watch() -> Watch:
    """Return the watch over the run under way in this thread; where there is none, one that watches nothing."""
    return _CURRENT.get(None) or Watch(Limits(decision=0.0, run=0.0))


def _interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise `TooLate` where the main thread is, but not while it opens or closes a watch."""
    if frame is not None and frame.f_code.co_filename != __file__ and _WATCHDOG.late(threading.get_ident()):
        raise TooLate


def _stop(watch: Watch) -> None:
    if watch.signalled:
        signal.pthread_kill(watch.thread, _SIGNAL)  # type: ignore[arg-type]
    else:
        _raise(watch.thread)


def _raise(thread: int) -> None:
    """Have a thread raise `TooLate` when it next runs Python code.

    It is never taken back: the interpreter (3.11) would go on looking for it in every thread, and never come to an end of
    that in one that is traced.
    """
    import ctypes

    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(TooLate))


def _place(stack: FrameType | None) -> str:
    """Return file and line of the innermost call of a stack that is none of Python's own library."""
    frame = stack
    while frame is not None and _in_library(frame.f_code.co_filename):
        frame = frame.f_back
    found = frame or stack
    return f"{Path(found.f_code.co_filename).name}:{found.f_lineno}" if found else "an unknown place"


def _in_library(file: str) -> bool:
    return file.startswith("<frozen") or (file.startswith(_LIBRARY) and "-packages" not in file)


def _debugged(stack: FrameType | None) -> bool:
    while stack is not None:
        if str(stack.f_globals.get("__name__")).partition(".")[0] in _DEBUGGERS:
            return True
        stack = stack.f_back
    return False
