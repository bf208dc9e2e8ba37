"""The process of a stack: bytes in, bytes out, each with a time limit, and its end."""

from __future__ import annotations

import os
import select
import shlex
import signal
import subprocess
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from pytest_rvads.drivers.stacks import guard
from pytest_rvads.drivers.stacks.descendants import MARK, Descendants, dismiss, kill
from pytest_rvads.drivers.stacks.standard_error import StandardError
from pytest_rvads.errors import AutopilotError
from pytest_rvads.wording import one_line

__all__ = ["Child", "StackError", "StackTimeout"]

_PIECE = 65536
"""Read at once [bytes]."""
_LINE = 16 * 2**20
"""The longest line [bytes]: what can be made of it takes some 20 times as much memory."""
_LONGEST = 1000
"""What is said of a failure, at most [characters]; some of it is of the stack's making."""
_MOMENT = 0.5
"""Between the end of the output of a process and its own [s]."""


class StackError(AutopilotError):
    """A stack in another process failed: it could not be started, ended, hung, or broke the protocol.

    Args:
        text: one sentence.
        detail: what it last wrote to its standard error.
    """

    def __init__(self, text: str, detail: str = "") -> None:
        super().__init__(one_line(text, _LONGEST))
        self.detail = detail


class StackTimeout(StackError):
    """A stack took longer than it may."""


class Child:
    """A running stack.

    Args:
        command: the program and its arguments.
        cwd: its working directory.
        env: variables to add to its environment.
        grace: how long it has to exit when it is told to, by `bye` and by SIGTERM [s].

    Raises:
        StackError: it can't be started.
    """

    def __init__(
        self, command: Sequence[str], cwd: str | Path | None = None, env: Mapping[str, str] | None = None, grace: float = 1.0
    ) -> None:
        self._grace, self._name, mark = grace, one_line(shlex.join(command), 100), uuid4().hex
        self._stderr = StandardError()
        try:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr.sink,
                bufsize=0,
                cwd=cwd,
                env={**os.environ, **(env or {}), MARK: mark},
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self._stderr.close()
            why = getattr(error, "strerror", None) or error
            raise StackError(f"it can't be started: {why}; give the path of a program that exists") from None
        finally:
            os.close(self._stderr.sink)
        guard.watch(self._process.pid, mark, grace)
        self._descendants = Descendants(self._process.pid, mark)
        if self._process.stdin is None or self._process.stdout is None:
            raise StackError("it has no pipes")
        self._in, self._out = self._process.stdin, self._process.stdout
        os.set_blocking(self._in.fileno(), False)
        self._closed = False
        self._buffer = bytearray()
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(self._out, select.POLLIN)
        self._writable.register(self._in, select.POLLOUT)

    @property
    def pid(self) -> int:
        """Number of the process, of its group and of its session."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._exited(0.0) is None

    def send(self, data: bytes, limit: float) -> None:
        """Write `data` to the process. A closed pipe raises no error here: reading the answer reports what happened.

        Raises:
            StackTimeout: the process did not read within `limit` seconds.
        """
        deadline = time.monotonic() + limit
        view = memoryview(data)
        while view:
            if not self._writable.poll(_left(deadline)):
                raise StackTimeout(f"it did not read its input for {limit:g} s")
            try:
                view = view[os.write(self._in.fileno(), view) :]
            except BlockingIOError:
                continue
            except BrokenPipeError:
                return

    def line(self, limit: float) -> bytes:
        """Return the next line, without its end.

        Raises:
            StackError: it ended, or the line does not.
            StackTimeout: it wrote none within `limit` seconds.
        """
        deadline = time.monotonic() + limit
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > _LINE:
                raise StackError(f"it wrote {searched:,} bytes without the end of a line, expected at most {_LINE:,}")
            self._fill(deadline, limit)
        found = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return found

    def exactly(self, count: int, limit: float) -> bytes:
        """Return the next `count` bytes.

        Raises:
            StackError: it ended.
            StackTimeout: it wrote fewer within `limit` seconds.
        """
        deadline = time.monotonic() + limit
        while len(self._buffer) < count:
            self._fill(deadline, limit)
        found = bytes(self._buffer[:count])
        del self._buffer[:count]
        return found

    def pending(self) -> bytes:
        """Return the first bytes that the process wrote without being asked."""
        if not self._buffer and self._readable.poll(0):
            self._buffer += os.read(self._out.fileno(), _PIECE)
        return bytes(self._buffer)

    def tail(self) -> str:
        """Return the end of what it wrote to its standard error."""
        return self._stderr.tail()

    def close(self, farewell: bytes = b"") -> None:
        """End it and all that it started: say goodbye and wait, send SIGTERM and wait, kill what is left.

        Warns:
            RuntimeWarning: of what can't be ended or found.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._dismiss(farewell)
        finally:  # also where somebody does not want to wait any longer
            left = kill([self._descendants])
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_MOMENT)
            guard.unwatch(self._process.pid)
            held = self._held()
            self._out.close()
            self._stderr.close()
        if left:
            _warn(f"the processes {sorted(left)} of the stack {self._name} can't be ended")
        elif held:
            _warn(f"a process that the stack {self._name} started holds its standard output and can't be found")

    def _dismiss(self, farewell: bytes) -> None:
        """Ask the process to exit, and wait for the process and all its descendants."""
        if farewell:
            self._descendants.living()  # what it leaves behind is not related to it any more once it has gone
            with suppress(OSError):  # it is gone, or does not read
                os.write(self._in.fileno(), farewell)
        self._in.close()
        if farewell:
            self._exited(self._grace)
        dismiss([self._descendants], self._grace)

    def _held(self) -> bool:
        """Tell whether somebody can still write to its standard output; who was killed may need a moment to let go of it."""
        deadline = time.monotonic() + _MOMENT
        while time.monotonic() < deadline and self._readable.poll(_left(deadline)):
            if not os.read(self._out.fileno(), _PIECE):
                return False
        return True

    def _fill(self, deadline: float, limit: float) -> None:
        if not self._readable.poll(_left(deadline)):
            raise StackTimeout(f"it did not answer within {limit:g} s")
        data = os.read(self._out.fileno(), _PIECE)
        if not data:
            raise StackError(self._ended())
        self._buffer += data

    def _ended(self) -> str:
        status = self._exited(_MOMENT)
        if status is None:
            return "it closed its standard input or output and went on"
        if status.si_code == os.CLD_EXITED:
            return f"it exited with status {status.si_status} before it answered"
        try:
            name = signal.Signals(status.si_status).name
        except ValueError:
            name = str(status.si_status)
        return f"it was killed by signal {name}"

    def _exited(self, limit: float) -> os.waitid_result | None:
        """Return how it exited, None if it has not within `limit` seconds; it is not reaped."""
        deadline = time.monotonic() + limit
        while True:
            try:
                found = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
            except ChildProcessError:  # somebody in this process waits for whatever ends
                return None
            if found is not None or time.monotonic() >= deadline:
                return found
            time.sleep(0.002)


def _warn(what: str) -> None:
    warnings.warn(f"{what}: end them by hand, and run what starts daemons in a container", RuntimeWarning, stacklevel=3)


def _left(deadline: float) -> float:
    """Return the time until `deadline` for `poll` [ms]."""
    return max(deadline - time.monotonic(), 0.0) * 1000.0
