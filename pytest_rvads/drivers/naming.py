"""Names of drivers in records and messages, the driver that an option names or that drives by default, and digests of drivers.

The digest of a driver is equal in all processes if the code and the arguments of the driver are equal. It covers the source files
of the driver and of the modules that they import, the arguments of the driver as pickle writes them, and the ``version`` that its
author states. It does not depend on which modules are loaded. Nothing tells whether a driver that can't be pickled, or whose
source code is in no file, is the same in another process: its digest equals no other digest, unless the author states a version.
"""

from __future__ import annotations

import subprocess
import sys
from functools import cache, partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.support.errors import AutopilotError
from pytest_rvads.support.tracebacks import located
from pytest_rvads.support.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.drivers.interface import Factory
import ast
import io
import pickle
from functools import lru_cache
from hashlib import sha256
from types import FunctionType, MethodType
from uuid import uuid4

from pytest_rvads import __version__
from pytest_rvads.support.installed import code

_LONGEST = 1000
"""Greatest length of a name; a longer name is cut [characters]."""
_RETURNED = 42
"""Exit status of a process in which the import of a module returned."""


@cache
def stand_in() -> Factory:
    """Return the reference autopilot, which drives if no fixture, option or command names a driver."""
    from pytest_rvads.drivers.reference import Reference

    return partial(Reference)  # a new object, so that it differs from a Reference that a fixture returns


def chosen(name: str, folder: Path, option: str = "rvads_autopilot") -> Any:
    """Return the driver that an option names: a traffic policy such as ``reference``, or ``module:name``."""
    if ":" not in name:
        from pytest_rvads.drivers.traffic import traffic

        return traffic(name, "autopilot")
    try:
        driver = at(name, folder)
    except (ImportError, AttributeError) as error:
        raise AutopilotError(f"{option} must name an autopilot as module:name, got {name!r}: {error}") from error
    if not callable(driver):
        raise AutopilotError(f"{option} must name a class or something callable, {name!r} is {driver!r:.60}")
    return driver


def at(name: str, folder: Path | None = None) -> Any:
    """Return the object that a text such as ``package.module:Class.method`` names."""
    module, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
        raise ImportError("expected module:name, two names that may contain dots")
    if folder is not None and str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    if folder is not None and module not in sys.modules:
        # A module that ends its process would end the command, with an exit status of its choice, so it is first imported in
        # another process. What the module prints is printed by the import that follows. A fork would copy the locks of other
        # threads.
        lines = (
            "import importlib, os, sys",
            f"sys.path[:] = {sys.path!r}",
            "try:",
            f"    importlib.import_module({module!r})",
            "except BaseException:",
            "    pass",
            f"os._exit({_RETURNED})",
        )
        command = [sys.executable, "-c", "\n".join(lines)]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
        if done.returncode != _RETURNED:
            raise ImportError(f"{module} ended its process while it was imported, as os._exit does")
    try:
        imported = import_module(module)
    except (ImportError, KeyboardInterrupt):
        raise
    except BaseException as error:  # code of a user may raise any error, and may call sys.exit
        raise ImportError(f"{module} raised {located(error)}") from error
    return attrgetter(attribute)(imported)


def name_of(driver: Any) -> str:
    """Return the name of a driver or of its factory for records: the ``label``, or the name of the class or function."""
    label, own, _ = _names(driver)
    return label or own


def labelled(driver: Any) -> bool:
    """Return whether a driver has a label (a name for reports), as drivers in other processes have."""
    return bool(_text(driver, "label"))


def called(driver: Any) -> str:
    """Return the name of a driver with the module of its class or function."""
    label, own, module = _names(driver)
    if driver is stand_in():
        return f"{own} (nobody said what drives)"
    return label or ".".join(filter(None, (module, own)))


def _names(driver: Any) -> tuple[str, str, str]:
    """Return the label of a driver or of its factory, the name of the class or function, and the name of its module."""
    inner = driver.func if isinstance(driver, partial) else driver
    own = _text(inner, "__qualname__") or _text(type(inner), "__qualname__")
    return _text(driver, "label") or _text(inner, "label"), own, _text(inner, "__module__")


def _text(driver: Any, name: str) -> str:
    """Return the text in the attribute `name` of a driver, on one line; an empty text if it is missing or raises an error."""
    try:
        text = getattr(driver, name, None)
        return one_line(str(text), _LONGEST) if isinstance(text, str) else ""
    except KeyboardInterrupt:
        raise
    except BaseException:  # an attribute that can't be read counts as missing
        return ""


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
    from pytest_rvads.drivers.stacks.process import Process

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
    from pytest_rvads.drivers.stacks.process import Process

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
