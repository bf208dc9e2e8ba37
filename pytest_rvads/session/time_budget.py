"""A time budget for a session: the most telling items first, and what is left when the time is up is NOT RUN.

The wall clock decides only which items still start; no run depends on it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.outcome import Outcome
from pytest_rvads.session.plan import start

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record

__all__ = ["BUDGET", "Budget", "OutOfTime"]

_STARTED = "rvads_started"
_HISTORY = "rvads/exercised"
"""Key of pytest's cache: in how many sessions with a budget an item ran."""
_FAILED = "cache/lastfailed"
"""Pytest's own key: what failed in the last session."""


class OutOfTime(pytest.skip.Exception):  # type: ignore[name-defined,misc]
    """The time budget of the session was used up before the item started."""


class Budget:
    """Puts the items of ours first and in order, and keeps those from starting that come too late."""

    def __init__(self, config: pytest.Config, seconds: float) -> None:
        self._config = config
        self._started: float = getattr(config, "workerinput", {}).get(_STARTED) or time.time()
        self._deadline = self._started + seconds
        self.reason = f"NOT RUN: the time budget of {seconds:g} s is used up"

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Put last failures first, then a run of every class, then what was covered least; the same in every worker."""
        records = {item.nodeid: record for item in items if (record := start(item))}
        order = {nodeid: i for i, nodeid in enumerate(priority(records.values(), self._cached(_FAILED), self._cached(_HISTORY)))}
        items.sort(key=lambda item: order.get(item.nodeid, len(order)))

    def spend(self) -> None:
        """Skip an item that is about to start too late.

        Raises:
            OutOfTime: the time is up.
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
        """Tell a worker when the session began."""
        node.workerinput[_STARTED] = self._started

    def _cached(self, key: str) -> dict[str, Any]:
        cache = getattr(self._config, "cache", None)
        found = cache.get(key, {}) if cache is not None else {}
        return found if isinstance(found, dict) else {}


BUDGET: pytest.StashKey[Budget | None] = pytest.StashKey()


def priority(records: Iterable[Record], failed: Mapping[str, Any], history: Mapping[str, int]) -> list[str]:
    """Return node ids in the order of their worth.

    The items of one run stay together, and so do the variants of a test in one start: what there is no time for is missing of
    every version of a controller. Runs with a failure of the last session come first; then a run of every class, in the
    configuration that ran least so far, else another one from class to class; then the runs that ran least, the classes
    taking turns.

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
    worth: dict[tuple[Any, ...], tuple[int, ...]] = {}
    for turn, members in enumerate(classes.values()):
        ran = {run: min(history.get(nodeid, 0) for nodeid in runs[run]) for run in members}
        shifted = members[turn % len(members) :] + members[: turn % len(members)]
        for place, run in enumerate(sorted(shifted, key=ran.__getitem__)):
            again = any(nodeid in failed for nodeid in runs[run])
            worth[run] = (0, 0, 0) if again else (1, 0, 0) if place == 0 else (2, ran[run], place)
    return [nodeid for run in sorted(runs, key=worth.__getitem__) for nodeid in runs[run]]
