"""All processes of a stack, and their end. Run as a program, this file is the guard that ends stacks after the parent's end.

A stack may start processes in other sessions and leave these processes running. On Linux they are identified in ``/proc``: by
parent, process group and session, and by a mark in the environment, which a process passes on to its children. On other systems
only the process group is identified. The file imports only the standard library, because the guard runs the file alone.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

__all__ = ["MARK", "Descendants", "dismiss", "kill"]

MARK = "RVADS_STACK"
"""Variable in the environment of a stack; every stack has another value."""
_PATIENCE = 5.0
"""Longest time until killed processes disappear [s]."""
_PROC = Path("/proc")


class _Status(NamedTuple):
    """Status of a process in ``/proc``."""

    kin: tuple[int, int, int]
    """Parent, process group, session."""
    start: int
    """Time of the start, which tells a process from a later process with the same number."""
    runs: bool
    """Whether the process has not ended. A zombie process counts as ended, but still links its children to the stack."""


class Descendants:
    """All processes of a stack.

    Args:
        leader: number of the process that was started for the stack, the leader of a session.
        mark: value of the environment variable `MARK` in all processes of the stack.
    """

    def __init__(self, leader: int, mark: str) -> None:
        self._leader, self._mark = leader, f"{MARK}={mark}".encode()
        self.groups = {leader}
        """Process groups of the stack: a chain of processes that fork and exit ends only by a signal to the group."""
        self._seen: set[tuple[int, int]] = set()
        """Numbers and starts of all processes of the stack so far: after the end of its parent a process may have no relation."""

    def living(self) -> set[int]:
        """Return the numbers of the running processes, as `os.kill` takes them: a negative number means a process group."""
        if not (_PROC / "self" / "stat").exists():
            return {-self._leader} if _exists(-self._leader) else set()
        table = {int(entry): status for entry in os.listdir(_PROC) if entry.isdecimal() and (status := _status(entry))}
        pids = {pid for pid, status in table.items() if self._concerns(pid, status)}
        while relatives := {pid for pid, status in table.items() if pid not in pids and not pids.isdisjoint(status.kin)}:
            pids |= relatives
        self._seen |= {(pid, table[pid].start) for pid in pids}
        self.groups |= {table[pid].kin[1] for pid in pids} - {0, 1, os.getpgrp()}  # for `os.kill`, 0 and 1 mean all processes
        return {pid for pid in pids if table[pid].runs}

    def _concerns(self, pid: int, status: _Status) -> bool:
        return (pid, status.start) in self._seen or self._leader in (pid, *status.kin) or self._has_mark(pid)

    def _has_mark(self, pid: int) -> bool:
        try:
            return self._mark in (_PROC / str(pid) / "environ").read_bytes()
        except OSError:  # the process has gone, or belongs to another user
            return False


def dismiss(stacks: Sequence[Descendants], grace: float) -> None:
    """Send SIGTERM to all processes of stacks, and wait at most `grace` seconds for the end of the processes."""
    deadline = time.monotonic() + grace
    living = _living(stacks)
    _signal(living, signal.SIGTERM)
    while living and time.monotonic() < deadline:
        time.sleep(0.01)
        living = _living(stacks)


def kill(stacks: Sequence[Descendants]) -> set[int]:
    """Send SIGKILL to all processes of stacks, and to the processes that these start meanwhile.

    Returns:
        Numbers of the processes that still run after some seconds: processes of another user, or blocked in the kernel.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        living = _living(stacks)
        _signal(living | {-group for stack in stacks for group in stack.groups}, signal.SIGKILL)
        if not living or time.monotonic() > deadline:
            return living
        time.sleep(0.002)


def _living(stacks: Sequence[Descendants]) -> set[int]:
    return set().union(*(stack.living() for stack in stacks))


def _signal(pids: set[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(OSError):  # the process has gone, or belongs to another user
            os.kill(pid, number)


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except OSError:
        return False
    return True


def _status(pid: str) -> _Status | None:
    """Return the status of a process, or None if the process does not exist."""
    try:
        state, *numbers = (_PROC / pid / "stat").read_bytes().rpartition(b")")[2].split()
    except OSError:
        return None
    parent, group, session, threads, start = (int(numbers[k]) for k in (0, 1, 2, 16, 18))
    return _Status((parent, group, session), start, state not in b"ZX" or threads > 1)  # threads may outlive the first


def _guard() -> None:
    """Read lines about starts and ends of stacks until the input ends; then end the stacks that still run."""
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


if __name__ == "__main__":
    _guard()
