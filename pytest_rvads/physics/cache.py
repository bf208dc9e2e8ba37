"""A cache on disk for speeds that are found by tests. The cache saves time and changes no result.

The key of an entry contains everything that its value depends on: the parameters, the code of this package, and the versions of
the libraries. So an entry never becomes wrong. Every entry is a file, which several processes may write at the same time. A file
that is damaged, not regular, or can't be read or written counts as absent.

The import of platformdirs takes some 10 ms, and happens only if ``RVADS_CACHE`` names no folder. Tests switch the cache off.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from pytest_rvads.support.storage import read_file, write_file
from pytest_rvads.support.versions import code, versions

__all__ = ["VARIABLE", "cached", "folder"]

VARIABLE = "RVADS_CACHE"
"""Environment variable with the folder of the cache; an empty value switches the cache off."""
_MOST_BYTES = 2**16
"""Greatest size of an entry; usual entries have some 2,000 bytes [bytes]."""


def cached(key: Mapping[str, Any], compute: Callable[[], float | None], *libraries: str) -> float | None:
    """Return the cached number of a key; compute and cache the number if it is absent.

    Args:
        key: all values that the number depends on, as JSON values; code and versions are added.
        compute: computes the number; an exception is not cached.
        libraries: packages that the computation uses; their versions are part of the key.
    """
    where = folder()
    if where is None:
        return compute()
    name = json.dumps([dict(key), code(), versions(*libraries), platform.platform()], sort_keys=True)
    path = where / f"{sha256(name.encode()).hexdigest()}.json"
    entry = _read(path, name)
    if entry is not None:
        return entry[0]
    value = compute()
    _write(path, _entry(name, value))
    return value


def folder() -> Path | None:
    """Return the folder of the cache: the value of `VARIABLE`, else a folder of the user; None if `VARIABLE` is empty."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    from platformdirs import user_cache_path  # not imported if the cache is off, as in tests

    try:
        path = user_cache_path("pytest-rvads", appauthor=False, opinion=False)
    except RuntimeError:  # the user has no home folder; older versions of platformdirs return a relative path
        return None
    return path if path.is_absolute() else None


def _entry(name: str, value: float | None) -> str:
    """Return the text of an entry: a checksum, and a line with key and value."""
    body = json.dumps({"key": name, "value": value})
    return f"{sha256(body.encode()).hexdigest()}\n{body}"


def _read(path: Path, name: str) -> tuple[float | None] | None:
    """Return the value of an entry as a tuple with one element; None without an undamaged entry of this key."""
    try:
        text = read_file(path, _MOST_BYTES).decode()
        value = json.loads(text.split("\n", 1)[1])["value"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    finite = value is None or (type(value) is float and math.isfinite(value))
    return (value,) if finite and text == _entry(name, value) else None


def _write(path: Path, text: str) -> None:
    """Write an entry; a folder that can't be written to is no error."""
    with contextlib.suppress(OSError):
        if path.is_symlink() or not path.is_file():
            path.unlink(missing_ok=True)  # a link or pipe would lead the text elsewhere
        write_file(path, text.encode())
