"""The default simulator and the limits of real time that a pytest session chooses, and how the limits end drivers and runs.

This module imports no simulator, because every session of pytest makes this choice, even a session without simulations.

The states of a run depend on simulated time alone. Limits of real time end the run of a driver that never answers, so that later
tests can run. A thread checks the current runs and raises `TooLate` in the thread of a run that exceeds a limit: in the main
thread by a signal, which also ends a blocking call, in other threads by the interpreter. A driver that catches all exceptions, or
that hangs in C, does not stop. The process of such a driver ends and writes the call stacks of its threads if it is a worker
process, without which its parent process goes on, or if `Limits.dump` is set.

The signal is SIGURG, which is ignored by default. No timer is used, so alarms stay free for drivers and plugins, and no system
call of a run within its limits is interrupted. Only to end the process, the timer of faulthandler is used.
"""

from __future__ import annotations

import faulthandler
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar, Token
from itertools import takewhile
from numbers import Real
from types import FrameType, TracebackType
from typing import Any, NamedTuple

from pytest_rvads.support.errors import ScenarioError, place

_TICK = 0.5
"""Longest time between two checks of the current runs [s]."""
_GRACE = 3.0
"""Time after a limit for a driver to stop, and to release processes and connections [s]."""
_SIGNAL = getattr(signal, "SIGURG", None)
"""A signal whose default action is to be ignored, so that a thread without a handler survives it; None on Windows."""
NEVER = -1
"""Value of `Limits.dump` with which no process ends, because something else uses the timer of faulthandler."""
_STANDARD_ERROR = 2
_DEBUGGERS = {"bdb", "pdb", "pydevd", "_pydevd_bundle"}
"""Packages of debuggers: a run in a debugger has no time limit."""


class Limits(NamedTuple):
    """Limits of real time; 0 sets no limit."""

    decision: float = 15.0
    """Longest call into a driver [s]."""
    run: float = 300.0
    """Longest run [s]."""
    dump: int | None = None
    """File descriptor for the stacks of a process that ends because a driver does not stop.

    None for standard error in a worker process; in other processes, None lets the driver run for ever.
    """


class TooLate(BaseException):
    """Raised in the thread of a run when a time limit is over; only the code that opened the `Watch` must catch it."""


class Watch:
    """A context that watches the time limits of one run, in the thread of the run; watches can be nested."""

    def __init__(self, limits: Limits) -> None:
        from multiprocessing.process import parent_process  # most sessions of pytest need it not

        if parent_process() is not None and limits.dump != NEVER:
            limits = limits._replace(dump=_STANDARD_ERROR)  # a descriptor of the parent process may mean another file here
        self.limits = limits._replace(dump=None) if limits.dump == NEVER else limits
        self.asked: object = None
        """A new object for every call into a driver; None between calls."""
        self.late = ""
        """The exceeded limit in words; it stays set even if a driver catches `TooLate`."""
        self.thread, self._process = threading.get_ident(), os.getpid()
        self.signalled = _SIGNAL is not None and self.thread == threading.main_thread().ident
        self._latest: object = None
        self._since = self._began = 0.0
        self._over: object = None
        """The value of `asked` when the limit of a decision was exceeded; the watch itself for the limit of the run."""

    @property
    def overdue(self) -> bool:
        """Whether a limit is exceeded by a call or a run that has not ended."""
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
                for _ in range(100):  # a TooLate that the watchdog has requested is raised in this loop at the latest
                    pass
        except TooLate:
            _WATCHDOG.remove(self)
        if self.signalled:
            signal.signal(_SIGNAL, self._before or signal.SIG_DFL)  # type: ignore[arg-type]
        _CURRENT.reset(self._token)

    def end_in_child(self, error: BaseException | None) -> None:
        """End the process if a driver forked it and the child returned from the driver's code, perhaps by `error`."""
        if os.getpid() != self._process:
            code = error.code if isinstance(error, SystemExit) else error and 1
            os._exit(code if isinstance(code, int) else 1 if code else 0)

    def look(self, now: float) -> bool:
        """Return whether the run advanced since the last call, within its limits; an exceeded limit is noted in `late`.

        `now` is the time by `_Watchdog.clock` [s].
        """
        asked = self.asked
        got_on = asked is None or asked is not self._latest
        if got_on:
            self._latest, self._since = asked, now
        decision = min(self.limits.decision, _GRACE) if self.late else self.limits.decision
        self._over, late = None, ""
        if decision and not got_on and now - self._since >= decision:
            self._over, late = asked, f"no answer within {decision:g} s of real time (setting rvads_decision_limit)"
        elif self.limits.run and now - self._began >= self.limits.run:
            self._over, late = self, f"the run took longer than {self.limits.run:g} s of real time (setting rvads_run_limit)"
            self._began += _GRACE
        if late and not self.late:
            frames, frame = list[FrameType](), sys._current_frames().get(self.thread)
            while frame is not None:
                frames.append(frame)
                frame = frame.f_back
            if any(str(frame.f_globals.get("__name__")).partition(".")[0] in _DEBUGGERS for frame in frames):
                self._over, self._since, self._began = None, now, now
                return True
            # The innermost call of a driver or a world ends where a frame of this package has called it.
            call = [*frames[:1], *takewhile(lambda frame: frame.f_globals.get("__package__") != __package__, frames[1:])]
            lines = [(frame.f_code.co_filename, frame.f_lineno) for frame in reversed(call)]
            self.late = f"{late}, it was at {place(lines) if lines else 'an unknown place'}"
        return got_on and not self.late


class _Watchdog:
    """Checks the time limits of all watches in a separate thread, which ends when the last watch closes."""

    def __init__(self, *, last_resort: bool = True) -> None:
        self._last_resort = last_resort
        self.clock = 0.0
        """Running time of the process without the time for which it was stopped [s]."""
        self.watches: list[Watch] = []
        self._lock = threading.Lock()
        self._runs = False

    def add(self, watch: Watch) -> None:
        with self._lock:
            self.watches.append(watch)
            self._put_off(watch.limits)
            if not self._runs:
                with suppress(RuntimeError):  # if no thread can be started, no limit is enforced
                    threading.Thread(target=self._patrol, name="rvads limits", daemon=True).start()
                    self._runs = True

    def remove(self, watch: Watch) -> None:
        with self._lock, suppress(ValueError):
            self.watches.remove(watch)
            if watch.limits.dump is not None and not self.watches and self._last_resort:
                faulthandler.cancel_dump_traceback_later()

    def late(self, thread: int) -> bool:
        """Return whether a run in a thread has exceeded a time limit."""
        return any(watch.overdue for watch in self.watches if watch.thread == thread)

    def _patrol(self) -> None:
        last = time.monotonic()
        while True:
            with self._lock:
                if not self.watches:
                    self._runs = False
                    return
                tick = min(_TICK, *(limit / 4 for watch in self.watches for limit in watch.limits[:2] if limit))
            time.sleep(tick)
            now = time.monotonic()
            self.clock += min(now - last, 2 * tick)
            last = now
            with self._lock:
                for watch in self.watches:
                    if watch.look(self.clock):
                        self._put_off(watch.limits)
                    elif watch.overdue and watch.signalled:
                        signal.pthread_kill(watch.thread, _SIGNAL)  # type: ignore[arg-type]
                    elif watch.overdue:
                        # The request is never cancelled: after a cancellation, Python 3.11 would keep searching every thread for
                        # the exception, and a traced thread would never end.
                        import ctypes

                        thread, late = ctypes.c_ulong(watch.thread), ctypes.py_object(TooLate)
                        ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, late)

    def _put_off(self, limits: Limits) -> None:
        """Set, or set anew, the timer that ends the process when a time limit and `_GRACE` are over."""
        if limits.dump is not None and self._last_resort:
            seconds = (limits.decision or limits.run) + _GRACE
            with suppress(RuntimeError, OSError):  # no thread can be started, or standard error is gone
                faulthandler.dump_traceback_later(seconds, file=limits.dump, exit=True)


_WATCHDOG = _Watchdog()
_CURRENT: ContextVar[Watch] = ContextVar("rvads_watch")


def _forked() -> None:
    """Make a new watchdog in a child process, which has only the thread that forked."""
    global _WATCHDOG
    # If a timer ran, a thread that the child lacks holds the lock of the timer.
    _WATCHDOG = _Watchdog(last_resort=not _WATCHDOG.watches)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def watch() -> Watch:
    """Return the timer with the limits of the run that this thread simulates; without a run, a timer without limits."""
    return _CURRENT.get(None) or Watch(Limits(decision=0.0, run=0.0))


def _interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise `TooLate` in the main thread, except while this thread opens or closes a watch."""
    if frame is not None and frame.f_code.co_filename != __file__ and _WATCHDOG.late(threading.get_ident()):
        raise TooLate


class Choice(NamedTuple):
    """The default simulator and the limits of real time."""

    simulator: Any = None
    """A `Simulator`; None for the usual simulator, which is imported when it is used."""
    limits: Limits = Limits()


_CHOICES: list[list[Choice]] = [[Choice()]]
"""One entry per open session. Each entry is a separate list, so that a session that ends can find and remove its own entry."""

_LOCK = threading.Lock()
"""Held while `_CHOICES` changes, because several threads can change it."""


def choice() -> Choice:
    """Return the default simulator and the time limits that the session chose."""
    return _CHOICES[-1][0]


@contextmanager
def choosing(new: Choice) -> Iterator[None]:
    """Make a default simulator and time limits hold within the context."""
    opened = [new]
    with _LOCK:
        _CHOICES.append(opened)
    try:
        yield
    finally:
        with _LOCK:
            _CHOICES[:] = [entry for entry in _CHOICES if entry is not opened]


@contextmanager
def limits(decision: float = Limits().decision, run: float = Limits().run) -> Iterator[None]:
    """Set the limits of real time for all simulations within the context, in any thread.

    A run that exceeds a limit ends by a fault that names the driver and its current line.

    Args:
        decision: longest call into a driver [s]; 0 sets no limit.
        run: longest run [s]; 0 sets no limit.

    Raises:
        ScenarioError: a limit is negative, infinite or no number.
    """
    for name, limit in (("decision", decision), ("run", run)):
        if not (isinstance(limit, Real) and 0 <= limit < math.inf):
            raise ScenarioError(f"limits({name}=) takes a number of seconds, 0 for no limit, got {limit!r:.60}")
    current = choice()
    with choosing(current._replace(limits=current.limits._replace(decision=float(decision), run=float(run)))):
        yield
