"""From the marks of a test to its runs; everything left out is noted for the summary and the reports.

A junction of many at which a mark has no scenario is left out, and every output counts it with the reason. A single junction
without a scenario, and a mark without any scenario, are refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Sized
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

from pytest_rvads.session.collection.misuse import told_at
from pytest_rvads.session.collection.resolved import PlannedRun, Resolved, Runs
from pytest_rvads.support.errors import ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.report.session_report import Drawn, Extent
    from pytest_rvads.session.collection.ask import Ask
    from pytest_rvads.session.collection.extensions import Extensions
    from pytest_rvads.session.options import Options

__all__ = ["DRAWN", "EXTENTS", "LEFT_OUT", "REFUSED", "UNFIT", "planned_runs", "resolve", "watched"]

T = TypeVar("T")
_POINTS, _RUNS = 10, 5000
"""Least number of points of a grid, and of runs to draw from, for which a terminal shows the progress of the collection."""
LEFT_OUT: pytest.StashKey[dict[str, int]] = pytest.StashKey()
"""Node id of a test to the number of points of its grid that were left out, because they are beyond v(d)max."""
UNFIT: pytest.StashKey[dict[str, int]] = pytest.StashKey()
"""Node id of a test to the number of scenarios that were left out, because a vehicle has no room at its start."""
REFUSED: pytest.StashKey[dict[str, dict[str, None]]] = pytest.StashKey()
"""Reason for which junctions are left out, or run with other starts than requested, to the names of the junctions."""
DRAWN: pytest.StashKey[dict[Drawn, None]] = pytest.StashKey()
"""Tests that run only a sample of their runs, with the size of the sample."""
EXTENTS: pytest.StashKey[dict[str, Extent]] = pytest.StashKey()
"""Junction to its numbers of classes and pairs, if its number of ways does not determine them."""


def resolve(ask: Ask, test: pytest.Function, options: Options, added: Extensions, takes_rule: bool) -> tuple[Resolved, ...]:
    """Return what one mark of a test selects at each junction, and note what is left out.

    Args:
        ask: the arguments of the mark.
        test: the test function.
        options: options of the session.
        added: junctions and grids that users add by hooks.
        takes_rule: whether the test runs over rules.

    Raises:
        RvadsError: a junction does not exist, no junction fits the mark, or the test would have too many items.
    """
    stash = test.config.stash
    watch = partial(watched, test.config, "v(d)max of point", least=_POINTS)
    selected = ask.resolve(test.path.parent, options, added, watch, takes_rule)
    if options.sample is None:
        _refuse_many(selected.resolved, options)
    from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT, extended

    extents_by_junction: dict[str, Extent] = stash.setdefault(EXTENTS, {})
    for resolved in selected.resolved:
        _note_left_out(stash, LEFT_OUT, test.nodeid, resolved.selection.left_out)
        extents_by_junction = extended(extents_by_junction, resolved.selection)
    stash[EXTENTS] = extents_by_junction
    bends = [(name, TOO_TIGHT) for resolved in selected.resolved for name in resolved.selection.too_tight]
    too_short = [(resolved.selection.place.name, TOO_SHORT) for resolved in selected.resolved if resolved.selection.too_short]
    for name, reason in (*selected.left_out, *bends, *too_short):
        stash.setdefault(REFUSED, {}).setdefault(reason, {})[name] = None
    if selected.passed_over:
        count = len(selected.resolved)
        _note_sample(stash, test.nodeid, "junctions", count, count + selected.passed_over, options.seed)
    return selected.resolved


def planned_runs(resolved: Sequence[Resolved], test: pytest.Function, options: Options) -> Iterator[PlannedRun]:
    """Yield the runs of a test, or a sample of them, and note how many runs and scenarios are left out.

    Raises:
        Misuse: the test would have too many items.
    """
    stash = test.config.stash
    most = sum(at_junction.runs for at_junction in resolved) if options.sample else 0
    watch = partial(watched, test.config, f"runs of {test.originalname} to draw from", least=_RUNS, most=most)
    runs = Runs(resolved, test.nodeid, watch)
    if options.sample is None:
        yield from runs
    else:
        drawn = runs.drawn(options.sample, options.seed)
        items = sum(len(run.resolved.rules) for run in drawn)
        if items > options.max_items:
            with told_at(f"{resolved[0].mark}: {test.nodeid}"):
                raise ScenarioError(
                    f"would expand to {items:,} items ({len(drawn):,} runs drawn): lower --rvads-sample, ask for fewer rules, or "
                    "raise --rvads-max-items"
                )
        if len(drawn) < runs.total:
            _note_sample(stash, test.nodeid, "runs", len(drawn), runs.total, options.seed)
        yield from drawn
    _note_left_out(stash, UNFIT, test.nodeid, runs.unfit)


def _refuse_many(marks: Sequence[Resolved], options: Options) -> None:
    """Raise a `ScenarioError` for a mark that would give more items than a test may have."""
    total = sum(resolved.runs * len(resolved.rules) for resolved in marks)
    if total <= options.max_items:
        return
    first = marks[0]
    rows, points = first.selection.count(), first.selection.points
    among = f" × {len(first.traffic)} kinds of traffic" if len(first.traffic) > 1 else ""
    factors = f"({rows:,} scenarios × {points} points{among} × {len(first.rules)} rules)"
    raise ScenarioError(
        f"would expand to {total:,} items {factors if len(marks) == 1 else f'at {len(marks):,} junctions'}: "
        "narrow the grid, use --rvads-cover=class, run some of them by --rvads-sample, or raise --rvads-max-items"
    )


def _note_left_out(stash: pytest.Stash, key: pytest.StashKey[dict[str, int]], test: str, count: int) -> None:
    """Add to the number of points or scenarios that a test leaves out."""
    if count:
        dropped = stash.setdefault(key, {})
        dropped[test] = dropped.get(test, 0) + count


def _note_sample(stash: pytest.Stash, test: str, what: str, taken: int, total: int, seed: int) -> None:
    """Note that a test runs a sample: `taken` of `total` junctions or runs."""
    from pytest_rvads.report.session_report import Drawn

    stash.setdefault(DRAWN, {})[Drawn(test, what, taken, total, seed)] = None


def watched(config: pytest.Config, what: str, things: Iterable[T], least: int, most: int = 0) -> Iterator[T]:
    """Yield things; on a terminal, show the number of things done in a line that is overwritten.

    Args:
        config: configuration of the session; workers, pipes and ``-q`` show nothing.
        what: the things in words.
        things: the things to yield.
        least: least number of things for which the line is shown.
        most: number of things, if they have no length.
    """
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    capture: Any = config.pluginmanager.get_plugin("capturemanager")
    shown = reporter is not None and reporter.isatty and reporter.verbosity >= 0 and not hasattr(config, "workerinput")
    total = len(things) if isinstance(things, Sized) else most
    for done, thing in enumerate(things):
        if shown and total >= least and done % max(1, total // 100) == 0:
            with capture.global_and_fixture_disabled() if capture else nullcontext():
                reporter.rewrite(f"rvads: {what} {done:,}/{total:,}", erase=True)
        yield thing
