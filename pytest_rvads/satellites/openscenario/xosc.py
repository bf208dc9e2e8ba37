"""Tracks in OpenSCENARIO XML: vehicles that follow trajectories with times, and the lights of its controllers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pytest_rvads.errors import RunError
from pytest_rvads.satellites.openscenario.played import Played, no_trajectories, played
from pytest_rvads.satellites.tracks.logformats import Format
from pytest_rvads.satellites.tracks.samples import Gather, Log
from pytest_rvads.satellites.tracks.source import Watch

__all__ = ["FORMAT", "log_of", "read_xosc"]

_COLUMNS = {"time": "time", "heading": "h", "size": "Dimensions"}


def read_xosc(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file, the lights of its controllers, and the map that it names.

    Places are those of rear axles, and the fronts are as far ahead of them as the bounding boxes say.

    Raises:
        RunError: it can't be read, nobody in it follows a trajectory, or a vertex is bad while reading is `strict`.
    """
    if columns:
        raise RunError(f"{path.name}: the attributes of OpenSCENARIO are known, leave --columns out")
    return log_of(played(path, watch), strict=strict)


def log_of(found: Played, *, strict: bool = False) -> Log:
    """Return a file that has been read as a log, see `read_xosc`."""
    if not found.ways:
        raise no_trajectories(found.where)
    gather = Gather(found.where, _COLUMNS, strict=strict)
    for entity in found.entities:
        way = found.ways.get(entity.name)
        if way is not None and len(way):
            gather.extend(entity.name, way[:, 0].astype(np.int64), np.column_stack((way[:, 1:], np.full(len(way), np.nan))))
            gather.describe(entity.name, entity.size, entity.kind, entity.ahead)
    gather.lights = dict(found.lights)
    log = gather.log()
    return replace(log, refused=(*log.refused, *found.untold.items()), map=found.map)


FORMAT = Format(read_xosc, (".xosc",), "rear_axle")
"""OpenSCENARIO XML as a format of tracks."""
