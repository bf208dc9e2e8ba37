"""Finds and ends all processes of a stack (an autopilot in another process).

A stack may start processes in other process sessions and leave these processes running. They are identified by parent, process
group and session, and by a mark in the environment, which a process passes on to its children.

The guard is a small process that ends all stacks when this process ends in any way. When this process ends, a stack reads the
end of its input. Without the guard, a stack that hangs, or that a script started, would go on. The guard reads from a pipe that
closes at an exit, a signal or a crash of this process. When the pipe closes, the guard ends all stacks that this process has
reported to the guard. Run as a program, this file is the guard; it imports psutil alone, because the guard runs the file alone.
"""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

import psutil

MARK = "RVADS_STACK"
"""Name of the variable that marks the processes of a stack by their environment; each stack has its own value."""
_PATIENCE = 5.0
"""Longest time until killed processes disappear [s]."""
_GUARD_PATIENCE = 60.0
"""Longest time that this process waits for the guard at its exit [s]; the guard continues after this process."""
_guard: subprocess.Popen[str] | None = None
"""The guard of this process; None before the first stack."""
_inherited: list[subprocess.Popen[str]] = []
"""Guards of the processes from which this process was forked."""
_watched: dict[int, str] = {}
"""Per stack, the line sent to the guard; a new guard gets all lines if the guard was killed."""


class Descendants:
    """All processes of a stack: the leader of its session, its descendants, and the processes that have its `MARK`."""

    def __init__(self, leader: int, mark: str) -> None:
        self._leader, self._mark = leader, mark
        self.groups = {leader}
        """Process groups of the stack; processes that keep forking and exiting can only be ended by a signal to their group."""
        self._seen: set[psutil.Process] = set()
        """All processes of the stack so far; a process is recognised after the end of its parent by its id and its start."""

    def living(self) -> set[int]:
        """Return the ids of the running processes of the stack; a zombie counts as ended, but its children are recognised."""
        table = {}
        for process in psutil.process_iter(["ppid", "status", "num_threads", "environ"]):
            try:
                kin = process.info["ppid"], os.getpgid(process.pid), os.getsid(process.pid)
            except OSError:  # it has ended
                kin = process.info["ppid"], -1, -1
            table[process] = kin  # the ids of its parent, of its process group and of its session
        ours = {
            process
            for process, kin in table.items()
            if (process.info["environ"] or {}).get(MARK) == self._mark
            or process in self._seen
            or self._leader in (process.pid, *kin)
        }
        pids = {process.pid for process in ours}
        while relatives := {process for process, kin in table.items() if process not in ours and not pids.isdisjoint(kin)}:
            ours |= relatives
            pids |= {process.pid for process in relatives}
        self._seen |= ours
        self.groups |= {table[process][1] for process in ours} - {0, 1, os.getpgrp()}  # `os.kill` takes 0 and 1 for other groups
        # Threads can outlive the main thread, whose end makes the process look like a zombie.
        return {p.pid for p in ours if p.info["status"] != psutil.STATUS_ZOMBIE or (p.info["num_threads"] or 0) > 1}


def dismiss(stacks: Sequence[Descendants], grace: float) -> None:
    """Send SIGTERM to all processes of stacks, and wait until they have ended, at most `grace` seconds."""
    deadline = time.monotonic() + grace
    living = _living(stacks)
    _signal(living, signal.SIGTERM)
    while living and time.monotonic() < deadline:
        time.sleep(0.01)
        living = _living(stacks)


def kill(stacks: Sequence[Descendants]) -> set[int]:
    """Send SIGKILL to all processes of stacks, and to the processes that they start meanwhile."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        living = _living(stacks)
        _signal(living | {-group for stack in stacks for group in stack.groups}, signal.SIGKILL)
        if not living or time.monotonic() > deadline:
            return living
        time.sleep(0.002)


def watch(leader: int, mark: str, grace: float) -> None:
    """Report a stack to the guard, which ends the stack, with a time for exiting after SIGTERM [s], when this process ends."""
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
            [sys.executable, "-I", __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            text=True,
        )
        atexit.register(_close_guard, _guard)
        line = "".join(_watched.values())
    if _guard.stdin is not None:
        with suppress(BrokenPipeError):  # the guard was just killed; the next guard gets the line
            _guard.stdin.write(line)
            _guard.stdin.flush()


def _close_guard(guard: subprocess.Popen[str]) -> None:
    """Close the input of the guard, and wait until the guard has ended the remaining stacks."""
    if guard.stdin is not None:
        with suppress(BrokenPipeError):
            guard.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        guard.wait(_GUARD_PATIENCE)


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


def _living(stacks: Sequence[Descendants]) -> set[int]:
    return set().union(*(stack.living() for stack in stacks))


def _signal(pids: set[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(OSError):  # the process has ended, or belongs to another user
            os.kill(pid, number)


if __name__ == "__main__":  # the guard reads about starts and ends of stacks until its input ends, and ends those that still run
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    stacks: dict[str, tuple[str, float]] = {}
    for line in sys.stdin:
        leader, *details = line.split()
        if details:
            stacks[leader] = details[0], float(details[1])
        else:
            stacks.pop(leader, None)
    running = [Descendants(int(leader), mark) for leader, (mark, _) in stacks.items()]
    dismiss(running, max([0.0, *(grace for _, grace in stacks.values())]))
    kill(running)
