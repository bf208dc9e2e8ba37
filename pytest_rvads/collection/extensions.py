"""What users add by hooks: junctions, rules and grids of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.errors import ScenarioError

__all__ = ["Extensions", "extensions"]


@dataclass(frozen=True, slots=True)
class Extensions:
    """Junctions, grids and drivers that users registered by name."""

    junctions: Mapping[str, tuple[str, str]]
    """Name to map file and junction in it."""
    grids: Mapping[str, tuple[Any, Any]]
    """Name to distances and speeds."""


_EXTENSIONS: pytest.StashKey[Extensions] = pytest.StashKey()


def extensions(config: pytest.Config, rules: Path | None) -> Extensions:
    """Return what the hooks of this session give, and put its rules into the book; once per session and process.

    Args:
        config: of the session.
        rules: a file of rules, if there is one.

    Raises:
        RvadsError: a hook gives something else, or a name that is taken.
    """
    if _EXTENSIONS not in config.stash:
        _rules(config, rules)
        config.stash[_EXTENSIONS] = Extensions(_junctions(config), _grids(config))
    return config.stash[_EXTENSIONS]


def _junctions(config: pytest.Config) -> dict[str, tuple[str, str]]:
    from pytest_rvads.junctions.finder import names

    found: dict[str, tuple[str, str]] = {}
    for name, value in _named("pytest_rvads_junctions", config.hook.pytest_rvads_junctions(config=config), names()).items():
        if not (_pair(value) and isinstance(value[0], str | Path) and isinstance(value[1], str)):
            raise ScenarioError(
                f"pytest_rvads_junctions must give a map file and a junction in it for {name!r}, such as "
                f"('town.xodr', '169'), got {value!r}"
            )
        found[name] = str((config.rootpath / value[0]).resolve()), value[1]
    return found


def _grids(config: pytest.Config) -> dict[str, tuple[Any, Any]]:
    found = _named("pytest_rvads_grids", config.hook.pytest_rvads_grids(config=config), ("paper", *"ABCDEFGHIJ"))
    for name, value in found.items():
        if not _pair(value):
            raise ScenarioError(f"pytest_rvads_grids must give distances and speeds for {name!r}, got {value!r}")
    return {name: (value[0], value[1]) for name, value in found.items()}


def _rules(config: pytest.Config, file: Path | None) -> None:
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


def _named(hook: str, given: Sequence[Any], taken: Sequence[str]) -> dict[str, Any]:
    """Return what several implementations of a hook give, under names that are free."""
    found: dict[str, Any] = {}
    for names in given:
        if not isinstance(names, Mapping):
            raise ScenarioError(f"{hook} must give names and what they stand for, as a dict, got {names!r}")
        for name, value in names.items():
            if name in taken or name in found:
                raise ScenarioError(f"{hook} gives {name!r}, which is taken already: choose another name")
            found[name] = value
    return found


def _pair(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 2
