"""The messages of the protocol, as JSON lines.

============  =========================================================================================================
message       content
============  =========================================================================================================
hello         both ways, always JSON; the stack answers with its name, version, format (``json`` or ``binary``) and rate
reset         a new scenario: map, itinerary, vehicle; answered by ready
observe       what the vehicle sees; answered by command
bye           the end; the stack exits
============  =========================================================================================================
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

from pytest_rvads.drivers.commands import Acceleration, Command, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.stacks.child import StackError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.segment import Pose, Segment
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import VehicleState

__all__ = ["VERSION", "Answer", "Json", "hello", "parse", "reset", "stray"]

VERSION = 1
"""Of the protocol; a stack of another version is refused."""
Answer = tuple[Command, float | None, Any]
"""A command, the compute time that the stack reports [s], if it does, and the step it answers."""
_KINDS = "throttle, brake and steering; target_speed; acceleration; or trajectory"


def hello() -> bytes:
    """Return the first message."""
    return _line({"type": "hello", "protocol": "rvads", "version": VERSION})


def parse(line: bytes, kind: str) -> dict[str, Any]:
    """Return a message of the stack.

    Raises:
        StackError: no JSON object, or another type than `kind`.
    """
    try:
        found = json.loads(line)
    except ValueError:
        found = None
    if not isinstance(found, dict) or "type" not in found:
        raise StackError(stray(line))
    if found["type"] != kind:
        raise StackError(f"it sent a message of type {str(found['type'])[:40]!r}, expected {kind!r}")
    return found


def stray(data: bytes) -> str:
    """Return what to say of output that is no message."""
    text = data[:60].decode(errors="replace")
    return f"it wrote {text!r} to its standard output, which carries the protocol: print to standard error instead"


def reset(seen: Observation, period: float) -> dict[str, Any]:
    """Return the content of the reset message for the run that begins with `seen`.

    Args:
        seen: the first observation.
        period: time between two observations [s].
    """
    itinerary, vehicle = seen.itinerary, seen.vehicle
    return {
        "type": "reset",
        "name": seen.me.name,
        "period": period,
        "speed_limit": seen.speed_limit,
        "vehicle": {
            "length": vehicle.length,
            "width": vehicle.width,
            "wheelbase": vehicle.wheelbase,
            "rear_axle_offset": vehicle.rear_axle_offset,
            "drive": vehicle.drive,
            "brake": vehicle.brake[seen.aggression - 1],
            "steering_limit": vehicle.steering_limit,
            "steering_rate": vehicle.steering_rate,
        },
        "itinerary": {
            "entrance": itinerary.entrance,
            "exit": itinerary.exit,
            "turn": itinerary.turn.value,
            "line": itinerary.line,
            "length": itinerary.length,
            "end": itinerary.end,
            "path": _path(itinerary),
        },
        "map": _map(seen.junction),
    }


def _path(itinerary: Itinerary) -> tuple[tuple[float, float, float, float], ...]:
    """Return the centre line of an itinerary by the metre: station, x, y [m], heading [rad]."""
    first = -itinerary.origin
    stations = [first + k for k in range(int(itinerary.end - first))] + [itinerary.end]
    return tuple((s, *itinerary.pose(s)) for s in stations)


class Json:
    """The format ``json``: every message one line."""

    bye = b'{"type": "bye"}\n'

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset message."""
        return _line(content)

    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe message; steps count from 1 in every scenario."""
        content = {
            "type": "observe",
            "step": step,
            "time": seen.time,
            "me": _vehicle(seen.me),
            "others": [_vehicle(other) for other in seen.others],
            "lights": [colour.name.lower() for colour in seen.lights],
        }
        return _line(content)

    def command(self, line: bytes) -> Answer:
        """Return the answer in a line.

        Raises:
            StackError: the line is not a command.
        """
        content = parse(line, "command")
        compute = content.get("compute")
        if compute is not None and not isinstance(compute, int | float):
            raise StackError(f"its command has a compute time of type {type(compute).__name__}, expected seconds")
        return _command(content), compute, content.get("step")


def _command(content: dict[str, Any]) -> Command:
    # Whether the values are numbers in range is for the seat to say: it says so of every autopilot.
    if "trajectory" in content:
        points = content["trajectory"]
        if not isinstance(points, list):
            return Trajectory(points)
        return Trajectory(tuple(Waypoint(*p) if isinstance(p, list) and len(p) == 3 else p for p in points))
    if "target_speed" in content:
        return TargetSpeed(content["target_speed"])
    if "acceleration" in content:
        return Acceleration(content["acceleration"], content.get("steering"))
    if content.keys() & {"throttle", "brake", "steering"}:
        return Control(*(content.get(name, 0.0) for name in Control._fields))
    raise StackError(f"its command says nothing: expected {_KINDS}")


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def _vehicle(state: VehicleState) -> dict[str, Any]:
    values = state._asdict()
    values["turn"] = state.turn.value
    values["zone"] = state.zone.name.lower()
    return values


@lru_cache(maxsize=64)
def _map(junction: Junction) -> dict[str, Any]:
    """Return a junction as builtins: what regulates it, who has the right of way, where its lanes are."""
    return {
        "junction": junction.name,
        "control": junction.control.value,
        "left_hand": junction.left_hand,
        "setbacks": list(junction.setbacks),
        "right_of": sorted(junction.right_of),
        "opposite": sorted(junction.opposite),
        "movements": [
            {
                "entrance": m.entrance,
                "exit": m.exit,
                "turn": m.turn.value,
                "length": m.length,
                "path": _points(m.path),
            }
            for m in junction.movements.values()
        ],
        "approaches": [_points(entrance.approach) for entrance in junction.entrances],
        "exits": [_points(exit.road) for exit in junction.exits],
    }


def _points(segment: Segment | None) -> list[Pose]:
    """Return x, y [m], heading [rad] along a centre line, by two metres; nothing where it is not known."""
    if segment is None:
        return []
    stations = [float(s) for s in range(0, int(segment.length), 2)] + [segment.length]
    return [segment.pose(s) for s in stations]
