"""One stack and the conversation with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import Child, StackError

__all__ = ["Connection"]

_DAY = 86400.0
"""No decision takes longer [s]."""


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
        self._startup, self._timeout, self._step = startup, timeout, 0
        self.serves: object = None
        """Whose scenario it is in."""
        self.child = start()
        try:
            self.child.send(messages.hello(), startup)
            answer = messages.read(self.child.line(startup), messages.Hello)
            self._format = _format(answer)
            self.rate = answer.rate
        except StackError as error:
            raise self.failed(error) from None
        except BaseException:  # somebody does not want to wait any longer
            self.child.close()
            raise

    def reset(self, content: dict[str, Any]) -> None:
        """Begin a scenario.

        Raises:
            StackError: it did not get ready.
        """
        self._step = 0
        try:
            early = self.child.pending()
            self.child.send(self._format.begin(content), self._startup)
            self._format.ready(self.child, self._startup)
            _refuse(early)
        except StackError as error:
            raise self.failed(error) from None

    def ask(self, seen: Observation) -> tuple[Command, float]:
        """Return the command for `seen`, and how long the stack computed [s]: as it says, else until it answered.

        Raises:
            StackError: no command came in time.
        """
        began = time.perf_counter()
        self._step += 1
        try:
            early = self.child.pending()
            self.child.send(self._format.observe(seen, self._step), self._timeout)
            command, compute, step = self._format.answer(self.child, self._timeout)
            if step != self._step:
                # A second answer to one question would shift all that follow.
                raise StackError(f"it answered step {step}, expected step {self._step}: answer every observation once")
            _refuse(early)
            if compute is not None and not 0.0 <= compute <= _DAY:
                raise StackError(f"it says that it computed for {compute:g} s, expected 0 to {_DAY:g}")
        except StackError as error:
            raise self.failed(error) from None
        return command, time.perf_counter() - began if compute is None else compute

    def failed(self, error: StackError) -> StackError:
        """End the process and return `error` with its last words."""
        error.detail = self.child.tail()
        self.close()
        return error

    def close(self, *, farewell: bool = False) -> None:
        """End the process, with a goodbye or at once."""
        self.child.close(self._format.bye if farewell else b"")


def _refuse(early: bytes) -> None:
    """Refuse bytes that the stack wrote before it was asked; called after the answer was read, whose errors come first."""
    if early:
        raise StackError(f"it wrote {messages.quoted(early)} before it was asked: read a message, then answer it once")


def _format(answer: messages.Hello) -> messages.Format:
    if answer.version != messages.VERSION:
        raise StackError(
            f"it speaks version {answer.version} of the protocol, expected {messages.VERSION}: "
            "build it with the client of this version"
        )
    if answer.format not in _FORMATS:
        raise StackError(f"it wants the format {answer.format[:20]!r}, expected {' or '.join(_FORMATS)}")
    return _FORMATS[answer.format]()


_FORMATS: dict[str, Callable[[], messages.Format]] = {"json": messages.Json, "binary": frames.Binary}
