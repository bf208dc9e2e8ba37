"""Names of drivers in records and messages, and the driver that an option names, or that drives if no driver is named."""

from __future__ import annotations

import subprocess
import sys
from functools import cache, partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.support.errors import AutopilotError, located
from pytest_rvads.support.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.drivers.interface import Factory

_LONGEST = 1000
"""Greatest length of a name; a longer name is cut [characters]."""
_RETURNED = 42
"""Exit status of a process in which the import of a module returned."""


@cache
def stand_in() -> Factory:
    """Return the reference autopilot, which drives if no fixture, option or command names a driver."""
    from pytest_rvads.drivers.reference import Reference

    return partial(Reference)  # a new object, so that it differs from a Reference that a fixture returns


def chosen(name: str, folder: Path, option: str = "rvads_autopilot") -> Any:
    """Return the driver that an option names: a traffic policy such as ``reference``, or ``module:name``."""
    if ":" not in name:
        from pytest_rvads.drivers.traffic import traffic

        return traffic(name, "autopilot")
    try:
        driver = at(name, folder)
    except (ImportError, AttributeError) as error:
        raise AutopilotError(f"{option} must name an autopilot as module:name, got {name!r}: {error}") from error
    if not callable(driver):
        raise AutopilotError(f"{option} must name a class or something callable, {name!r} is {driver!r:.60}")
    return driver


def at(name: str, folder: Path | None = None) -> Any:
    """Return the object that a text such as ``package.module:Class.method`` names."""
    module, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
        raise ImportError("expected module:name, two names that may contain dots")
    if folder is not None and str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    if folder is not None and module not in sys.modules:
        # A module that ends its process would end the command, with an exit status of its choice, so it is first imported in
        # another process. What the module prints is printed by the import that follows. A fork would copy the locks of other
        # threads.
        lines = (
            "import importlib, os, sys",
            f"sys.path[:] = {sys.path!r}",
            "try:",
            f"    importlib.import_module({module!r})",
            "except BaseException:",
            "    pass",
            f"os._exit({_RETURNED})",
        )
        command = [sys.executable, "-c", "\n".join(lines)]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
        if done.returncode != _RETURNED:
            raise ImportError(f"{module} ended its process while it was imported, as os._exit does")
    try:
        imported = import_module(module)
    except (ImportError, KeyboardInterrupt):
        raise
    except BaseException as error:  # code of a user may raise any error, and may call sys.exit
        raise ImportError(f"{module} raised {located(error)}") from error
    return attrgetter(attribute)(imported)


def name_of(driver: Any) -> str:
    """Return the name of a driver or of its factory for records: the ``label``, or the name of the class or function."""
    label, own, _ = _names(driver)
    return label or own


def labelled(driver: Any) -> bool:
    """Return whether a driver has a label (a name for reports), as drivers in other processes have."""
    return bool(_text(driver, "label"))


def called(driver: Any) -> str:
    """Return the name of a driver with the module of its class or function."""
    label, own, module = _names(driver)
    if driver is stand_in():
        return f"{own} (nobody said what drives)"
    return label or ".".join(filter(None, (module, own)))


def _names(driver: Any) -> tuple[str, str, str]:
    """Return the label of a driver or of its factory, the name of the class or function, and the name of its module."""
    inner = driver.func if isinstance(driver, partial) else driver
    own = _text(inner, "__qualname__") or _text(type(inner), "__qualname__")
    return _text(driver, "label") or _text(inner, "label"), own, _text(inner, "__module__")


def _text(driver: Any, name: str) -> str:
    """Return the text in the attribute `name` of a driver, on one line; an empty text if it is missing or raises an error."""
    try:
        text = getattr(driver, name, None)
        return one_line(str(text), _LONGEST) if isinstance(text, str) else ""
    except KeyboardInterrupt:
        raise
    except BaseException:  # an attribute that can't be read counts as missing
        return ""
