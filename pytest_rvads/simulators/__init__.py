"""Simulators: what makes a run of a case, and the kit that checks one.

`pytest_rvads.simulators.kit` has the checks; they are loaded when they are asked for.
"""

from typing import TYPE_CHECKING

__all__ = ["Check", "Conformance", "Outcome", "Result", "checks", "conformance"]

if TYPE_CHECKING:
    from pytest_rvads.simulators.kit.conformance import Check, Conformance, Outcome, Result, checks, conformance
else:

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(f"{__name__}.kit.conformance"), name)
