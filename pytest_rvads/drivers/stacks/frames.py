"""The messages of the protocol as binary frames, little-endian, for speed; ``clients/c/rvads.h`` has the same as structs.

A frame is a header of two unsigned 32-bit integers, kind and size, then `size` bytes. Observations and commands have a
fixed size. The sizes of the structs leave no padding.
"""

from __future__ import annotations

import json
import struct
from typing import Any

from pytest_rvads.drivers.commands import Acceleration, Command, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.stacks.child import StackError
from pytest_rvads.drivers.stacks.messages import Answer
from pytest_rvads.junctions.junction import JunctionControl
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.states import VehicleState
from pytest_rvads.scenarios.classes import WAYS

__all__ = ["COMMAND", "HEADER", "MOST_POINTS", "READY", "Binary"]

RESET, READY, OBSERVE, COMMAND, BYE = 1, 2, 3, 4, 5
"""Kinds of frames."""
MOST = WAYS[-1]
"""Entrances a frame has room for."""
MOST_POINTS = 64
"""Points of a trajectory a frame has room for."""
HEADER = struct.Struct("<2I")
_RESET = struct.Struct(f"<8I5d8d{MOST}d{2 * MOST * MOST}B")
_SEEN = struct.Struct("<d4I")
_VEHICLE = struct.Struct("<4I8d")
_LIGHTS = struct.Struct(f"<{MOST}I")
_COMMAND = struct.Struct(f"<4I4d{3 * MOST_POINTS}d")
_TURNS = {turn: number for number, turn in enumerate((Turn.RIGHT, Turn.STRAIGHT, Turn.LEFT))}
_CONTROLS = {control: number for number, control in enumerate(JunctionControl)}
_NOBODY = bytes(_VEHICLE.size)


class Binary:
    """The format ``binary``."""

    bye = HEADER.pack(BYE, 0)
    command_size = _COMMAND.size

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset frame: a fixed part, the path of the itinerary by the metre, and the whole content as JSON."""
        way, place = content["itinerary"], content["map"]
        points, ways = way["path"], len(place["setbacks"])
        text = json.dumps(content, separators=(",", ":")).encode()
        pairs = [(i, k) for i in range(MOST) for k in range(MOST)]
        fixed = _RESET.pack(
            ways,
            _CONTROLS[place["control"]],
            int(place["left_hand"]),
            way["entrance"],
            way["exit"],
            _TURNS[Turn(way["turn"])],
            len(points),
            len(text),
            content["period"],
            content["speed_limit"],
            way["line"],
            way["length"],
            way["end"],
            *content["vehicle"].values(),
            *place["setbacks"],
            *[0.0] * (MOST - ways),
            *(pair in place["right_of"] for pair in pairs),
            *(pair in place["opposite"] for pair in pairs),
        )
        body = fixed + b"".join(struct.pack("<4d", *point) for point in points) + text
        return HEADER.pack(RESET, len(body)) + body

    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe frame; steps count from 1 in every scenario."""
        others = seen.others
        lights = [int(colour) for colour in seen.lights]
        body = b"".join(
            (
                _SEEN.pack(seen.time, step, len(others), len(lights), 0),
                _vehicle(seen.me),
                *map(_vehicle, others),
                _NOBODY * (MOST - 1 - len(others)),
                _LIGHTS.pack(*lights, *[0] * (MOST - len(lights))),
            )
        )
        return HEADER.pack(OBSERVE, len(body)) + body

    def command(self, body: bytes) -> Answer:
        """Return the answer in the body of a frame.

        Raises:
            StackError: no such kind of command, or more points than there is room for.
        """
        kind, count, step, _, one, two, three, compute, *points = _COMMAND.unpack(body)
        taken = compute if compute >= 0 else None
        return _command(kind, count, (one, two, three), points), taken, step


def _command(kind: int, count: int, values: tuple[float, float, float], points: list[float]) -> Command:
    match kind:
        case 0:
            return Control(*values)
        case 1:
            return TargetSpeed(values[0])
        case 2:
            return Acceleration(values[0])
        case 3:
            return Acceleration(values[0], values[1])
        case 4 if count <= MOST_POINTS:
            return Trajectory(tuple(Waypoint(*points[3 * k : 3 * k + 3]) for k in range(count)))
        case 4:
            raise StackError(f"its trajectory has {count} points, expected at most {MOST_POINTS}")
    raise StackError(f"its command is of kind {kind}, expected 0 to 4")


def _vehicle(state: VehicleState) -> bytes:
    return _VEHICLE.pack(state.entrance, _TURNS[state.turn], int(state.zone), 0, *state[_FIRST:])


_FIRST = VehicleState._fields.index("station")
