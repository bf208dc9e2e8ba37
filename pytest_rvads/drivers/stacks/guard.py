"""The guard: a small process that ends the stacks when this one is gone, however it went.

A stack reads the end of its input when we die, but one that hangs, or that a script started, would stay. The guard holds
one end of a pipe; when the other end closes, by an exit, a signal or a crash, it ends every stack it was told of.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from contextlib import suppress

from pytest_rvads.drivers.stacks import descendants

__all__ = ["unwatch", "watch"]

_PATIENCE = 60.0
"""How long we wait for the guard when we exit [s]; it goes on without us."""

_guard: subprocess.Popen[str] | None = None
_inherited: list[subprocess.Popen[str]] = []
"""Guards of the processes that this one was forked from."""
_watched: dict[int, str] = {}
"""What the guard knows of each stack, for another one to be told should it be killed."""


def _forked() -> None:
    """Forget in a forked process what its parent watches: it would be ended when this process ends."""
    global _guard
    if _guard is not None:
        _inherited.append(_guard)  # not collected: that would warn of a process that is not ours
        if _guard.stdin is not None:
            with suppress(OSError):
                _guard.stdin.close()  # or the guard would wait for us, too
    _guard = None
    _watched.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def watch(leader: int, mark: str, grace: float) -> None:
    """Have a stack ended when this process ends; see `descendants`."""
    _watched[leader] = f"{leader} {mark} {grace}\n"
    _tell(_watched[leader])


def unwatch(leader: int) -> None:
    """Forget a stack that has ended."""
    if _watched.pop(leader, None):
        _tell(f"{leader}\n")


def _tell(line: str) -> None:
    global _guard
    if _guard is None or _guard.poll() is not None:
        # A session of its own: Ctrl-C in a terminal goes to every process of the foreground group.
        _guard = subprocess.Popen(
            [sys.executable, "-I", "-S", descendants.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            text=True,
        )
        atexit.register(_dismiss, _guard)
        line = "".join(_watched.values())
    if _guard.stdin is not None:
        with suppress(BrokenPipeError):  # it was killed this moment: the next one is told
            _guard.stdin.write(line)
            _guard.stdin.flush()


def _dismiss(guard: subprocess.Popen[str]) -> None:
    """Let the guard do what is left to do, and wait for it."""
    if guard.stdin is not None:
        with suppress(BrokenPipeError):
            guard.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        guard.wait(_PATIENCE)
