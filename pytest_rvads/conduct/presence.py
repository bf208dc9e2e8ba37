"""Who is near the junction at the same time, in runs whose vehicles come and go."""

from __future__ import annotations

import numpy as np

from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["judged", "together"]


def judged(run: Run) -> frozenset[int] | None:
    """Return the columns of the agents whose instances are judged in this run, None where all are."""
    if run.excerpt is None or run.excerpt.judged is None:
        return None
    names = set(run.excerpt.judged)
    return frozenset(column for column, agent in enumerate(run.agents) if agent.name in names)


def together(run: Run) -> frozenset[tuple[int, int]] | None:
    """Return the pairs of columns of agents that are in the run at the same time, in both orders; None where nobody is absent."""
    if not (run.zone == Zone.ABSENT).any():
        return None
    begin, end = run.spans.T
    overlap = np.minimum(end[:, None], end) > np.maximum(begin[:, None], begin)
    return frozenset((one, two) for one, two in np.argwhere(overlap).tolist() if one != two)
