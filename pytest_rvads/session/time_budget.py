"""A time budget for a session: the most informative items run first, and items after the deadline are NOT RUN.

The wall clock decides only which items start. No run depends on the wall clock.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.session.plan import start

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record

__all__ = ["BUDGET", "Budget", "OutOfTime"]

_STARTED = "rvads_started"
_HISTORY = "rvads/exercised"
"""Key of pytest's cache for the number of sessions with a budget in which an item ran."""
_FAILED = "cache/lastfailed"
"""Pytest's key of its cache for the failures of the last session."""


class OutOfTime(pytest.skip.Exception):  # type: ignore[name-defined,misc]
    """The time budget of the session was used up before the item started."""


class Budget:
    """Sorts the items of this plugin to the front, and skips items after the deadline."""

    def __init__(self, config: pytest.Config, seconds: float) -> None:
        self._config = config
        self._started: float = getattr(config, "workerinput", {}).get(_STARTED) or time.time()
        self._deadline = self._started + seconds
        self.reason = f"NOT RUN: the time budget of {seconds:g} s is used up"

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort the items by `priority`; every worker gets the same order."""
        records = {item.nodeid: record for item in items if (record := start(item))}
        order = {nodeid: i for i, nodeid in enumerate(priority(records.values(), self._cached(_FAILED), self._cached(_HISTORY)))}
        items.sort(key=lambda item: order.get(item.nodeid, len(order)))

    def check_deadline(self) -> None:
        """Skip the current item after the deadline.

        Raises:
            OutOfTime: the deadline is over.
        """
        if time.time() > self._deadline:
            raise OutOfTime(self.reason)

    def remember(self, records: Iterable[Record]) -> None:
        """Count the runs of each item, so that the next session begins with the items that ran least often."""
        cache = getattr(self._config, "cache", None)
        if cache is not None:
            history = Counter(self._cached(_HISTORY))
            history.update(record.nodeid for record in records if record.status is not Outcome.NOT_RUN)
            cache.set(_HISTORY, dict(history))

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Send the start time of the session to a worker."""
        node.workerinput[_STARTED] = self._started

    def _cached(self, key: str) -> dict[str, Any]:
        cache = getattr(self._config, "cache", None)
        entry = cache.get(key, {}) if cache is not None else {}
        return entry if isinstance(entry, dict) else {}


BUDGET: pytest.StashKey[Budget | None] = pytest.StashKey()


def priority(records: Iterable[Record], failed: Mapping[str, Any], history: Mapping[str, int]) -> list[str]:
    """Return the node ids in the order in which their items should run.

    The items of one run stay together, and so do the variants of a test with one start, so that a start that is left out is
    left out for every variant. Runs with a failure in the last session come first. Then comes one run of every class, in the
    configuration that ran least so far; among configurations that ran equally often, the choice changes from class to class.
    Then come the other runs, those that ran least first, the classes in turn.

    Args:
        records: starts of the records of all items.
        failed: node ids that failed in the last session.
        history: node id to the number of earlier sessions in which it ran.
    """
    from pytest_rvads.report.record import RecordedItem

    runs: dict[tuple[Any, ...], list[str]] = {}
    classes: dict[tuple[Any, ...], list[tuple[Any, ...]]] = {}
    for record in records:
        group: tuple[Any, ...] = (record.junction,)
        start: tuple[Any, ...]
        if isinstance(record, RecordedItem):
            start = (record.recording,)
        else:
            group, start = (*group, record.cls), (record.scenario, record.cfg, record.rotation, record.seat)
        run = record.nodeid.partition("[")[0], *group, *start
        if run not in runs:
            classes.setdefault(group, []).append(run)
        runs.setdefault(run, []).append(record.nodeid)
    ranks: dict[tuple[Any, ...], tuple[int, ...]] = {}
    for turn, members in enumerate(classes.values()):
        executions = {run: min(history.get(nodeid, 0) for nodeid in runs[run]) for run in members}
        shifted = members[turn % len(members) :] + members[: turn % len(members)]
        for place, run in enumerate(sorted(shifted, key=executions.__getitem__)):
            failed_before = any(nodeid in failed for nodeid in runs[run])
            ranks[run] = (0, 0, 0) if failed_before else (1, 0, 0) if place == 0 else (2, executions[run], place)
    return [nodeid for run in sorted(runs, key=ranks.__getitem__) for nodeid in runs[run]]
