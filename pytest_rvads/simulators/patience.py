"""The limits of real time of a run, and how they end drivers and runs.

The states of a run depend on simulated time alone. Limits of real time end the run of a driver that never answers, so that later
tests can run. A thread checks the run and raises `TooLate` in the thread of a run that exceeds a limit: in the main thread by a
signal, which also ends a blocking call, in other threads by the interpreter. A driver that catches all exceptions, or that hangs
in C, does not stop. The process of such a driver ends and writes the call stacks of its threads if it is a worker process,
without which its parent process goes on, or if `Limits.dump` is set.

The signal is SIGURG, which is ignored by default. No timer is used, so alarms stay free for drivers and plugins, and no system
call of a run within its limits is interrupted. Only to end the process, the timer of faulthandler is used, which a process has
once: every watch sets the timer anew at each check of its run.

This module imports no simulator, because every session of pytest sets limits, even a session without simulations.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from itertools import takewhile
from types import FrameType, TracebackType
from typing import Any, NamedTuple

from pytest_rvads.support.errors import place

_TICK = 0.5
"""Longest time between two checks of a run [s]."""
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


USUAL, UNLIMITED = Limits(), Limits(decision=0.0, run=0.0)


class Watch:
    """A context that watches the time limits of one run, in the thread of the run; watches can be nested.

    Outside of its context, a watch notes what is asked and enforces nothing.
    """

    def __init__(self, limits: Limits = UNLIMITED) -> None:
        from multiprocessing.process import parent_process  # most sessions of pytest need it not

        self.thread, self._process = threading.get_ident(), os.getpid()
        self.signalled = _SIGNAL is not None and self.thread == threading.main_thread().ident
        handler: Any = signal.getsignal(_SIGNAL) if _SIGNAL is not None and self.signalled else None
        while isinstance(outer := getattr(handler, "__self__", None), Watch) and outer._process == self._process:
            handler = outer._before
        dump = limits.dump
        if parent_process() is not None and dump != NEVER:
            dump = _STANDARD_ERROR  # a descriptor of the parent process may mean another file here
        if dump == NEVER or isinstance(outer, Watch):
            # A process forked during a run lacks the thread of the timer, which holds the lock of the timer.
            dump = None
        self.limits = limits._replace(dump=dump)
        self.asked: object = None
        """A new object for every call into a driver; None between calls."""
        self.late = ""
        """The exceeded limit in words; it stays set even if a driver catches `TooLate`."""
        self._before: Any = None
        """What handles the signal outside of the context; for a nested watch, the outer watch."""
        self._latest: object = None
        self._since = self._began = self._fresh = self._clock = 0.0
        """Times of the last call, of the begin and of the last check without an exceeded limit, and the present time, by the
        running time of the process in this context, without the time for which it was stopped [s]."""
        self._over: object = None
        """The value of `asked` when the limit of a decision was exceeded; the watch itself for the limit of the run."""
        self._lock, self._open = threading.Lock(), threading.Lock()
        """The first is held by who checks or closes the watch; the second as long as the watch is open."""
        self._closed = False

    @property
    def overdue(self) -> bool:
        """Whether a limit is exceeded by a call or a run that has not ended."""
        return self._over is self or (self._over is not None and self._over is self.asked)

    def __enter__(self) -> Watch:
        if self.signalled:
            self._before = signal.signal(_SIGNAL, self._interrupt)  # type: ignore[arg-type]
        self._open.acquire()
        if self.limits.decision or self.limits.run:
            self._set_timer()
            with suppress(RuntimeError):  # if no thread can be started, no limit is enforced
                threading.Thread(target=self._patrol, name="rvads limits", daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.end_in_child(error)
        try:
            self._close()
            if self.late and not self.signalled:
                for _ in range(100):  # a TooLate that was requested is raised in this loop at the latest
                    pass
        except TooLate:
            self._close()
        if self.signalled:
            signal.signal(_SIGNAL, self._before or signal.SIG_DFL)  # type: ignore[arg-type]

    def _close(self) -> None:
        with self._lock:
            if not self._closed:
                self._closed = True
                self._open.release()
                if self.limits.dump is not None:
                    faulthandler.cancel_dump_traceback_later()

    def end_in_child(self, error: BaseException | None) -> None:
        """End the process if a driver forked it and the child returned from the driver's code, perhaps by `error`."""
        if os.getpid() != self._process:
            code = error.code if isinstance(error, SystemExit) else error and 1
            os._exit(code if isinstance(code, int) else 1 if code else 0)

    def look(self, now: float) -> bool:
        """Return whether the run advanced since the last call, within its limits; an exceeded limit is noted in `late`.

        `now` is the running time of the process in this context [s].
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

    def _patrol(self) -> None:
        """Check the limits in a thread of its own until the watch closes."""
        tick = min(_TICK, *(limit / 4 for limit in self.limits[:2] if limit))
        last = time.monotonic()
        while not self._open.acquire(timeout=tick):
            now = time.monotonic()
            self._clock += min(now - last, 2 * tick)
            last = now
            with self._lock:
                if self._closed:
                    return
                if self.look(self._clock):
                    self._fresh = self._clock
                elif self.overdue and self.signalled:
                    signal.pthread_kill(self.thread, _SIGNAL)  # type: ignore[arg-type]
                elif self.overdue:
                    # The request is never cancelled: after a cancellation, Python 3.11 would keep searching every thread for
                    # the exception, and a traced thread would never end.
                    import ctypes

                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.thread), ctypes.py_object(TooLate))
                self._set_timer()

    def _set_timer(self) -> None:
        """Set the timer that ends the process when a time limit and `_GRACE` are over."""
        if self.limits.dump is not None:
            seconds = self._fresh + (self.limits.decision or self.limits.run) + _GRACE - self._clock
            with suppress(RuntimeError, OSError):  # no thread can be started, or standard error is gone
                faulthandler.dump_traceback_later(max(seconds, 0.001), file=self.limits.dump, exit=True)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        """Raise `TooLate` in the main thread, except while this thread opens or closes a watch."""
        if frame is not None and frame.f_code.co_filename == __file__:
            return
        if self.overdue and os.getpid() == self._process:
            raise TooLate
        if callable(self._before):
            self._before(number, frame)
