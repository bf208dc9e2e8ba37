"""What a session chose: the simulator that makes the runs for which callers name no other, and how long they may take.

Imports no simulator, because every session of pytest makes a choice, also where nobody simulates.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from numbers import Real
from typing import Any, NamedTuple

from pytest_rvads.errors import ScenarioError
from pytest_rvads.simulators.patience import Limits

__all__ = ["Choice", "choice", "choosing", "limits"]


class Choice(NamedTuple):
    """What makes runs, and how long they may take."""

    simulator: Any = None
    """A `Simulator`; None for the usual one, not loaded yet, as outside of sessions."""
    limits: Limits = Limits()


_CHOICES: list[list[Choice]] = [[Choice()]]
"""One entry per open session. Each entry is a separate list, so that a session removes its own choice in any order of ends."""

_LOCK = threading.Lock()
"""Runs may be made in several threads, each of which chooses."""


def choice() -> Choice:
    """Return the choice of the session."""
    return _CHOICES[-1][0]


@contextmanager
def choosing(made: Choice) -> Iterator[None]:
    """Have a choice hold."""
    own = [made]
    with _LOCK:
        _CHOICES.append(own)
    try:
        yield
    finally:
        with _LOCK:
            _CHOICES[:] = [entry for entry in _CHOICES if entry is not own]


@contextmanager
def limits(decision: float = Limits().decision, run: float = Limits().run) -> Iterator[None]:
    """Have other limits of real time hold for what is simulated in this context, in any thread.

    A run that exceeds one ends by a fault that names the driver and the line where it was.

    Args:
        decision: for one call into a driver [s]; 0 sets no limit.
        run: for all of a run [s]; 0 sets no limit.

    Raises:
        ScenarioError: a limit that is no number from 0 on.
    """
    for name, limit in (("decision", decision), ("run", run)):
        if not (isinstance(limit, Real) and 0 <= limit < math.inf):
            raise ScenarioError(f"limits({name}=) takes a number of seconds, 0 for no limit, got {limit!r:.60}")
    held = choice()
    with choosing(held._replace(limits=held.limits._replace(decision=float(decision), run=float(run)))):
        yield
