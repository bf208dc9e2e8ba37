"""Which simulator a session chose; it makes the runs wherever a caller of the session names none.

Imports nothing, because every session of pytest makes a choice, also where nobody simulates.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["choice", "choosing"]

_CHOICES: list[list[Any]] = [[None]]
"""One entry per open session, a list of its own so that a session takes back its own choice, whoever ends first."""


def choice() -> Any:
    """Return the `Simulator` of the session; None for ``bullet``, not loaded yet, as outside of sessions."""
    return _CHOICES[-1][0]


@contextmanager
def choosing(simulator: Any) -> Iterator[None]:
    """Have a simulator, or None for ``bullet``, make the runs for which callers name no other."""
    own = [simulator]
    _CHOICES.append(own)
    try:
        yield
    finally:
        _CHOICES[:] = [entry for entry in _CHOICES if entry is not own]
