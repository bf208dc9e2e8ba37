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

from pytest_rvads.drivers.abilities import OF_AUTOPILOTS, OF_SYSTEMS, spelling
from pytest_rvads.drivers.commands import clamped, trouble
from pytest_rvads.drivers.interface import Autopilot, Command, Control, Factory, Observation, TrafficSystem
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.drivers.tracker import Tracker
from pytest_rvads.errors import AutopilotError
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import Agent
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.simulators.latency import Latency
from pytest_rvads.simulators.perception import Perception

__all__ = ["Seat", "crew"]

_LONGEST = 4096
"""Of what is told of a fault beside its reason [characters]."""


class Seat:
    """One vehicle's place for an autopilot: any object with a method ``control``; `Autopilot` says what else it may have.

    Raises:
        Halt: no method ``control``, an ability that is misspelt, or a period that is not a multiple of the step.
    """

    def __init__(self, agent: Agent, autopilot: Any, senses: Senses = IDEAL, key: str = "") -> None:
        self.agent = agent
        self.name = name_of(autopilot)
        self.autopilot = autopilot
        wrong = spelling(autopilot, OF_AUTOPILOTS, Autopilot)
        if not wrong and not callable(getattr(autopilot, "control", None)):
            wrong = "an autopilot needs a method control(seen: Observation) -> Command"
        if wrong:
            raise self._unfit(wrong)
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
        if type(command) is Control:
            return command
        if self._tracker is None:
            self._tracker = Tracker()
        # The tracking controller sits in the vehicle: it knows where it is.
        return self._tracker.control(command, seen)

    def timing(self) -> dict[str, Any] | None:
        """Return how long a stack that runs elsewhere computed, see `Autopilot`; None for others, whatever they answer."""
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
            raise Halt(self.agent.name, f"{self._where(seen)}: {error}", _told(error, "detail")) from error
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
        wrong = trouble(answer)
        if wrong:
            raise Halt(self.agent.name, f"{self._where(seen)} returned {wrong}", _told(self.autopilot, "abandon"))
        held: Command = clamped(answer) if isinstance(answer, Control) else answer
        return held

    def _where(self, seen: Observation) -> str:
        return f"{self.name} driving {self.agent.name} at {seen.time:.2f} s"

    def _unfit(self, why: str) -> Halt:
        return Halt(self.agent.name, f"{self.name} can't drive {self.agent.name}: {why}")

    def _steps(self, period: Any) -> int:
        if isinstance(period, Real) and not isinstance(period, bool) and math.isfinite(period):
            steps = round(float(period) / DT)
            if steps >= 1 and math.isclose(steps * DT, float(period), rel_tol=1e-9):
                return steps
        raise self._unfit(f"its period must be a whole multiple of {DT:g} s, got {period!r}")


def crew(
    agents: Sequence[Agent],
    driver: Factory,
    traffic: Factory | None = None,
    subject: str | None = None,
    senses: Senses = IDEAL,
    key: str = "",
) -> list[Seat]:
    """Make the autopilots of a run.

    Args:
        agents: in creation order.
        driver: drives every vehicle, or the subject alone.
        traffic: drives the other vehicles where there is a subject.
        subject: name of the vehicle under test, or None.
        senses: of what `driver` drives; traffic sees everything.
        key: what their random draws depend on, beside the seed and the vehicle.

    Returns:
        One seat per agent, in the same order.

    Raises:
        Halt: `driver` or `traffic` raised, or made something that can't drive.
    """
    if traffic is None:
        return _hire(driver, agents, senses, key)
    seats = {seat.agent: seat for seat in _hire(driver, [a for a in agents if a.name == subject], senses, key)}
    seats |= {seat.agent: seat for seat in _hire(traffic, [a for a in agents if a.name != subject])}
    return [seats[agent] for agent in agents]


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
    name, first = type(system).__qualname__, agents[0].name
    misspelt = spelling(system, OF_SYSTEMS, TrafficSystem)
    if misspelt:
        raise Halt(first, f"{name} can't coordinate {len(agents)} agents: {misspelt}")
    try:
        made = list(system.autopilots(tuple(agents)))
    except AutopilotError as error:
        raise Halt(first, str(error), _told(error, "detail")) from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise Halt(first, f"{name}.autopilots {_describe(error)}") from error
    if len(made) != len(agents):
        raise Halt(first, f"{name}.autopilots returned {len(made)} autopilots, expected one for each of {len(agents)} agents")
    return made


def _told(teller: Any, name: str) -> str:
    """Return what an attribute or method of `teller` adds to a fault, at most its last `_LONGEST` characters."""
    try:
        more = getattr(teller, name, None)
        more = more() if callable(more) else more
        text = "" if more is None else str(more)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the run has ended anyway, and what ended it is known
        text = f"{name} {_describe(error)}"
    return text[-_LONGEST:]


def _describe(error: BaseException) -> str:
    """Return "raised Type: text (file:line)" for the place where `error` came up.

    The file goes by its name alone: the reason is part of the run's hash, which must not depend on the checkout.
    """
    frames = traceback.extract_tb(error.__traceback__)
    text = " ".join(str(error).split())
    return f"raised {type(error).__name__}{': ' if text else ''}{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
