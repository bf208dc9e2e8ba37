"""Tracks in logs of simulators: floating car data of SUMO, and trajectory logs of autoware-carla-scenario.

SUMO writes floating car data as XML by ``--fcd-output``. A trajectory log has a record of JSON per line, in CARLA's left-handed
frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.boundedxml import read_xml
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import RunError

__all__ = ["read_carla", "read_fcd"]


_FCD_COLUMNS = {"speed": "speed", "heading": "angle", "size": "length"}


def read_fcd(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles in floating car data of SUMO; the rows are lines of the file.

    Positions are the middle of the front bumper, and angles are degrees clockwise from north. A file has sizes only if SUMO was
    started with ``--fcd-output.attributes``.

    Raises:
        RunError: the file can't be read, or has a bad row while reading is `strict`.
    """
    if columns:
        raise RunError(f"{path.name}: floating car data of SUMO have fixed attributes, leave --columns out")
    with opened(path, watch) as source:
        reader = _FcdReader(Gather(source.where, _FCD_COLUMNS, strict=strict))
        read_xml(source.chunks(), "floating car data of SUMO", reader.take)
        if not reader.seen:
            raise RunError(
                f"{source.where}: <fcd-export> is missing, expected floating car data of SUMO, written by --fcd-output"
            )
        return reader.gather.log()


class _FcdReader:
    """Adds the vehicles of a file element by element, so that a file may be larger than memory."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.seen = False
        self._time = math.nan
        self._time_text = ""

    def take(self, tag: str, attributes: dict[str, str], row: int) -> None:
        if tag == "vehicle":
            self._vehicle(attributes, row)
        elif tag == "timestep":
            self._time_text = attributes.get("time", "")
            try:
                self._time = float(self._time_text)
            except ValueError:
                self._time = math.nan
        elif tag == "fcd-export":
            self.seen = True

    def _vehicle(self, attributes: dict[str, str], row: int) -> None:
        name = attributes.get("id", "")
        if math.isnan(self._time):
            self.gather.refuse(name, row, "time", f"{self._time_text!r:.60} is no time")
        numbers = [self._time]
        for column in ("x", "y", "angle", "speed"):
            text = attributes.get(column)
            try:
                numbers.append(math.nan if text is None else float(text))
            except ValueError:
                numbers.append(math.nan)
                self.gather.refuse(name, row, column, f"{text!r:.60} is no number")
        numbers[3] = math.radians(90.0 - numbers[3])
        new = self.gather.add(name, row, (numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]))
        if new:
            self._describe(name, row, attributes)

    def _describe(self, name: str, row: int, attributes: dict[str, str]) -> None:
        """Describe size and kind of a vehicle. The kind is looked for in the name of the vehicle's type, too."""
        kind = kind_of(f"{attributes.get('vClass', '')} {attributes.get('type', '')}")
        size = None
        if "length" in attributes and "width" in attributes:
            try:
                size = float(attributes["length"]), float(attributes["width"])
            except ValueError:
                lengths = f"{attributes['length']!r:.40} and {attributes['width']!r:.40}"
                self.gather.refuse(name, row, "size", f"{lengths} are no length and width, expected numbers in metres")
        self.gather.describe(name, size, kind)


_CARLA_COLUMNS = {"x": "actors", "y": "actors", "heading": "actors", "speed": "actors", "time": "t", "size": "extent"}
_CARLA_COLOURS = {"Green": Colour.GREEN, "Yellow": Colour.YELLOW, "Red": Colour.RED}
_CarlaState = tuple[int, float, float, float, float, float, float, float, float, float]
"""Id; x, y, z [m]; roll, pitch, yaw [deg]; velocity in x, y, z [m/s]."""


def read_carla(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return vehicles and lights of a trajectory log in the frame of its OpenDRIVE map, in which y and yaw have the other sign.

    Raises:
        RunError: the file can't be read, or has a bad record; the message names the line.
    """
    if columns:
        raise RunError(f"{path.name}: a trajectory log has fixed fields, leave --columns out")
    with opened(path, watch) as source:
        reader = _CarlaReader(Gather(source.where, _CARLA_COLUMNS, strict=strict))
        for row, line in enumerate(source.lines(), start=1):
            if line.strip():
                reader.take(row, decode(line, dict[str, Any], f"{source.where}: row {row}", RunError))
        reader.gather.lights = changes_of(reader.colours)
        return reader.gather.log()


class _CarlaReader:
    """Adds the vehicles and lights of a file record by record."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.colours: dict[str, list[tuple[float, Colour]]] = {}
        self._changes = 0
        self._ids: dict[str, str] = {}
        self._actors: dict[int, tuple[tuple[float, float], Kind, float]] = {}
        """By id of an actor: length and width [m], kind, and distance from the recorded point to the front [m]."""

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
            raise RunError(f"{where}: extent and center must have three numbers each, got {half!r:.60} and {centre!r:.60}")
        blueprint = typed(record.get("type_id"), str, f"{where}, column type_id", RunError)
        self._actors[number] = (2 * half[0], 2 * half[1]), kind_of(blueprint), centre[0] + half[0]

    def _tick(self, row: int, record: dict[str, Any], where: str) -> None:
        time = typed(record.get("t"), float, f"{where}, column t", RunError)
        for number, x, y, _, _, _, yaw, vx, vy, _ in typed(
            record.get("actors"), list[_CarlaState], f"{where}, column actors", RunError
        ):
            if number not in self._actors:
                self.gather.refuse(str(number), row, "actors", f"actor {number} has no record before this row")
            heading = math.radians(-yaw)
            forward = vx * math.cos(heading) - vy * math.sin(heading)
            if self.gather.add(str(number), row, (time, x, -y, heading, forward)) and number in self._actors:
                self.gather.describe(str(number), *self._actors[number])
        lights = typed(record.get("lights") or {}, dict[str, str], f"{where}, column lights", RunError)
        for light, state in lights.items():
            if name := self._ids.get(light):
                colour, before = _CARLA_COLOURS.get(state, Colour.NONE), self.colours.setdefault(name, [])
                if not before or before[-1][1] is not colour:
                    before.append((time, colour))
                    self._changes += 1
                    limit_lights(self._changes, len(self.colours), where)
