"""The messages of the protocol as little-endian binary frames; ``clients/c/rvads.h`` declares the same frames as C structs.

A frame is a header of two unsigned 32-bit integers, kind and size, followed by `size` bytes. Commands have a fixed size. An
observation ends with a struct per vehicle. The structs have no padding. Frames for a stack that reads pedestrians go on with
crosswalks and pedestrians.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any

from msgspec import json

from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.drivers.stacks import messages
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import NUMBERS, Kind, VehicleState, numbers

RESET, READY, OBSERVE, COMMAND, BYE = 1, 2, 3, 4, 5
ENTRANCES, OTHERS, POINTS = 32, 63, 64
"""Largest numbers of entrances (or exits), of other vehicles, and of points of a trajectory in a frame."""
HEADER = struct.Struct("<2I")
_RESET = struct.Struct("<14I5d8d")
_ENTRANCE, _EXIT = struct.Struct("<3Ii2d"), struct.Struct("<2I")
_MOVEMENT, _PAIR, _POINT = struct.Struct("<4Id"), struct.Struct("<2I"), struct.Struct("<4d")
_YIELD = struct.Struct("<4I")
_SEEN = struct.Struct("<d4I")
NAME = 24
"""Length of the name of a vehicle in a frame [bytes]; the last byte is 0, and a longer name is cut."""
_VEHICLE = struct.Struct(f"<6I{len(NUMBERS)}d{NAME}s")
"""The struct of a vehicle, and the struct of a pedestrian, which has crosswalk and side in place of entrance and lane."""
_CROSSWALK, _COVER, _BESIDE = struct.Struct("<Ii3d"), struct.Struct("<2I4d"), struct.Struct(f"<2I{ENTRANCES}I")
_LIGHTS = struct.Struct(f"<{ENTRANCES}I")
_COMMAND = struct.Struct("<4I4d")
_SIZES = {READY: 0, COMMAND: _COMMAND.size + 3 * 8 * POINTS}
"""Sizes of the bodies of the frames that a stack sends [bytes]."""
_TURNS = {turn: number for number, turn in enumerate((Turn.RIGHT, Turn.STRAIGHT, Turn.LEFT))}
_CONTROLS = {control: number for number, control in enumerate(("stop", "lights", "none", "partial", "yield"))}
_REASONS = {reason: number for number, reason in enumerate(("stated", "sign", "turn", "right", "merge", "undecided"))}
_SIGNS = {sign: number for number, sign in enumerate(("none", "stop", "yield", "priority", "lights"))}
_KINDS = {kind: number for number, kind in enumerate(Kind)}


class Binary(messages.Format):
    """The format ``binary``: every message but ``hello`` is a binary frame."""

    bye = HEADER.pack(BYE, 0)

    def reset(self, content: dict[str, Any]) -> bytes:
        """Return the reset frame: a struct, tables of movements, conflicts, yields and path, and the whole content as JSON."""
        way, place = content["itinerary"], content["map"]
        entrances, exits, crosswalks = place["entrances"], place["exits"], place.get("crosswalks", ())
        if len(crosswalks) > ENTRANCES:
            raise StackError(f"the junction has {len(crosswalks)} crosswalks, {_ROOM.format(ENTRANCES)}")
        if max(len(entrances), len(exits)) > ENTRANCES:
            raise StackError(f"the junction has {len(entrances)} entrances and {len(exits)} exits, {_ROOM.format(ENTRANCES)}")
        text = json.encode(content)
        fixed = _RESET.pack(
            len(place["arms"]),
            len(entrances),
            len(exits),
            _CONTROLS[place["control"]],
            int(place["left_hand"]),
            way["entrance"],
            way["exit"],
            _TURNS[way["turn"]],
            *(len(part) for part in (place["movements"], place["conflicts"], place["yields"], way["path"], text)),
            len(crosswalks),
            content["period"],
            content["speed_limit"],
            way["line"],
            way["length"],
            way["end"],
            *content["vehicle"].values(),
        )
        rows = []
        for e in entrances:
            # Without a setback of the sign, the setback of the stopping line is given twice.
            posted = e["setback"] if e["sign_setback"] is None else e["sign_setback"]
            rows.append((e["arm"], e["lane"], _SIGNS[e["sign"]], -1 if e["phase"] is None else e["phase"], e["setback"], posted))
        body = b"".join(
            (
                fixed,
                _table(_ENTRANCE, rows),
                _table(_EXIT, ((e["arm"], e["lane"]) for e in exits)),
                _relation(place["right_of"]),
                _relation(place["opposite"]),
                *(_MOVEMENT.pack(m["entrance"], m["exit"], _TURNS[m["turn"]], 0, m["length"]) for m in place["movements"]),
                *(_PAIR.pack(*pair) for pair in place["conflicts"]),
                *(
                    _YIELD.pack(*pair, _REASONS[reason], 0)
                    for pair, reason in zip(place["yields"], place["reasons"], strict=True)
                ),
                *(_POINT.pack(*point) for point in way["path"]),
                text,
                *(
                    _CROSSWALK.pack(c["arm"], -1 if c["phase"] is None else c["phase"], c["length"], c["middle"], c["island"])
                    for c in crosswalks
                ),
                *(_COVER.pack(*cover.values()) for cover in place.get("covers", ())),
            )
        )
        return HEADER.pack(RESET, len(body)) + body

    def observe(self, seen: Observation, step: int) -> bytes:
        """Return the observe frame; steps count from 1 in every scenario."""
        others, lights = self.others(seen), self.lights(seen)
        if len(others) > OTHERS:
            raise StackError(f"there are {len(others)} other vehicles, {_ROOM.format(OTHERS)}")
        me, *rows = [self._row(state, state.entrance, self._lanes[state.entrance]) for state in (seen.me, *others)]
        parts = [
            _SEEN.pack(seen.time, step, len(others), len(lights), 0),
            me,
            _LIGHTS.pack(*lights, *[0] * (ENTRANCES - len(lights))),
            *rows,
        ]
        if self.pedestrians:
            (pedestrians, parked), walks = self.beside(seen), self.walks(seen)
            if len(pedestrians) > OTHERS:
                raise StackError(f"there are {len(pedestrians)} pedestrians, {_ROOM.format(OTHERS)}")
            parts.append(_BESIDE.pack(len(pedestrians), len(parked), *walks, *[0] * (ENTRANCES - len(walks))))
            parts += [self._row(*one) for one in (*pedestrians, *parked)]
        body = b"".join(parts)
        return HEADER.pack(OBSERVE, len(body)) + body

    def command(self, body: bytes) -> tuple[Command, float | None, int]:
        """Return the command in a frame, the compute time that the stack reports [s], and the step of the observation."""
        kind, count, step, _, *values, compute = _COMMAND.unpack_from(body)
        command: Command
        match kind:
            case 0:
                command = Control(*values)
            case 1:
                command = TargetSpeed(values[0])
            case 2:
                command = Acceleration(values[0])
            case 3:
                command = Acceleration(*values[:2])
            case 4:
                if count > POINTS:
                    raise StackError(f"its trajectory has {count} points, expected at most {POINTS}")
                points = struct.iter_unpack("<3d", body[_COMMAND.size : _COMMAND.size + 24 * count])
                command = Trajectory(tuple(Waypoint(*point) for point in points))
            case _:
                raise StackError(f"its command is of kind {kind}, expected 0 to 4")
        return command, None if compute < 0 else compute, step

    def ready(self, child: Child, limit: float) -> None:
        """Wait for the frame ``ready``, at most `limit` seconds of real time."""
        _frame(child, READY, limit)

    def answer(self, child: Child, limit: float) -> tuple[Command, float | None, int]:
        """Return the command in the next frame, the compute time that the stack reports [s], and the answered step."""
        return self.command(_frame(child, COMMAND, limit))

    def _row(self, state: VehicleState, place: int, part: int) -> bytes:
        return _VEHICLE.pack(
            self.number(state),
            _KINDS[state.kind],
            place,
            part,
            _TURNS[state.turn],
            state.zone,
            *numbers(state),
            state.name.encode("utf-8", "replace")[: NAME - 1],
        )


def _frame(child: Child, kind: int, limit: float) -> bytes:
    """Return the body of the next frame, whose kind must be `kind`."""
    head = child.exactly(HEADER.size, limit)
    received, size = HEADER.unpack(head)
    if _SIZES.get(received) != size:
        raise StackError(messages.stray(head + child.pending()))
    if received != kind:
        raise StackError(f"it sent a frame of kind {received}, expected {kind}")
    return child.exactly(size, limit)


def _table(row: struct.Struct, rows: Iterable[tuple[Any, ...]]) -> bytes:
    """Return rows of numbers as bytes, with rows of zeros appended up to `ENTRANCES` rows."""
    return b"".join(row.pack(*values) for values in rows).ljust(row.size * ENTRANCES, b"\0")


def _relation(pairs: Iterable[tuple[int, int]]) -> bytes:
    """Return a relation between entrances as a square table of bytes: 1 for pairs in the relation, 0 for all other pairs."""
    table = bytearray(ENTRANCES * ENTRANCES)
    for row, column in pairs:
        table[row * ENTRANCES + column] = 1
    return bytes(table)


_ROOM = "a binary frame has room for {}: let the stack say the format json in its hello"
