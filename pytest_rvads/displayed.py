"""How a value comes to be drawn in a notebook: what draws it lies above all values, and is found by name when a notebook asks."""

from __future__ import annotations

from importlib import import_module

__all__ = ["shown"]

_DRAWS = "pytest_rvads.notebook"


def shown(value: object) -> str:
    """Return a value as HTML, as `pytest_rvads.notebook.html` draws it."""
    return str(import_module(_DRAWS).html(value))
