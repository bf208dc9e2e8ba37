"""What a file of a run tells at a glance: where it was, from the head of the file alone."""

from __future__ import annotations

from pathlib import Path

import msgspec
from msgspec.structs import replace

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.archive import peek
from pytest_rvads.runs.junctionfile import JunctionRecord, get_junction
from pytest_rvads.runs.runfile import FORMAT, VERSION

__all__ = ["glance"]

_MOST = 2**21
"""Longest head that is read [bytes]."""


class _Head(msgspec.Struct, frozen=True):
    format: str
    version: int
    junction: JunctionRecord


def glance(path: Path) -> Junction | None:
    """Return the junction of a run that `save_run` wrote, without its centre lines, or None.

    Only the head of the file is read, so a folder of a thousand runs takes a second. None means that the file holds no run or is
    damaged; the error of `load_run` tells the two apart.
    """
    try:
        head = msgspec.json.decode(peek(path, "header", _MOST), type=_Head)
        return _bare(head.junction) if (head.format, head.version) == (FORMAT, VERSION) else None
    except (msgspec.MsgspecError, KeyError, ValueError, MapError):
        return None


def _bare(record: JunctionRecord) -> Junction:
    """Return a junction without centre lines, which alone stand elsewhere in the file."""
    bare = replace(
        record,
        entrances=[replace(entrance, approach=None) for entrance in record.entrances],
        exits=[replace(exit, road=None) for exit in record.exits],
        movements=[replace(movement, path=None) for movement in record.movements],
    )
    return get_junction(bare, {})
