"""Tracks in floating car data of SUMO (``--fcd-output``): XML, as large as it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from pytest_rvads.boundedxml import read_xml
from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened

__all__ = ["read_fcd"]

_NAMES = {"speed": "speed", "heading": "angle", "size": "length"}


def read_fcd(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file of SUMO.

    Its places are the middles of the front bumpers, its angles degrees clockwise from north. Sizes stand in it where SUMO was
    asked for them (``--fcd-output.attributes``).

    Raises:
        RunError: it can't be read, or a row, which is a line of the file, is bad while reading is `strict`.
    """
    if columns:
        raise RunError(f"{path.name}: the attributes of SUMO's floating car data are known, leave --columns out")
    with opened(path, watch) as source:
        reader = _Reader(Gather(source.where, _NAMES, strict=strict))
        read_xml(source.chunks(), "floating car data of SUMO", reader.take)
        if not reader.seen:
            raise RunError(f"{source.where}: it has no <fcd-export>, expected floating car data of SUMO, written by --fcd-output")
        return reader.gather.log()


class _Reader:
    """Takes the elements of a file as they come; nothing of them is kept."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.seen = False
        self._time = math.nan
        self._said = ""

    def take(self, tag: str, attributes: dict[str, str], row: int) -> None:
        if tag == "vehicle":
            self._vehicle(attributes, row)
        elif tag == "timestep":
            self._said = attributes.get("time", "")
            try:
                self._time = float(self._said)
            except ValueError:
                self._time = math.nan
        elif tag == "fcd-export":
            self.seen = True

    def _vehicle(self, attributes: dict[str, str], row: int) -> None:
        name = attributes.get("id", "")
        if math.isnan(self._time):
            self.gather.refuse(name, row, "time", f"{self._said!r:.60} is no time")
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
        """Keep size and kind; the type of a vehicle is often called after its kind."""
        kind = kind_of(f"{attributes.get('vClass', '')} {attributes.get('type', '')}")
        size = None
        if "length" in attributes and "width" in attributes:
            try:
                size = float(attributes["length"]), float(attributes["width"])
            except ValueError:
                self.gather.refuse(name, row, "size", f"{attributes['length']!r:.40} is no length, or its width none")
        self.gather.describe(name, size, kind)
