"""Seats: what stands between the simulation and the autopilots.

A seat asks its autopilot at the autopilot's own rate, holds the answer in between, lets nothing through that is not a
command, and has the tracking controller drive what is not a control.

A fault is what is no driving: an autopilot that raises or answers nonsense, or a world that fails. The fault ends the run and is
kept in it. The states before the fault are judged: a violation stands, every other verdict is ERROR.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from numbers import Real
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.abilities import OF_AUTOPILOTS, OF_SYSTEMS, spelling
from pytest_rvads.drivers.commands import UnfitCommand, plain
from pytest_rvads.drivers.interface import Autopilot, Command, Control, Factory, Observation, TrafficSystem
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.drivers.tracker import Tracker
from pytest_rvads.errors import AutopilotError
from pytest_rvads.runs.run import DT, FAULT, LATE, Halt
from pytest_rvads.runs.states import Agent
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.simulators.latency import Latency
from pytest_rvads.simulators.patience import TooLate, watch
from pytest_rvads.simulators.perception import Perception
from pytest_rvads.wording import one_line, printable

__all__ = ["Seat", "crew"]

_LONGEST = 4096
"""Of what is told of a fault beside its reason [characters]."""
_REASON = 2000
"""Of a reason [characters]."""
_TEXT = 400
"""Of a text that an autopilot tells beside its run [characters]."""
_DAY = 86400.0
"""No period is longer [s]."""
_TIMES = 32
"""How many of the times that an autopilot measured are kept."""


class Seat:
    """One vehicle's place for an autopilot: any object with a method ``control``; `Autopilot` says what else it may have.

    Raises:
        Halt: no method ``control``, an ability that is misspelt or raises, or a period that is not a multiple of the step.
    """

    def __init__(self, agent: Agent, autopilot: Any, senses: Senses = IDEAL, key: str = "") -> None:
        self.agent = agent
        self.autopilot = autopilot
        self._watch = watch()
        with _asking(f"making {type(autopilot).__qualname__} for {agent.name}", agent):
            self.name = name_of(autopilot)
            wrong = spelling(autopilot, OF_AUTOPILOTS, Autopilot)
            if not wrong and not callable(getattr(autopilot, "control", None)):
                wrong = "an autopilot needs a method control(seen: Observation) -> Command"
            if not wrong:
                self._ask = autopilot.control
                self._limited = not getattr(autopilot, "own_limits", False)
                period = getattr(autopilot, "period", DT)
                self._every = _steps(period)
                wrong = "" if self._every else f"its period must be a whole multiple of {DT:g} s, got {period!r:.60}"
        if wrong:
            raise Halt(agent.name, f"{self.name} can't drive {agent.name}: {one_line(wrong, _REASON)}")
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

    def timing(self) -> dict[str, float | str] | None:
        """Return what the autopilot measured, see `Autopilot.timing`; None where it tells nothing of the kind.

        Raises:
            Halt: it took too long.
        """
        try:
            with _asking("timing", self.agent, limited=self._limited):
                told = self.autopilot.timing()
                return _measured(told) if isinstance(told, Mapping) else None
        except Halt as halt:  # what it measured is no part of the run, so nothing that it does here ends one
            if halt.end == LATE:
                raise
            return None

    def _answer(self, seen: Observation) -> Command:
        watched = self._watch
        if self._limited:
            watched.asked = seen
        try:
            answer = self._ask(seen)
            if type(answer) is Control and not watched.late:
                throttle, brake, steering = answer
                # Plain floats in range are the usual case; everything else is looked at closely.
                if type(throttle) is type(brake) is type(steering) is float and (
                    0.0 <= throttle <= 1.0 and 0.0 <= brake <= 1.0 and -1.5 < steering < 1.5
                ):
                    return answer
            command = plain(answer)
            if watched.late:
                raise TooLate  # which it caught
        except BaseException as error:
            watched.asked = None
            doing = f"{self.name} driving {self.agent.name}"
            raise _fault(error, doing, self.agent, self.autopilot, f" at {seen.time:.2f} s") from error
        finally:
            watched.asked = None
        return self._held if command == self._held else command  # the tracking controller knows a trajectory again


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
        agents: the vehicles of the run, in creation order.
        driver: drives every vehicle, or the subject alone.
        traffic: drives all vehicles but the subject; None in a run without a subject.
        subject: name of the vehicle under test, or None.
        senses: senses of the vehicles that `driver` drives; traffic sees everything.
        key: seeds the random draws together with the scenario's seed and the vehicle's name.

    Returns:
        One seat per agent, in the order of `agents`.

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
        made, coordinates = _make(factory, agent)
        if coordinates:
            return [Seat(a, one, senses, key) for a, one in zip(agents, _delegate(made, agents), strict=True)]
        seats.append(Seat(agent, made, senses, key))
    return seats


def _make(factory: Factory, agent: Agent) -> tuple[Any, bool]:
    """Return what a factory makes, and whether it is a traffic system."""
    with _asking(f"making {name_of(factory)} for {agent.name}", agent):
        made = factory()
        return made, callable(getattr(made, "autopilots", None))


def _delegate(system: Any, agents: Sequence[Agent]) -> list[Any]:
    name, first = name_of(type(system)), agents[0]
    with _asking(f"{name}.autopilots", first, limited=not getattr(system, "own_limits", False)):
        misspelt = spelling(system, OF_SYSTEMS, TrafficSystem)
        made = [] if misspelt else list(islice(system.autopilots(tuple(agents)), len(agents) + 1))
    if misspelt:
        raise Halt(first.name, f"{name} can't coordinate {len(agents)} agents: {one_line(misspelt, _REASON)}")
    if len(made) != len(agents):
        count = f"{len(made)}" if len(made) < len(agents) else "more"
        raise Halt(first.name, f"{name}.autopilots returned {count} autopilots, expected one for each of {len(agents)} agents")
    return made


@contextmanager
def _asking(doing: str, agent: Agent, *, limited: bool = True) -> Iterator[None]:
    """Run code of a driver: an exception ends the run with a fault, and so does exceeding the time limit of the watch.

    Args:
        doing: the requested action in words, for the fault's reason.
        agent: the vehicle concerned.
        limited: whether the limit of a decision counts; a stack in another process has limits of its own.

    Raises:
        Halt: it raised, or took too long.
    """
    watched = watch()
    watched.asked = object() if limited else None
    try:
        yield
        if watched.late:
            raise TooLate  # which it caught
    except BaseException as error:
        watched.asked = None
        raise _fault(error, doing, agent) from error
    finally:
        watched.asked = None


def _fault(error: BaseException, doing: str, agent: Agent, autopilot: Any = None, when: str = "") -> Halt:
    """Return what an error in code of a driver makes of its run; an autopilot that is too late, or answered nonsense, lets go.

    Raises:
        KeyboardInterrupt: the error, which is no driver's.
        TooLate: the error, which is meant for a run that this one is simulated within.
    """
    watch().end_in_child(error)
    if isinstance(error, KeyboardInterrupt):
        raise error
    if isinstance(error, TooLate):
        late, detail = watch().late, _told(autopilot, "abandon")
        if not late:
            raise error
        return Halt(agent.name, one_line(f"{doing}{when}: {late}", _REASON), detail, LATE)
    if isinstance(error, UnfitCommand):
        return Halt(agent.name, one_line(f"{doing}{when} returned {error}", _REASON), _told(autopilot, "abandon"))
    if isinstance(error, AutopilotError):
        from pytest_rvads.drivers.stacks.child import StackError, StackTimeout

        named = not when and isinstance(error, StackError)  # its own text says which stack
        end = LATE if isinstance(error, StackTimeout) else FAULT
        reason = str(error) if named else f"{doing}{when}: {error}"
        return Halt(agent.name, one_line(reason, _REASON), _told(error, "detail"), end)
    return Halt(agent.name, one_line(f"{doing} {_describe(error)}{when}", _REASON))


def _steps(period: Any) -> int:
    """Return a period in steps of the simulation, 0 where it is no whole number of them."""
    number = float(period) if isinstance(period, Real) and not isinstance(period, bool) else 0.0
    steps = round(number / DT) if 0.0 < number < _DAY else 0
    return steps if math.isclose(steps * DT, number, rel_tol=1e-9) else 0


def _measured(told: Mapping[Any, Any]) -> dict[str, float | str]:
    """Return the entries of a mapping that are finite numbers or texts, as builtins."""
    found: dict[str, float | str] = {}
    for name, value in islice(told.items(), _TIMES):
        if isinstance(value, str):
            found[one_line(str(name), _TEXT)] = one_line(value, _TEXT)
        elif isinstance(value, Real) and math.isfinite(number := float(value)):
            found[one_line(str(name), _TEXT)] = int(value) if isinstance(value, int) else number
    return found


def _told(teller: Any, name: str) -> str:
    """Return what an attribute or method of `teller` adds to a fault, at most its last `_LONGEST` characters."""
    watched = watch()
    watched.asked = object()
    try:
        more = getattr(teller, name, None)
        more = more() if callable(more) else more
        text = "" if more is None else str(more)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the run has ended anyway, and what ended it is known
        text = f"{name} {_describe(error)}"
    finally:
        watched.asked = None
    return printable(text[-_LONGEST:], _LONGEST)


def _describe(error: BaseException) -> str:
    """Return "raised Type: text (file:line)" for the place where `error` came up.

    The file goes by its name alone: the reason is part of the run's hash, which must not depend on the checkout.
    """
    kind = _read(lambda: type(error).__name__, "an error")
    text = _read(lambda: str(error), "it can't be told what")
    frames = traceback.extract_tb(error.__traceback__)
    return f"raised {kind}{': ' if text else ''}{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})"


def _read(tell: Callable[[], str], otherwise: str) -> str:
    """Return a text that code of a driver may make, on one line."""
    watched = watch()
    watched.asked = tell
    try:
        return one_line(tell(), _TEXT)
    except KeyboardInterrupt:
        raise
    except BaseException:  # what it was to tell of has ended the run anyway
        return otherwise
    finally:
        watched.asked = None
