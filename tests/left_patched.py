"""Finds the test that leaves an attribute of the package replaced, which later tests would meet."""

import sys
from collections import defaultdict
from collections.abc import Iterable
from types import ModuleType
from typing import Any

import pytest


class Attributes:
    """The attributes of the package's modules and classes, as they are between tests.

    Attributes that `pytest.MonkeyPatch` replaced are looked at after each test, all functions and classes after each test file,
    because this takes a millisecond. Other values are not looked at without `pytest.MonkeyPatch`: the package changes some.
    """

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, dict[str, Any]]] = {}
        """By id, a module or class with a copy of its attributes."""
        self._patched: defaultdict[int, set[object]] = defaultdict(set)
        """By id of a target of `pytest.MonkeyPatch`, the attributes that it replaced since the last test."""
        setattr_of_pytest = pytest.MonkeyPatch.setattr

        def noted(patch: pytest.MonkeyPatch, target: Any, name: Any, *arguments: Any, **options: Any) -> None:
            if not isinstance(target, str):
                self._patched[id(target)].add(name)
            setattr_of_pytest(patch, target, name, *arguments, **options)

        pytest.MonkeyPatch.setattr = noted  # type: ignore[assignment]

    def learn(self) -> None:
        """Add the modules, and their classes, that were imported since the last call."""
        for name in [name for name in sys.modules if name.startswith("pytest_rvads")]:
            module = sys.modules[name]
            if id(module) not in self._known:
                classes = (one for one in vars(module).values() if isinstance(one, type) and one.__module__ == name)
                self._known |= {id(owner): (owner, dict(vars(owner))) for owner in (module, *classes)}

    def forget(self) -> None:
        """Leave what a fixture of a wider scope has replaced to the end of its file."""
        self._patched.clear()

    def restore(self, *, everything: bool) -> list[str]:
        """Undo all replacements by tests, and return the names of what was replaced."""
        owners: Iterable[int] = self._known if everything else self._patched.keys() & self._known.keys()
        changed = [(*self._known[owner], self._patched.get(owner, set())) for owner in owners if not _same(*self._known[owner])]
        self._patched.clear()
        return [name for entry in changed for name in _restored(*entry)]


def _same(owner: Any, before: dict[str, Any]) -> bool:
    try:
        return bool(vars(owner) == before)  # compares ids first
    except Exception:  # an array was replaced
        return False


def _restored(owner: Any, before: dict[str, Any], patched: set[object]) -> list[str]:
    """Restore the attributes of a module or class that were replaced, and return their names."""
    now = vars(owner)
    changed = [name for name, value in before.items() if now.get(name) is not value]
    left = [name for name in changed if name in patched or callable(before[name]) or hasattr(before[name], "__get__")]
    for name in left:
        setattr(owner, name, before[name])
    before |= now
    full = owner.__name__ if isinstance(owner, ModuleType) else f"{owner.__module__}.{owner.__qualname__}"
    return [f"{full}.{name}" for name in left]
