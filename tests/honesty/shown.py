"""Which test shows which entry of the catalogue: noted where tests are defined, compared in ``test_catalogue.py``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import pytest

__all__ = ["SHOWN", "shows", "shows_each"]

Test = TypeVar("Test", bound=Callable[..., Any])

SHOWN: dict[str, set[str]] = {}
"""Name of an entry to the tests that show it; it has to be one."""


def shows(*names: str) -> Callable[[Test], Test]:
    """Note that a test shows the entries of these names."""

    def note(test: Test) -> Test:
        for name in names:
            SHOWN.setdefault(name, set()).add(f"{test.__module__}.{test.__qualname__}")
        return test

    return note


def shows_each(cases: Mapping[str, Any]) -> Callable[[Test], pytest.MarkDecorator]:
    """Run a test once for every case, as its argument `case`, and note that it shows the entry of the case's name."""

    def note(test: Test) -> Any:
        return pytest.mark.parametrize("case", cases.values(), ids=cases)(shows(*cases)(test))

    return note
