"""The supported map formats: a reader for each suffix of a file name."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pytest_rvads.geometry.network import Network
from pytest_rvads.geometry.opendrive.builder import read_network
from pytest_rvads.support.entrypoints import entries, load

__all__ = ["READERS", "read_file"]

Reader = Callable[[str | os.PathLike[str]], Network]


def _added(name: str, path: str | os.PathLike[str]) -> Network:
    """Read a map file with the reader of entry point `name`."""
    network: Network = load("maps", name)(path)
    return network


READERS: dict[str, Reader] = {".xodr": read_network, **{f".{name}": partial(_added, name) for name in entries("maps")}}
"""Per suffix, in lower case, a reader, which raises MapError for a file that it can't read.

Formats of other packages are entry points ``rvads.maps``, named by the suffix.
"""


def read_file(path: str | os.PathLike[str]) -> Network:
    """Return the network of a map file; a file with an unknown suffix is read as OpenDRIVE.

    Raises:
        MapError: the file cannot be used at all; the message is one sentence.
    """
    return READERS.get(Path(str(path)).suffix.lower(), read_network)(path)
