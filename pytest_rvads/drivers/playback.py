"""Traffic that repeats the motion of a recorded run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pytest_rvads.drivers.commands import PLACE_GAIN, SPEED_GAIN
from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.interface import Control, Drives, Observation, TrafficSystem
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import RunError, ScenarioError

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
