"""The map formats that are read: a reader for each suffix of a file name."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from pytest_rvads.maps.network import Network
from pytest_rvads.opendrive.builder import read_network

__all__ = ["READERS", "read_file"]

Reader = Callable[[str | os.PathLike[str]], Network]

READERS: dict[str, Reader] = {".xodr": read_network}
"""Per suffix, in lower case, what reads such a file and raises MapError where it can't; a format of your own is a row here."""


def read_file(path: str | os.PathLike[str]) -> Network:
    """Return the network of a map file; a file of any other suffix is taken as OpenDRIVE.

    Raises:
        MapError: the file cannot be used at all; the message is one sentence.
    """
    return READERS.get(Path(str(path)).suffix.lower(), read_network)(path)
