"""A stand-in for a CARLA server, in CARLA's frame: kinematic vehicles whose boxes touch; written after CARLA's documented API.

It is no CARLA: neither its physics, nor its timing, nor its errors were compared with a server.
"""

import math
from collections.abc import Sequence

DT = 0.01
CENTRE, HALF, SIDE = 0.1, 2.3, 0.93
"""Bounding box of the one blueprint [m]: where its centre is before the location of the actor, and its extents."""
WHEELBASE, STEERING = 2.7, math.radians(70.0)
DRIVE, BRAKE = 3.0, 8.0
"""Acceleration at full throttle, deceleration at full pedal [m/s^2]."""


class Actor:
    def __init__(self, x: float, y: float, yaw: float) -> None:
        self.x, self.y, self.yaw, self.speed = x, y, math.radians(yaw), 0.0
        self.throttle = self.steer = self.brake = 0.0

    def corners(self) -> list[tuple[float, float]]:
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        ends = [(CENTRE + along * HALF, across * SIDE) for along, across in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        return [(self.x + a * cos - b * sin, self.y + a * sin + b * cos) for a, b in ends]

    def move(self) -> None:
        """Drive on: the rear axle follows the heading, which turns to the right for a positive steer (a bicycle without slip)."""
        gain = self.throttle * DRIVE * DT - self.brake * BRAKE * DT
        self.speed = max(self.speed + gain, 0.0)
        back = WHEELBASE / 2 - CENTRE  # from the location to the rear axle, under the middle of the body
        x, y = self.x - back * math.cos(self.yaw), self.y - back * math.sin(self.yaw)
        x, y = x + self.speed * DT * math.cos(self.yaw), y + self.speed * DT * math.sin(self.yaw)
        self.yaw += self.speed * DT * math.tan(self.steer * STEERING) / WHEELBASE
        self.x, self.y = x + back * math.cos(self.yaw), y + back * math.sin(self.yaw)


class LeftHandedServer:
    """Answers what `examples/carla_simulator.py` asks of a client."""

    def __init__(self) -> None:
        self.actors: dict[int, Actor] = {}
        self.made = 0
        self.shown: dict[int, str] = {}
        self.touching: set[tuple[int, int]] = set()

    def box(self, kind: str) -> tuple[float, float, float]:
        return CENTRE, HALF, SIDE

    def spawn(self, kind: str, x: float, y: float, yaw: float) -> int:
        new = Actor(x, y, yaw)
        if any(touch(new, other) for other in self.actors.values()):
            raise RuntimeError("Spawn failed because of collision at spawn position")
        self.made += 1
        self.actors[self.made] = new
        return self.made

    def push(self, actor: int, vx: float, vy: float) -> None:
        self.actors[actor].speed = math.hypot(vx, vy)

    def control(self, actor: int, throttle: float, steer: float, brake: float) -> None:
        self.actors[actor].throttle, self.actors[actor].steer, self.actors[actor].brake = throttle, steer, brake

    def light(self, entrance: int, state: str) -> None:
        self.shown[entrance] = state

    def tick(self) -> None:
        for actor in self.actors.values():
            actor.move()

    def state(self, actor: int) -> tuple[float, float, float, float, float]:
        found = self.actors[actor]
        yaw = math.degrees(math.remainder(found.yaw, math.tau))
        return found.x, found.y, yaw, found.speed * math.cos(found.yaw), found.speed * math.sin(found.yaw)

    def collided(self) -> Sequence[tuple[int, int]]:
        ids = sorted(self.actors)
        return [(a, b) for k, a in enumerate(ids) for b in ids[k + 1 :] if touch(self.actors[a], self.actors[b])]

    def destroy(self, actor: int) -> None:
        del self.actors[actor]


def touch(one: Actor, two: Actor) -> bool:
    """Return whether two boxes overlap: no axis of either separates them."""
    if math.hypot(one.x - two.x, one.y - two.y) > 2 * (HALF + SIDE + CENTRE):
        return False
    for yaw in (one.yaw, one.yaw + math.pi / 2, two.yaw, two.yaw + math.pi / 2):
        first, second = ([x * math.cos(yaw) + y * math.sin(yaw) for x, y in actor.corners()] for actor in (one, two))
        if max(first) < min(second) or max(second) < min(first):
            return False
    return True
