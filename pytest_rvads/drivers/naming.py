"""Names of drivers: in records and messages, in ids and in options; and the stand-in for a session without a named driver."""

from __future__ import annotations

import re
import sys
from functools import cache, partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, Any

from pytest_rvads.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.drivers.interface import Factory

__all__ = ["at", "called", "in_ids", "labelled", "name_of", "stand_in"]

_LONGEST = 1000
"""Of a name [characters]."""


@cache
def stand_in() -> Factory:
    """Return the reference autopilot, as what drives where no fixture, option or command names anything."""
    from pytest_rvads.drivers.reference import Reference

    return partial(Reference)  # an object of its own, so that a fixture that returns Reference is told apart


def at(name: str, here: Path | None = None) -> Any:
    """Return what ``module:name`` names, where both may be several names with dots between them.

    Args:
        name: as options take it.
        here: a folder in which modules are looked for first, as ``python -m`` does.

    Raises:
        ImportError: `name` is not written so, there is no such module, or it raises when it is imported; says where.
        AttributeError: nothing in it has this name.
    """
    module, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
        raise ImportError("expected module:name, both of them names with dots between them at most")
    if here is not None and str(here) not in sys.path:
        sys.path.insert(0, str(here))
    try:
        found = import_module(module)
    except ImportError:
        raise
    except Exception as error:  # it is the code of others
        last = extract_tb(error.__traceback__)[-1]
        place = "" if last.filename.startswith("<frozen") else f" ({Path(last.filename).name}:{last.lineno})"
        raise ImportError(f"{module} raised {type(error).__name__}: {one_line(str(error))}{place}") from error
    return attrgetter(attribute)(found)


def name_of(driver: Any) -> str:
    """Return the name of a driver or of its factory for records: the ``label``, or the name of the class or function."""
    label, own = _names(driver)
    return label or own


def labelled(driver: Any) -> bool:
    """Tell whether a driver has a label, as stacks in other processes do."""
    return bool(_text(driver, "label"))


def called(driver: Any) -> str:
    """Return the name of a driver with the module of its class or function."""
    label, own = _names(driver)
    if driver is stand_in():
        return f"{own} (nobody said what drives)"
    module = "" if label else _text(_inner(driver), "__module__")
    return ".".join(filter(None, (module, label or own)))


def in_ids(driver: Any) -> str:
    """Return the name of a traffic policy of one's own, for ids: its ``name``, else that of its class; no stack's command."""
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
    except BaseException:  # a name that can't be read is none, and costs no more
        return ""


def _inner(driver: Any) -> Any:
    return driver.func if isinstance(driver, partial) else driver
