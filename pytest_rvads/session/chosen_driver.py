"""Which code drives and simulates in a session: for the header of the session, and for a session without a driver."""

from __future__ import annotations

import difflib
import sys
from typing import Any

import pytest

from pytest_rvads.drivers.chosen import chosen
from pytest_rvads.session.options import OPTIONS

__all__ = ["code_of_driver", "code_of_simulator", "where_else"]

_NAME = "rvads_autopilot"
_ALIKE = 0.8
"""Least similarity of a misspelt name to the name of the fixture, see `difflib`."""
_ELSEWHERE: pytest.StashKey[str] = pytest.StashKey()


def code_of_driver(config: pytest.Config) -> str:
    """Return file and digest (or version) of the driver that an option names, such as `` (pilots.py 3fa29c01)``.

    The text is empty if no option names a driver.
    """
    options = config.stash[OPTIONS]
    if options.autopilot is not None:
        return _code(chosen(options.autopilot, config.invocation_params.dir), config)
    if options.sut is not None:
        from pytest_rvads.drivers.stacks.process import Process

        return _code(Process(options.sut), config)  # the process starts only when a run asks for a decision
    return ""


def code_of_simulator(config: pytest.Config, simulator: Any) -> str:
    """Return file and digest (or version) of a simulator, in the form of `code_of_driver`."""
    return _code(simulator, config)


def _code(factory: Any, config: pytest.Config) -> str:
    from pytest_rvads.drivers.identity import source

    code = source(factory, config.invocation_params.dir)
    return f" ({code})" if code else ""


def where_else(session: pytest.Session) -> str:
    """Return a sentence on a definition that was probably meant as the fixture of the driver, or an empty text.

    The modules of the tests and of the plugins are searched once per session.
    """
    stash = session.config.stash
    if _ELSEWHERE not in stash:
        stash[_ELSEWHERE] = _misplaced(session)
    return stash[_ELSEWHERE]


def _misplaced(session: pytest.Session) -> str:
    plugins = session.config.pluginmanager.get_plugins()
    modules = {m.__file__: m for m in (*(getattr(i, "module", None) for i in session.items), *plugins) if _from_file(m)}
    package = __name__.partition(".")[0]
    for file, module in sorted(modules.items()):
        if module.__name__.partition(".")[0] == package:
            continue
        for name in difflib.get_close_matches(_NAME, vars(module), cutoff=_ALIKE):
            if name == _NAME:
                return f"{file} has one that is not visible there: move it into a conftest.py of a folder that holds both"
            return f"{file} defines {name!r}: is it misspelt?"
    return ""


def _from_file(module: Any) -> bool:
    return isinstance(module, type(sys)) and getattr(module, "__file__", None) is not None
