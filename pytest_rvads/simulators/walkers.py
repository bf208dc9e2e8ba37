"""Moves pedestrians in a simulation: only the behaviour of a pedestrian moves the pedestrian, and no vehicle pushes anybody.

The physics engine holds neither pedestrians nor parked vehicles. A contact is computed from the circle of a pedestrian, or the
rectangle of a parked vehicle, and the rectangles of the vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pytest_rvads.drivers.walking import STRIDE, Approaching, Sight, behaviour
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.bodies import Box, gap, strikes, touch
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import GONE, Colour, Kind, VehicleState
from pytest_rvads.scenarios.pedestrians import Setting


class Walker:
    """A pedestrian, or a parked vehicle, in a run with vehicles on their itineraries."""

    state: VehicleState

    def __init__(self, junction: Junction, setting: Setting, itineraries: Sequence[Itinerary]) -> None:
        agent = setting.agent
        self.agent, self.itinerary = agent, itinerary(junction, *agent.way.key)
        self._station, self._delay, self._behind = setting.station, setting.delay, setting.behind
        self._pace = None if math.isinf(setting.delay) else behaviour(setting.behaviour).pace()
        self._speed = setting.speed
        stretches = junction.stretches or {}
        shared = [(column, stretches.get(((way.entrance, way.exit), agent.way.key))) for column, way in enumerate(itineraries)]
        self._crossed = [(column, both.mine) for column, both in shared if both]
        """Columns of the vehicles that drive over the way of the pedestrian, and the stretches on which they do."""
        self.state = self._state(0.0)

    def sample(self) -> VehicleState:
        """Return the next state in the run, one step after the last sample."""
        if self._station != self.state.station or self._speed != self.state.speed or self.state.acceleration:
            self.state = self._state((self._speed - self.state.speed) / DT)
        return self.state

    def walk(self, time: float, lights: Sequence[Colour], vehicles: Sequence[VehicleState]) -> None:
        """Take the next step, from what the pedestrian sees at `time` [s]."""
        if self._pace is None or self.state.zone is GONE or time < self._delay:
            return
        coming = (
            Approaching(stretch.start - state.station, state.speed)
            for column, stretch in self._crossed
            if (state := vehicles[column]).zone is not GONE and state.station - state.length < stretch.end
        )
        light = lights[self.agent.entrance]
        # Who walks behind others stops behind them when the first of the group is at the kerb.
        station = self._station if self._station > 0.0 else min(self._station + self._behind, 0.0)
        wanted = self._pace(Sight(time - self._delay, station, self.agent.way.length, light, coming))
        if wanted < 0.0 and self._station + wanted * abs(wanted) / (2.0 * STRIDE) <= -self.itinerary.origin:
            wanted = 0.0  # back at the end of the sidewalk
        before, most = self._speed, STRIDE * DT
        self._speed = before + min(max(wanted - before, -most), most)
        self._station += (before + self._speed) / 2.0 * DT

    def touches(self, vehicle: VehicleState) -> bool:
        """Return whether the body overlaps the body of a vehicle."""
        me = self.state
        if me.zone is GONE or vehicle.zone is GONE:
            return False
        far = me.length + vehicle.length + vehicle.width
        if abs(me.x - vehicle.x) > far or abs(me.y - vehicle.y) > far:
            return False
        # Where a gap is between the rectangles around both bodies, as in most steps, no exact test is needed.
        if gap(*(Box(s.x, s.y, s.heading, s.length, s.width) for s in (vehicle, me))) > 0.0:
            return False
        bodies = [(np.array([[s.x, s.y, s.heading]]), (s.length, s.width)) for s in (vehicle, me)]
        return bool((strikes(bodies) if me.kind is Kind.PEDESTRIAN else touch(bodies))[0])

    def _state(self, acceleration: float) -> VehicleState:
        agent, station = self.agent, self._station
        length, width = agent.size or (0.0, 0.0)
        x, y, heading = self.itinerary.pose(station)
        zone = self.itinerary.zone(station)
        moves = self._speed, acceleration
        return VehicleState(
            agent.name, agent.entrance, agent.turn, zone, station, x, y, heading, *moves, length, width, agent.kind
        )
