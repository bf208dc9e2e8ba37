"""Tracks in the trajectory log of autoware-carla-scenario: a record of JSON per line, in CARLA's left-handed frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pytest_rvads.decoding import decode, typed
from pytest_rvads.errors import RunError
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened

__all__ = ["read_carla"]

_COLUMNS = {"x": "actors", "y": "actors", "heading": "actors", "speed": "actors", "time": "t", "size": "extent"}
_COLOURS = {"Green": Colour.GREEN, "Yellow": Colour.YELLOW, "Red": Colour.RED}
_State = tuple[int, float, float, float, float, float, float, float, float, float]
"""Id, x, y, z, roll, pitch, yaw [deg], velocity in x, y, z."""


def read_carla(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return vehicles and lights of a trajectory log, in the frame of its OpenDRIVE map: y and yaw have another sign there.

    Raises:
        RunError: it can't be read, or a record is none; the message names its line.
    """
    if columns:
        raise RunError(f"{path.name}: the fields of a trajectory log are known, leave --columns out")
    with opened(path, watch) as source:
        reader = _Reader(Gather(source.where, _COLUMNS, strict=strict))
        for row, line in enumerate(source.lines(), start=1):
            if line.strip():
                reader.take(row, decode(line, dict[str, Any], f"{source.where}: row {row}", RunError))
        reader.gather.lights = changes_of(reader.shown)
        return reader.gather.log()


class _Reader:
    """Takes records one by one."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.shown: dict[str, list[tuple[float, Colour]]] = {}
        self._changes = 0
        self._ids: dict[str, str] = {}
        self._known: dict[int, tuple[tuple[float, float], Kind, float]] = {}
        """Size, kind, and how far ahead the front is [m], by id."""

    def take(self, row: int, record: dict[str, Any]) -> None:
        where = f"{self.gather.where}: row {row}"
        kind = record.get("type")
        if kind == "actor":
            self._actor(record, where)
        elif kind == "traffic_light":
            self._ids[str(record.get("id"))] = typed(record.get("opendrive_id"), str, f"{where}, column opendrive_id", RunError)
        elif kind == "tick":
            self._tick(row, record, where)

    def _actor(self, record: dict[str, Any], where: str) -> None:
        number = typed(record.get("id"), int, f"{where}, column id", RunError)
        half = typed(record.get("extent"), list[float], f"{where}, column extent", RunError)
        centre = typed(record.get("center"), list[float], f"{where}, column center", RunError)
        if len(half) != 3 or len(centre) != 3:
            raise RunError(f"{where}: extent and center must be three numbers each, got {half!r:.60} and {centre!r:.60}")
        blueprint = typed(record.get("type_id"), str, f"{where}, column type_id", RunError)
        self._known[number] = (2 * half[0], 2 * half[1]), kind_of(blueprint), centre[0] + half[0]

    def _tick(self, row: int, record: dict[str, Any], where: str) -> None:
        time = typed(record.get("t"), float, f"{where}, column t", RunError)
        for number, x, y, _, _, _, yaw, vx, vy, _ in typed(
            record.get("actors"), list[_State], f"{where}, column actors", RunError
        ):
            if number not in self._known:
                self.gather.refuse(str(number), row, "actors", f"no record of an actor {number} comes before")
            heading = math.radians(-yaw)
            forward = vx * math.cos(heading) - vy * math.sin(heading)
            if self.gather.add(str(number), row, (time, x, -y, heading, forward)) and number in self._known:
                self.gather.describe(str(number), *self._known[number])
        lights = typed(record.get("lights") or {}, dict[str, str], f"{where}, column lights", RunError)
        for light, state in lights.items():
            if name := self._ids.get(light):
                colour, before = _COLOURS.get(state, Colour.NONE), self.shown.setdefault(name, [])
                if not before or before[-1][1] is not colour:
                    before.append((time, colour))
                    self._changes += 1
                    limit_lights(self._changes, len(self.shown), where)
