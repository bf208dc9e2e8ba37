"""Names of drivers in records, messages, ids and options, and the stand-in for a session without a named driver."""

from __future__ import annotations

import re
import sys
from functools import cache, partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, Any

from pytest_rvads.support.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.drivers.interface import Factory

__all__ = ["at", "called", "in_ids", "labelled", "name_of", "stand_in"]


_LONGEST = 1000
"""Longest name [characters]."""


@cache
def stand_in() -> Factory:
    """Return the reference autopilot, which drives if no fixture, option or command names a driver."""
    from pytest_rvads.drivers.reference import Reference

    return partial(Reference)  # another object than Reference, which a fixture may return


def at(name: str, folder: Path | None = None) -> Any:
    """Return the object that ``module:name`` names; module and name may contain dots.

    Args:
        name: the text of an option.
        folder: the folder in which modules are searched first, as with ``python -m``.

    Raises:
        ImportError: `name` is not of this form, the module does not exist, or the module raises an error at its import.
        AttributeError: the module has no object of this name.
    """
    module, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
        raise ImportError("expected module:name, two names that may contain dots")
    if folder is not None and str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    try:
        imported = import_module(module)
    except ImportError:
        raise
    except Exception as error:  # code of a user may raise any error
        last = extract_tb(error.__traceback__)[-1]
        place = "" if last.filename.startswith("<frozen") else f" ({Path(last.filename).name}:{last.lineno})"
        raise ImportError(f"{module} raised {type(error).__name__}: {one_line(str(error))}{place}") from error
    return attrgetter(attribute)(imported)


def name_of(driver: Any) -> str:
    """Return the name of a driver or of its factory for records: the ``label``, or the name of the class or function."""
    label, own = _names(driver)
    return label or own


def labelled(driver: Any) -> bool:
    """Return whether a driver has a label, as stacks in other processes have."""
    return bool(_text(driver, "label"))


def called(driver: Any) -> str:
    """Return the name of a driver with the module of its class or function."""
    label, own = _names(driver)
    if driver is stand_in():
        return f"{own} (nobody said what drives)"
    module = "" if label else _text(_inner(driver), "__module__")
    return ".".join(filter(None, (module, label or own)))


def in_ids(driver: Any) -> str:
    """Return the name of a user's traffic policy for ids: its ``name``, else that of its class; never a stack's command."""
    inner = _inner(driver)
    name = getattr(driver, "name", None) or getattr(inner, "__name__", type(inner).__name__)
    return re.sub(r"\W+", "_", str(name), flags=re.ASCII).strip("_") or "own"


def _names(driver: Any) -> tuple[str, str]:
    inner = _inner(driver)
    own = _text(inner, "__qualname__") or _text(type(inner), "__qualname__")
    return _text(driver, "label") or _text(inner, "label"), own


def _text(driver: Any, name: str) -> str:
    """Return a text attribute of a driver on one line; an empty text if the attribute is missing or raises an error."""
    try:
        text = getattr(driver, name, None)
        return one_line(str(text), _LONGEST) if isinstance(text, str) else ""
    except KeyboardInterrupt:
        raise
    except BaseException:  # an unreadable name counts as no name
        return ""


def _inner(driver: Any) -> Any:
    return driver.func if isinstance(driver, partial) else driver
