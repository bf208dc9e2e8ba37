"""Hooks that a ``conftest.py`` or another plugin can implement to extend pytest-rvads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule


@pytest.hookspec
def pytest_rvads_junctions(config: pytest.Config) -> Mapping[str, tuple[str | Path, str]]:  # type: ignore[empty-body]
    """Return a dict of your junctions: the key is a name for ``@rvads.scenario``, the value is a pair.

    The pair is a map file and the id or type of a junction in the file.
    A relative path starts at pytest's root folder. The hook is called once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_junctions(config):
        ...     return {"depot": ("maps/depot.xodr", "169"), "town": ("maps/town.xodr", "4-way stop")}
    """


@pytest.hookspec
def pytest_rvads_rules(config: pytest.Config) -> Iterable[Rule | str | Path]:  # type: ignore[empty-body]
    """Return your rules, made by ``rvads.rule``, or files of rules; the argument ``rules=`` of marks can name these rules.

    A relative path starts at pytest's root folder. The hook is called once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_rules(config):
        ...     return ["rules/site.ini"]
    """


@pytest.hookspec
def pytest_rvads_grids(config: pytest.Config) -> Mapping[str, tuple[Any, Any]]:  # type: ignore[empty-body]
    """Return a dict of your grids: the key is a name for ``grid=`` or ``--rvads-grid``, the value is a pair.

    The pair is the values of the arguments ``distances=`` [m] and ``speeds=`` [m/s] of ``@rvads.scenario``.
    Points from which a vehicle can't stop before its line (beyond the braking envelope v(d)max) are left out. The hook is called
    once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_grids(config):
        ...     return {"rush": ([5.0, 20.0], [0.0, 3.0])}
    """


@pytest.hookspec
def pytest_rvads_verdict(record: dict[str, Any], config: pytest.Config) -> None:
    """Receive the record of an item when the item ends.

    The record has the fields of a record in the JSON report (see docs/sessions.md), as values of built-in types; hooks must not
    change the record.
    The hook is called in the main process, also under xdist, and not for items that never ran. A repeated item calls the hook
    once per repetition. Since 0.1.
    """
