"""pytest-rvads: validate autonomous-driving controllers against traffic rules, in pytest.

The public names stand in ``__init__.pyi`` and are loaded when first used, so that importing the package costs nothing. So are the
marks of tests that other packages add by entry points in the group ``rvads.marks``.
The modules ``errors``, ``files`` and ``values`` hold the public names that few tests write.
"""

from importlib import import_module

__version__ = "0.3.0"


def _homes() -> dict[str, str]:
    """Return, by name, the module from which the stub ``__init__.pyi`` imports the name."""
    import ast
    from pkgutil import get_data

    stub = ast.parse(get_data(__name__, "__init__.pyi") or b"")
    return {name.name: str(node.module) for node in stub.body if isinstance(node, ast.ImportFrom) for name in node.names}


def __getattr__(name: str) -> object:
    homes = globals().get("_known") or globals().setdefault("_known", _homes())
    if name == "__all__":
        return sorted(homes)
    if name in homes:
        home = homes[name]
        value = import_module(f"{home}.{name}") if home == __name__ else getattr(import_module(home), name)
    elif not name.startswith("_") and name in (installed := import_module(f"{__name__}.support.installed")).entries("marks"):
        value = installed.load("marks", name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __getattr__("__all__")
