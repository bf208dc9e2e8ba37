"""Imperfect senses in a run: what an autopilot sees of other road users, and when its commands take effect."""

from __future__ import annotations

import math
from collections import deque
from random import Random

from pytest_rvads.drivers.interface import Command, Control, Observation
from pytest_rvads.geometry.crosswalks import hides
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Kind, VehicleState, Zone
from pytest_rvads.scenarios.senses import Senses


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
