"""Behaviour to order: controllers that are lawful but for one thing, traffic with a part for everybody."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest_rvads as rvads
from pytest_rvads.drivers.follower import STANDING, Track, lookahead, pursue, track
from pytest_rvads.drivers.reference import Gate

__all__ = ["REFERENCE", "OnCentreLine", "beside", "cast", "gated", "lawful", "lawful_at", "paced", "stops_at", "timed"]

Seen = rvads.Observation
REFERENCE = rvads.traffic("reference")


class OnCentreLine(rvads.Reference):
    """Keeps its rear axle on the centre line, also in a bend in which a wider arc would keep its body in the lane."""

    def track(self, seen: Seen) -> Track:
        self._track = track(seen.itinerary, seen.vehicle.rear_axle_offset)
        return self._track


def paced(speed: Callable[[Seen], float], name: str = "Paced") -> type[rvads.Follower]:
    """Return a controller that follows its way at the speed [m/s] that a function gives, and looks at nothing else."""
    return type(name, (rvads.Follower,), {"target_speed": lambda _self, seen: speed(seen)})


def timed(*speeds: tuple[float, float]) -> type[rvads.Follower]:
    """Return a controller that drives by the clock: (from when on [s], how fast [m/s]), in order."""
    return paced(lambda seen: [v for t, v in speeds if seen.time >= t - 1e-9][-1], "Timed")


def lawful(speed: Callable[[Seen], float]) -> type[rvads.Reference]:
    """Return the reference autopilot with another speed to aim at [m/s]."""
    return type("Lawful", (rvads.Reference,), {"target_speed": lambda _self, seen: min(speed(seen), seen.speed_limit)})


def lawful_at(station: float, speed: float, *, since: float = 0.0, until: float = math.inf) -> type[rvads.Reference]:
    """Return the reference autopilot which from a station [m] on, and for a while [s], aims at a speed of its own [m/s]."""
    return lawful(lambda seen: speed if seen.me.station >= station and since <= seen.time < until else math.inf)


def gated(allows: Callable[[Seen], bool], speed: Callable[[Seen], float] = lambda _seen: math.inf) -> type[rvads.Reference]:
    """Return the reference autopilot which enters when a function says so, whatever the law says."""

    class Constant:
        def allows(self, seen: Seen) -> bool:
            return allows(seen)

    def make_gate(_self: Any, _seen: Seen) -> Gate:
        return Constant()

    return type("Gated", (lawful(speed),), {"make_gate": make_gate})


def stops_at(station: float, go: float = math.inf, speed: float = 8.0) -> type[rvads.Follower]:
    """Return a controller that stops with its front at a station [m], goes on at a time [s], and looks at nobody."""

    class Stops(rvads.Follower):
        def target_speed(self, seen: Seen) -> float:
            return speed if seen.time >= go else min(speed, self.stopping_speed(station - seen.me.station, 1.0))

    return Stops


def beside(offset: float, speed: float = 6.0) -> type[rvads.Follower]:
    """Return a controller that drives beside its way, this far to the left [m]."""

    class Beside(rvads.Follower):
        def target_speed(self, seen: Seen) -> float:
            return speed

        def steer(self, seen: Seen) -> float:
            me, vehicle = seen.me, seen.vehicle
            ahead = seen.itinerary.pose(me.station - vehicle.rear_axle_offset + 2.0 * lookahead(me.speed))
            x, y = ahead.x - offset * math.sin(ahead.heading), ahead.y + offset * math.cos(ahead.heading)
            if me.speed > STANDING:
                self._steering = pursue(me, vehicle.rear_axle_offset, vehicle.wheelbase, x, y)
            return self._steering

    return Beside


def cast(**parts: Callable[[], Any]) -> Callable[[], Any]:
    """Return traffic in which everybody has a part of its own, by name."""

    class Cast:
        def autopilots(self, agents: Sequence[rvads.Agent]) -> list[Any]:
            return [parts[agent.name]() for agent in agents]

    return Cast
