"""Seats: a seat connects an autopilot to a vehicle of the simulation.

A seat asks its autopilot at the rate of the autopilot, repeats the last answer in between, and refuses answers that are no
commands. The tracking controller turns a command that is no control (throttle, brake, steering) into a control. With imperfect
senses, `Perception` decides what the autopilot sees of other road users, and `Latency` when its commands take effect.

An autopilot that raises an exception or answers with no command ends the run by a fault. The run stores the fault. The states
before the fault are judged: a rule that they violate gets FAIL, every other rule gets ERROR.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from numbers import Real
from random import Random
from typing import Any

from pytest_rvads.drivers.commands import Tracker, UnfitCommand, plain
from pytest_rvads.drivers.interface import Acceleration, Command, Control, Factory, Observation, wrong_label
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.geometry.crosswalks import hides
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.run import DT, FAULT, LATE, Halt
from pytest_rvads.runs.states import Agent, Kind, VehicleState, Zone
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.simulators.patience import TooLate, Watch
from pytest_rvads.support.errors import AutopilotError, place_of
from pytest_rvads.support.wording import one_line, printable

_MOST_DETAIL = 4096
"""Greatest length of the detail of a fault [characters]."""
_MOST_REASON = 2000
"""Greatest length of the reason of a fault [characters]."""
_MOST_TEXT = 400
"""Greatest length of a text of ``timing()`` or of an exception of an autopilot [characters]."""
_LONGEST_PERIOD = 86400.0
"""Longest period of an autopilot [s]."""
_MOST_TIMINGS = 32
"""Greatest number of entries of ``timing()`` of an autopilot."""


class Seat:
    """The connection of an autopilot to one vehicle; the random draws of its senses depend on `key` and the vehicle's name.

    `watch` enforces the limits of real time.

    A `Halt` is raised if the autopilot has no method ``control``, its label is no text, it raises, or its period is no multiple
    of the step.
    """

    def __init__(self, agent: Agent, autopilot: Any, senses: Senses = IDEAL, key: str = "", watch: Watch | None = None) -> None:
        self.agent = agent
        self.autopilot = autopilot
        self._watch = watch or Watch()
        with _asking(self._watch, f"making {type(autopilot).__qualname__} for {agent.name}", agent):
            self.name = name_of(autopilot)
            objection = wrong_label(autopilot)
            if not objection and not callable(getattr(autopilot, "control", None)):
                objection = "an autopilot needs a method control(seen: Observation) -> Command"
            if not objection:
                self._ask = autopilot.control
                # A driver in another process can keep limits of its own, see `own_limits` of its autopilot.
                self._limited = not getattr(autopilot, "own_limits", False)
                period = getattr(autopilot, "period", DT)
                number = float(period) if isinstance(period, Real) and not isinstance(period, bool) else 0.0
                steps = round(number / DT) if 0.0 < number < _LONGEST_PERIOD else 0
                self._every = steps if math.isclose(steps * DT, number, rel_tol=1e-9) else 0
                objection = "" if self._every else f"its period must be a whole multiple of {DT:g} s, got {period!r:.60}"
        if objection:
            raise Halt(agent.name, f"{self.name} can't drive {agent.name}: {one_line(objection, _MOST_REASON)}")
        self.excess: tuple[int, float] | None = None
        """Number of accelerations that the vehicle can't reach, and the largest of them [m/s^2]; None without any."""
        self._held: Command = Control()
        self._tracker: Tracker | None = None
        key = f"{key} {agent.name}"
        self._perception = Perception(senses, key) if senses.blurred else None
        self._latency = Latency(senses, key) if senses.latency or senses.jitter else None

    def command(self, step: int, seen: Observation) -> Control:
        """Return the control for the step that starts in state number `step`; the autopilot is asked every `_every` steps."""
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
        # The tracking controller is part of the vehicle and gets the true state.
        return self._tracker.control(command, seen)

    def timing(self) -> dict[str, float | str] | None:
        """Return the finite numbers and the texts of `Autopilot.timing`; None without measurements or after an error."""
        entries: dict[str, float | str] = {}
        try:
            with _asking(self._watch, "timing", self.agent, limited=self._limited):
                measurements = self.autopilot.timing()
                if not isinstance(measurements, Mapping):
                    return None
                for name, value in islice(measurements.items(), _MOST_TIMINGS):
                    if isinstance(value, str):
                        entries[one_line(str(name), _MOST_TEXT)] = one_line(value, _MOST_TEXT)
                    elif isinstance(value, Real) and math.isfinite(number := float(value)):
                        entries[one_line(str(name), _MOST_TEXT)] = int(value) if isinstance(value, int) else number
                return entries
        except Halt as halt:  # measurements are no part of the run, so an error in them does not end the run
            if halt.end == LATE:
                raise
            return None

    def _answer(self, seen: Observation) -> Command:
        """Return the command that the autopilot gives on an observation, checked and in plain numbers."""
        watched = self._watch
        if self._limited:
            watched.asked = seen
        try:
            answer = self._ask(seen)
            if type(answer) is Control and not watched.late:
                throttle, brake, steering = answer
                # Plain floats in range are the usual case; `plain` checks all other answers.
                if type(throttle) is type(brake) is type(steering) is float and (
                    0.0 <= throttle <= 1.0 and 0.0 <= brake <= 1.0 and -1.5 < steering < 1.5
                ):
                    return answer
            command = plain(answer)
            if type(command) is Acceleration:
                # An acceleration that the vehicle can't reach is counted; the dynamics of the vehicle limit it.
                vehicle, wanted = seen.vehicle, command.acceleration
                if not -vehicle.brake[seen.aggression - 1] <= wanted <= vehicle.drive:
                    requests, largest = self.excess or (0, 0.0)
                    self.excess = requests + 1, max(largest, wanted, key=abs)
            if watched.late:
                raise TooLate  # the autopilot caught the exception that the time limit raised
        except BaseException as error:
            watched.asked = None
            doing = f"{self.name} driving {self.agent.name}"
            raise _fault(watched, error, doing, self.agent, self.autopilot, f" at {seen.time:.2f} s") from error
        finally:
            watched.asked = None
        return self._held if command == self._held else command  # the tracking controller compares trajectories by identity


def crew(
    agents: Sequence[Agent],
    driver: Factory,
    traffic: Factory | None = None,
    subject: str | None = None,
    senses: Senses = IDEAL,
    key: str = "",
    junction: Junction | None = None,
    watch: Watch | None = None,
) -> list[Seat]:
    """Return the seats of a run, with new autopilots.

    In a run with a subject, `traffic` makes the autopilots of all other vehicles. Traffic systems get the junction, if it is
    given, before they make autopilots. `watch` enforces the limits of real time.
    """
    watch = watch or Watch()
    if traffic is None:
        return _hire(watch, driver, agents, junction, senses, key)
    seats = {seat.agent: seat for seat in _hire(watch, driver, [a for a in agents if a.name == subject], junction, senses, key)}
    seats |= {seat.agent: seat for seat in _hire(watch, traffic, [a for a in agents if a.name != subject], junction)}
    return [seats[agent] for agent in agents]


def _hire(
    watch: Watch, factory: Factory, agents: Sequence[Agent], junction: Junction | None, senses: Senses = IDEAL, key: str = ""
) -> list[Seat]:
    """Return the seats of `agents`; the factory is called once per agent, or only once if the factory makes a traffic system."""
    seats: list[Seat] = []
    for agent in agents:
        with _asking(watch, f"making {name_of(factory)} for {agent.name}", agent):
            product: Any = factory()
            coordinates = callable(getattr(product, "autopilots", None))
        if not coordinates:
            seats.append(Seat(agent, product, senses, key, watch))
            continue
        name, first = name_of(type(product)), agents[0]
        limited = not getattr(product, "own_limits", False)
        if junction is not None and callable(prepare := getattr(product, "prepare", None)):
            with _asking(watch, f"{name}.prepare", first, limited=limited):
                prepare(junction)
        with _asking(watch, f"{name}.autopilots", first, limited=limited):
            objection = wrong_label(product)
            autopilots = [] if objection else list(islice(product.autopilots(tuple(agents)), len(agents) + 1))
        if objection:
            raise Halt(first.name, f"{name} can't coordinate {len(agents)} agents: {objection}")
        if len(autopilots) != len(agents):
            count = f"{len(autopilots)}" if len(autopilots) < len(agents) else "more"
            reason = f"{name}.autopilots returned {count} autopilots, expected one for each of {len(agents)} agents"
            raise Halt(first.name, reason)
        return [Seat(a, autopilot, senses, key, watch) for a, autopilot in zip(agents, autopilots, strict=True)]
    return seats


@contextmanager
def _asking(watch: Watch, doing: str, agent: Agent, *, limited: bool = True) -> Iterator[None]:
    """Run code of a driver: an exception ends the run with a fault, and so does exceeding a limit of real time."""
    watch.asked = object() if limited else None
    try:
        yield
        if watch.late:
            raise TooLate  # the driver caught the exception that the time limit raised
    except BaseException as error:
        watch.asked = None
        raise _fault(watch, error, doing, agent) from error
    finally:
        watch.asked = None


def _fault(watch: Watch, error: BaseException, doing: str, agent: Agent, autopilot: Any = None, when: str = "") -> Halt:
    """Return the `Halt` for an error in code of a driver; call ``abandon()`` of an autopilot that is late or gave no command."""
    watch.end_in_child(error)
    if isinstance(error, KeyboardInterrupt):
        raise error
    if isinstance(error, TooLate):
        late, detail = watch.late, _detail(watch, autopilot, "abandon")
        if not late:
            raise error
        return Halt(agent.name, one_line(f"{doing}{when}: {late}", _MOST_REASON), detail, LATE)
    if isinstance(error, UnfitCommand):
        return Halt(agent.name, one_line(f"{doing}{when} returned {error}", _MOST_REASON), _detail(watch, autopilot, "abandon"))
    if isinstance(error, AutopilotError):
        from pytest_rvads.drivers.stacks.child import StackError, StackTimeout

        named = not when and isinstance(error, StackError)  # its text names the stack
        end = LATE if isinstance(error, StackTimeout) else FAULT
        reason = str(error) if named else f"{doing}{when}: {error}" if str(error) else f"{doing} {_describe(watch, error)}{when}"
        return Halt(agent.name, one_line(reason, _MOST_REASON), _detail(watch, error, "detail"), end)
    return Halt(agent.name, one_line(f"{doing} {_describe(watch, error)}{when}", _MOST_REASON))


def _detail(watch: Watch, source: Any, name: str) -> str:
    """Return the text of an attribute or method of `source`, at most its last `_MOST_DETAIL` characters."""
    watch.asked = object()
    try:
        value = getattr(source, name, None)
        value = value() if callable(value) else value
        text = "" if value is None else str(value)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the run has ended, and the reason is known
        text = f"{name} {_describe(watch, error)}"
    finally:
        watch.asked = None
    return printable(text[-_MOST_DETAIL:], _MOST_DETAIL)


def _describe(watch: Watch, error: BaseException) -> str:
    """Return "raised Type: text (file:line)" with the innermost line in code of the user.

    The file is named without its folder, because the text is part of the run's hash, which must not depend on the checkout.
    """
    kind = _read(watch, lambda: type(error).__name__, "an error")
    text = _read(watch, lambda: str(error), "it can't be told what")
    return f"raised {kind}{': ' if text else ''}{text} ({place_of(error)})"


def _read(watch: Watch, compute: Callable[[], str], otherwise: str) -> str:
    """Return a text that code of a driver computes, on one line; `otherwise` if this code raises an exception."""
    watch.asked = compute
    try:
        return one_line(compute(), _MOST_TEXT)
    except KeyboardInterrupt:
        raise
    except BaseException:  # the run has ended anyway
        return otherwise
    finally:
        watch.asked = None


class Perception:
    """The view of one vehicle with imperfect senses; seed and key (scenario and vehicle) decide the random draws."""

    def __init__(self, senses: Senses, key: str) -> None:
        self._senses = senses
        self._random = Random(f"{senses.seed} {key} perception")
        self._past: deque[tuple[VehicleState, ...]] = deque(maxlen=round(senses.delay / DT) + 1)
        self._earlier: set[str] = set()
        """Names of the vehicles that were created before the own vehicle."""

    def watch(self, seen: Observation) -> None:
        """Store the true states of the other vehicles; called in every step."""
        self._past.append(seen.others)
        self._earlier.update(other.name for other in seen.others[: seen.created])

    def view(self, seen: Observation) -> Observation:
        """Return what the vehicle perceives of the true observation `seen`, which was stored last."""
        senses, draw = self._senses, self._random
        bodies = self._past[0]
        perceived = []
        for other in bodies:
            # Numbers are drawn for every vehicle, seen or not, so that no draw depends on the vehicles in sight.
            lost, along, across, faster = draw.random(), draw.gauss(), draw.gauss(), draw.gauss()
            if lost < senses.dropout or math.hypot(other.x - seen.me.x, other.y - seen.me.y) > senses.range:
                continue
            if senses.occlusion and hidden(seen.me, other, bodies):
                continue
            if senses.position_noise or senses.speed_noise:
                other = _blurred(other, seen.junction, senses, along, across, faster)
            perceived.append(other)
        return seen._replace(others=tuple(perceived), created=sum(other.name in self._earlier for other in perceived))


def hidden(me: VehicleState, other: VehicleState, bodies: tuple[VehicleState, ...]) -> bool:
    """Return whether other vehicles cross all lines from the front of `me` to the front, the centre and the rear of `other`.

    A pedestrian hides nobody.
    """
    vehicles = [body for body in bodies if body.name not in (me.name, other.name) and body.kind is not Kind.PEDESTRIAN]
    cos, sin = math.cos(other.heading), math.sin(other.heading)
    points = [(other.x - back * cos, other.y - back * sin) for back in (0.0, 0.5 * other.length, other.length)]
    return all(any(hides((me.x, me.y), point, (v.x, v.y, v.heading), (v.length, v.width)) for v in vehicles) for point in points)


def _blurred(state: VehicleState, junction: Junction, senses: Senses, along: float, across: float, faster: float) -> VehicleState:
    """Return a state moved along and across its way and changed in speed by random draws, with the zone of the moved station."""
    along, across, faster = senses.position_noise * along, senses.position_noise * across, senses.speed_noise * faster
    cos, sin = math.cos(state.heading), math.sin(state.heading)
    station, zone = state.station + along, state.zone
    if along:
        line = -junction.setbacks[state.entrance]
        if station <= max(line, 0.0):
            zone = Zone.ENTRANCE if station >= line - ENTRANCE_ZONE else Zone.APPROACH
        else:
            shortest = min(movement.length for movement in junction.by_turn[state.entrance, state.turn])
            zone = Zone.JUNCTION if station < shortest else Zone.EXIT
    return state._replace(
        station=station,
        zone=zone,
        x=state.x + along * cos - across * sin,
        y=state.y + along * sin + across * cos,
        # Only pedestrians walk backwards.
        speed=state.speed + faster if state.speed < 0.0 and state.kind is Kind.PEDESTRIAN else max(state.speed + faster, 0.0),
    )


class Latency:
    """Delays the commands of an autopilot. Commands keep their order; until the first command arrives, the vehicle coasts."""

    def __init__(self, senses: Senses, key: str) -> None:
        self._senses = senses
        self._random = Random(f"{senses.seed} {key} latency")
        self._coming: deque[tuple[int, Command]] = deque()
        self._held: Command = Control()

    def send(self, step: int, command: Command) -> None:
        """Send a command that answers the observation of `step`; it takes effect after the latency."""
        delay = self._senses.latency + self._senses.jitter * self._random.random()
        arrival = step + round(delay / DT)
        if self._coming:
            arrival = max(arrival, self._coming[-1][0])
        self._coming.append((arrival, command))

    def held(self, step: int) -> Command:
        """Return the command of the autopilot that is in effect in `step`."""
        while self._coming and self._coming[0][0] <= step:
            self._held = self._coming.popleft()[1]
        return self._held
