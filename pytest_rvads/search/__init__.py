"""Searches for faults: falsification, strategies of Hypothesis."""

from importlib import import_module


def __getattr__(name: str) -> object:
    if name != "strategies":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.strategies")  # imported at the first use, because the module imports Hypothesis
