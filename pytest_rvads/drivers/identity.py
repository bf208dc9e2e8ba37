"""What a driver is, in a digest that says in any process whether it is the same: its code, and the values that it works with."""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from pytest_rvads import __version__
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.versions import code

__all__ = ["identity", "source"]

_PLAIN = {bool, int, float, complex, str, bytes, type(None), type(Path())}
_PACKAGE = __name__.partition(".")[0]
_SITES = {Path(path).resolve() for name, path in sysconfig.get_paths().items() if name.endswith("lib")}
_INSTALLED = {"site-packages", "dist-packages"}
"""Folders of other installations of Python, in which packages are looked for as well."""
_Told = tuple[list[str], list[Any]]
"""What there is to say of a value itself, and the values it consists of."""


def identity(thing: Any) -> str:
    """Return a digest of what decides what a driver, simulator or function of somebody does.

    Of its code these are the modules that it and they import by name from its package or from beside it, whether they are loaded
    by then or not; not what is installed elsewhere. Of a stack in another process they are its command and the files that this
    names. Values count as they are now: those it was made with, those of its class, and those that its functions know by a name.
    What can't be taken apart, such as a lock, counts by its kind; what another program reads by itself does not count.
    """
    lines: list[str] = []
    known: dict[int, tuple[int, Any]] = {}
    """Of what was met, by address, its number; and itself, so that nothing else gets its address."""
    files: dict[Path, str] = {}
    home = _top(thing)
    rest = [thing]
    while rest:
        value = rest.pop()
        lines.append(f"{type(value).__module__}.{type(value).__qualname__}")
        if type(value) in _PLAIN:
            lines.append(repr(value))
        elif id(value) in known:
            lines.append(f"again {known[id(value)][0]}")
        else:
            known[id(value)] = len(known), value
            texts, parts = _told(value, home, files)
            lines += [*texts, str(len(parts))]
            rest += reversed(parts)
    lines += sorted(f"{file.name} {digest}" for file, digest in files.items())
    return sha256("\n".join(lines).encode("utf-8", "surrogatepass")).hexdigest()


def source(driver: Any, here: Path) -> str:
    """Return where the code of a driver is and a digest of it: ``pilots.py 3fa29c01``; of what is bundled, the package's version.

    Of the code count the files that `identity` counts, and no values: it is the same before and after a run. Where it can't be
    told there is nothing: a driver is code of others, and that costs no verdict.

    Args:
        driver: what drives, or what makes it.
        here: the folder that the file is told from.
    """
    try:
        if isinstance(driver, Process):
            _, _, _, _, digests = driver.settings()
            return _short(digests)
        made = driver.func if isinstance(driver, partial) else driver
        return _source(made if isinstance(made, type | FunctionType) else type(made), here)
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
    told = "".join(digests)
    return sha256(told.encode()).hexdigest()[:8] if told else ""


def _told(value: Any, home: str, files: dict[Path, str]) -> _Told:  # noqa: C901 - a case per kind of value
    """Say what a value is, equal in any process; digests of files that make it one are added to `files`."""
    if isinstance(value, type | FunctionType):
        texts = [f"{value.__module__}.{value.__qualname__}"]
        ours = _follow(value.__module__, home, files) or not _is_there(value)
        return (texts, []) if not ours else (texts, _of_class(value) if isinstance(value, type) else _of_function(value))
    if isinstance(value, CodeType):
        return [value.co_code.hex(), *value.co_names], list(value.co_consts)
    if isinstance(value, BuiltinFunctionType | ModuleType):
        return [value.__name__], []
    if isinstance(value, Process):
        return [], [type(value), value.settings()]
    if isinstance(value, Enum):
        return [value.name], [type(value)]
    if type(value) is dict:
        return [], [part for key in sorted(value, key=_order) for part in (key, value[key])]
    if type(value) in (set, frozenset):
        return [], sorted(value, key=_order)
    if type(value) in (list, tuple):
        return [], list(value)
    if isinstance(value, partial):
        return [], [value.func, list(value.args), value.keywords]
    if isinstance(value, MethodType | staticmethod | classmethod):
        return [], [value.__func__, getattr(value, "__self__", None)]
    if isinstance(value, property):
        return [], [value.fget, value.fset, value.fdel]
    return _of_object(value)


def _order(key: Any) -> str:
    return repr(key) if type(key) in _PLAIN else identity(key)


def _of_object(value: Any) -> _Told:
    """Take an object apart as for a journey to another process."""
    try:
        made = value.__reduce_ex__(4)
        if isinstance(made, str):
            return [made], [type(value), getattr(value, "__wrapped__", None)]
        function, given, state, items, pairs = (*made, *[None] * 3)[:5]
        return [], [type(value), function, given, state, list(items or ()), [list(pair) for pair in pairs or ()]]
    except Exception:  # whatever the code of others raises; a lock or a file is none that could be told
        state = getattr(value, "__dict__", None)
        return [], [type(value), dict(state) if isinstance(state, Mapping) else None]


def _of_class(made: type) -> list[Any]:
    own = {
        name: value
        for name, value in vars(made).items()
        if isinstance(value, FunctionType) or not name.startswith(("__", "_abc_impl"))
    }
    return [list(made.__bases__), own]


def _of_function(made: FunctionType) -> list[Any]:
    names = sorted(_names(made.__code__))
    used = {name: made.__globals__[name] for name in names if name in made.__globals__}
    for name, module in [(name, module) for name, module in used.items() if isinstance(module, ModuleType)]:
        known = vars(module) if _is_ours(module.__name__) else {}
        used |= {f"{name}.{inner}": known[inner] for inner in names if inner in known}
    cells = [list(_content(cell)) for cell in made.__closure__ or ()]
    return [made.__code__, made.__defaults__, made.__kwdefaults__, cells, used]


def _names(made: CodeType) -> set[str]:
    """Return the names of what is global, or an attribute, in a function and in those within it."""
    return set(made.co_names).union(*(_names(inner) for inner in made.co_consts if isinstance(inner, CodeType)))


def _content(cell: Any) -> Iterator[Any]:
    try:
        yield cell.cell_contents
    except ValueError:  # nothing is in it yet
        return


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
    own = None if module is None else getattr(module, "__file__", None)
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
    module, ours = sys.modules.get(name or ""), _is_ours(name)
    own = _file(module) if module is not None and (ours or top == home not in sys.stdlib_module_names) else None
    if own is not None and own not in files:
        package = next(iter(getattr(sys.modules.get(top), "__path__", ())), None)
        folder = Path(package).resolve().parent if package else own.parent
        _add(own, folder, None if ours else top, files)
    return ours


def _add(file: Path, folder: Path, package: str | None, files: dict[Path, str]) -> None:
    """Add the digest of a file and of those that it imports from a folder, or from a package there."""
    rest = [file]
    while rest:
        file = rest.pop()
        if file not in files:
            text = file.read_bytes()
            files[file] = sha256(text).hexdigest()
            found = _imported(file, folder, text)
            rest += [other for other in found if package is None or other.is_relative_to(folder / package)]


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
    """Return the source of a module, where it has one that is there."""
    try:
        name = getattr(module, "__file__", None)
        path = Path(name).resolve() if isinstance(name, str) and name.endswith(".py") else None
    except (OSError, ValueError):
        return None
    return path if path is not None and path.is_file() else None
