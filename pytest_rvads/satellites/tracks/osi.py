"""Tracks in ground truth of ASAM OSI: in MCAP or a trace file; the extra ``osi`` reads them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pytest_rvads.errors import RunError
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.samples import Gather, Log
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.wording import one_line

__all__ = ["read_osi"]

_COLUMNS = {"x": "base.position", "y": "base.position", "heading": "base.orientation", "speed": "base.velocity"}
_PEDESTRIAN, _ANIMAL = 3, 4
"""Of ``MovingObject.Type``."""
_TRUCKS = frozenset({5, 6, 7, 8, 11, 16})
"""Of ``VehicleClassification.Type``: delivery van, heavy truck, semitractor, semitrailer, trailer, bus."""
_BICYCLE = 10


def read_osi(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:  # noqa: ARG001 - nobody knows how far it is
    """Return the moving objects of ground truths, or of those in sensor views; rows are messages.

    Raises:
        RunError: it can't be read, or the extra is not installed.
    """
    if columns:
        raise RunError(f"{path.name}: the fields of OSI are known, leave --columns out")
    gather = Gather(path.name, _COLUMNS, strict=strict)
    row = 0
    try:
        for row, truth in enumerate(_truths(path), start=1):
            if truth.timestamp is None:
                raise RunError(f"{path}: row {row} has no timestamp, expected one in every ground truth")
            time = truth.timestamp.seconds + truth.timestamp.nanos * 1e-9
            for item in truth.moving_object:
                _add(gather, row, time, item)
    except RunError:
        raise
    except Exception as error:  # of a library that we do not know
        raise RunError(f"{path}: row {row + 1} can't be read as OSI: {one_line(str(error) or type(error).__name__)}") from error
    return gather.log()


def _truths(path: Path) -> Iterator[Any]:
    try:
        import betterosi
    except ImportError:
        raise RunError(f"{path}: OSI is read by an extra: install pytest-rvads[osi]") from None
    if not path.is_file():
        raise RunError(f"{path}: can't be read: it is no file")
    yield from betterosi.read(str(path), return_ground_truth=True)  # looks into a trace file whose name does not tell its type


def _add(gather: Gather, row: int, time: float, item: Any) -> None:
    """Add a moving object; its place is the centre of its box."""
    if item.id is None:
        gather.refuse("", row, "id", "a moving object has no id")
        return
    name, base = str(item.id.value), item.base
    if base is None or base.position is None:
        gather.refuse(name, row, "x", "it has no position")
        return
    heading = base.orientation.yaw if base.orientation is not None else math.nan
    speed = math.nan
    if base.velocity is not None:
        speed = math.hypot(base.velocity.x, base.velocity.y)
        if base.orientation is not None:
            speed = base.velocity.x * math.cos(heading) + base.velocity.y * math.sin(heading)
    if gather.add(name, row, (time, base.position.x, base.position.y, heading, speed)):
        size = base.dimension
        has = size is not None and size.length > 0.0 and size.width > 0.0
        gather.describe(name, (size.length, size.width) if has else None, _kind(item))


def _kind(item: Any) -> Kind:
    if int(item.type) in (_PEDESTRIAN, _ANIMAL):
        return Kind.PEDESTRIAN
    what = item.vehicle_classification
    number = -1 if what is None else int(what.type)
    return Kind.CYCLIST if number == _BICYCLE else Kind.TRUCK if number in _TRUCKS else Kind.CAR
