"""Autopilots that run as separate programs (stacks), and the exchange of messages with these programs.

Simulated time waits for a stack, so no verdict depends on how fast the stack computes. If a stack exceeds a limit of real time,
its run ends with the verdict ERROR. The provenance of the run holds the computing time. All processes that a stack started are
ended with the stack, even if this process is killed.
"""

from __future__ import annotations

import math
import os
import shlex
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from numbers import Real
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.interface import Autopilot, Command, Observation, TrafficSystem
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.drivers.stacks.descendants import Guard
from pytest_rvads.drivers.stacks.messages import reset
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import AutopilotError
from pytest_rvads.support.wording import one_line

_FORMATS: dict[str, Callable[[bool], messages.Format]] = {"json": messages.Json, "binary": frames.Binary}
_EARLY = "it wrote {} before it was asked: read a message, then answer it once"
_DAY = 86400.0
"""Longest compute time of a decision that is accepted in the report of a stack [s]."""
RATE = 20.0
"""Decisions per second if neither the caller nor the stack states a rate [Hz]."""


class Process(TrafficSystem):
    """A stack: an autopilot in another process. Simulated time stands still until the process has answered.

    The object is a factory of autopilots, for the fixture ``rvads_autopilot`` or for `simulate`. A process drives in one scenario
    after another. If the stack drives several vehicles of a run, each vehicle has a process of its own. If a process fails, its
    run ends with a fault, and later runs use a new process. When the object is deleted, all its processes and their descendants
    are ended. A RuntimeWarning names processes that can't be ended.

    Args:
        command: the program and its arguments, or one string with both.
        rate: decisions per simulated second [Hz], a divisor of 100; by default the rate in the stack's hello message, or 20.
        timeout: longest real time of a decision [s].
        startup: longest real time until the process answers the first message, and until it is ready for a scenario [s]; by
            default three times `timeout`, at least 15 s.
        grace: real time that the processes get to exit after the message ``bye``, and again after SIGTERM, before they are
            killed [s].
        cwd: working directory of the program.
        env: variables to add to the environment of the program.

    Raises:
        AutopilotError: the command is empty, the rate does not divide 100 Hz, a time limit is not positive, or the system is not
            POSIX.

    Example:
        >>> stack = Process(["./stack", "--quiet"], rate=20, timeout=2.0)
        >>> run = simulate(Case(Scenario(find("stop4"), "1133", subject=0), stack, traffic=Reference))
    """

    own_limits = True
    """Whether the limits of real time that a session sets for drivers don't apply; a stack has its own limits."""

    def __init__(
        self,
        command: str | Sequence[str],
        *,
        rate: float | None = None,
        timeout: float = 5.0,
        startup: float | None = None,
        grace: float = 1.0,
        cwd: str | Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        if os.name != "posix":
            raise AutopilotError(f"stacks in other processes need a POSIX system, this one is {os.name!r}")
        try:
            self.command = shlex.split(command) if isinstance(command, str) else [str(part) for part in command]
        except ValueError as error:
            raise AutopilotError(f"a stack needs a command as for a shell, got {command!r}: {error}") from error
        if not self.command:
            raise AutopilotError("a stack needs a command, such as ['./stack'], got none")
        start = timeout if startup is None else startup
        for name, limit in (("timeout", timeout), ("startup", start), ("grace", grace or 1.0)):  # grace may be 0
            if not (isinstance(limit, Real) and math.isfinite(limit) and limit > 0):
                raise AutopilotError(f"{name} must be a number of seconds above 0, got {limit!r}")
        self.label: str = one_line(f"stack {shlex.join(self.command)}")
        self._period = None if rate is None else _period(rate, self.label)
        self._limits = max(3 * timeout, 15.0) if startup is None else startup, timeout
        self._place = cwd, env, grace, Guard()
        self.connections: list[Connection] = []
        """Running processes; the first process drives the first vehicle of a run, and so on."""
        weakref.finalize(self, _close, self.connections)

    def __call__(self) -> Process:
        """Return this object as the traffic system of a run."""
        return self

    def settings(self) -> list[Any]:
        """Return the settings that decide how the stack drives, as builtins.

        The settings are the command, the time between decisions, the working directory, the added variables, and the digests of
        files that the command names.
        """
        cwd, env, *_ = self._place
        files = [Path(cwd or "", word) for word in self.command]
        digests = [sha256(file.read_bytes()).hexdigest() for file in files if file.is_file()]
        return [self.command, self._period, None if cwd is None else str(cwd), dict(env or {}), digests]

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Pilot]:
        """Return one autopilot per agent, each with a running process.

        Raises:
            StackError: a process does not start.
        """
        while len(self.connections) < len(agents):
            try:
                connection = Connection(lambda: Child(self.command, *self._place), *self._limits)
            except StackError as error:
                raise type(error)(f"{self.label}: {error}", error.detail) from None
            self.connections.append(connection)
        return [Pilot(self, k) for k in range(len(agents))]

    def drop(self, connection: Connection) -> None:
        """End a process and forget its connection, so that a later run starts another process."""
        connection.close()
        if connection in self.connections:
            self.connections.remove(connection)

    def period(self, connection: Connection) -> float:
        """Return the time between two decisions of a connected stack [s]."""
        if self._period is not None:
            return self._period
        return _period(RATE if connection.rate is None else connection.rate, self.label)

    def close(self) -> None:
        """End all processes of the stack; a later run starts new processes."""
        _close(self.connections)

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Pilot(Autopilot):
    """The autopilot of a vehicle in a run, whose commands come from one of the connections of a `Process`."""

    own_limits = True

    def __init__(self, process: Process, number: int) -> None:
        self._process = process
        self._connection = process.connections[number]
        self.label = process.label
        self.period = process.period(self._connection)
        self._begun = False
        self._times = [0, 0.0, 0.0]
        """Number of decisions, total compute time [s], longest compute time [s]."""

    def control(self, seen: Observation) -> Command:
        """Return the command with which the process answers an observation."""
        try:
            if not self._begun:
                self._connection.reset(reset(seen, self.period, self._connection.pedestrians))
                self._connection.serves = self
                self._begun = True
            if self._connection.serves is not self:
                raise StackError("it serves two vehicles at once: give the traffic a Process of its own")
            command, compute = self._connection.ask(seen)
        except BaseException:  # after an interrupt, a late answer could be taken for the answer to another observation
            self._process.drop(self._connection)
            raise
        count, total, longest = self._times
        self._times = [count + 1, total + compute, max(longest, compute)]
        return command

    def abandon(self) -> str:
        """End the process, and return the end of its standard error; called if a fault of this vehicle ended the run."""
        detail = self._connection.failed(StackError("")).detail
        self._process.drop(self._connection)
        return detail

    def timing(self) -> dict[str, Any]:
        """Return the stack's name, its number of decisions in this run, and their total and longest compute time [s]."""
        count, total, longest = self._times
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


class Connection:
    """A running stack that has answered the hello message.

    The limits of real time are `startup`, until the stack answers ``hello`` or is ready for a scenario, and `timeout` for a
    command [s].
    """

    def __init__(self, start: Callable[[], Child], startup: float, timeout: float) -> None:
        self._startup, self._timeout, self._step = startup, timeout, 0
        self.serves: object = None
        """The `Pilot` whose vehicle the stack drives at present."""
        self.child = start()
        try:
            self.child.send(messages.hello(), startup)
            answer = messages.read(self.child.line(startup), messages.Hello)
            if answer.version != messages.VERSION:
                raise StackError(
                    f"it speaks version {answer.version} of the protocol, expected {messages.VERSION}: "
                    "build it with the client of this version"
                )
            if answer.format not in _FORMATS:
                raise StackError(f"it wants the format {answer.format[:20]!r}, expected {' or '.join(_FORMATS)}")
            self._format = _FORMATS[answer.format](answer.pedestrians)
            self.rate, self.pedestrians = answer.rate, answer.pedestrians
        except StackError as error:
            raise self.failed(error) from None
        except BaseException:  # an interrupt
            self.child.close()
            raise

    def reset(self, content: dict[str, Any]) -> None:
        """Begin a scenario: send the message ``reset``, and wait until the stack is ready."""
        self._step = 0
        try:
            early = self.child.pending()
            self.child.send(self._format.begin(content), self._startup)
            self._format.ready(self.child, self._startup)
            if early:  # checked after the answer, because an error in the answer explains more
                raise StackError(_EARLY.format(messages.quoted(early)))
        except StackError as error:
            raise self.failed(error) from None

    def ask(self, seen: Observation) -> tuple[Command, float]:
        """Return the command for an observation, and the compute time, reported or until the answer arrived [s]."""
        began = time.perf_counter()
        self._step += 1
        try:
            early = self.child.pending()
            self.child.send(self._format.observe(seen, self._step), self._timeout)
            command, compute, step = self._format.answer(self.child, self._timeout)
            if step != self._step:
                # After a second answer to an observation, every later answer would be taken for the answer to another
                # observation.
                raise StackError(f"it answered step {step}, expected step {self._step}: answer every observation once")
            if early:
                raise StackError(_EARLY.format(messages.quoted(early)))
            if compute is not None and not 0.0 <= compute <= _DAY:
                raise StackError(f"it says that it computed for {compute:g} s, expected 0 to {_DAY:g}")
        except StackError as error:
            raise self.failed(error) from None
        return command, time.perf_counter() - began if compute is None else compute

    def failed(self, error: StackError) -> StackError:
        """End the process, and return `error` with the end of the process's standard error as its detail."""
        error.detail = self.child.tail()
        self.close()
        return error

    def close(self, *, farewell: bool = False) -> None:
        """End the process; with `farewell`, the message ``bye`` is sent first, so that the stack can exit by itself."""
        self.child.close(self._format.bye if farewell else b"")
