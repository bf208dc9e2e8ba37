"""A cache on disk for speeds that are found by testing; it saves time and never decides anything.

An entry's key holds all that its value depends on: the parameters, the code of this package, the versions of what computes.
So no entry ever becomes wrong, only unused. Every entry is a file of its own, which processes may write at the same
time; one that is damaged, no regular file, or can't be read or written counts as absent.

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

from pytest_rvads.storage import read_file, write_file
from pytest_rvads.versions import code, versions

__all__ = ["VARIABLE", "cached", "folder"]

VARIABLE = "RVADS_CACHE"
"""Environment variable that names the folder of the cache; empty, it switches the cache off."""
_MOST_BYTES = 2**16
"""Of an entry; they take some 2,000."""


def cached(key: Mapping[str, Any], compute: Callable[[], float | None], *libraries: str) -> float | None:
    """Return the number kept under `key`, or compute and keep it.

    Args:
        key: everything that the number depends on but code and versions, which are added; values that JSON knows.
        compute: called where nothing is kept; what it raises is not kept.
        libraries: packages that compute; their versions are part of the key.
    """
    where = folder()
    if where is None:
        return compute()
    name = json.dumps([dict(key), code(), versions(*libraries), platform.platform()], sort_keys=True)
    path = where / f"{sha256(name.encode()).hexdigest()}.json"
    kept = _read(path, name)
    if kept is not None:
        return kept[0]
    value = compute()
    _write(path, _entry(name, value))
    return value


def folder() -> Path | None:
    """Return the folder of the cache, the user's unless the environment names one; None where it is switched off."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    from platformdirs import user_cache_path  # where the cache is switched off, as in tests, nothing needs it

    try:
        path = user_cache_path("pytest-rvads", appauthor=False, opinion=False)
    except RuntimeError:  # nobody's home, which older versions of platformdirs tell by a relative path
        return None
    return path if path.is_absolute() else None


def _entry(name: str, value: float | None) -> str:
    """Return the text of an entry: a checksum, then key and value."""
    body = json.dumps({"key": name, "value": value})
    return f"{sha256(body.encode()).hexdigest()}\n{body}"


def _read(path: Path, name: str) -> tuple[float | None] | None:
    """Return the value of an entry as a tuple of one, or None where there is no whole entry of this key."""
    try:
        text = read_file(path, _MOST_BYTES).decode()
        value = json.loads(text.split("\n", 1)[1])["value"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    finite = value is None or (type(value) is float and math.isfinite(value))
    return (value,) if finite and text == _entry(name, value) else None


def _write(path: Path, text: str) -> None:
    """Put an entry into place; a cache that can't be written is no reason to fail."""
    with contextlib.suppress(OSError):
        if path.is_symlink() or not path.is_file():
            path.unlink(missing_ok=True)  # a link or pipe would be written through
        write_file(path, text.encode())
