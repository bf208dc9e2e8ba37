"""Copies the map file of a junction into the folder of an exported file."""

from __future__ import annotations

import os
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.builtin import LAYOUTS, path_of
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.opendrive.xmlfile import MAX_BYTES
from pytest_rvads.storage import read_file, write_file

__all__ = ["mapped", "put_map"]


def mapped(junction: Junction, *maps: str | os.PathLike[str] | None) -> Junction:
    """Return a junction as read from its map file, with the path of that file.

    Args:
        junction: the junction.
        maps: further map files that may hold the junction; the first file that holds it counts.

    Raises:
        MapError: no file holds the junction, or the file holds a different junction of this name.
    """
    candidates = [path_of(junction.name)] if junction.name in LAYOUTS else []
    candidates += [Path(map) for map in (*maps, junction.map) if map is not None]
    lacking: MapError | None = None
    for path in candidates:
        try:
            found = find(junction.id, path)
        except MapError as error:
            lacking = error
            continue
        if found.digest == junction.digest:
            return replace(junction, map=str(path))
        lacking = MapError(
            f"junction {junction.name!r} is not as it is in map file {path}: the file has changed since, or U-turns were kept; "
            "give the map that it is from (--map, --rvads-map, map=)"
        )
    raise lacking or MapError(
        f"junction {junction.name!r} is from no map file that is known, which has to lie beside a file of OpenSCENARIO: give its "
        "OpenDRIVE map (--map, --rvads-map, map=)"
    )


def put_map(junction: Junction, folder: Path) -> str:
    """Copy the map file of a junction from `mapped` into a folder, and return the name of the copy.

    The map is written once. If a different file has the same name, the copy gets another name.

    Raises:
        MapError: the map can't be read or written.
    """
    source = Path(str(junction.map))
    try:
        content = read_file(source, MAX_BYTES)
        name = source.name
        if _differs(folder / name, content):
            name = f"{source.stem}-{sha256(content).hexdigest()[:8]}{source.suffix}"
        target = folder / name
        if not target.exists() or _differs(target, content):
            write_file(target, content)
    except OSError as error:
        raise MapError(f"map file {source} can't be copied to {folder}: {error.strerror}") from error
    return name


def _differs(path: Path, content: bytes) -> bool:
    return path.exists() and (path.stat().st_size != len(content) or path.read_bytes() != content)
