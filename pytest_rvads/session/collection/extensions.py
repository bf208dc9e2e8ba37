"""Junctions, rules and grids that users add by hooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.support.errors import ScenarioError

__all__ = ["Extensions", "extensions"]


@dataclass(frozen=True, slots=True)
class Extensions:
    """Junctions and grids that users added by name."""

    junctions: Mapping[str, tuple[str, str]]
    """Name to the map file and the junction in the map."""
    grids: Mapping[str, tuple[Any, Any]]
    """Name to distances [m] and speeds [m/s]."""


_EXTENSIONS: pytest.StashKey[Extensions] = pytest.StashKey()


def extensions(config: pytest.Config, rules: Path | None) -> Extensions:
    """Return the junctions and grids of the hooks, and register the rules of the hooks; the hooks are called once per process.

    Args:
        config: configuration of the session.
        rules: file of ``--rvads-rules``, or None.

    Raises:
        RvadsError: a hook returns a value of another form, or a name that is taken.
    """
    if _EXTENSIONS not in config.stash:
        _register_rules(config, rules)
        config.stash[_EXTENSIONS] = Extensions(_junctions(config), _grids(config))
    return config.stash[_EXTENSIONS]


def _junctions(config: pytest.Config) -> dict[str, tuple[str, str]]:
    from pytest_rvads.geometry.finder import names

    junctions: dict[str, tuple[str, str]] = {}
    for name, value in _merged("pytest_rvads_junctions", config.hook.pytest_rvads_junctions(config=config), names()).items():
        if not (_is_pair(value) and isinstance(value[0], str | Path) and isinstance(value[1], str)):
            raise ScenarioError(
                f"pytest_rvads_junctions must give a map file and a junction in it for {name!r}, such as "
                f"('town.xodr', '169'), got {value!r}"
            )
        junctions[name] = str((config.rootpath / value[0]).resolve()), value[1]
    return junctions


def _grids(config: pytest.Config) -> dict[str, tuple[Any, Any]]:
    grids = _merged("pytest_rvads_grids", config.hook.pytest_rvads_grids(config=config), ("paper", *"ABCDEFGHIJ"))
    for name, value in grids.items():
        if not _is_pair(value):
            raise ScenarioError(f"pytest_rvads_grids must give distances and speeds for {name!r}, got {value!r}")
    return {name: (value[0], value[1]) for name, value in grids.items()}


def _register_rules(config: pytest.Config, file: Path | None) -> None:
    from pytest_rvads.logic.rules.book import current_book
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.logic.rules.rulefile import load_rules

    if file is not None:
        load_rules(file)
    for rules in config.hook.pytest_rvads_rules(config=config):
        if isinstance(rules, str | bytes | Mapping) or not hasattr(rules, "__iter__"):
            raise ScenarioError(f"pytest_rvads_rules must give a list of rules or files of rules, got {rules!r}")
        for rule in rules:
            if isinstance(rule, str | Path):
                load_rules(config.rootpath / rule)
            elif not isinstance(rule, Rule) or rule not in current_book().own:
                raise ScenarioError(f"pytest_rvads_rules must give rules made by rvads.rule or files of rules, got {rule!r}")


def _merged(hook: str, results: Sequence[Any], taken: Sequence[str]) -> dict[str, Any]:
    """Return the names and values of all implementations of a hook as one dictionary.

    Args:
        hook: name of the hook, for messages.
        results: a dictionary per implementation.
        taken: names that are not free.
    """
    merged: dict[str, Any] = {}
    for names in results:
        if not isinstance(names, Mapping):
            raise ScenarioError(f"{hook} must give a dict with names as keys, got {names!r}")
        for name, value in names.items():
            if name in taken or name in merged:
                raise ScenarioError(f"{hook} gives {name!r}, which is taken already: choose another name")
            merged[name] = value
    return merged


def _is_pair(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 2
