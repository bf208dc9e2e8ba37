"""The messages of the protocol as JSON lines, and the content of the message ``reset``.

============  =========================================================================================================
message       content
============  =========================================================================================================
hello         to the stack, always JSON; the stack answers hello with its name, version, format (``json`` or ``binary``) and rate,
              and says whether it reads pedestrians
reset         a new scenario: map, itinerary, vehicle; the stack answers ready
observe       the observation of the vehicle; the stack answers command
bye           the end; the stack exits
============  =========================================================================================================
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

from msgspec import MsgspecError, Struct, convert, defstruct
from msgspec.json import Decoder, Encoder

from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.geometry.conflicts import Stretch
from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.runs.states import NUMBERS, Colour, VehicleState, Zone, numbers

VERSION = 2
"""Version of the protocol; a stack of another version is refused."""
_POINTS = 10_000
"""Largest number of points of a trajectory."""
_KINDS = "throttle, brake and steering; target_speed; acceleration; or trajectory"
_ZONES = tuple(zone.name.lower() for zone in Zone)
_SIDES = tuple(side.value for side in Side)
_COLOURS = tuple(colour.name.lower() for colour in Colour)


class Hello(Struct, tag_field="type", tag="hello"):
    """The message ``hello`` of a stack, its first message."""

    version: int
    format: str = "json"
    rate: float | None = None
    """Number of decisions that the stack wants to make per simulated second [Hz]; None if it has no wish."""
    pedestrians: bool = False
    """Whether the stack reads pedestrians and crosswalks; a stack that does not read them is not told of them."""


class Ready(Struct, tag_field="type", tag="ready"):
    """The message ``ready`` of a stack that has prepared for the scenario."""


class Answer(Struct, tag_field="type", tag="command"):
    """The message ``command`` of a stack; the simulation checks the ranges of its values, as for every autopilot."""

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
        """Return the single command in the message."""
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
    """Return the message ``hello``, the first message to a stack."""
    return _encode({"type": "hello", "protocol": "rvads", "version": VERSION}) + b"\n"


def read(line: bytes, kind: type[_Message]) -> _Message:
    """Return the message of the stack that a line holds."""
    try:
        message = _decode(line)
    except (MsgspecError, ValueError, RecursionError):
        message = None
    if isinstance(message, kind):
        return message
    expected = str(kind.__struct_config__.tag)  # what follows also reads values that strict JSON lacks, such as NaN
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
    """Return the text of the error about bytes in the output of a stack that are no message."""
    return f"it wrote {quoted(data)} to its standard output, which carries the protocol: print to standard error instead"


def quoted(data: bytes) -> str:
    """Return the beginning of the output of a stack in quotation marks."""
    return repr(data[:60].decode(errors="replace"))


def reset(seen: Observation, period: float, pedestrians: bool = False) -> dict[str, Any]:
    """Return the content of ``reset`` for the run that begins with `seen`, with an observation per `period` [s], as builtins."""
    itinerary, vehicle = seen.itinerary, seen.vehicle
    first = -itinerary.origin
    stations = [first + k for k in range(int(itinerary.end - first))] + [itinerary.end]  # a point per metre, and the end
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
            "path": tuple((s, *itinerary.pose(s)) for s in stations),
        },
        "map": _map(seen.junction) | (_crosswalks(seen.junction.walked) if pedestrians else {}),
    }


@lru_cache(maxsize=64)
def _map(junction: Junction) -> dict[str, Any]:
    """Return a junction as builtins: its arms, lanes, signs, lights and centre lines, and which movement yields to which."""
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
                **({"no_turn_on_red": True} if e.no_turn_on_red else {}),
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


@lru_cache(maxsize=64)
def _crosswalks(junction: Junction) -> dict[str, Any]:
    """Return the crosswalks of a walked junction as builtins, and where movements lead over crosswalks."""
    index = {key: number for number, key in enumerate(junction.movements)}
    covers = []
    for (number, key), stretch in sorted(junction.covers.items()):
        shared = (junction.stretches or {}).get((key, junction.further[2 * number].way.key))
        walk = shared.yours if shared else Stretch(0.0, junction.crossings[number].path.length)
        covers.append({"crosswalk": number, "movement": index[key], "start": stretch.start, "end": stretch.end})
        covers[-1] |= {"walk_start": walk.start, "walk_end": walk.end}
    return {
        "crosswalks": [
            {
                "arm": c.arm,
                "phase": c.phase,
                "length": c.path.length,
                "middle": c.middle,
                "island": c.island,
                "area": c.area.tolist(),
                "path": c.path.points.tolist(),
            }
            for c in junction.crossings
        ],
        "covers": covers,
    }


def _points(segment: Segment | None) -> list[Pose]:
    """Return x, y [m] and heading [rad] along a centre line with a point per 2 m; no points without a centre line."""
    if segment is None:
        return []
    stations = [float(s) for s in range(0, int(segment.length), 2)] + [segment.length]
    return [segment.pose(s) for s in stations]


class Beside(NamedTuple):
    """An agent on a crosswalk or beside it: a pedestrian, or a vehicle that is parked before the crosswalk."""

    state: VehicleState
    crosswalk: int
    side: int
    """0 for an agent that comes from the near side of the crosswalk, 1 for an agent from the far side."""


class Format(ABC):
    """Encodes and decodes the messages about a scenario, and remembers its numbers of vehicles and lanes of entrances.

    For a stack that reads no pedestrians, the messages are those of a scenario without pedestrians.
    """

    bye: bytes

    def __init__(self, pedestrians: bool = False) -> None:
        self.pedestrians = pedestrians
        self._ids: dict[str, int] = {}
        self._lanes: list[int] = []
        self._crosswalks = 0

    def begin(self, content: dict[str, Any]) -> bytes:
        """Begin a scenario: forget the numbers of vehicles, and return the message ``reset`` with a content made by `reset`."""
        self._ids.clear()
        self._lanes = [entrance["lane"] for entrance in content["map"]["entrances"]]
        self._crosswalks = len(content["map"].get("crosswalks", ()))
        return self.reset(content)

    @abstractmethod
    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the message ``reset`` in this format, given its content."""

    @abstractmethod
    def ready(self, child: Child, limit: float) -> None:
        """Wait for the message ``ready`` of the stack, at most `limit` seconds of real time."""

    @abstractmethod
    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the message ``observe`` in this format; `step` counts the observations of a scenario from 1."""

    @abstractmethod
    def answer(self, child: Child, limit: float) -> tuple[Command, float | None, int | None]:
        """Return the next command, and compute time [s] and step of the answered observation, None if not reported."""

    def others(self, seen: Observation) -> list[VehicleState]:
        """Return the other vehicles that came from an entrance."""
        return [other for other in seen.others if other.entrance < len(self._lanes)]

    def lights(self, seen: Observation) -> tuple[Colour, ...]:
        """Return the colours of the lights at the entrances."""
        return seen.lights[: len(self._lanes)]

    def walks(self, seen: Observation) -> list[Colour]:
        """Return the colour of the pedestrian light of each crosswalk: green for WALK, yellow for flashing DON'T WALK."""
        return list(seen.lights[len(self._lanes) :][: 2 * self._crosswalks : 2]) or [Colour.NONE] * self._crosswalks

    def beside(self, seen: Observation) -> tuple[list[Beside], list[Beside]]:
        """Return the pedestrians, and the vehicles that are parked before a crosswalk; see `Junction.walked` for the numbers."""
        count, rows = self._crosswalks, [(other, other.entrance - len(self._lanes)) for other in seen.others]
        return (
            [Beside(other, *divmod(way, 2)) for other, way in rows if 0 <= way < 2 * count],
            [Beside(other, way - 2 * count, 0) for other, way in rows if 2 * count <= way < 3 * count],
        )

    def number(self, state: VehicleState) -> int:
        """Return the number of a vehicle in messages: 0 for the driven vehicle, and 1, 2, ... in the order of observation."""
        return self._ids.setdefault(state.name, len(self._ids))


class Json(Format):
    """The format ``json``: every message is a line of JSON text."""

    bye = b'{"type":"bye"}\n'

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the message ``reset`` as a line of JSON."""
        return _encode(content) + b"\n"

    def ready(self, child: Child, limit: float) -> None:
        """Wait for the message ``ready``, at most `limit` seconds of real time."""
        read(child.line(limit), Ready)

    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe message; steps count from 1 in every scenario."""
        lanes = self._lanes
        me, *others = [
            _Seen(self.number(s), s.name, s.kind.value, s.entrance, lanes[s.entrance], s.turn.value, _ZONES[s.zone], *numbers(s))
            for s in (seen.me, *self.others(seen))
        ]
        content: dict[str, Any] = {
            "type": "observe",
            "step": step,
            "time": seen.time,
            "me": me,
            "others": others,
            "lights": [_COLOURS[colour] for colour in self.lights(seen)],
        }
        if self.pedestrians:
            content["pedestrians"], content["parked"] = (
                [
                    _Beside(self.number(s), s.name, s.kind.value, crosswalk, _SIDES[side], _ZONES[s.zone], *numbers(s))
                    for s, crosswalk, side in agents
                ]
                for agents in self.beside(seen)
            )
            content["walks"] = [_COLOURS[colour] for colour in self.walks(seen)]
        return _encode(content) + b"\n"

    def answer(self, child: Child, limit: float) -> tuple[Command, float | None, int | None]:
        """Return the command in the next line, the compute time that the stack reports [s], and the answered step."""
        message = read(child.line(limit), Answer)
        return message.command(), message.compute, message.step


_WHO = (("id", int), ("name", str), ("kind", str))
_MEASURED = tuple((name, float) for name in NUMBERS)
_Seen = defstruct("_Seen", (*_WHO, ("entrance", int), ("lane", int), ("turn", str), ("zone", str), *_MEASURED), gc=False)
"""What the message ``observe`` says about one vehicle."""
_Beside = defstruct("_Beside", (*_WHO, ("crosswalk", int), ("side", str), ("zone", str), *_MEASURED), gc=False)
"""What the message ``observe`` says about a pedestrian, or a vehicle that is parked before a crosswalk."""
