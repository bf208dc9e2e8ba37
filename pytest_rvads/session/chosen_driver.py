"""Names the code of a session's driver and simulator for the header of the session, and offers tests to users without tests.

The tests that come with the plugin (folder ``suite``) are collected for users without tests: ``pytest --rvads-sut ./stack``.
The report of a session without a driver names a definition that was probably meant as the driver.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.session.interrupts import LIMITS

if TYPE_CHECKING:
    from pytest_rvads.simulators.simulator import Choice, Simulator

_SUITE = Path(__file__).parent / "suite"
"""Folder of the tests that come with the plugin."""
_NAME = "rvads_autopilot"
"""Name of the fixture that returns the driver."""
_ALIKE = 0.8
"""Least similarity of a misspelt name to the name of the fixture, see `difflib`."""
_ELSEWHERE: pytest.StashKey[str] = pytest.StashKey()
NAMED: pytest.StashKey[Simulator | None] = pytest.StashKey()
"""The simulator that an option names; None if no option names one."""


def choice_of(config: pytest.Config, simulator: Any = NAMED) -> Choice:
    """Return the value of a fixture, or by default the simulator of the session, with the session's limits of real time."""
    from pytest_rvads.simulators.simulator import Choice, usable

    chosen = config.stash[NAMED] if simulator is NAMED else usable(simulator)
    return Choice.of(chosen, config.stash[LIMITS])


def code_of(factory: Any, config: pytest.Config) -> str:
    """Return file and digest (or version) of a driver or simulator, such as `` (pilots.py 3fa29c01)``, or an empty text."""
    from pytest_rvads.drivers.identity import source

    code = source(factory, config.invocation_params.dir)
    return f" ({code})" if code else ""


def offer(config: pytest.Config) -> None:
    """Collect the bundled tests if pytest was started without arguments in a folder without test files.

    Ids of bundled tests among the arguments select these tests, if no file of the same name exists.
    """
    start = config.invocation_params.dir
    if config.args_source is config.ArgsSource.INVOCATION_DIR:
        patterns: list[str] = config.getini("python_files")
        if not any(next(start.rglob(pattern), None) for pattern in patterns):
            config.args[:] = [str(_SUITE)]
        return
    files = {argument.partition("::")[0] for argument in config.args}
    if files <= {path.name for path in _SUITE.glob("*.py")} and not any((start / file).exists() for file in files):
        # Pytest makes the ids relative to the folder of the suite only if that folder is the argument.
        config.pluginmanager.register(_Selected(tuple(config.args)), "rvads_named")
        config.args[:] = [str(_SUITE)]


class _Selected:
    """A plugin that deselects the bundled tests which the arguments of pytest do not name."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Deselect the bundled test items that no argument of pytest names."""
        named: dict[str, list[pytest.Item]] = {}
        for name in self._names:  # the id of a test item, of its test function or of its test file
            within = (f"{name}[", f"{name}::")
            named[name] = [item for item in items if item.nodeid == name or item.nodeid.startswith(within)]
        if missing := [name for name, matches in named.items() if not matches]:
            raise pytest.UsageError(f"not found: {missing[0]}, among the tests that come with the plugin")
        selected = {item for matches in named.values() for item in matches}
        config.hook.pytest_deselected(items=[item for item in items if item not in selected])
        items[:] = [item for item in items if item in selected]


def where_else(session: pytest.Session) -> str:
    """Return a sentence on a definition in the tests that was probably meant as the fixture of the driver; empty without one.

    The modules of the tests and of the plugins are searched once per session.
    """
    stash = session.config.stash
    if _ELSEWHERE in stash:
        return stash[_ELSEWHERE]
    plugins = session.config.pluginmanager.get_plugins()
    candidates = (*(getattr(item, "module", None) for item in session.items), *plugins)
    modules = {str(m.__file__): m for m in candidates if isinstance(m, ModuleType) and getattr(m, "__file__", None) is not None}
    package, text = __name__.partition(".")[0], ""
    for file, module in sorted(modules.items()):
        if module.__name__.partition(".")[0] != package and not text:
            for name in difflib.get_close_matches(_NAME, vars(module), 1, _ALIKE):
                text = f"{file} defines {name!r}: is it misspelt?"
                if name == _NAME:
                    text = f"{file} has one that is not visible there: move it into a conftest.py of a folder that holds both"
    return stash.setdefault(_ELSEWHERE, text)
