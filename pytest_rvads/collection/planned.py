"""From the marks of a test to its runs, with what is left out noted for the summary and the reports.

What does not fit at one of many junctions costs that junction alone, and every output counts it with the reason. A junction that
the mark names by its id, and a mark of which nothing is left, are refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.collection.meter import watched
from pytest_rvads.collection.misuse import told_at
from pytest_rvads.collection.resolved import PlannedRun, Resolved, Runs
from pytest_rvads.errors import ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.collection.ask import Ask
    from pytest_rvads.collection.extensions import Extensions
    from pytest_rvads.options import Options
    from pytest_rvads.report.session_report import Drawn, Extent

__all__ = ["DRAWN", "EXTENTS", "LEFT_OUT", "REFUSED", "UNFIT", "planned_runs", "resolve"]

_POINTS, _RUNS = 10, 5000
"""From how many points, or runs that some are drawn from, on a terminal shows how far the collection is."""
LEFT_OUT: pytest.StashKey[dict[str, int]] = pytest.StashKey()
"""Node id of a test to how many points of its grid are beyond v(d)max and were left out."""
UNFIT: pytest.StashKey[dict[str, int]] = pytest.StashKey()
"""Likewise to how many scenarios were left out because a vehicle has no room where it would start."""
REFUSED: pytest.StashKey[dict[str, dict[str, None]]] = pytest.StashKey()
"""Why junctions are left out, or run otherwise than asked for, to their names."""
DRAWN: pytest.StashKey[dict[Drawn, None]] = pytest.StashKey()
"""Tests that run only a sample of their runs, with the size of the sample."""
EXTENTS: pytest.StashKey[dict[str, Extent]] = pytest.StashKey()
"""Junction to how much there is to cover, where its number of ways does not tell."""


def resolve(ask: Ask, test: pytest.Function, options: Options, added: Extensions, takes_rule: bool) -> tuple[Resolved, ...]:
    """Return what one mark of a test comes to, and note what it leaves out.

    Args:
        ask: the mark.
        test: the test function.
        options: of the session.
        added: what users add by hooks.
        takes_rule: whether the test runs over rules.

    Raises:
        RvadsError: no such junction, none that has what is asked for, or more items than a test may have.
    """
    stash = test.config.stash
    watch = partial(watched, test.config, "v(d)max of point", least=_POINTS)
    found = ask.resolve(test.path.parent, options, added, watch, takes_rule)
    if options.sample is None:
        _refuse_many(found.resolved, options)
    from pytest_rvads.scenarios.selection import extended
    from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT

    known: dict[str, Extent] = stash.setdefault(EXTENTS, {})
    for resolved in found.resolved:
        _count(stash, LEFT_OUT, test.nodeid, resolved.selection.left_out)
        known = extended(known, resolved.selection)
    stash[EXTENTS] = known
    bends = [(name, TOO_TIGHT) for resolved in found.resolved for name in resolved.selection.too_tight]
    short = [(one.selection.place.name, TOO_SHORT) for one in found.resolved if one.selection.too_short]
    for name, reason in (*found.left_out, *bends, *short):
        stash.setdefault(REFUSED, {}).setdefault(reason, {})[name] = None
    if found.passed_over:
        taken = len(found.resolved)
        _draw(stash, test.nodeid, "junctions", taken, taken + found.passed_over, options.seed)
    return found.resolved


def planned_runs(resolved: Sequence[Resolved], test: pytest.Function, options: Options) -> Iterator[PlannedRun]:
    """Yield the runs of a test, or those of them that are drawn, and note how many are left out.

    Raises:
        Misuse: more items than a test may have.
    """
    stash = test.config.stash
    most = sum(one.runs for one in resolved) if options.sample else 0
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
            _draw(stash, test.nodeid, "runs", len(drawn), runs.total, options.seed)
        yield from drawn
    _count(stash, UNFIT, test.nodeid, runs.unfit)


def _refuse_many(found: Sequence[Resolved], options: Options) -> None:
    """Refuse a mark that asks for more items than a test may have."""
    total = sum(resolved.runs * len(resolved.rules) for resolved in found)
    if total <= options.max_items:
        return
    first = found[0]
    rows, points = first.selection.count(), first.selection.points
    among = f" × {len(first.traffic)} kinds of traffic" if len(first.traffic) > 1 else ""
    told = f"({rows:,} scenarios × {points} points{among} × {len(first.rules)} rules)"
    raise ScenarioError(
        f"would expand to {total:,} items {told if len(found) == 1 else f'at {len(found):,} junctions'}: "
        "narrow the grid, use --rvads-cover=class, run some of them by --rvads-sample, or raise --rvads-max-items"
    )


def _count(stash: pytest.Stash, key: pytest.StashKey[dict[str, int]], test: str, count: int) -> None:
    """Note that a test leaves out so many more."""
    if count:
        dropped = stash.setdefault(key, {})
        dropped[test] = dropped.get(test, 0) + count


def _draw(stash: pytest.Stash, test: str, what: str, taken: int, total: int, seed: int) -> None:
    """Note that so many of all that a test asks for were drawn."""
    from pytest_rvads.report.session_report import Drawn

    stash.setdefault(DRAWN, {})[Drawn(test, what, taken, total, seed)] = None
