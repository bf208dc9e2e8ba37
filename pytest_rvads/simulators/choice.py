"""The choice of a session: its default simulator, and its limits of real time.

This module imports no simulator, because every session of pytest makes a choice, even a session without simulations.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from numbers import Real
from typing import Any, NamedTuple

from pytest_rvads.simulators.patience import Limits
from pytest_rvads.support.errors import ScenarioError

__all__ = ["Choice", "choice", "choosing", "limits"]


class Choice(NamedTuple):
    """The default simulator and the limits of real time."""

    simulator: Any = None
    """A `Simulator`; None for the usual simulator, which is imported when it is used."""
    limits: Limits = Limits()


_CHOICES: list[list[Choice]] = [[Choice()]]
"""One entry per open session. Each entry is a separate list, so that a session removes its own choice in any order of ends."""

_LOCK = threading.Lock()
"""Held while `_CHOICES` changes, because several threads may make choices."""


def choice() -> Choice:
    """Return the choice of the session."""
    return _CHOICES[-1][0]


@contextmanager
def choosing(new: Choice) -> Iterator[None]:
    """Make a choice hold within the context."""
    opened = [new]
    with _LOCK:
        _CHOICES.append(opened)
    try:
        yield
    finally:
        with _LOCK:
            _CHOICES[:] = [entry for entry in _CHOICES if entry is not opened]


@contextmanager
def limits(decision: float = Limits().decision, run: float = Limits().run) -> Iterator[None]:
    """Set the limits of real time for all simulations within the context, in any thread.

    A run that exceeds a limit ends by a fault that names the driver and its current line.

    Args:
        decision: longest call into a driver [s]; 0 sets no limit.
        run: longest run [s]; 0 sets no limit.

    Raises:
        ScenarioError: a limit is negative, infinite or no number.
    """
    for name, limit in (("decision", decision), ("run", run)):
        if not (isinstance(limit, Real) and 0 <= limit < math.inf):
            raise ScenarioError(f"limits({name}=) takes a number of seconds, 0 for no limit, got {limit!r:.60}")
    current = choice()
    with choosing(current._replace(limits=current.limits._replace(decision=float(decision), run=float(run)))):
        yield
