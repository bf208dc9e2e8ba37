"""One stack and the conversation with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import Child, StackError

__all__ = ["Connection", "Exchange"]


class Connection:
    """A stack that said hello.

    Args:
        start: starts its process.
        startup: how long it may take to say hello, and to get ready for a scenario [s].
        timeout: how long it may take for a command [s].

    Raises:
        StackError: it can't be started, or does not say hello in this version of the protocol.
    """

    def __init__(self, start: Callable[[], Child], startup: float, timeout: float) -> None:
        self._startup, self._timeout = startup, timeout
        self.serves: object = None
        """Whose scenario it is in."""
        self.child = start()
        try:
            self.child.send(messages.hello(), startup)
            answer = messages.read(self.child.line(startup), messages.Hello)
            self._exchange = _exchange(answer, self.child)
            self.rate = answer.rate
        except StackError as error:
            raise self.failed(error) from None

    def reset(self, content: dict[str, Any]) -> None:
        """Begin a scenario.

        Raises:
            StackError: it did not get ready.
        """
        try:
            self._exchange.begin(content, self._startup)
        except StackError as error:
            raise self.failed(error) from None

    def ask(self, seen: Observation) -> tuple[Command, float]:
        """Return the command for `seen`, and how long the stack computed [s]: as it says, else until it answered.

        Raises:
            StackError: no command came in time.
        """
        began = time.perf_counter()
        try:
            command, compute = self._exchange.decide(seen, self._timeout)
        except StackError as error:
            raise self.failed(error) from None
        return command, time.perf_counter() - began if compute is None else compute

    def failed(self, error: StackError) -> StackError:
        """End the process and return `error` with its last words."""
        detail = self.child.tail()
        self.close()
        return StackError(str(error), detail)

    def close(self, *, farewell: bool = False) -> None:
        """End the process, with a goodbye or at once."""
        self.child.close(self._exchange.format.bye if farewell else b"")


class Exchange:
    """Questions and answers in the format ``json``."""

    format: messages.Format

    def __init__(self, child: Child) -> None:
        self._child = child
        self.format = messages.Json()
        self._step = 0

    def begin(self, content: dict[str, Any], limit: float) -> None:
        """Send a reset and wait until the stack is ready."""
        self._step = 0
        self._child.send(self.format.begin(content), limit)
        self._ready(limit)

    def decide(self, seen: Observation, limit: float) -> tuple[Command, float | None]:
        """Send an observation and return the command, and the compute time that the stack reports [s], if it does."""
        self._step += 1
        self._child.send(self.format.observe(seen, self._step), limit)
        command, compute, step = self._receive(limit)
        if step != self._step:
            # A second answer to one question would shift all that follow.
            raise StackError(f"it answered step {step}, expected step {self._step}: answer every observation once")
        return command, compute

    def _ready(self, limit: float) -> None:
        messages.read(self._child.line(limit), messages.Ready)

    def _receive(self, limit: float) -> tuple[Command, float | None, int | None]:
        answer = messages.read(self._child.line(limit), messages.Answer)
        return answer.command(), answer.compute, answer.step


class _Frames(Exchange):
    """Questions and answers in the format ``binary``."""

    def __init__(self, child: Child) -> None:
        super().__init__(child)
        self.format = self._binary = frames.Binary()

    def _ready(self, limit: float) -> None:
        self._frame(frames.READY, 0, limit)

    def _receive(self, limit: float) -> tuple[Command, float | None, int | None]:
        return self._binary.command(self._frame(frames.COMMAND, self._binary.command_size, limit))

    def _frame(self, kind: int, size: int, limit: float) -> bytes:
        head = self._child.exactly(frames.HEADER.size, limit)
        found = frames.HEADER.unpack(head)
        if found != (kind, size):
            if found in ((frames.READY, 0), (frames.COMMAND, self._binary.command_size)):
                raise StackError(f"it sent a frame of kind {found[0]}, expected {kind}")
            raise StackError(messages.stray(head + self._child.pending()))
        return self._child.exactly(size, limit)


_FORMATS = {"json": Exchange, "binary": _Frames}


def _exchange(answer: messages.Hello, child: Child) -> Exchange:
    if answer.version != messages.VERSION:
        raise StackError(
            f"it speaks version {answer.version} of the protocol, expected {messages.VERSION}: "
            "build it with the client of this version"
        )
    if answer.format not in _FORMATS:
        raise StackError(f"it wants the format {answer.format[:20]!r}, expected {' or '.join(_FORMATS)}")
    return _FORMATS[answer.format](child)
