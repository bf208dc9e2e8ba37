"""The guard: a small process that kills the stacks when this one is gone, however it went.

A stack reads the end of its input when we die, but one that hangs, or that a script started, would stay. The guard holds
one end of a pipe; when the other end closes, by an exit, a signal or a crash, it kills every process group it was told of.
"""

from __future__ import annotations

import atexit
import subprocess
import sys

__all__ = ["unwatch", "watch"]

_PROGRAM = """
import os, signal, sys
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_IGN)
groups = set()
for line in sys.stdin:
    (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
for group in groups:
    try:
        os.killpg(group, signal.SIGKILL)
    except OSError:
        pass
"""

_guard: subprocess.Popen[str] | None = None


def watch(group: int) -> None:
    """Have a process group killed when this process ends."""
    _tell(f"+{group}")


def unwatch(group: int) -> None:
    """Forget a process group that has ended."""
    _tell(f"-{group}")


def _tell(line: str) -> None:
    global _guard
    if _guard is None or _guard.poll() is not None:
        # A session of its own: Ctrl-C in a terminal goes to every process of the foreground group.
        _guard = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            text=True,
        )
        atexit.register(_dismiss, _guard)
    if _guard.stdin is not None:
        _guard.stdin.write(line + "\n")
        _guard.stdin.flush()


def _dismiss(guard: subprocess.Popen[str]) -> None:
    """Let the guard do what is left to do, and wait for it."""
    if guard.stdin is not None:
        guard.stdin.close()
    guard.wait()
