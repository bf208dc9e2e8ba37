"""The processes of a stack, wherever they went, and their end; run as a program, the guard that ends them when we are gone.

A stack may start others, in sessions of their own, and leave them behind. On Linux they are found in ``/proc``: by parent,
process group and session, and by a mark in their environment, which every process hands on to those that it starts. Elsewhere
only the process group is known. Nothing but the standard library is imported, because the guard runs this file alone.
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
"""Variable in the environment of a stack, with a value of its own for each."""
_PATIENCE = 5.0
"""How long killed processes may take to disappear [s]."""
_PROC = Path("/proc")


class _Status(NamedTuple):
    """What the kernel says of a process."""

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
        """Process groups that were found: who forks and exits for ever is hit only by a signal to all of its group."""
        self._known: set[tuple[int, int]] = set()
        """Numbers and starts of all that were found: a process whose parent has gone may be related to nobody."""

    def living(self) -> set[int]:
        """Return the numbers of the running processes, as `os.kill` takes them: a negative number means a process group."""
        if not (_PROC / "self" / "stat").exists():
            return {-self._leader} if _exists(-self._leader) else set()
        table = {int(entry): status for entry in os.listdir(_PROC) if entry.isdecimal() and (status := _status(entry))}
        found = {pid for pid, status in table.items() if self._concerns(pid, status)}
        while more := {pid for pid, status in table.items() if pid not in found and not found.isdisjoint(status.kin)}:
            found |= more
        self._known |= {(pid, table[pid].start) for pid in found}
        self.groups |= {table[pid].kin[1] for pid in found} - {0, 1, os.getpgrp()}  # for `os.kill`, 0 and 1 mean all others
        return {pid for pid in found if table[pid].runs}

    def _concerns(self, pid: int, status: _Status) -> bool:
        return (pid, status.start) in self._known or self._leader in (pid, *status.kin) or self._marked(pid)

    def _marked(self, pid: int) -> bool:
        try:
            return self._mark in (_PROC / str(pid) / "environ").read_bytes()
        except OSError:  # it has gone, or is somebody else's
            return False


def dismiss(stacks: Sequence[Descendants], grace: float) -> None:
    """Send SIGTERM to all processes of stacks, and wait until they have gone, at most `grace` seconds."""
    deadline = time.monotonic() + grace
    left = _living(stacks)
    _signal(left, signal.SIGTERM)
    while left and time.monotonic() < deadline:
        time.sleep(0.01)
        left = _living(stacks)


def kill(stacks: Sequence[Descendants]) -> set[int]:
    """Send SIGKILL to all processes of stacks, and to those that these start meanwhile.

    Returns:
        Numbers of the processes that still run after some seconds: processes of another user, or blocked in the kernel.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        left = _living(stacks)
        _signal(left | {-group for stack in stacks for group in stack.groups}, signal.SIGKILL)
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.002)


def _living(stacks: Sequence[Descendants]) -> set[int]:
    return set().union(*(stack.living() for stack in stacks))


def _signal(pids: set[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(OSError):  # it has gone, or is somebody else's
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
    return _Status((parent, group, session), start, state not in b"ZX" or threads > 1)  # others go on where the first has ended


def _guard() -> None:
    """Read which stacks begin and end, a line for each, until the input ends; then end those that are left."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    stacks: dict[str, tuple[str, float]] = {}
    for line in sys.stdin:
        leader, *more = line.split()
        if more:
            stacks[leader] = more[0], float(more[1])
        else:
            stacks.pop(leader, None)
    left = [Descendants(int(leader), mark) for leader, (mark, _) in stacks.items()]
    dismiss(left, max([0.0, *(grace for _, grace in stacks.values())]))
    kill(left)


if __name__ == "__main__":
    _guard()
