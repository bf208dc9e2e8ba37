"""The messages of the protocol as JSON lines, and the content of the message ``reset``.

============  =========================================================================================================
message       content
============  =========================================================================================================
hello         both ways, always JSON; the stack answers with its name, version, format (``json`` or ``binary``) and rate
reset         a new scenario: map, itinerary, vehicle; answered by ready
observe       the observation of the vehicle; answered by command
bye           the end; the stack exits
============  =========================================================================================================
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, TypeVar

from msgspec import MsgspecError, Struct, convert
from msgspec.json import Decoder, Encoder

from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import Colour, VehicleState, Zone

__all__ = ["VERSION", "Format", "Hello", "Json", "hello", "quoted", "read", "reset", "stray"]

VERSION = 2
"""Version of the protocol; a stack of another version is refused."""
_POINTS = 10_000
"""Most points of a trajectory."""
_KINDS = "throttle, brake and steering; target_speed; acceleration; or trajectory"
_ZONES = tuple(zone.name.lower() for zone in Zone)
_COLOURS = tuple(colour.name.lower() for colour in Colour)


class Hello(Struct, tag_field="type", tag="hello"):
    """The first message of a stack."""

    version: int
    format: str = "json"
    rate: float | None = None
    """Decisions per simulated second [Hz]."""


class Ready(Struct, tag_field="type", tag="ready"):
    """The message of a stack that is ready for the scenario."""


class Answer(Struct, tag_field="type", tag="command"):
    """The message ``command``; the seat checks the ranges of its values, as for every autopilot."""

    step: int | None = None
    """Step of the observation that the command answers."""
    compute: float | None = None
    """Compute time that the stack reports [s]."""
    throttle: float | None = None
    brake: float | None = None
    steering: float | None = None
    target_speed: float | None = None
    acceleration: float | None = None
    trajectory: tuple[Waypoint, ...] | None = None

    def command(self) -> Command:
        """Return the command in the message.

        Raises:
            StackError: the message has no command or several commands.
        """
        parts = [name for name in ("trajectory", "target_speed", "acceleration") if getattr(self, name) is not None]
        parts += ["throttle or brake"] if not (self.throttle is self.brake is None) else []
        if len(parts) > 1:
            raise StackError(f"its command says {' and '.join(parts)}: expected {_KINDS}")
        if self.trajectory is not None:
            if len(self.trajectory) > _POINTS:
                raise StackError(f"its trajectory has {len(self.trajectory)} points, expected at most {_POINTS}")
            return Trajectory(self.trajectory)
        if self.target_speed is not None:
            return TargetSpeed(self.target_speed)
        if self.acceleration is not None:
            return Acceleration(self.acceleration, self.steering)
        if self.throttle is self.brake is self.steering is None:
            raise StackError(f"its command says nothing: expected {_KINDS}")
        return Control(self.throttle or 0.0, self.brake or 0.0, self.steering or 0.0)


_encode = Encoder().encode


_decode = Decoder(Hello | Ready | Answer).decode


_Message = TypeVar("_Message", Hello, Ready, Answer)


def hello() -> bytes:
    """Return the first message."""
    return _encode({"type": "hello", "protocol": "rvads", "version": VERSION}) + b"\n"


def read(line: bytes, kind: type[_Message]) -> _Message:
    """Return a message of the stack.

    Raises:
        StackError: the line is no JSON object, a message of another type than `kind`, or has a field of the wrong type.
    """
    try:
        message = _decode(line)
    except (MsgspecError, ValueError, RecursionError):
        message = None
    return message if isinstance(message, kind) else _read_leniently(line, kind)


def _read_leniently(line: bytes, kind: type[_Message]) -> _Message:
    """Return a message with values beyond strict JSON, such as NaN, or raise an error that explains the fault."""
    expected = str(kind.__struct_config__.tag)
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or "type" not in content:
        raise StackError(stray(line))
    if content["type"] != expected:
        raise StackError(f"it sent a message of type {content['type']!r:.40}, expected {expected!r}")
    try:
        return convert(content, kind)
    except (MsgspecError, ValueError, OverflowError) as error:
        raise StackError(f"its {expected} is not as the protocol has it: {error}") from None


def stray(data: bytes) -> str:
    """Return the text of the error about output that is no message."""
    return f"it wrote {quoted(data)} to its standard output, which carries the protocol: print to standard error instead"


def quoted(data: bytes) -> str:
    """Return the beginning of output in quotation marks."""
    return repr(data[:60].decode(errors="replace"))


def reset(seen: Observation, period: float) -> dict[str, Any]:
    """Return the content of the reset message for the run that begins with `seen`.

    Args:
        seen: the first observation of the run.
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
            "speed_limits": [(at, itinerary.limit_at(at)) for at, _ in itinerary.limits or ((-itinerary.origin, None),)],
            "path": _path(itinerary),
        },
        "map": _map(seen.junction),
    }


def _path(itinerary: Itinerary) -> tuple[tuple[float, float, float, float], ...]:
    """Return the centre line of an itinerary with a point per metre: station, x, y [m], heading [rad]."""
    first = -itinerary.origin
    stations = [first + k for k in range(int(itinerary.end - first))] + [itinerary.end]
    return tuple((s, *itinerary.pose(s)) for s in stations)


@lru_cache(maxsize=64)
def _map(junction: Junction) -> dict[str, Any]:
    """Return a junction as builtins: its arms, lanes, signs and lights, the yields between movements, and the centre lines."""
    index = {key: number for number, key in enumerate(junction.movements)}
    between = {pair for pair in junction.conflicts or () if junction.movements.keys() >= {*pair}}
    yields = (junction.yields or {}).items()
    reasons = {(index[way], index[prior]): reason.value for (way, prior), reason in yields if (way, prior) in between}
    return {
        "junction": junction.name,
        "control": junction.control.value,
        "left_hand": junction.left_hand,
        "arms": [arm._asdict() for arm in junction.arms],
        "entrances": [
            {
                "arm": e.arm,
                "lane": e.lane,
                "sign": e.sign.value,
                "phase": e.phase,
                "setback": e.setback,
                "sign_setback": e.sign_setback,
                "path": _points(e.approach),
            }
            for e in junction.entrances
        ],
        "exits": [{"arm": e.arm, "lane": e.lane, "path": _points(e.road)} for e in junction.exits],
        "right_of": sorted(junction.right_of),
        "opposite": sorted(junction.opposite),
        "movements": [
            {"entrance": m.entrance, "exit": m.exit, "turn": m.turn.value, "length": m.length, "path": _points(m.path)}
            for m in junction.movements.values()
        ],
        "conflicts": sorted((index[a], index[b]) for a, b in between),
        "yields": sorted(reasons),
        "reasons": [reasons[pair] for pair in sorted(reasons)],
    }


def _points(segment: Segment | None) -> list[Pose]:
    """Return x, y [m] and heading [rad] along a centre line with a point per 2 m; no points without a centre line."""
    if segment is None:
        return []
    stations = [float(s) for s in range(0, int(segment.length), 2)] + [segment.length]
    return [segment.pose(s) for s in stations]


class Format(ABC):
    """Encodes and decodes the messages of a scenario.

    A format stores the numbers of the vehicles and the lanes of the entrances of the scenario.
    """

    bye: bytes

    def __init__(self) -> None:
        self._ids: dict[str, int] = {}
        self._lanes: list[int] = []

    def begin(self, content: dict[str, Any]) -> bytes:
        """Return the reset message from its content, see the function `reset`; the numbers of vehicles start again."""
        self._ids.clear()
        self._lanes = [entrance["lane"] for entrance in content["map"]["entrances"]]
        return self.reset(content)

    @abstractmethod
    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset message in this format."""

    @abstractmethod
    def ready(self, child: Child, limit: float) -> None:
        """Wait until the stack is ready, at most `limit` seconds."""

    @abstractmethod
    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe message; steps count from 1 in every scenario."""

    @abstractmethod
    def answer(self, child: Child, limit: float) -> tuple[Command, float | None, int | None]:
        """Return the next command, the reported compute time [s], and the step of its observation; None if not reported."""

    def number(self, state: VehicleState) -> int:
        """Return the number of a vehicle: the driven vehicle is 0, other vehicles count on in the order of first observation."""
        return self._ids.setdefault(state.name, len(self._ids))


class Json(Format):
    """The format ``json``: every message is a line."""

    bye = b'{"type":"bye"}\n'

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset message."""
        return _encode(content) + b"\n"

    def ready(self, child: Child, limit: float) -> None:
        """Wait for the message ``ready``, at most `limit` seconds."""
        read(child.line(limit), Ready)

    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe message; steps count from 1 in every scenario."""
        content = {
            "type": "observe",
            "step": step,
            "time": seen.time,
            "me": self._vehicle(seen.me),
            "others": [self._vehicle(other) for other in seen.others],
            "lights": [_COLOURS[colour] for colour in seen.lights],
        }
        return _encode(content) + b"\n"

    def answer(self, child: Child, limit: float) -> tuple[Command, float | None, int | None]:
        """Return the command, the reported compute time [s] and the step in the next line."""
        message = read(child.line(limit), Answer)
        return message.command(), message.compute, message.step

    def _vehicle(self, state: VehicleState) -> _Seen:
        name, entrance, turn, zone = state[:4]
        lane = self._lanes[entrance]
        # The fields from station to width have the same order in both types.
        return _Seen(self.number(state), name, state.kind.value, entrance, lane, turn.value, _ZONES[zone], *state[4:12])


class _Seen(Struct, gc=False):
    """A vehicle in the message ``observe``."""

    id: int
    name: str
    kind: str
    entrance: int
    lane: int
    turn: str
    zone: str
    station: float
    x: float
    y: float
    heading: float
    speed: float
    acceleration: float
    length: float
    width: float
