"""Public names that are loaded at their first use, from the modules that a stub names."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module


@cache
def homes(module: str) -> dict[str, str]:
    """Return the modules of public names, by name, as the stub of a module (the ``.pyi`` file beside it) imports the names."""
    import ast
    from pkgutil import get_data

    package, _, stem = module.partition(".")
    stub = ast.parse(get_data(package, f"{stem or '__init__'}.pyi") or b"")
    return {name.name: str(node.module) for node in stub.body if isinstance(node, ast.ImportFrom) for name in node.names}


def _added(group: str, name: str) -> object:
    """Return the object that an entry point of a group names; None without such an entry point."""
    installed = import_module("pytest_rvads.support.installed")  # which imports the package, whose names are loaded here
    return installed.load(group, name) if name in installed.entries(group) else None


def public_names(module: str, group: str = "") -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return the functions `__getattr__` and `__dir__` of a module whose stub imports its public names.

    The names of entry points in a `group` are names of the module, too.
    """

    def load(name: str) -> object:
        if name == "__all__":
            return sorted(homes(module))
        if name in homes(module):
            home = homes(module)[name]
            value = import_module(f"{home}.{name}") if home == module else getattr(import_module(home), name)
        else:
            value = _added(group, name) if group and not name.startswith("_") else None
            if value is None:
                raise AttributeError(f"module {module!r} has no attribute {name!r}")
        setattr(sys.modules[module], name, value)
        return value

    return load, lambda: sorted(homes(module))
