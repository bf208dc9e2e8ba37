"""Hooks that a ``conftest.py`` or another plugin may implement to extend pytest-rvads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule

__all__ = ["pytest_rvads_grids", "pytest_rvads_junctions", "pytest_rvads_rules", "pytest_rvads_verdict"]


@pytest.hookspec
def pytest_rvads_junctions(config: pytest.Config) -> Mapping[str, tuple[str | Path, str]]:  # type: ignore[empty-body]
    """Return your junctions: a name for ``@rvads.scenario`` to an OpenDRIVE file and the id or type of a junction in this file.

    A relative path starts at pytest's root folder. The hook is called once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_junctions(config):
        ...     return {"depot": ("maps/depot.xodr", "169"), "town": ("maps/town.xodr", "4-way stop")}
    """


@pytest.hookspec
def pytest_rvads_rules(config: pytest.Config) -> Iterable[Rule | str | Path]:  # type: ignore[empty-body]
    """Return your rules, made by ``rvads.rule``, or files of rules; ``rules=`` of a mark may then name these rules.

    A relative path starts at pytest's root folder. The hook is called once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_rules(config):
        ...     return ["rules/site.ini"]
    """


@pytest.hookspec
def pytest_rvads_grids(config: pytest.Config) -> Mapping[str, tuple[Any, Any]]:  # type: ignore[empty-body]
    """Return your grids: a name for ``grid=`` or ``--rvads-grid`` to ``distances=`` [m] and ``speeds=`` [m/s] of the mark.

    Points beyond the braking envelope are left out. The hook is called once per process, at collection. Since 0.1.

    Example:
        >>> def pytest_rvads_grids(config):
        ...     return {"rush": ([5.0, 20.0], [0.0, 3.0])}
    """


@pytest.hookspec
def pytest_rvads_verdict(record: dict[str, Any], config: pytest.Config) -> None:
    """Receive the record of an item when the item ends.

    The record has the fields of a record in the JSON report (see docs/sessions.md), as builtins; hooks must not change it.
    The hook is called in the main process, also under xdist, and not for items that never ran. A repeated item calls the hook
    once per repetition. Since 0.1.
    """
