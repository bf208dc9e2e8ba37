"""Objects that satellites and other packages add to this package by entry points in groups ``rvads.GROUP``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

__all__ = ["entries", "load"]


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, in alphabetical order.

    Args:
        group: name of the group without its prefix, such as ``simulators``.
    """
    return {entry.name: entry for entry in sorted(entry_points(group=f"rvads.{group}"), key=lambda entry: entry.name)}


def load(group: str, name: str) -> Any:
    """Return the object that an entry point names.

    Args:
        group: name of the group without its prefix.
        name: name of an entry point of the group.

    Raises:
        RvadsError: the object can't be imported; the message names the entry point and the package that declares it.
    """
    entry = entries(group)[name]
    try:
        return entry.load()
    except Exception as error:  # the module of another package may raise any exception
        package = f" of {entry.dist.name}" if entry.dist else ""
        raise RvadsError(
            f"the entry point {name} = {entry.value} in the group rvads.{group}{package} can't be loaded: {one_line(str(error))}"
        ) from error
