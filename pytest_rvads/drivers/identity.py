"""A digest of a driver, equal in every process for equal code and equal values.

A digest of source files alone is not enough: a campaign that is called again with another argument, or after ``Pilot.speed = 9``,
would return the results of the former speed.

The digest covers the files that the driver's code imports by name, loaded or not, and the driver's values as they would travel to
another process. The digest never depends on which modules happen to be loaded.
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
from pytest_rvads.versions import code
from pytest_rvads.wording import one_line

__all__ = ["identity", "source"]

_PLAIN = {bool, int, float, complex, str, bytes, type(None), type(Path())}
_PACKAGE = __name__.partition(".")[0]
_SITES = {Path(path).resolve() for name, path in sysconfig.get_paths().items() if name.endswith("lib")}
_INSTALLED = {"site-packages", "dist-packages"}
"""Folders of other installations of Python, in which packages are looked for as well."""
_WRAPPED = ("func", "args", "keywords", "__func__", "__self__", "fget", "fset", "fdel")
"""Attributes of partials, methods and properties that say what they call, and with what."""


def identity(thing: Any) -> str:
    """Return a digest of the code and values of a driver, a simulator or a function of the user.

    Code counts by its source files: the module of the object, and all modules that are imported by name, directly or not, from
    the same package or folder, loaded or not. Installed packages do not count. A stack in another process counts by its command
    and the files that the command names. Values count as they are now: arguments, attributes of objects and classes (such as
    ``version``), and the globals that functions name. A value that can't be pickled, such as a lock, counts by its type. Files
    that a program reads itself do not count.
    """
    lines: list[str] = []
    met: dict[int, tuple[int, Any]] = {}
    """By address: the number of a value, and the value itself, so that no other value gets its address."""
    files: dict[Path, str] = {}
    home = _top(thing)
    rest = [thing]
    while rest:
        value = rest.pop()
        lines.append(f"{type(value).__module__}.{type(value).__qualname__}")
        if type(value) in _PLAIN:
            lines.append(repr(value))
        elif id(value) in met:
            lines.append(f"again {met[id(value)][0]}")
        else:
            met[id(value)] = len(met), value
            parts = _parts(value, home, files)
            lines.append(str(len(parts)))
            rest += reversed(parts)
    lines += sorted(f"{file.name} {digest}" for file, digest in files.items())
    return sha256("\n".join(lines).encode("utf-8", "surrogatepass")).hexdigest()


def source(driver: Any, here: Path) -> str:
    """Return where the code of a driver is, and which: ``pilots.py 3fa29c01``; of what is bundled, the package's version.

    The digest is of the files that `identity` counts, and of no values: it is the same before and after a run. The text of an
    attribute ``version`` follows. Where the code can't be told the answer is empty: a driver is code of others, and that costs
    no verdict.

    Args:
        driver: what drives, or what makes it.
        here: the folder that the file is told from.
    """
    try:
        if isinstance(driver, Process):
            return _short(driver.settings()[-1])
        made = driver.func if isinstance(driver, partial) else driver
        version = getattr(made, "version", None)
        place = _source(made if isinstance(made, type | FunctionType) else type(made), here)
        return f"{place} version {one_line(version, 40)}".lstrip() if isinstance(version, str) else place
    except Exception:
        return ""


@lru_cache(maxsize=64)  # every item tells it
def _source(made: type | FunctionType, here: Path) -> str:
    if _top(made) == _PACKAGE:
        return f"pytest-rvads {__version__}"
    files: dict[Path, str] = {}
    _follow(made.__module__, _top(made), files)
    own = _file(sys.modules.get(made.__module__ or ""))
    name = "" if own is None else f"{own.relative_to(here) if own.is_relative_to(here) else own.name} "
    return f"{name}{_short(sorted(digest for file, digest in files.items() if file != Path(_PACKAGE)))}".rstrip()


def _short(digests: Iterable[str]) -> str:
    """Return eight digits for some files, nothing for none."""
    digits = "".join(digests)
    return sha256(digits.encode()).hexdigest()[:8] if digits else ""


def _parts(value: Any, home: str, files: dict[Path, str]) -> list[Any]:
    """Return the values that a value consists of, equal in any process; digests of the files of its code are added to `files`."""
    if isinstance(value, type | FunctionType):
        name = [value.__module__, value.__qualname__]
        if not _follow(value.__module__, home, files) and _is_there(value):
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
    """Take an object apart as for a journey to another process."""
    try:
        made = value.__reduce_ex__(4)
        if isinstance(made, str):
            return [made, type(value), getattr(value, "__wrapped__", None)]
        function, given, state, items, pairs = (*made, *[None] * 3)[:5]
        return [type(value), function, given, state, list(items or ()), [list(pair) for pair in pairs or ()]]
    except Exception:  # whatever the code of others raises; a lock or a file can't travel
        state = getattr(value, "__dict__", None)
        return [type(value), dict(state) if isinstance(state, Mapping) else None]


def _of_class(made: type) -> list[Any]:
    own = {
        name: value
        for name, value in vars(made).items()
        if isinstance(value, FunctionType) or not name.startswith(("__", "_abc_impl"))
    }
    return [list(made.__bases__), own]


def _of_function(made: FunctionType) -> list[Any]:
    names = sorted({name for code in codes(made.__code__) for name in code.co_names})
    used = {name: made.__globals__[name] for name in names if name in made.__globals__}
    for name, module in [(name, module) for name, module in used.items() if isinstance(module, ModuleType)]:
        inside = vars(module) if _is_ours(module.__name__) else {}
        used |= {f"{name}.{inner}": inside[inner] for inner in names if inner in inside}
    cells = [content(cell) for cell in made.__closure__ or ()]
    return [made.__code__, made.__defaults__, made.__kwdefaults__, vars(made).get("version"), cells, used]


def _is_there(made: Any) -> bool:
    """Tell whether a class or function is in the module that it names: one that was made elsewhere may name any."""
    found: Any = sys.modules.get(made.__module__ or "")
    for name in made.__qualname__.split("."):
        found = getattr(found, name, None)
    return found is made


def _is_ours(name: str | None) -> bool:
    """Tell whether a module is code of a user: none of this package, of Python, or installed."""
    top = (name or "").partition(".")[0]
    module = sys.modules.get(name or "")
    if top == _PACKAGE or top in sys.stdlib_module_names:
        return False
    own = getattr(module, "__file__", None)
    if not isinstance(own, str):
        return True
    file = Path(own).resolve()
    return _INSTALLED.isdisjoint(file.parts) and not any(file.is_relative_to(site) for site in _SITES)


def _top(thing: Any) -> str:
    """Return the package of what makes a thing."""
    if isinstance(thing, partial | MethodType):
        return _top(thing.func if isinstance(thing, partial) else thing.__self__)
    made = thing if isinstance(thing, type | FunctionType) else type(thing)
    return (made.__module__ or "").partition(".")[0]


def _follow(name: str | None, home: str, files: dict[Path, str]) -> bool:
    """Add the digests of a module and of all that it imports from its package or from beside it; tell whether it is a user's.

    Of what is installed that is done for the package `home` alone: nobody's weights change what numpy is.
    """
    top = (name or "").partition(".")[0]
    if top == _PACKAGE:
        files[Path(_PACKAGE)] = code()
        return False
    ours = _is_ours(name)
    own = _file(sys.modules.get(name or "")) if ours or top == home not in sys.stdlib_module_names else None
    if own is not None and own not in files:
        package = next(iter(getattr(sys.modules.get(top), "__path__", ())), None)
        folder = Path(package).resolve().parent if package else own.parent
        rest = [own]
        while rest:
            file = rest.pop()
            if file not in files:
                text = file.read_bytes()
                files[file] = sha256(text).hexdigest()
                rest += [other for other in _imported(file, folder, text) if ours or other.is_relative_to(folder / top)]
    return ours


def _imported(file: Path, folder: Path, text: bytes) -> Iterator[Path]:
    """Yield the files below a folder that a module in it imports by name."""
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
                continue  # its checksum is told in any case
            place = start
            for part in name.split("."):
                place /= part
                yield from (found for found in (place.with_name(f"{part}.py"), place / "__init__.py") if found.is_file())


def _file(module: ModuleType | None) -> Path | None:
    """Return the source file of a module, or None if the module has no source file."""
    name = getattr(module, "__file__", None)
    return Path(name).resolve() if isinstance(name, str) and name.endswith(".py") and Path(name).is_file() else None
