"""The process of a stack (an autopilot in another process): writing and reading with time limits, and ending the process.

A thread of this package reads the standard error of the stack, so that the stack is never blocked by a full pipe. Only the end of
the standard error is stored.
"""

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
from threading import Lock, Thread
from uuid import uuid4

from pytest_rvads.drivers.stacks.descendants import MARK, Descendants, Guard, dismiss, kill
from pytest_rvads.support.errors import AutopilotError
from pytest_rvads.support.wording import one_line, printable

_STORED = 2**20
"""Length of the end of the standard error that is stored [bytes]."""
_TAIL = 4096
"""Length of the end of the standard error that an error message shows [bytes]."""
_PIECE = 65536
"""Largest number of bytes that are read at once."""
_LINE = 16 * 2**20
"""Greatest length of a line from a stack [bytes]; the decoded values of a line take about 20 times as much memory."""
_LONGEST = 1000
"""Greatest length of the text of an error, of which a stack can have written parts [characters]."""
_MOMENT = 0.5
"""Longest wait for the end of a process after the end of its output, and for the end of its output after it was killed [s]."""


class StackError(AutopilotError):
    """A stack in another process failed: it could not be started, ended, hung, or broke the protocol.

    Args:
        text: the failure in one sentence.
        detail: the end of the standard error of the stack.
    """

    def __init__(self, text: str, detail: str = "") -> None:
        super().__init__(one_line(text, _LONGEST))
        self.detail = detail


class StackTimeout(StackError):
    """A stack took longer than its time limit."""


class Child:
    """The running process of a stack (an autopilot in another process).

    The process gets the time `grace` to exit after the message ``bye``, and again after SIGTERM [s]. `guard` ends it when this
    process ends.
    """

    def __init__(
        self,
        command: Sequence[str],
        cwd: str | Path | None = None,
        env: Mapping[str, str] | None = None,
        grace: float = 1.0,
        guard: Guard | None = None,
    ) -> None:
        self._guard = guard or Guard()
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
            cause = getattr(error, "strerror", None) or error
            raise StackError(f"it can't be started: {cause}; give the path of a program that exists") from None
        finally:
            os.close(self._stderr.sink)
        self._guard.watch(self._process.pid, mark, grace)
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
        """Id of the process, which is also the id of its process group and of its session."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._exited(0.0) is None

    def send(self, data: bytes, limit: float) -> None:
        """Write `data` to the process. If the process has closed its input, the error is raised when its answer is read."""
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
        """Return the next line that the process writes, without the newline."""
        deadline = time.monotonic() + limit
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > _LINE:
                raise StackError(f"it wrote {searched:,} bytes without the end of a line, expected at most {_LINE:,}")
            self._fill(deadline, limit)
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return line

    def exactly(self, count: int, limit: float) -> bytes:
        """Return the next `count` bytes that the process writes."""
        deadline = time.monotonic() + limit
        while len(self._buffer) < count:
            self._fill(deadline, limit)
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def pending(self) -> bytes:
        """Return bytes that the process has written although nothing was asked; empty if there are none."""
        if not self._buffer and self._readable.poll(0):
            self._buffer += os.read(self._out.fileno(), _PIECE)
        return bytes(self._buffer)

    def tail(self) -> str:
        """Return the end of what the process wrote to its standard error."""
        return self._stderr.tail()

    def close(self, farewell: bytes = b"") -> None:
        """End the process and its descendants: send `farewell` and wait, send SIGTERM and wait, send SIGKILL.

        Processes that can't be ended, or can't be found, are named in a warning.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if farewell:
                self._descendants.living()  # descendants are identified before the process exits, when they lose their parent
                with suppress(OSError):  # the process has ended, or does not read
                    os.write(self._in.fileno(), farewell)
            self._in.close()
            if farewell:
                self._exited(self._grace)
            dismiss([self._descendants], self._grace)
        finally:  # an interrupt must not leave processes behind
            living = kill([self._descendants])
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_MOMENT)
            self._guard.unwatch(self._process.pid)
            deadline, held = time.monotonic() + _MOMENT, True
            while held and time.monotonic() < deadline and self._readable.poll(_left(deadline)):
                held = bool(os.read(self._out.fileno(), _PIECE))  # the output ends when no process holds it
            self._out.close()
            self._stderr.close()
        fault = f"a process that the stack {self._name} started holds its standard output and can't be found" if held else ""
        if living:
            fault = f"the processes {sorted(living)} of the stack {self._name} can't be ended"
        if fault:
            advice = "end them by hand, and run stacks that start daemons in a container"
            warnings.warn(f"{fault}: {advice}", RuntimeWarning, stacklevel=2)

    def _fill(self, deadline: float, limit: float) -> None:
        if not self._readable.poll(_left(deadline)):
            raise StackTimeout(f"it did not answer within {limit:g} s")
        data = os.read(self._out.fileno(), _PIECE)
        self._buffer += data
        if data:
            return
        status = self._exited(_MOMENT)
        if status is None:
            raise StackError("it closed its standard input or output and went on")
        if status.si_code == os.CLD_EXITED:
            raise StackError(f"it exited with status {status.si_status} before it answered")
        try:
            name = signal.Signals(status.si_status).name
        except ValueError:
            name = str(status.si_status)
        raise StackError(f"it was killed by signal {name}")

    def _exited(self, limit: float) -> os.waitid_result | None:
        """Return the exit status of the process, which stays a zombie; None if the process still runs after `limit` seconds."""
        deadline = time.monotonic() + limit
        while True:
            try:
                status = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
            except ChildProcessError:  # other code in this process has reaped the process
                return None
            if status is not None or time.monotonic() >= deadline:
                return status
            time.sleep(0.002)


def _left(deadline: float) -> float:
    """Return the time until `deadline` in milliseconds, the unit of `poll`; 0 after the deadline."""
    return max(deadline - time.monotonic(), 0.0) * 1000.0


class StandardError:
    """A pipe for the standard error of a stack; only the end of what the stack writes is stored.

    A thread reads the pipe until every process has closed it, or until `close` is called. `close` does not wait for processes
    that still hold the pipe open.
    """

    def __init__(self) -> None:
        self._source, self.sink = os.pipe()
        """The two ends of the pipe: this process reads from `_source`, and the stack writes to `sink`."""
        self._stop, self._stopper = os.pipe()
        os.set_blocking(self._source, False)
        self._stored = bytearray()
        self._lock = Lock()
        self._thread = Thread(target=self._follow, name="standard error of a stack", daemon=True)
        self._thread.start()

    def tail(self) -> str:
        """Return the end of the text that the stack has written to its standard error until now."""
        if self._thread.is_alive():
            self._read()
        return printable(self._stored[-_TAIL:].decode(errors="replace").strip(), _TAIL)

    def close(self) -> None:
        """Stop reading; `tail` does not change any more."""
        os.close(self._stopper)
        self._thread.join()
        for number in (self._source, self._stop):
            os.close(number)

    def _follow(self) -> None:
        waits = select.poll()
        for number in (self._source, self._stop):
            waits.register(number, select.POLLIN)
        while self._stop not in dict(waits.poll()) and self._read():
            pass

    def _read(self) -> bool:
        """Read and store at most `_PIECE` bytes from the pipe, and return False if every process has closed the pipe."""
        with self._lock:
            try:
                piece = os.read(self._source, _PIECE)
            except BlockingIOError:
                return True
            self._stored += piece
            del self._stored[:-_STORED]
        return bool(piece)
