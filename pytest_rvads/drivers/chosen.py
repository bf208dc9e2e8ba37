"""Finds the driver that an option of a session or a command names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pytest_rvads.drivers.naming import at
from pytest_rvads.support.errors import AutopilotError

__all__ = ["chosen"]


def chosen(name: str, folder: Path, option: str = "rvads_autopilot") -> Any:
    """Return the driver that an option names: a traffic policy such as ``reference``, or ``module:name``.

    Args:
        name: the value of the option.
        folder: the working directory of the command, which is searched for modules first.
        option: the name of the option, for messages.

    Raises:
        RvadsError: no driver has this name, or the named object can't be called.
    """
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
