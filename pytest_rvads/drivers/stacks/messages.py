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
from abc import ABC, abstractmethod
from typing import Any, TypeVar

from msgspec import MsgspecError, Struct, convert
from msgspec.json import Decoder, Encoder

from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.runs.states import Colour, VehicleState, Zone

__all__ = ["VERSION", "Format", "Hello", "Json", "hello", "quoted", "read", "stray"]

VERSION = 2
"""Of the protocol; a stack of another version is refused."""
_POINTS = 10_000
"""Of a trajectory, at most."""
_KINDS = "throttle, brake and steering; target_speed; acceleration; or trajectory"
_ZONES = tuple(zone.name.lower() for zone in Zone)
_COLOURS = tuple(colour.name.lower() for colour in Colour)


class Hello(Struct, tag_field="type", tag="hello"):
    """What a stack says first."""

    version: int
    format: str = "json"
    rate: float | None = None
    """Decisions per simulated second that it wants [Hz]."""


class Ready(Struct, tag_field="type", tag="ready"):
    """A stack has taken in the scenario."""


class Answer(Struct, tag_field="type", tag="command"):
    """A command; whether its values are in range is for the seat to say: it says so of every autopilot."""

    step: int | None = None
    """Of the observation that it answers."""
    compute: float | None = None
    """Time that the stack says it took [s]."""
    throttle: float | None = None
    brake: float | None = None
    steering: float | None = None
    target_speed: float | None = None
    acceleration: float | None = None
    trajectory: tuple[Waypoint, ...] | None = None

    def command(self) -> Command:
        """Return what to do.

        Raises:
            StackError: it says nothing, or too much.
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
        StackError: no JSON object, another type of message than `kind`, or a field of the wrong sort.
    """
    try:
        found = _decode(line)
    except (MsgspecError, ValueError, RecursionError):
        found = None
    return found if isinstance(found, kind) else _closely(line, kind)


def _closely(line: bytes, kind: type[_Message]) -> _Message:
    """Return a message that is no JSON by the book, NaN is not, or say what is wrong with it."""
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
    """Return what to say of output that is no message."""
    return f"it wrote {quoted(data)} to its standard output, which carries the protocol: print to standard error instead"


def quoted(data: bytes) -> str:
    """Return the beginning of some output, to be shown."""
    return repr(data[:60].decode(errors="replace"))


class _Seen(Struct, gc=False):
    """A vehicle as the message ``observe`` has it."""

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


class Format(ABC):
    """Encodes and decodes the messages of a scenario, with the numbers of vehicles and the lanes of entrances."""

    bye: bytes

    def __init__(self) -> None:
        self._ids: dict[str, int] = {}
        self._lanes: list[int] = []

    def begin(self, content: dict[str, Any]) -> bytes:
        """Return the reset message, from the content that `place.reset` makes; vehicles are numbered anew."""
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
        """Return the next command, the compute time that the stack reports [s], and the step it answers, where it says so."""

    def number(self, state: VehicleState) -> int:
        """Return the number of a vehicle: the own one is 0, the others count on in the order in which they are first seen."""
        return self._ids.setdefault(state.name, len(self._ids))


class Json(Format):
    """The format ``json``: every message one line."""

    bye = b'{"type":"bye"}\n'

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset message."""
        return _encode(content) + b"\n"

    def ready(self, child: Child, limit: float) -> None:
        """Wait for the line that says so."""
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
        """Return what the next line says."""
        found = read(child.line(limit), Answer)
        return found.command(), found.compute, found.step

    def _vehicle(self, state: VehicleState) -> _Seen:
        name, entrance, turn, zone = state[:4]
        lane = self._lanes[entrance]
        # All that follows, from station to width, is told as it is.
        return _Seen(self.number(state), name, state.kind.value, entrance, lane, turn.value, _ZONES[zone], *state[4:12])
