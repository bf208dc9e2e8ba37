"""The process of a stack: bytes in, bytes out, each with a time limit, and its end."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from pytest_rvads.drivers.stacks import guard
from pytest_rvads.errors import AutopilotError
from pytest_rvads.wording import one_line

__all__ = ["Child", "StackError", "StackTimeout"]

_TAIL = 4096
"""How much of the standard error of a stack is shown when it fails [bytes]."""
_LONGEST = 1000
"""What is said of a failure, at most [characters]; some of it is of the stack's making."""
_GRACE = 0.5
"""How long a stack has to exit after it was told to [s]."""


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

    Raises:
        StackError: it can't be started.
    """

    def __init__(self, command: Sequence[str], cwd: str | Path | None, env: Mapping[str, str] | None) -> None:
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the child
        try:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                bufsize=0,
                cwd=cwd,
                env=None if env is None else {**os.environ, **env},
                process_group=0,
            )
        except OSError as error:
            self._stderr.close()
            raise StackError(f"it can't be started: {error.strerror or error}; give the path of a program that exists") from None
        guard.watch(self._process.pid)
        if self._process.stdin is None or self._process.stdout is None:
            raise StackError("it has no pipes")
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._in, False)
        self._buffer = bytearray()
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(self._out, select.POLLIN)
        self._writable.register(self._in, select.POLLOUT)

    @property
    def pid(self) -> int:
        """Number of the process, and of its group."""
        return self._process.pid

    def send(self, data: bytes, limit: float) -> None:
        """Write `data`; where it no longer reads, its answer, or the lack of one, tells what happened.

        Raises:
            StackTimeout: it did not read within `limit` seconds.
        """
        deadline = time.monotonic() + limit
        view = memoryview(data)
        while view:
            if not self._writable.poll(_left(deadline)):
                raise StackTimeout(f"it did not read its input for {limit:g} s")
            try:
                view = view[os.write(self._in, view) :]
            except BlockingIOError:
                continue
            except BrokenPipeError:
                return

    def line(self, limit: float) -> bytes:
        """Return the next line, without its end.

        Raises:
            StackError: it ended.
            StackTimeout: it wrote none within `limit` seconds.
        """
        deadline = time.monotonic() + limit
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
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
        """Return what it wrote and nobody has asked for."""
        while self._readable.poll(0):
            data = os.read(self._out, 65536)
            if not data:
                break
            self._buffer += data
        return bytes(self._buffer)

    def tail(self) -> str:
        """Return the end of what it wrote to its standard error."""
        size = self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(size - _TAIL, 0))
        return self._stderr.read().decode(errors="replace").strip()

    def close(self, farewell: bytes = b"") -> None:
        """Say goodbye, wait a moment, and kill what is left of its process group."""
        process = self._process
        if process.stdin is None or process.stdout is None or process.stdin.closed:
            return
        if farewell:
            with suppress(OSError):  # it is gone, or does not read: it is killed below
                os.write(self._in, farewell)
        process.stdin.close()
        if farewell:
            self._exited(_GRACE)
        # The leader is not reaped yet, so that its number still names this group and no other one.
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        guard.unwatch(process.pid)
        process.stdout.close()
        self._stderr.close()

    def _fill(self, deadline: float, limit: float) -> None:
        if not self._readable.poll(_left(deadline)):
            raise StackTimeout(f"it did not answer within {limit:g} s")
        data = os.read(self._out, 65536)
        if not data:
            raise StackError(self._ended())
        self._buffer += data

    def _ended(self) -> str:
        status = self._exited(_GRACE)
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
            found = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
            if found is not None or time.monotonic() >= deadline:
                return found
            time.sleep(0.002)


def _left(deadline: float) -> float:
    """Return the time until `deadline` for `poll` [ms]."""
    return max(deadline - time.monotonic(), 0.0) * 1000.0
