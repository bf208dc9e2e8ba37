"""Beyond the tables: metamorphic checks, falsification, strategies, chance, consistency of rules."""

from importlib import import_module


def __getattr__(name: str) -> object:
    if name != "strategies":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.strategies")  # Hypothesis is imported at the first use
