"""The standard error of a stack: read as it comes, so that the stack never waits for us, and forgotten but for its end."""

from __future__ import annotations

import os
import select
from threading import Lock, Thread

from pytest_rvads.wording import printable

__all__ = ["StandardError"]

_KEPT = 2**20
"""How much of the end is kept [bytes]."""
_TAIL = 4096
"""How much of that is shown when the stack fails [bytes]."""
_PIECE = 65536


class StandardError:
    """A pipe whose end is known.

    A thread reads it, until nobody can write any more or it is closed: who has left the stack and still holds the pipe is
    not waited for.
    """

    def __init__(self) -> None:
        self._source, self.sink = os.pipe()
        """Where to read; where the stack writes."""
        self._stop, self._stopper = os.pipe()
        os.set_blocking(self._source, False)
        self._kept = bytearray()
        self._lock = Lock()
        self._thread = Thread(target=self._follow, name="standard error of a stack", daemon=True)
        self._thread.start()

    def tail(self) -> str:
        """Return the end of what was written until now."""
        if self._thread.is_alive():
            self._take()
        return printable(self._kept[-_TAIL:].decode(errors="replace").strip(), _TAIL)

    def close(self) -> None:
        """Read no more; `tail` stays what it was."""
        os.close(self._stopper)
        self._thread.join()
        for number in (self._source, self._stop):
            os.close(number)

    def _follow(self) -> None:
        waits = select.poll()
        for number in (self._source, self._stop):
            waits.register(number, select.POLLIN)
        while self._stop not in dict(waits.poll()) and self._take():
            pass

    def _take(self) -> bool:
        """Take in what is there, at most one piece, and tell whether more may come."""
        with self._lock:
            try:
                piece = os.read(self._source, _PIECE)
            except BlockingIOError:
                return True
            self._kept += piece
            del self._kept[:-_KEPT]
        return bool(piece)
