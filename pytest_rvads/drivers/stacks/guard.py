"""The guard: a small process that ends the stacks after any end of this process.

When this process ends, a stack reads the end of its input. But a stack that hangs, or that a script started, would go on. The
guard holds an end of a pipe. The other end closes at an exit, a signal or a crash of this process. Then the guard ends all stacks
that this process reported to the guard.
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
"""Longest time that this process waits for the guard at its exit [s]; the guard continues after this process."""

_guard: subprocess.Popen[str] | None = None
_inherited: list[subprocess.Popen[str]] = []
"""Guards of the processes from which this process was forked."""
_watched: dict[int, str] = {}
"""Per stack, the line sent to the guard; a new guard gets all lines if the guard was killed."""


def _forked() -> None:
    """Forget, in a forked process, the stacks of the parent, which the end of the forked process must not end."""
    global _guard
    if _guard is not None:
        _inherited.append(_guard)  # garbage collection would warn about a process of the parent
        if _guard.stdin is not None:
            with suppress(OSError):
                _guard.stdin.close()  # else the guard would wait for this process, too
    _guard = None
    _watched.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def watch(leader: int, mark: str, grace: float) -> None:
    """Report a stack to the guard, which ends the stack when this process ends.

    Args:
        leader: number of the process of the stack.
        mark: value of the environment variable `descendants.MARK` in all processes of the stack.
        grace: longest time for exiting after SIGTERM [s].
    """
    _watched[leader] = f"{leader} {mark} {grace}\n"
    _send(_watched[leader])


def unwatch(leader: int) -> None:
    """Report to the guard that a stack has ended."""
    if _watched.pop(leader, None):
        _send(f"{leader}\n")


def _send(line: str) -> None:
    global _guard
    if _guard is None or _guard.poll() is not None:
        # The guard has a separate session because Ctrl-C in a terminal goes to all processes of the foreground group.
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
        with suppress(BrokenPipeError):  # the guard was just killed; the next guard gets the line
            _guard.stdin.write(line)
            _guard.stdin.flush()


def _dismiss(guard: subprocess.Popen[str]) -> None:
    """Close the input of the guard, and wait until the guard has ended the remaining stacks."""
    if guard.stdin is not None:
        with suppress(BrokenPipeError):
            guard.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        guard.wait(_PATIENCE)
