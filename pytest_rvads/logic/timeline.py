"""The verdicts of the monitors of a rule along a run, for people to look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.conduct.presence import without_jumps
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import walk
from pytest_rvads.logic.judging.prepare import prepare
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.telling.story import bound_names
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError

__all__ = ["Timeline", "timelines"]

_WORDS = {Truth.FALSE: "violated", Truth.TRUE: "satisfied"}


@dataclass(frozen=True, slots=True)
class Timeline:
    """The monitor of one instance along a run."""

    binding: tuple[tuple[str, str], ...]
    """Variables of the rule, and the names of the elements that the variables stand for."""
    changes: tuple[tuple[int, str], ...]
    """Pairs of tick and new state of the monitor.

    The states are ``watching`` (no obligation is due, every verdict is possible), ``due`` (an obligation is due), ``violated``
    and ``satisfied`` (whatever comes). Their LTL3 verdicts are ?, ?, F and T.
    """

    @property
    def moved(self) -> bool:
        """Whether the monitor ever left the state ``watching``."""
        return len(self.changes) > 1 or self.changes[0][1] != "watching"


def timelines(run: Run, rule: str | Rule) -> tuple[Timeline, ...]:
    """Return the timeline of every instance of a rule; none if the run does not hold what the rule needs.

    Args:
        run: the run.
        rule: a rule or the name of a rule.

    Raises:
        FormulaError: no rule has this name.
    """
    rule, run = get_rule(rule), without_jumps(run)
    templates = prepare(rule.formula, extract(run), rule.bound).templates
    try:
        walked = walk(templates, Values(run, rule.tie))
    except RunError:
        return ()
    result = []
    for template, states in zip(templates, walked, strict=True):
        ticks = np.concatenate(([0], np.flatnonzero(np.diff(states)) + 1))
        changes: list[tuple[int, str]] = []
        for tick in ticks.tolist():
            state = int(states[tick])
            word = _WORDS.get(Truth(int(template.machine.output[state])), "due" if state else "watching")
            if not changes or changes[-1][1] != word:
                changes.append((tick, word))
        result.append(Timeline(bound_names(template), tuple(changes)))
    return tuple(result)
