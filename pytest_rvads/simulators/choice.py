"""Which simulator a session chose; it makes the runs wherever a caller of the session names none.

Imports nothing, because every session of pytest makes a choice, also where nobody simulates.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["choice", "choosing"]

_CHOICES: list[Any] = [None]


def choice() -> Any:
    """Return the `Simulator` of the session; None for ``bullet``, not loaded yet, as outside of sessions."""
    return _CHOICES[-1]


@contextmanager
def choosing(simulator: Any) -> Iterator[None]:
    """Have a simulator, or None for ``bullet``, make the runs for which callers name no other."""
    _CHOICES.append(simulator)
    try:
        yield
    finally:
        _CHOICES.pop()
