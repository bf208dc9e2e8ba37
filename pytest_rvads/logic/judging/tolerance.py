"""How wrong the measurements of a recorded run can be before a violation is in doubt.

If a map lies 0.8 m beside the road, vehicles that keep the rules seem to break the rules. So a violation is judged again with
places, or speeds, that are less exact than the recording says. The same errors are tried for all rules, so that rules share runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pytest_rvads.logic.judging.readings import SURE
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Excerpt, Run, once

__all__ = ["tolerance"]

_KINDS = (("places", "m", (0.1, 0.2, 0.4, 0.8, 1.6)), ("speeds", "m/s", (0.1, 0.2, 0.5, 1.0, 2.0)))
"""Per kind of measurement its name, its unit, and the errors that are tried."""


def tolerance(run: Run, status_of: Callable[[Run], Status]) -> str:
    """Return in words with how large an error of the measurements a violation stays definite.

    Args:
        run: an excerpt of a recording with stations and speeds, on which a rule is violated.
        status_of: judges the violated instances of the rule on a run.
    """
    parts = []
    for kind, (noun, unit, errors) in enumerate(_KINDS):
        held = 0
        while held < len(errors) and status_of(once(run, _less_exact, kind, held)) is Status.FAIL:
            held += 1
        if held < len(errors):
            limit = f"at {errors[held]:g} {unit} it is in doubt"
            parts.append(
                f"{noun} may be wrong by {errors[held - 1]:g} {unit}, {limit}" if held else f"if {noun} are wrong {limit}"
            )
    most = " and ".join(f"{noun} are wrong by {errors[-1]:g} {unit}" for noun, unit, errors in _KINDS)
    return "; ".join(parts) or f"a violation even if {most}"


def _less_exact(run: Run, kind: int, number: int) -> Run:
    """Return a run whose places (kind 0) or speeds (kind 1) are known to an error of `_KINDS` only."""
    excerpt, error = run.excerpt or Excerpt(), _KINDS[kind][2][number]
    if kind:
        return replace(run, excerpt=replace(excerpt, speed_accuracy=max(excerpt.speed_accuracy, error / SURE)))
    spread = np.full(run.zone.shape, error) if run.spread is None else np.maximum(run.spread, error)
    accuracy = max(excerpt.position_accuracy, error / SURE)
    return replace(run, spread=spread, excerpt=replace(excerpt, position_accuracy=accuracy))
