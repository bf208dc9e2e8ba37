"""Finds and ends all processes of a stack (an autopilot in another process).

A stack may start processes in other process sessions and leave these processes running. They are identified by parent, process
group and session, and by a mark in the environment, which a process passes on to its children.

A guard is a small process that ends stacks when the process that started them ends in any way. When that process ends, a stack
reads the end of its input. Without the guard, a stack that hangs, or that a script started, would go on. The guard reads from a
pipe that closes at an exit, a signal or a crash of its parent process. A process that its parent forked can hold the pipe open,
so the guard also sees whether its parent is still there. Then it ends all stacks that were reported to it. Run as a program, this
file is the guard; it imports psutil alone, because the guard runs the file alone.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import psutil

MARK = "RVADS_STACK"
"""Name of the variable that marks the processes of a stack by their environment; each stack has its own value."""
_PATIENCE = 5.0
"""Longest time until killed processes disappear [s]."""
_GUARD_PATIENCE = 60.0
"""Longest time that this process waits for the guard at its exit [s]; the guard continues after this process."""
_LOOK = 1.0
"""Time between two looks of a guard at its parent process [s]."""


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


class Guard:
    """Ends stacks that still run when this process ends; the guard's process starts with the first stack."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._parent = 0
        """The process that started the guard's process; a process forked from it has a guard's process of its own."""
        self._watched: dict[int, str] = {}
        """Per stack, the line sent to the guard's process; a new process gets all lines if the process was killed."""

    def __reduce__(self) -> tuple[Any, ...]:  # a copy, such as in another process, starts a guard's process of its own
        return Guard, ()

    def watch(self, leader: int, mark: str, grace: float) -> None:
        """Report a stack, which gets a time for exiting after SIGTERM [s] when this process ends."""
        if self._parent != os.getpid():
            self._watched.clear()
        self._watched[leader] = f"{leader} {mark} {grace}\n"
        if self._process is None or self._parent != os.getpid() or self._process.poll() is not None:
            self._parent = os.getpid()
            # The process has a separate session because Ctrl-C in a terminal goes to all processes of the foreground group.
            self._process = subprocess.Popen(
                [sys.executable, "-I", __file__, str(self._parent)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                text=True,
            )
            weakref.finalize(self, _close, self._process)
            self._send("".join(self._watched.values()))
        else:
            self._send(self._watched[leader])

    def unwatch(self, leader: int) -> None:
        """Report that a stack has ended."""
        if self._parent == os.getpid() and leader in self._watched:
            del self._watched[leader]
            self._send(f"{leader}\n")

    def _send(self, line: str) -> None:
        stdin = self._process and self._process.stdin
        if stdin and not stdin.closed:  # it is closed when this process ends
            with suppress(BrokenPipeError):  # the guard's process was killed; the next process gets the line
                stdin.write(line)
                stdin.flush()


def _close(guard: subprocess.Popen[str]) -> None:
    """Close the input of a guard's process, and wait until the process has ended the remaining stacks."""
    if guard.stdin is not None:
        with suppress(BrokenPipeError):
            guard.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        guard.wait(_GUARD_PATIENCE)


def _living(stacks: Sequence[Descendants]) -> set[int]:
    return set().union(*(stack.living() for stack in stacks))


def _signal(pids: set[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(OSError):  # the process has ended, or belongs to another user
            os.kill(pid, number)


def _lines(parent: int) -> Iterator[str]:
    """Yield the lines of the standard input until the input or the parent process ends."""
    text = b""
    while True:
        if select.select([0], [], [], _LOOK)[0]:
            piece = os.read(0, 65536)
            if not piece:
                return
            *lines, text = (text + piece).split(b"\n")
            yield from map(bytes.decode, lines)
        elif os.getppid() != parent:
            return


if __name__ == "__main__":  # a guard reads about starts and ends of stacks until its input ends, and ends those that still run
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    stacks: dict[str, tuple[str, float]] = {}
    for line in _lines(int(sys.argv[1])):
        leader, *details = line.split()
        if details:
            stacks[leader] = details[0], float(details[1])
        else:
            stacks.pop(leader, None)
    running = [Descendants(int(leader), mark) for leader, (mark, _) in stacks.items()]
    dismiss(running, max([0.0, *(grace for _, grace in stacks.values())]))
    kill(running)
