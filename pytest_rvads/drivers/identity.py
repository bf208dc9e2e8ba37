"""What a driver is, in a digest that says in any process whether it is the same: its code, and the values that it works with."""

from __future__ import annotations

import inspect
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from hashlib import sha256
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.versions import code

__all__ = ["identity"]

_PLAIN = (bool, int, float, complex, str, bytes, type(None), Path)
_DEEPEST = 8
"""Values within values that are looked into."""
_SITES = {Path(path).resolve() for name, path in sysconfig.get_paths().items() if name.endswith(("lib", "stdlib"))}


def identity(thing: Any) -> str:
    """Return a digest of what decides what a driver, simulator or function of somebody does.

    Of its code these are the modules that are loaded by then of its package, or those beside its module; not what is installed
    elsewhere. Of a stack in another process they are its command and the files that this names. Values it was made with count as
    far as they are plain, or consist of plain ones; what another program reads by itself, such as parameters on disk, does not.
    """
    return sha256("\n".join(_told(thing, _DEEPEST)).encode("utf-8", "surrogatepass")).hexdigest()


def _told(value: Any, depth: int) -> Iterator[str]:  # noqa: C901 - a case per kind of value
    """Yield what there is to say of a value, equal in any process."""
    kind = type(value)
    yield f"{kind.__module__}.{kind.__qualname__}"
    if isinstance(value, _PLAIN) and not isinstance(value, Enum):
        yield repr(value)
    elif depth == 0:
        return
    elif isinstance(value, type | FunctionType | BuiltinFunctionType):
        yield from _code(value)
        if isinstance(value, FunctionType):  # what it was made with, where it was made in another one
            given = [*(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).values()]
            yield from _each([*given, *(cell.cell_contents for cell in value.__closure__ or ())], depth)
    elif isinstance(value, MethodType):
        yield from _each((value.__func__, value.__self__), depth)
    elif isinstance(value, partial):
        yield from _each((value.func, value.args, value.keywords), depth)
    elif isinstance(value, Process):
        yield from _each(value.settings(), depth)
    elif isinstance(value, Mapping):
        yield from _each([part for key in sorted(value, key=repr) for part in (key, value[key])], depth)
    elif isinstance(value, Set):
        yield from _each(sorted(value, key=repr), depth)
    elif isinstance(value, list | tuple):
        yield from _each(value, depth)
    elif isinstance(value, Enum):
        yield value.name
    else:
        yield from _code(kind)
        names = [item.name for item in fields(value)] if is_dataclass(value) else sorted(getattr(value, "__dict__", {}))
        yield from _each([part for name in names for part in (name, getattr(value, name))], depth)


def _each(values: Any, depth: int) -> Iterator[str]:
    for value in values:
        yield from _told(value, depth - 1)
    yield "."


def _code(made: Any) -> Iterator[str]:
    """Yield the name of a class or function, and a digest of every module that may decide what it does."""
    yield made.__qualname__
    module = sys.modules.get(made.__module__ or "")
    package = (made.__module__ or "").partition(".")[0]
    if package == __name__.partition(".")[0]:
        yield code()
    elif module is None or package in sys.stdlib_module_names:
        return
    elif _file(module) is None:  # written at a prompt or in a notebook
        try:
            yield inspect.getsource(made)
        except (OSError, TypeError):
            yield repr(getattr(getattr(made, "__code__", None), "co_code", None))
    else:
        for file in sorted(_beside(module, package)):
            yield f"{file.name} {sha256(file.read_bytes()).hexdigest()}"


def _beside(module: ModuleType, package: str) -> Iterator[Path]:
    """Yield the files of the loaded modules of a package, or of those in the folder of a module that is in none."""
    own = _file(module)
    if own is not None:
        yield own
    top = sys.modules.get(package)
    roots = {Path(path).resolve() for path in getattr(top, "__path__", ())} or {own.parent if own else Path()}
    if roots & _SITES:  # a module that is installed by itself
        return
    for name, other in list(sys.modules.items()):
        file = _file(other)
        if file is None or name == "__main__" or file == own:
            continue
        root = next((root for root in roots if file.is_relative_to(root)), None)
        if root is not None and "site-packages" not in file.relative_to(root).parts:
            yield file


def _file(module: ModuleType) -> Path | None:
    """Return the source of a module, where it has one that is there."""
    try:
        name = getattr(module, "__file__", None)
        path = Path(name).resolve() if isinstance(name, str) and name.endswith(".py") else None
    except (OSError, ValueError):
        return None
    return path if path is not None and path.is_file() else None
