"""How a value comes to be drawn in a notebook: what draws it lies above all values, and is found by name when a notebook asks.

A value does not know what draws it, so that judging and driving never load the pictures. A table in which drawing modules
register would be empty until such a module is imported.
"""

from __future__ import annotations

from importlib import import_module

__all__ = ["shown"]

_DRAWS = "pytest_rvads.cli.notebook"


def shown(value: object) -> str:
    """Return a value as HTML, as `pytest_rvads.cli.notebook.html` draws it."""
    return str(import_module(_DRAWS).html(value))
