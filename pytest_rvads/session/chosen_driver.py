"""Where a fixture for what drives was defined in vain."""

from __future__ import annotations

import difflib
import sys
from typing import Any

import pytest

__all__ = ["where_else"]

_NAME = "rvads_autopilot"
_ALIKE = 0.8
"""How alike a misspelt name is to the right one, see `difflib`."""
_ELSEWHERE: pytest.StashKey[str] = pytest.StashKey()


def where_else(session: pytest.Session) -> str:
    """Return where something that looks like the missing fixture is defined, as a sentence, or nothing; looked for once."""
    stash = session.config.stash
    if _ELSEWHERE not in stash:
        stash[_ELSEWHERE] = _alike(session)
    return stash[_ELSEWHERE]


def _alike(session: pytest.Session) -> str:
    plugins = session.config.pluginmanager.get_plugins()
    modules = {m.__file__: m for m in (*(getattr(i, "module", None) for i in session.items), *plugins) if _from_file(m)}
    ours = __name__.partition(".")[0]
    for file, module in sorted(modules.items()):
        if module.__name__.partition(".")[0] == ours:
            continue
        for near in difflib.get_close_matches(_NAME, vars(module), cutoff=_ALIKE):
            if near == _NAME:
                return f"{file} has one that is not visible there: move it into a conftest.py of a folder that holds both"
            return f"{file} defines {near!r}: is it misspelt?"
    return ""


def _from_file(module: Any) -> bool:
    return isinstance(module, type(sys)) and getattr(module, "__file__", None) is not None
