"""The autopilots that ship with the project, by the names that the command line knows them under."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pytest_rvads.autopilots.lgsvl import LgsvlLike
from pytest_rvads.autopilots.reference import Reference
from pytest_rvads.autopilots.rolling import RollingStop
from pytest_rvads.errors import AutopilotError, suggest

__all__ = ["AUTOPILOTS", "named"]

AUTOPILOTS: Mapping[str, Callable[[], Any]] = {"reference": Reference, "lgsvl": LgsvlLike, "rolling": RollingStop}


def named(name: str) -> Callable[[], Any]:
    """Return the autopilot called `name`.

    Raises:
        AutopilotError: there is none.
    """
    if name not in AUTOPILOTS:
        raise AutopilotError(f"unknown autopilot {name!r}, expected one of {', '.join(AUTOPILOTS)}{suggest(name, AUTOPILOTS)}")
    return AUTOPILOTS[name]
