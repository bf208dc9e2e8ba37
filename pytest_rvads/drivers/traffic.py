"""Traffic policies by name: how the vehicles around the vehicle under test drive.

Some policies have drivers with a single fault, which hesitate, brake late, run red lights or never enter. `RollingStop` has
obvious faults, for examples and for trying out rules.

`Replay` repeats the motion of a recorded run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pytest_rvads.drivers.commands import PLACE_GAIN, SPEED_GAIN
from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.give_way import GiveWay
from pytest_rvads.drivers.interface import Autopilot, Command, Control, Drives, Factory, Observation, TrafficSystem
from pytest_rvads.drivers.reference import Gate, Reference, by_zones
from pytest_rvads.drivers.signs_and_lights import PATIENCE, PATIENCE_STEP, Light
from pytest_rvads.drivers.spacing import CREEP, STAND_OFF, Stopping
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.support.errors import AutopilotError, RunError, ScenarioError, suggest
from pytest_rvads.support.installed import entries, load

ROLL = 2.5
"""Speed at which `RollingStop` crosses its stopping line if no vehicle is in its way [m/s]."""
NEAR = 5.0
"""`RollingStop` gives way to a vehicle on its right that is at most this far from the junction [m]."""

HESITATION = 2.0
"""Time for which the hesitant driver waits although it could go [s]; after 3 s it would have waived its right."""
HESITANT_SPEED = 0.6
"""Share of the speed limit at which the hesitant driver drives."""
LATE = 0.85
"""The late yielder begins to brake when the stop needs this share of the full service brake."""


class RollingStop(Reference):
    """A driver that treats stop signs as yield signs, and turns on red without looking.

    The driver has two faults. At a stop sign, the driver does not stop: it slows down, gives way to vehicles in the junction and
    to vehicles near the junction on its right, and rolls on, without regard to the order of arrival. At a red light, the driver
    turns right (left where traffic keeps left) without regard to vehicles with green, unless a vehicle in the junction is in its
    way. In everything else the driver behaves like the reference driver, also in giving way where signs differ or arms have
    several lanes.
    """

    def make_gate(self, seen: Observation) -> Gate:
        """Return the object that decides when to enter the junction."""
        if not by_zones(seen.junction):
            return _Rolling(seen, self.track(seen), stops=False)
        return _RightOnRed(paper=False) if seen.junction.control is JunctionControl.LIGHTS else _Yield()

    def target_speed(self, seen: Observation) -> float:
        """Return the speed limit [m/s], or a lower speed before a line at which the driver should stop, but does not."""
        line = seen.itinerary.line - seen.me.station
        signs = seen.junction.control is JunctionControl.STOP or seen.junction.entrances[seen.me.entrance].sign is Sign.STOP
        if not (signs or _turns_on_red(seen)) or seen.me.zone > Zone.ENTRANCE:
            return super().target_speed(seen)
        return min(super().target_speed(seen), math.hypot(ROLL, self.stopping_speed(line - ENTRANCE_ZONE)))


class _Yield:
    """Decides when to enter: when no vehicle is in the junction, and no vehicle from the right is near the junction.

    If vehicles from the right stay, as when four vehicles wait for each other, the driver enters after a wait.
    """

    def __init__(self) -> None:
        self._stuck_since: float | None = None

    def allows(self, seen: Observation) -> bool:
        me = seen.me
        if any(other.zone is Zone.JUNCTION for other in seen.others):
            self._stuck_since = None
            return False
        waiting = [o for o in seen.others if o.zone is Zone.ENTRANCE or (o.zone is Zone.APPROACH and o.station > -NEAR)]
        if not any((other.entrance, me.entrance) in seen.junction.right_of for other in waiting):
            self._stuck_since = None
            return True
        if self._stuck_since is None or me.zone is not Zone.ENTRANCE:
            self._stuck_since = seen.time
        return seen.time - self._stuck_since >= PATIENCE + PATIENCE_STEP * seen.created


class _Rolling(GiveWay):
    """Decides when to enter: treats stop signs as yield signs, and ignores red on a right turn (left in left-hand traffic)."""

    def allows(self, seen: Observation) -> bool:
        if not _turns_on_red(seen):
            return super().allows(seen)
        return not any(in_the_way(seen, other) for other in seen.others)


class _RightOnRed(Light):
    """Decides when to enter: obeys the light, but ignores red on a right turn (left turn in left-hand traffic)."""

    def allows(self, seen: Observation) -> bool:
        if not _turns_on_red(seen):
            return super().allows(seen)
        return not any(in_the_way(seen, other) for other in seen.others)


def _turns_on_red(seen: Observation) -> bool:
    return seen.junction.turns_on_red(seen.me.entrance, seen.me.turn) and seen.lights[seen.me.entrance] is Colour.RED


class Hesitant(Reference):
    """A driver that obeys every rule, but waits for two seconds when it could go, and drives slowly."""

    def make_gate(self, seen: Observation) -> Gate:
        """Return the object that decides when to enter the junction."""
        return _Hesitating(super().make_gate(seen))

    def target_speed(self, seen: Observation) -> float:
        """Return the low speed of the hesitant driver [m/s]."""
        return HESITANT_SPEED * super().target_speed(seen)


class LateYielder(Reference):
    """A driver that obeys every rule, but brakes late and hard before a stopping line."""

    def __init__(self, tie: float = 0.0) -> None:
        super().__init__(tie)
        self._stopping = _LateStopping()


class RedLightRunner(Reference):
    """A driver that ignores lights, stop signs and the right of way, but stops for a vehicle that blocks its way."""

    def make_gate(self, _seen: Observation) -> Gate:
        """Return the object that decides when to enter the junction."""
        return _Constant(True)


class Stopped(Reference):
    """A driver that drives up to the stopping line, stops, and never goes on."""

    def make_gate(self, _seen: Observation) -> Gate:
        """Return the object that decides when to enter the junction."""
        return _Constant(False)


class _Constant:
    """Decides always to enter, or never to enter."""

    def __init__(self, answer: bool) -> None:
        self._answer = answer

    def allows(self, _seen: Observation) -> bool:
        return self._answer


class _Hesitating:
    """Decides when to enter: after another `Gate` has allowed the entry for the time `HESITATION`."""

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._since: float | None = None

    def allows(self, seen: Observation) -> bool:
        if not self._gate.allows(seen):
            self._since = None
            return False
        if self._since is None:
            self._since = seen.time
        return seen.time - self._since >= HESITATION


class _LateStopping(Stopping):
    """Brakes for the stopping line, beginning only when the stop needs the share `LATE` of the service brake."""

    def acceleration(self, seen: Observation) -> float:
        """Return the acceleration for a late stop [m/s^2]: an upper limit before braking begins, and -inf to hold the vehicle."""
        me, vehicle = seen.me, seen.vehicle
        distance = seen.itinerary.line - STAND_OFF - me.station
        if me.speed < CREEP and (distance < 0.02 or me.zone is Zone.ENTRANCE):
            return -math.inf
        full = vehicle.brake[seen.aggression - 1]
        room = distance - me.speed * (vehicle.brake_lag + (0.0 if self._braking else vehicle.drive_lag))
        needed = me.speed * me.speed / (2.0 * room) if room > 0.0 else math.inf
        self._braking = self._braking or needed >= LATE * full
        if self._braking:
            return -min(needed, full)
        return 1.0 + distance


class SumoDriver(Autopilot):
    """SUMO's own car-following and junction models, which drive in the simulator ``sumo`` only."""

    label = "sumo"

    def control(self, _seen: Observation) -> Command:
        """Raise an error, because SUMO moves its vehicles by itself."""
        raise AutopilotError(
            "SUMO's driver drives in the simulator sumo alone: add --rvads-simulator sumo, and name rvads.traffic('sumo') itself"
        )


DEFAULT = "reference"
"""Name of the default policy; ids of runs do not contain it."""
POLICIES: dict[str, Factory] = {
    "reference": partial(Reference, tie=TIE),
    "hesitant": partial(Hesitant, tie=TIE),
    "rolling_stop": RollingStop,
    "late_yielder": partial(LateYielder, tie=TIE),
    "red_light_runner": RedLightRunner,
    "stopped": Stopped,
}
"""The policies by name; further policies are entry points in the group ``rvads.policies``."""


@dataclass(frozen=True, slots=True)
class Policy:
    """A traffic policy: the named driver of the vehicles around the vehicle under test."""

    name: str
    """Name of the policy in ids, of letters, digits and underscores."""
    factory: Factory
    """Creates the autopilot of one vehicle, or the traffic system of a run."""

    @classmethod
    def of(cls, what: str | Factory) -> Policy:
        """Return the traffic policy that has a name, or a traffic policy made of a user's autopilot or traffic system."""
        if isinstance(what, str):
            return cls(what, traffic(what))
        if not callable(what):
            raise ScenarioError(f"traffic takes names of policies or classes of autopilots, got {what!r}")
        return cls(_in_ids(what), what)


def policy_name(factory: Factory) -> str:
    """Return the name of a traffic policy for the ids of tests: the name of a known policy, or the name of the factory."""
    place = f"{getattr(factory, '__module__', '')}:{getattr(factory, '__qualname__', '')}"
    known = (name for name, policy in POLICIES.items() if policy is factory)
    added = (name for name, entry in entries("policies").items() if entry.value == place)
    return next(known, "") or next(added, "") or _in_ids(factory)


def policies() -> tuple[str, ...]:
    """Return the names of all policies."""
    return *POLICIES, *entries("policies")


def traffic(name: str, what: str = "traffic") -> Factory:
    """Return the traffic policy called `name`, for the argument `traffic` of `Case`.

    Args:
        name: ``reference``, ``hesitant``, ``rolling_stop``, ``late_yielder``, ``red_light_runner``, ``stopped``, ``lgsvl`` or
            ``sumo``.
        what: role of the policy in the error message, such as ``traffic``.

    Raises:
        ScenarioError: no policy has this name.
    """
    if name in POLICIES:
        return POLICIES[name]
    if name not in entries("policies"):
        raise ScenarioError(f"unknown {what} {name!r}, there are {', '.join(policies())}{suggest(name, policies())}")
    policy: Factory = load("policies", name)
    return policy


def _in_ids(factory: Factory) -> str:
    """Return the name of a user's traffic policy for the ids of tests: the attribute ``name``, or the name of the class."""
    inner = factory.func if isinstance(factory, partial) else factory
    name = getattr(factory, "name", None) or getattr(inner, "__name__", type(inner).__name__)
    return re.sub(r"\W+", "_", str(name), flags=re.ASCII).strip("_") or "own"


_SAME = 1e-6
"""Recorded controls are applied while the sum of the deviations in station [m] and speed [m/s] from the recording is smaller."""
_AHEAD = 0.2
"""The acceleration of the recording is computed from its speed after this time [s], which is about the lag of drive and brake."""


class Replay(TrafficSystem):
    """A traffic policy: every vehicle repeats the motion of a recorded vehicle with the same movement.

    The vehicles don't react to the vehicle under test. If a scenario has the recorded starts and the run holds the recorded
    controls, the vehicles repeat the run bit for bit. If not, they follow the recorded stations and speeds as closely as
    possible. After the end of the recording, a vehicle continues at its last recorded speed.

    Args:
        run: the recorded run, or a file that ``--rvads-keep`` wrote.

    Raises:
        RunError: the run holds no stations or speeds, or the file can't be read.
    """

    name = "replay"

    def __init__(self, run: Run | str | Path) -> None:
        run = run if isinstance(run, Run) else load_run(run)
        if run.station is None or run.speed is None:
            raise RunError(f"run {run.label!r} holds no positions and speeds, so it can't be replayed as traffic")
        self.run = run

    def __call__(self) -> Replay:
        """Return this object as the traffic system of another run, because it keeps no state between runs."""
        return self

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return an autopilot per agent, which follows a recorded vehicle with the movement of the agent.

        Raises:
            ScenarioError: the recording has fewer vehicles with a movement than the scenario.
        """
        unused = list(enumerate(self.run.agents))
        playbacks = []
        for agent in agents:
            candidates = [candidate for candidate in unused if candidate[1].way.key == agent.way.key]
            if not candidates:
                raise ScenarioError(
                    f"run {self.run.label!r} has no vehicle from entrance {agent.entrance} to exit {agent.exit} "
                    f"that {agent.name} could replay: choose a scenario with the same movements"
                )
            # Of several vehicles with this movement, the vehicle with the agent's name is taken, or if there is none, the first.
            recorded = next((candidate for candidate in candidates if candidate[1].name == agent.name), candidates[0])
            unused.remove(recorded)
            playbacks.append(_Playback(self.run, recorded[0]))
        return playbacks


class _Playback(Follower):
    """An autopilot that follows the recorded stations and speeds of a vehicle."""

    def __init__(self, run: Run, column: int) -> None:
        self._dt = run.dt
        self._times = np.arange(run.steps) * run.dt
        self._station, self._speed = run.need("station")[:, column], run.need("speed")[:, column]
        self._controls = None if run.controls is None else run.controls[:, column]
        # After a vehicle has left, a run repeats the last state of the vehicle; these copies are not followed.
        moves = np.flatnonzero((np.diff(self._station) != 0.0) | (self._speed[1:] < STANDING))
        self._last = int(moves[-1]) + 1 if len(moves) else 0

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering for the next step."""
        me = seen.me
        place, speed = self._at(seen.time)
        tick = round(seen.time / self._dt)
        if self._controls is not None and tick < self._last and abs(place - me.station) + abs(speed - me.speed) < _SAME:
            return Control(*(float(value) for value in self._controls[tick]))
        if speed < STANDING and me.speed < 0.3 and place - me.station < 0.05:
            return self.drive(seen, -math.inf)
        _, soon = self._at(seen.time + _AHEAD)
        acceleration = (soon - speed) / _AHEAD + PLACE_GAIN * (place - me.station) + SPEED_GAIN * (speed - me.speed)
        return self.drive(seen, acceleration)

    def _at(self, time: float) -> tuple[float, float]:
        """Return the recorded station [m] and speed [m/s] at a time [s]."""
        end = float(self._times[self._last])
        beyond = max(time - end, 0.0)
        speed = float(np.interp(min(time, end), self._times, self._speed))
        return float(np.interp(min(time, end), self._times, self._station)) + beyond * speed, speed
