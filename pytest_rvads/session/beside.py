"""What stands beside the replay of an item's run: facts, the other verdicts, the run of the baseline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from pytest_rvads.errors import RvadsError
from pytest_rvads.options import Options

if TYPE_CHECKING:
    from pytest_rvads.draw.replay import Beside
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Report
    from pytest_rvads.runs.run import Run

__all__ = ["beside"]

_BASELINE: pytest.StashKey[Report | None] = pytest.StashKey()
"""What this process has read of it, once it has a failure to show."""


def beside(item: pytest.Item, options: Options, record: Record, run: Run, start: str, rerun: str) -> Beside:
    """Return what stands beside the replay of a failure; a rule that can't judge the run is an ERROR there.

    Args:
        item: that failed.
        options: of the session.
        record: of the item.
        run: of the item.
        start: how the run began, or which file it was recorded in.
        rerun: the command that runs the item once more.
    """
    from pytest_rvads.draw.replay import Beside
    from pytest_rvads.failure_page import other_verdicts
    from pytest_rvads.report.facts import facts
    from pytest_rvads.report.folders import INDEX

    others = other_verdicts(run, _rules(item, run), record.verdicts[-1].rule)
    ghost = _ghost(item, options, run)
    name = options.baseline.name if ghost is not None and options.baseline else ""
    return Beside(facts(record, start, rerun), others, INDEX, ghost, name)


def _rules(item: pytest.Item, run: Run) -> tuple[Rule, ...]:
    """Return the rules that the marks of a test name for its runs, whichever of them were selected; else the usual ones."""
    from pytest_rvads.failure_page import usual_rules
    from pytest_rvads.logic.rules.book import rules_for

    marks = [found for name in ("scenario", "recorded") for found in item.iter_markers_with_node(f"rvads_{name}")]
    named = [rule for node, mark in marks if node is marks[0][0] for rule in mark.args[0].rules or ()]
    return rules_for(named, run.junction) if named else usual_rules(run)


def _ghost(item: pytest.Item, options: Options, run: Run) -> Run | None:
    if options.baseline is None or run.excerpt is not None:
        return None
    from pytest_rvads.report.earlier import earlier_run

    baseline = _baseline(item, options)
    if baseline is None:
        return None
    return earlier_run(baseline, options.baseline.parent, item.config.invocation_params.dir, item.nodeid, run)


def _baseline(item: pytest.Item, options: Options) -> Report | None:
    stash = item.config.stash
    if _BASELINE not in stash:
        from pytest_rvads.report.files import load

        try:
            stash[_BASELINE] = load(options.baseline) if options.baseline else None
        except RvadsError:  # replaced since the main process read it
            stash[_BASELINE] = None
    return stash[_BASELINE]
