"""The versions of the software that verdicts depend on."""

from __future__ import annotations

import platform
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pytest_rvads import __version__

__all__ = ["ENGINES", "code", "versions"]

ENGINES = ("pybullet", "mujoco", "libsumo")
"""Packages of the engines of simulators; a package may be missing."""


def versions(*libraries: str) -> dict[str, str]:
    """Return the versions of this package, of numpy, of Python and of further libraries, by name.

    Args:
        libraries: names of packages; packages that are not installed are left out.
    """
    by_name = {"pytest-rvads": __version__}
    for library in libraries:
        try:
            by_name[library] = _version(library)
        except PackageNotFoundError:
            continue
    return by_name | {"numpy": _version("numpy"), "python": platform.python_version()}


@lru_cache(maxsize=1)
def code() -> str:
    """Return a checksum of all modules of this package."""
    digest = sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=64)  # every run needs the versions, and a search for a version reads a large file
def _version(library: str) -> str:
    return version(library)
