"""Autopilots that run as programs of their own.

Simulated time waits for a stack, so the speed of a stack decides nothing. Time limits are limits of real time and end in an
ERROR. The computing time is in the provenance of the run. All processes that a stack started end with it, also if this process is
killed.
"""

from __future__ import annotations

import math
import os
import shlex
import weakref
from collections.abc import Mapping, Sequence
from hashlib import sha256
from numbers import Real
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.interface import Autopilot, Command, Observation, TrafficSystem
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.drivers.stacks.connection import Connection
from pytest_rvads.drivers.stacks.place import reset
from pytest_rvads.errors import AutopilotError
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Agent
from pytest_rvads.wording import one_line

__all__ = ["Pilot", "Process"]

RATE = 20.0
"""Decisions per second where neither the caller nor the stack says another rate [Hz]."""


class Process(TrafficSystem):
    """A stack in another process, asked in lock-step: simulated time waits for it.

    The object is a factory of autopilots, for the fixture ``rvads_autopilot`` or for `simulate`. A process serves
    many scenarios in succession; if the stack drives several vehicles of a run, each vehicle has a process. A process that fails
    ends the run with a fault and is replaced for the next run. All processes and their descendants are ended with the object; a
    RuntimeWarning names processes that can't be ended.

    Args:
        command: the program and its arguments, or one string with both.
        rate: decisions per simulated second [Hz], a divisor of 100; by default the rate in the stack's hello message, or 20.
        timeout: longest real time of a decision [s].
        startup: longest real time for starting the process, and for getting ready for a scenario [s].
        grace: longest real time for exiting after `bye`, and after SIGTERM, before the processes are killed [s].
        cwd: working directory of the program.
        env: variables to add to its environment.

    Raises:
        AutopilotError: no command, a rate that does not divide 100 Hz, a time limit that is not positive, or not a POSIX system.

    Example:
        >>> stack = Process(["./stack", "--quiet"], rate=20, timeout=2.0)
        >>> run = simulate(Case(Scenario(find("stop4"), "1133", subject=0), stack, traffic=Reference))
    """

    own_limits = True
    """Whether the session's limits of real time for drivers don't apply; a stack has separate limits."""

    def __init__(  # noqa: PLR0913 - a program has a place and several limits, most of them left alone
        self,
        command: str | Sequence[str],
        *,
        rate: float | None = None,
        timeout: float = 5.0,
        startup: float = 15.0,
        grace: float = 1.0,
        cwd: str | Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        if os.name != "posix":
            raise AutopilotError(f"stacks in other processes need a POSIX system, this one is {os.name!r}")
        self.command = shlex.split(command) if isinstance(command, str) else [str(part) for part in command]
        if not self.command:
            raise AutopilotError("a stack needs a command, such as ['./stack'], got none")
        for name, limit in (("timeout", timeout), ("startup", startup), ("grace", grace or 1.0)):  # there may be no grace
            if not (isinstance(limit, Real) and math.isfinite(limit) and limit > 0):
                raise AutopilotError(f"{name} must be a number of seconds above 0, got {limit!r}")
        self.label: str = one_line(f"stack {shlex.join(self.command)}")
        """How reports call it."""
        self._period = None if rate is None else _period(rate, self.label)
        self._limits = startup, timeout
        self._place = cwd, env, grace
        self.connections: list[Connection] = []
        """Running processes, by the order of the vehicles of a run."""
        weakref.finalize(self, _close, self.connections)

    def __call__(self) -> Process:
        """Return the traffic system of the next run."""
        return self

    def settings(self) -> list[Any]:
        """Return what decides how it drives, as builtins: command, rate, place, variables, and digests of files that it names."""
        cwd, env, _ = self._place
        files = [Path(cwd or "", word) for word in self.command]
        digests = [sha256(file.read_bytes()).hexdigest() for file in files if file.is_file()]
        return [self.command, self._period, None if cwd is None else str(cwd), dict(env or {}), digests]

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Pilot]:
        """Return one autopilot per agent, each with a running process.

        Raises:
            StackError: a process does not start.
        """
        while len(self.connections) < len(agents):
            self.connections.append(self._connect())
        return [Pilot(self, k) for k in range(len(agents))]

    def drop(self, connection: Connection) -> None:
        """End a process and forget it; the next run starts another one."""
        connection.close()
        if connection in self.connections:
            self.connections.remove(connection)

    def period(self, connection: Connection) -> float:
        """Return the time between two decisions [s]."""
        if self._period is not None:
            return self._period
        return _period(RATE if connection.rate is None else connection.rate, self.label)

    def close(self) -> None:
        """End all processes; a later run starts new ones."""
        _close(self.connections)

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connect(self) -> Connection:
        try:
            return Connection(lambda: Child(self.command, *self._place), *self._limits)
        except StackError as error:
            raise type(error)(f"{self.label}: {error}", error.detail) from None


class Pilot(Autopilot):
    """Drives one vehicle in one run by asking a process.

    Args:
        process: whose.
        number: which of its connections.
    """

    own_limits = True

    def __init__(self, process: Process, number: int) -> None:
        self._process = process
        self._connection = process.connections[number]
        self.label = process.label
        self.period = process.period(self._connection)
        self._begun = False
        self._taken = [0, 0.0, 0.0]
        """Decisions, their compute time in all, the longest [s]."""

    def control(self, seen: Observation) -> Command:
        """Return what the process commands.

        Raises:
            StackError: it failed.
        """
        try:
            if not self._begun:
                self._connection.reset(reset(seen, self.period))
                self._connection.serves = self
                self._begun = True
            if self._connection.serves is not self:
                raise StackError("it serves two vehicles at once: give the traffic a Process of its own")
            command, compute = self._connection.ask(seen)
        except BaseException:  # also where somebody does not want to wait any longer: an answer may still come
            self._process.drop(self._connection)
            raise
        count, total, longest = self._taken
        self._taken = [count + 1, total + compute, max(longest, compute)]
        return command

    def abandon(self) -> str:
        """End the process because the run ended by a fault of this vehicle, and return what it last wrote to standard error."""
        detail = self._connection.failed(StackError("")).detail
        self._process.drop(self._connection)
        return detail

    def timing(self) -> dict[str, Any]:
        """Return how long the stack computed in this run: real time, which no verdict depends on."""
        count, total, longest = self._taken
        return {"stack": self.label, "decisions": count, "compute": total, "longest": longest}


def _close(connections: list[Connection]) -> None:
    while connections:
        connections.pop().close(farewell=True)


def _period(rate: Any, label: str) -> float:
    number = float(rate) if isinstance(rate, Real) and not isinstance(rate, bool) else 0.0
    if 1e-6 <= number <= 1.0 / DT:
        steps = round(1.0 / (number * DT))
        if math.isclose(steps * number * DT, 1.0, rel_tol=1e-9):
            return steps * DT
    raise StackError(f"{label}: its rate must divide {1 / DT:g} Hz, such as 10, 20, 25 or 50, got {rate!r}")
