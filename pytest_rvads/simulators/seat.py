"""Seats: what stands between the simulation and the autopilots.

A seat asks its autopilot at the autopilot's own rate, holds the answer in between, lets nothing through that is not a
command, and has the tracking controller drive what is not a control.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.commands import Command, trouble
from pytest_rvads.drivers.interface import Control, Factory, Observation
from pytest_rvads.drivers.tracker import Tracker
from pytest_rvads.errors import AutopilotError
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import Agent
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.simulators.latency import Latency
from pytest_rvads.simulators.perception import Perception

__all__ = ["Seat", "crew", "name_of"]

_TOLERANCE = 1e-6
"""How far throttle and brake may leave 0..1 by rounding; they are clamped."""


class Seat:
    """One vehicle's place for an autopilot.

    An autopilot may have an attribute `period` [s], a whole multiple of the step: it is then asked that often, and
    its last answer is held in between (zero-order hold). Without one it is asked in every step. One that runs elsewhere
    may have a ``label`` to be called by, a method ``abandon``, called when its answer ended the run, which returns what else
    there is to know, and a method ``timing``, see `simulate`.

    Raises:
        Halt: no method ``control``, or a period that is not a multiple of the step.
    """

    def __init__(self, agent: Agent, autopilot: Any, senses: Senses = IDEAL, key: str = "") -> None:
        self.agent = agent
        self.name = getattr(autopilot, "label", type(autopilot).__qualname__)
        self.autopilot = autopilot
        if not callable(getattr(autopilot, "control", None)):
            raise Halt(
                agent.name,
                f"{self.name} can't drive {agent.name}: an autopilot needs a method control(seen: Observation) -> Control",
            )
        self._ask = autopilot.control
        self._every = self._steps(getattr(autopilot, "period", DT))
        self._held: Command = Control()
        self._tracker: Tracker | None = None
        key = f"{key} {agent.name}"
        self._perception = Perception(senses, key) if senses.blurred else None
        self._latency = Latency(senses, key) if senses.latency or senses.jitter else None

    def command(self, step: int, seen: Observation) -> Control:
        """Return the control for the step that starts in state number `step`.

        Raises:
            Halt: the autopilot raised, or its answer is not a command.
        """
        if self._perception is not None:
            self._perception.watch(seen)
        if step % self._every == 0:
            self._held = self._answer(seen if self._perception is None else self._perception.view(seen))
            if self._latency is not None:
                self._latency.send(step, self._held)
        command = self._held if self._latency is None else self._latency.held(step)
        if isinstance(command, Control):
            return command
        if self._tracker is None:
            self._tracker = Tracker()
        # The tracking controller sits in the vehicle: it knows where it is.
        return self._tracker.control(command, seen)

    def timing(self) -> dict[str, Any] | None:
        """Return how long a stack that runs elsewhere computed, see `simulate`; None for others, whatever they answer."""
        try:
            told = self.autopilot.timing()
            numbers = {key: float(told[key]) for key in ("compute", "longest")}
            return {"stack": str(told["stack"]), "decisions": int(told["decisions"]), **numbers}
        except KeyboardInterrupt:
            raise
        except BaseException:  # what it computed is no part of the run, so nothing that it does here ends one
            return None

    def _answer(self, seen: Observation) -> Command:
        try:
            answer = self._ask(seen)
        except AutopilotError as error:
            where = f"{self.name} driving {self.agent.name} at {seen.time:.2f} s"
            raise Halt(self.agent.name, f"{where}: {error}", getattr(error, "detail", "")) from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever it raises, a skip of pytest's included, ends its run and no more
            raise Halt(
                self.agent.name, f"{self.name} driving {self.agent.name} {_describe(error)} at {seen.time:.2f} s"
            ) from error
        if type(answer) is Control:
            throttle, brake, steering = answer
            # Plain floats in range are the usual case; everything else is looked at closely.
            if type(throttle) is type(brake) is type(steering) is float and (
                0.0 <= throttle <= 1.0 and 0.0 <= brake <= 1.0 and -1.5 < steering < 1.5
            ):
                return answer
        try:
            return self._checked(answer, seen.time)
        except Halt as halt:
            if callable(getattr(self.autopilot, "abandon", None)):
                halt.detail = self.autopilot.abandon()
            raise

    def _steps(self, period: Any) -> int:
        if isinstance(period, Real) and not isinstance(period, bool) and math.isfinite(period):
            steps = round(float(period) / DT)
            if steps >= 1 and math.isclose(steps * DT, float(period), rel_tol=1e-9):
                return steps
        raise Halt(
            self.agent.name,
            f"{self.name} can't drive {self.agent.name}: its period must be a whole multiple of {DT:g} s, got {period!r}",
        )

    def _checked(self, answer: Any, time: float) -> Command:
        where = f"{self.name} driving {self.agent.name} at {time:.2f} s"
        if not isinstance(answer, Control):
            wrong = trouble(answer)
            if wrong:
                raise Halt(self.agent.name, f"{where} returned {wrong}")
            held: Command = answer
            return held
        for name, value in zip(Control._fields, answer, strict=True):
            if not isinstance(value, Real):
                raise Halt(self.agent.name, f"{where} returned a {name} of type {type(value).__name__}, expected a number")
            if not math.isfinite(value):
                raise Halt(self.agent.name, f"{where} returned {name} {float(value)}, expected a finite number")
        throttle, brake, steering = (float(value) for value in answer)
        for name, value in (("throttle", throttle), ("brake", brake)):
            if not -_TOLERANCE <= value <= 1.0 + _TOLERANCE:
                raise Halt(self.agent.name, f"{where} returned {name} {value:g}, expected 0..1")
        if abs(steering) > math.pi / 2:
            raise Halt(
                self.agent.name,
                f"{where} returned steering {steering:g}, expected radians within -pi/2..pi/2 (was it in degrees?)",
            )
        return Control(min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0), steering)


def crew(
    agents: Sequence[Agent],
    autopilot: Factory,
    subject: str | None = None,
    traffic: Factory | None = None,
    senses: Senses = IDEAL,
    key: str = "",
) -> list[Seat]:
    """Make the autopilots of a run.

    Args:
        agents: in creation order.
        autopilot: drives every vehicle, or the subject alone.
        subject: name of the subject, or None.
        traffic: drives the other vehicles where there is a subject.
        senses: of what `autopilot` drives; traffic sees everything.
        key: what their random draws depend on, beside the seed and the vehicle.

    Returns:
        One seat per agent, in the same order.

    Raises:
        Halt: it raised, or made something that can't drive.
    """
    if traffic is None:
        return _hire(autopilot, agents, senses, key)
    seats = {seat.agent: seat for seat in _hire(autopilot, [a for a in agents if a.name == subject], senses, key)}
    seats |= {seat.agent: seat for seat in _hire(traffic, [a for a in agents if a.name != subject])}
    return [seats[agent] for agent in agents]


def name_of(factory: Factory | None) -> str | None:
    """Return the name of an autopilot factory, for records."""
    if factory is None:
        return None
    if isinstance(label := getattr(factory, "label", None), str):
        return label
    inner = getattr(factory, "func", factory)  # of a functools.partial
    return str(getattr(inner, "__qualname__", type(inner).__qualname__))


def _hire(factory: Factory, agents: Sequence[Agent], senses: Senses = IDEAL, key: str = "") -> list[Seat]:
    """Return the seats of `agents`, filled by one factory, asked in order; or once, if it makes a traffic system."""
    seats: list[Seat] = []
    for agent in agents:
        made = _make(factory, agent)
        if callable(getattr(made, "autopilots", None)):
            return [Seat(a, one, senses, key) for a, one in zip(agents, _delegate(made, agents), strict=True)]
        seats.append(Seat(agent, made, senses, key))
    return seats


def _make(factory: Factory, agent: Agent) -> Any:
    try:
        return factory()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise Halt(agent.name, f"making {name_of(factory)} for {agent.name} {_describe(error)}") from error


def _delegate(system: Any, agents: Sequence[Agent]) -> list[Any]:
    name = type(system).__qualname__
    try:
        made = list(system.autopilots(tuple(agents)))
    except AutopilotError as error:
        raise Halt(agents[0].name, str(error), getattr(error, "detail", "")) from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise Halt(agents[0].name, f"{name}.autopilots {_describe(error)}") from error
    if len(made) != len(agents):
        raise Halt(
            agents[0].name, f"{name}.autopilots returned {len(made)} autopilots, expected one for each of {len(agents)} agents"
        )
    return made


def _describe(error: BaseException) -> str:
    """Return "raised Type: text (file:line)" for the place where `error` came up.

    The file goes by its name alone: the reason is part of the run's hash, which must not depend on the checkout.
    """
    frames = traceback.extract_tb(error.__traceback__)
    text = " ".join(str(error).split())
    return f"raised {type(error).__name__}{': ' if text else ''}{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
