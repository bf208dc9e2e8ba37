"""What drives, as options of sessions and commands name it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pytest_rvads.drivers.naming import at
from pytest_rvads.errors import AutopilotError

__all__ = ["chosen"]


def chosen(name: str, here: Path, option: str = "rvads_autopilot") -> Any:
    """Return the autopilot of a name: a traffic policy, of which ``reference`` is the first, or ``module:name``.

    Args:
        name: the value of the option.
        here: where the command was started; modules are looked for there first.
        option: what the option is called.

    Raises:
        RvadsError: there is none, or nothing that can be called.
    """
    if ":" not in name:
        from pytest_rvads.drivers.traffic import traffic

        return traffic(name, "autopilot")
    try:
        found = at(name, here)
    except (ImportError, AttributeError) as error:
        raise AutopilotError(f"{option} must name an autopilot as module:name, got {name!r}: {error}") from error
    if not callable(found):
        raise AutopilotError(f"{option} must name a class or something callable, {name!r} is {found!r:.60}")
    return found
