"""Computes the digest of a driver: a hash that is equal in all processes if the code and the parameters of the driver are equal.

The digest covers the source files of the driver and of the modules that they import, and the values of the driver's attributes
and arguments. A digest of source files alone is not enough: after ``Pilot.speed = 9``, or with another argument, a campaign would
return results that were stored for the earlier speed. The digest does not depend on which modules are loaded.
"""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from pytest_rvads import __version__
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.logic.rules.sameness import codes, content
from pytest_rvads.support.installed import code
from pytest_rvads.support.wording import one_line

__all__ = ["identity", "source"]

_PLAIN = {bool, int, float, complex, str, bytes, type(None), type(Path())}
_PACKAGE = __name__.partition(".")[0]
_SITES = {Path(path).resolve() for name, path in sysconfig.get_paths().items() if name.endswith("lib")}
_INSTALLED = {"site-packages", "dist-packages"}
"""Names of the folders that hold installed packages in any installation of Python."""
_WRAPPED = ("func", "args", "keywords", "__func__", "__self__", "fget", "fset", "fdel")
"""Attributes of partials, methods and properties that hold the wrapped function or object, and its arguments."""


def identity(thing: Any) -> str:
    """Return a digest of the code and values of a driver, a simulator or a function of the user.

    The digest covers these inputs:

    - The source files of the object's module and of all modules that it imports, directly or indirectly, from the same package or
      folder, even if they are not loaded. The code of installed packages is not covered.
    - The present values of arguments, of attributes of objects and classes (such as ``version``), and of the global variables
      that functions use. Of a value that can't be pickled, such as a lock, only the type is covered.
    - For a stack in another process, its command and the files that the command names. Other files that a program reads are not
      covered.
    """
    lines: list[str] = []
    visited: dict[int, tuple[int, Any]] = {}
    """By id() of a value, its number and the value, which is kept alive so that its id() cannot be reused for another value."""
    files: dict[Path, str] = {}
    home = _top_package(thing)
    pending = [thing]
    while pending:
        value = pending.pop()
        lines.append(f"{type(value).__module__}.{type(value).__qualname__}")
        if type(value) in _PLAIN:
            lines.append(repr(value))
        elif id(value) in visited:
            lines.append(f"again {visited[id(value)][0]}")
        else:
            visited[id(value)] = len(visited), value
            parts = _parts(value, home, files)
            lines.append(str(len(parts)))
            pending += reversed(parts)
    lines += sorted(f"{file.name} {digest}" for file, digest in files.items())
    return sha256("\n".join(lines).encode("utf-8", "surrogatepass")).hexdigest()


def source(driver: Any, folder: Path) -> str:
    """Return the source file of a driver with a short digest, such as ``pilots.py 3fa29c01``, for reports.

    The digest covers the source files that `identity` covers, but no values of attributes, which can change during a run. The
    text of the driver's attribute ``version`` is appended. The result is the version of this package for a driver of this
    package, and empty if the source code can't be read.

    Args:
        driver: the driver, or its factory.
        folder: the folder to which the path of the file is relative.
    """
    try:
        if isinstance(driver, Process):
            return _short(driver.settings()[-1])
        inner = driver.func if isinstance(driver, partial) else driver
        version = getattr(inner, "version", None)
        place = _source(inner if isinstance(inner, type | FunctionType) else type(inner), folder)
        return f"{place} version {one_line(version, 40)}".lstrip() if isinstance(version, str) else place
    except Exception:
        return ""


@lru_cache(maxsize=64)  # the source is computed for the record of every test item
def _source(definition: type | FunctionType, folder: Path) -> str:
    if _top_package(definition) == _PACKAGE:
        return f"pytest-rvads {__version__}"
    files: dict[Path, str] = {}
    _add_digests(definition.__module__, _top_package(definition), files)
    own = _file(sys.modules.get(definition.__module__ or ""))
    name = "" if own is None else f"{own.relative_to(folder) if own.is_relative_to(folder) else own.name} "
    return f"{name}{_short(sorted(digest for file, digest in files.items() if file != Path(_PACKAGE)))}".rstrip()


def _short(digests: Iterable[str]) -> str:
    """Return a digest of the digests of files, of eight hexadecimal digits; an empty text without files."""
    digits = "".join(digests)
    return sha256(digits.encode()).hexdigest()[:8] if digits else ""


def _parts(value: Any, home: str, files: dict[Path, str]) -> list[Any]:
    """Return the values that make up a value and are equal in all processes, and add digests of its source files to `files`."""
    if isinstance(value, type | FunctionType):
        name = [value.__module__, value.__qualname__]
        if not _add_digests(value.__module__, home, files) and _is_in_its_module(value):
            return name
        return name + (_of_class(value) if isinstance(value, type) else _of_function(value))
    if isinstance(value, CodeType):
        return [value.co_code, list(value.co_names), list(value.co_consts)]
    if isinstance(value, ModuleType):
        return [value.__name__]
    if isinstance(value, Process):
        return [type(value), value.settings()]
    if isinstance(value, partial | MethodType | staticmethod | classmethod | property):
        return [getattr(value, name, None) for name in _WRAPPED]
    if type(value) is dict:
        return [part for key in sorted(value, key=_order) for part in (key, value[key])]
    if type(value) in (list, tuple, set, frozenset):
        return list(value) if type(value) in (list, tuple) else sorted(value, key=_order)
    return _of_object(value)


def _order(key: Any) -> str:
    return repr(key) if type(key) in _PLAIN else identity(key)


def _of_object(value: Any) -> list[Any]:
    """Return the values that pickle would store for an object; if it can't be pickled, its type and attributes."""
    try:
        reduced = value.__reduce_ex__(4)
        if isinstance(reduced, str):
            return [reduced, type(value), getattr(value, "__wrapped__", None)]
        function, arguments, state, items, pairs = (*reduced, *[None] * 3)[:5]
        return [type(value), function, arguments, state, list(items or ()), [list(pair) for pair in pairs or ()]]
    except Exception:  # code of a user may raise any error; a lock or a file can't be pickled
        state = getattr(value, "__dict__", None)
        return [type(value), dict(state) if isinstance(state, Mapping) else None]


def _of_class(definition: type) -> list[Any]:
    own = {
        name: value
        for name, value in vars(definition).items()
        if isinstance(value, FunctionType) or not name.startswith(("__", "_abc_impl"))
    }
    return [list(definition.__bases__), own]


def _of_function(function: FunctionType) -> list[Any]:
    names = sorted({name for code in codes(function.__code__) for name in code.co_names})
    used = {name: function.__globals__[name] for name in names if name in function.__globals__}
    for name, module in [(name, module) for name, module in used.items() if isinstance(module, ModuleType)]:
        inside = vars(module) if _is_user_code(module.__name__) else {}
        used |= {f"{name}.{inner}": inside[inner] for inner in names if inner in inside}
    cells = [content(cell) for cell in function.__closure__ or ()]
    return [function.__code__, function.__defaults__, function.__kwdefaults__, vars(function).get("version"), cells, used]


def _is_in_its_module(definition: Any) -> bool:
    """Return whether a class or function can be looked up by its name in the module in which it was defined."""
    value: Any = sys.modules.get(definition.__module__ or "")
    for name in definition.__qualname__.split("."):
        value = getattr(value, name, None)
    return value is definition


def _is_user_code(name: str | None) -> bool:
    """Return whether a module is code of a user, i.e. not of this package, of Python, or of an installed package."""
    top = (name or "").partition(".")[0]
    module = sys.modules.get(name or "")
    if top == _PACKAGE or top in sys.stdlib_module_names:
        return False
    own = getattr(module, "__file__", None)
    if not isinstance(own, str):
        return True
    file = Path(own).resolve()
    return _INSTALLED.isdisjoint(file.parts) and not any(file.is_relative_to(site) for site in _SITES)


def _top_package(thing: Any) -> str:
    """Return the name of the top-level package in which an object's class, or a function, was defined."""
    if isinstance(thing, partial | MethodType):
        return _top_package(thing.func if isinstance(thing, partial) else thing.__self__)
    definition = thing if isinstance(thing, type | FunctionType) else type(thing)
    return (definition.__module__ or "").partition(".")[0]


def _add_digests(name: str | None, home: str, files: dict[Path, str]) -> bool:
    """Add the digests of a module's file, and of the files that it imports from its package or folder, to `files`.

    Args:
        name: name of the module.
        home: top-level package of the driver, whose modules are added even if the package is installed.
        files: digest by path of the file.

    Returns:
        Whether the module is code of a user.
    """
    top = (name or "").partition(".")[0]
    if top == _PACKAGE:
        files[Path(_PACKAGE)] = code()
        return False
    ours = _is_user_code(name)
    own = _file(sys.modules.get(name or "")) if ours or top == home not in sys.stdlib_module_names else None
    if own is not None and own not in files:
        package = next(iter(getattr(sys.modules.get(top), "__path__", ())), None)
        folder = Path(package).resolve().parent if package else own.parent
        pending = [own]
        while pending:
            file = pending.pop()
            if file not in files:
                text = file.read_bytes()
                files[file] = sha256(text).hexdigest()
                imported = _imported_files(file, folder, text)
                pending += [module for module in imported if ours or module.is_relative_to(folder / top)]
    return ours


def _imported_files(file: Path, folder: Path, text: bytes) -> Iterator[Path]:
    """Yield the files inside of `folder` that the import statements of a module can refer to.

    Args:
        file: path of the module.
        folder: the folder that holds the module or its package.
        text: content of the module.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return
    for node in ast.walk(tree):
        start, names = folder, []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = file.parents[node.level - 1] if 0 < node.level <= len(file.parents) else folder
            names = [".".join(filter(None, (node.module, alias.name))) for alias in node.names]
        for name in names:
            if name.partition(".")[0] == _PACKAGE and start == folder:
                continue  # `_add_digests` covers this package by its checksum
            place = start
            for part in name.split("."):
                place /= part
                yield from filter(Path.is_file, (place.with_name(f"{part}.py"), place / "__init__.py"))


def _file(module: ModuleType | None) -> Path | None:
    """Return the source file of a module, or None if the module has no source file."""
    name = getattr(module, "__file__", None)
    return Path(name).resolve() if isinstance(name, str) and name.endswith(".py") and Path(name).is_file() else None
