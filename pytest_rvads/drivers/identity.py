"""Computes the digest of a driver: a hash that is equal in all processes if the code and the arguments of the driver are equal.

The digest covers the source files of the driver and of the modules that they import, the arguments of the driver as pickle writes
them, and the ``version`` that its author states. It does not depend on which modules are loaded. Nothing tells whether a driver
that can't be pickled, or whose source code is in no file, is the same in another process: its digest equals no other digest,
unless the author states a version.
"""

from __future__ import annotations

import ast
import io
import pickle
import sys
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any
from uuid import uuid4

from pytest_rvads import __version__
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.support.installed import code
from pytest_rvads.support.wording import one_line

_PACKAGE = __name__.partition(".")[0]
_INSTALLED = {"site-packages", "dist-packages"}
"""Names of the folders that hold installed packages in any installation of Python."""


class _Pickler(pickle.Pickler):
    """Pickles a value, and collects the names of the modules in which the classes and functions of the value are defined."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.modules: set[str] = set()

    def persistent_id(self, value: Any) -> None:
        if isinstance(value, type | FunctionType):
            self.modules.add(value.__module__)


def identity(thing: Any) -> str:
    """Return a digest of the code, the arguments and the stated version of a driver, a simulator or a function of the user.

    For a stack in another process, the digest covers its command and the files that the command names.
    """
    if isinstance(thing, Process):
        return _digest(code(), repr(thing.settings()))
    definition, content = _definition(thing), io.BytesIO()
    version = getattr(_without_arguments(thing), "version", None)
    pickler = _Pickler(content)
    pickler.modules.add(definition.__module__)
    try:
        pickler.dump(thing)
        told = sha256(content.getvalue()).hexdigest()
    except Exception:  # code of the user may raise any error; a lambda or a lock can't be pickled
        told = "" if isinstance(version, str) else uuid4().hex
    files = {file: digest for module in pickler.modules for file, digest in _sources(module, definition.__module__)}
    if not files and not definition.__module__.startswith(f"{_PACKAGE}.") and not isinstance(version, str):
        told = uuid4().hex  # the code is in no file, as in a notebook
    name = f"{definition.__module__}.{definition.__qualname__}"
    return _digest(code(), name, told, str(version), *sorted(f"{file.name} {digest}" for file, digest in files.items()))


def source(driver: Any, folder: Path) -> str:
    """Return the source file of a driver with a short digest, such as ``pilots.py 3fa29c01``, for reports.

    The digest covers the source files that `identity` covers, but no arguments. The text of the driver's attribute ``version`` is
    appended. The result is the version of this package for a driver of this package, and empty if the code can't be read.
    """
    try:
        if isinstance(driver, Process):
            digests = driver.settings()[-1]
            return _digest(*digests)[:8] if digests else ""
        module, version = _definition(driver).__module__, getattr(_without_arguments(driver), "version", None)
        files = _sources(module, module)
        if files:
            own = Path(sys.modules[module].__file__ or "").resolve()
            place = own.relative_to(folder) if own.is_relative_to(folder) else own.name
            text = f"{place} {_digest(*sorted(digest for _, digest in files))[:8]}"
        else:
            text = f"pytest-rvads {__version__}" if module.partition(".")[0] == _PACKAGE else ""
        return f"{text} version {one_line(version, 40)}".lstrip() if isinstance(version, str) else text
    except Exception:  # code of the user may raise any error, and a report does without the source
        return ""


def _digest(*texts: str) -> str:
    return sha256("\n".join(texts).encode("utf-8", "surrogatepass")).hexdigest()


def _without_arguments(thing: Any) -> Any:
    return _without_arguments(thing.func) if isinstance(thing, partial) else thing


def _definition(thing: Any) -> Any:
    """Return the class or function whose source code decides what a driver does."""
    inner = _without_arguments(thing)
    inner = inner.__self__ if isinstance(inner, MethodType) else inner
    return inner if isinstance(inner, type | FunctionType) else type(inner)


@lru_cache(maxsize=64)  # the source is computed for the record of every test item
def _sources(module: str, home: str) -> tuple[tuple[Path, str], ...]:
    """Return the source file of a module and all files that it imports from its package or folder, each with its digest.

    The result is empty for modules of this package, of Python, and of installed packages other than that of the module `home`.
    """
    top = module.partition(".")[0]
    own = Path(getattr(sys.modules.get(module), "__file__", None) or "").resolve()
    installed = not _INSTALLED.isdisjoint(own.parts) and top != home.partition(".")[0]
    if top == _PACKAGE or top in sys.stdlib_module_names or installed or own.suffix != ".py" or not own.is_file():
        return ()
    package = next(iter(getattr(sys.modules.get(top), "__path__", ())), None)
    folder = Path(package).resolve().parent if package else own.parent
    files: dict[Path, str] = {}
    pending = [own]
    while pending:
        file = pending.pop()
        if file in files:
            continue
        text = file.read_bytes()
        files[file] = sha256(text).hexdigest()
        try:
            tree = ast.parse(text)
        except (SyntaxError, ValueError, RecursionError):
            continue
        for node in ast.walk(tree):
            start, names = folder, []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                start = file.parents[node.level - 1] if 0 < node.level <= len(file.parents) else folder
                names = [".".join(filter(None, (node.module, alias.name))) for alias in node.names]
            for name in names:
                place = start
                for part in name.split("."):
                    place /= part
                    pending += filter(Path.is_file, (place.with_name(f"{part}.py"), place / "__init__.py"))
    return tuple(files.items())
