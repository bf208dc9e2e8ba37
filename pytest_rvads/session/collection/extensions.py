"""Additions of users to a session: hooks of a ``conftest.py`` or plugin, and rules of a test file, which only this file knows.

A desk is a place for registered rules. The session has a desk until its end, each test file has a desk while pytest collects or
runs the file, and each test has a desk while the test runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.logic.rules.current import PROCESS, Desk, desk, own_desk
from pytest_rvads.support.errors import ScenarioError

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


_SESSION: pytest.StashKey[Desk] = pytest.StashKey()
"""The desk (place for registered rules and predicates) of the session, whose rules all test files know."""
_FILES: pytest.StashKey[dict[str, Any]] = pytest.StashKey()
"""By test file, its rules at the end of its last use; Python imports a file, which registers the rules, only once."""


@dataclass(frozen=True, slots=True)
class Extensions:
    """Junctions and grids that users added by name."""

    junctions: Mapping[str, tuple[str, str]]
    """By name, the map file and the junction in the map."""
    grids: Mapping[str, tuple[Any, Any]]
    """By name, distances [m] and speeds [m/s]."""


_EXTENSIONS: pytest.StashKey[Extensions] = pytest.StashKey()


def extensions(config: pytest.Config, rules: Path | None) -> Extensions:
    """Call the hooks of users once per process, register their rules and those of a file, and return junctions and grids."""
    __tracebackhide__ = True
    if _EXTENSIONS in config.stash:
        return config.stash[_EXTENSIONS]
    from pytest_rvads.geometry.finder import names
    from pytest_rvads.logic.rules.book import current_book, load_rules
    from pytest_rvads.logic.rules.rule import Rule

    if rules is not None:
        load_rules(rules)
    for given in config.hook.pytest_rvads_rules(config=config):
        if isinstance(given, str | bytes | Mapping) or not hasattr(given, "__iter__"):
            raise ScenarioError(f"pytest_rvads_rules must give a list of rules or files of rules, got {given!r}")
        for rule in given:
            if isinstance(rule, str | Path):
                load_rules(config.rootpath / rule)
            elif not isinstance(rule, Rule) or rule not in current_book().own:
                raise ScenarioError(f"pytest_rvads_rules must give rules made by rvads.rule or files of rules, got {rule!r}")
    junctions: dict[str, tuple[str, str]] = {}
    for name, value in _merged(config, "pytest_rvads_junctions", names()).items():
        if not (_is_pair(value) and isinstance(value[0], str | Path) and isinstance(value[1], str)):
            raise ScenarioError(
                f"pytest_rvads_junctions must give a map file and a junction in it for {name!r}, such as "
                f"('town.xodr', '169'), got {value!r}"
            )
        junctions[name] = str((config.rootpath / value[0]).resolve()), value[1]
    grids = _merged(config, "pytest_rvads_grids", ("paper", *"ABCDEFGHIJ"))
    for name, value in grids.items():
        if not _is_pair(value):
            raise ScenarioError(f"pytest_rvads_grids must give distances and speeds for {name!r}, got {value!r}")
    config.stash[_EXTENSIONS] = Extensions(junctions, {name: (value[0], value[1]) for name, value in grids.items()})
    return config.stash[_EXTENSIONS]


def _merged(config: pytest.Config, hook: str, taken: Sequence[str]) -> dict[str, Any]:
    """Merge the dictionaries that the implementations of a hook return into one dictionary."""
    __tracebackhide__ = True
    merged: dict[str, Any] = {}
    for names in getattr(config.hook, hook)(config=config):
        if not isinstance(names, Mapping):
            raise ScenarioError(f"{hook} must give a dict with names as keys, got {names!r}")
        for name, value in names.items():
            if name in taken or name in merged:
                raise ScenarioError(f"{hook} gives {name!r}, which is taken already: choose another name")
            merged[name] = value
    return merged


def _is_pair(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 2


@contextmanager
def open_session(config: pytest.Config) -> Iterator[None]:
    """Open a place for the rules that are registered during a session; the rules are forgotten at the end of the session.

    At its beginning the session knows the rules that were registered outside of any session. A test can start an inner session of
    pytest in the same process; the inner session does not know the rules of the test.
    """
    with own_desk(Desk(PROCESS.book, index=Desk(PROCESS.book))) as config.stash[_SESSION]:
        yield


@contextmanager
def open_book(node: pytest.Item | pytest.Collector) -> Iterator[None]:
    """Make the rules of the test file of a node available beside the session's rules; for a test item, also its own rules."""
    outer = node.config.stash.get(_SESSION, desk())  # the desk of the process, if a conftest.py loads the plugin
    file, module = "", node.getparent(pytest.Module)
    if module is not None:
        patterns: list[str] = node.config.getini("python_files")
        is_test_file = type(module) is pytest.Module or any(map(module.path.match, patterns))
        file = str(module.path) if is_test_file else ""  # the session's rules hold in a module that has only doctests
    with ExitStack() as opened:
        files = node.config.stash.setdefault(_FILES, {})
        if file:
            book = files.get(file) or outer.book
            if book is not outer.book and outer.book is not None:
                from pytest_rvads.logic.rules.book import joined  # imported only if a file registers rules

                book = joined(outer.book, book)
            outer = opened.enter_context(own_desk(Desk(book, file, outer.index or Desk(book))))
        if isinstance(node, pytest.Item):
            opened.enter_context(own_desk(Desk(outer.book, str(node.path), outer.index, test=True)))
        yield
        if file:
            files[file] = outer.book


@contextmanager
def outliving(fixture: pytest.FixtureDef[Any]) -> Iterator[None]:
    """Keep the rules that a fixture registers during its setup until the scope of the fixture ends."""
    opened = desk()
    before, opened.outlived = opened.outlived, opened.test and fixture.scope != "function"
    try:
        yield
    finally:
        opened.outlived = before
