"""What is installed: objects that packages add by entry points ``rvads.GROUP``, and versions of software.

Verdicts depend on the software whose versions are listed.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from functools import cache, lru_cache, partial
from hashlib import sha256
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from pathlib import Path
from typing import Any

from pytest_rvads import __version__
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group, such as ``simulators``, by name, in alphabetical order."""
    return {entry.name: entry for entry in sorted(entry_points(group=f"rvads.{group}"), key=lambda entry: entry.name)}


def load(group: str, name: str) -> Any:
    """Return the object that an entry point names."""
    entry = entries(group).get(name)
    if entry is None:
        raise RvadsError(f"no installed package has an entry point {name} of rvads.{group}: install all of pytest-rvads again")
    try:
        return entry.load()
    except (Exception, SystemExit) as error:  # the module of another package may raise any exception
        package = f" of {entry.dist.name}" if entry.dist else ""
        raise RvadsError(
            f"the entry point {name} = {entry.value} in the group rvads.{group}{package} can't be loaded: {one_line(str(error))}"
        ) from error


def by_suffix(group: str) -> dict[str, Callable[..., Any]]:
    """Return the entry points of a group that are named by suffixes, by suffix; each is loaded when it is called."""

    def call(name: str, *arguments: object) -> Any:
        return load(group, name)(*arguments)

    return {f".{name}": partial(call, name) for name in entries(group)}


@cache
def libraries(simulator: str) -> tuple[str, ...]:
    """Return the packages that a simulator says it imports; none if no installed package declares such a simulator."""
    try:
        return tuple(getattr(load("simulators", simulator), "libraries", ()))
    except RvadsError:
        return ()


def versions(*libraries: str) -> dict[str, str]:
    """Return the versions of this package, of numpy, of Python and of further libraries, if installed, by name."""
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


_version = lru_cache(maxsize=64)(version)
"""Every run needs the versions, and a search for a version reads a large file."""
