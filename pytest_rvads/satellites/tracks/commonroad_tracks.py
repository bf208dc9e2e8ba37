"""Reads the recorded vehicles of a CommonRoad scenario (``.xml``, versions 2018b and 2020a); the same file is their map."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.samples import FIELDS, Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import number_in, read_xml
from pytest_rvads.support.wording import one_line

_COLUMNS = {"x": "position", "y": "position", "heading": "orientation", "speed": "velocity", "size": "shape"}
_NUMBERS = ("time/exact", "position/point/x", "position/point/y", "orientation/exact", "velocity/exact")
"""Elements of a state that hold the numbers of a sample, in the order of `FIELDS`."""
_SHAPE = ("shape/rectangle/length", "shape/rectangle/width", "shape/circle/radius")


def is_commonroad(path: Path) -> bool:
    """Return whether a file is a CommonRoad scenario, given by the first kilobytes of the file."""
    with opened(path) as source:
        return b"<commonRoad" in next(source.chunks(), b"")


def read_commonroad_tracks(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the dynamic obstacles of a CommonRoad scenario; the scenario is the map of the log, unless it is packed.

    A position is the centre of a vehicle; a row in messages is the line of a state. A vehicle is left out if it has no
    trajectory, or if a time, position or orientation is an interval or an area.
    """
    if columns:
        raise RunError(f"{path.name}: a CommonRoad scenario has fixed elements, leave --columns out")
    with opened(path, watch) as source:
        reader = _Reader(Gather(source.where, _COLUMNS, strict=strict))
        read_xml(source.chunks(), "a CommonRoad scenario", reader.start, reader.end, reader.take_text)
        return replace(reader.gather.log(), map=None if path.suffix.lower() == ".gz" else path)  # maps are not packed


class _Reader:
    """Adds the dynamic obstacles of a file element by element."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self._path: list[str] = []
        self._step, self._name, self._row = 0.0, "", 0
        self._text, self._texts = "", dict[str, str]()
        """Text of the open element; texts of the open obstacle and of its open state by element."""
        self._states = array("d")
        """Row and numbers of each state of the open obstacle."""

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        self._path.append(tag)
        self._text = ""
        if len(self._path) == 1:
            self._step = number_in(attributes.get("timeStepSize", ""))
            if tag != "commonRoad" or not 0.0 < self._step < math.inf:
                what = one_line(f"<{tag} timeStepSize={attributes.get('timeStepSize', '')!r:.20}>", 80)
                raise RunError(f"{self.gather.where}: row {row}: got {what}, expected <commonRoad> with a positive timeStepSize")
        elif len(self._path) == 2:
            self._name, self._row, self._texts, self._states = attributes.get("id", ""), row, {}, array("d")
        elif tag in ("initialState", "state"):
            self._row = row

    def take_text(self, text: str) -> None:
        self._text = (self._text + text)[:100]  # longer than any number

    def end(self, tag: str) -> None:
        parents = self._path[2:]
        if self._path[1:2] in (["dynamicObstacle"], ["obstacle"]):
            element = "/".join(part for part in parents if part not in ("initialState", "trajectory", "state"))
            if element in (*_NUMBERS, *_SHAPE, "type", "role"):
                self._texts[element] = self._text.strip()
            elif tag in ("initialState", "state"):
                self._states.extend((self._row, *(number_in(self._texts.pop(name, "")) for name in _NUMBERS)))
            elif not parents and self._texts.get("role") != "static":
                self._add_vehicle()
        self._path.pop()

    def _add_vehicle(self) -> None:
        table = np.array(self._states).reshape(-1, 1 + len(_NUMBERS))
        rows, samples = table[:, 0].astype(np.int64), table[:, 1:]
        if len(rows) < 2:
            self.gather.refuse(self._name, self._row, "x", "the obstacle has no trajectory, expected states")
            return
        kind = kind_of(self._texts.get("type", ""))
        for k, field in np.argwhere(np.isnan(samples[:, : 3 if kind is Kind.PEDESTRIAN else 4]))[:1]:
            why = "it is missing or not exact, expected a number or a point"
            self.gather.refuse(self._name, int(rows[k]), FIELDS[field], why)
        samples[:, 0] *= self._step
        if np.isnan(samples[:, 4]).any():  # only the initial state must have a velocity
            samples[:, 4] = np.nan
        length, width, radius = (number_in(self._texts.get(name, "")) for name in _SHAPE)
        size = (length, width) if math.isnan(radius) else (2.0 * radius, 2.0 * radius)
        before, to_describe = self.gather.extend(self._name, rows, samples)
        for k in to_describe.tolist():
            self.gather.describe(self._name, None if math.isnan(sum(size)) else size, self._texts.get("type", ""), at=before + k)
