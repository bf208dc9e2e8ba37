"""What a failed comparison of runs or verdicts says, instead of all of their fields."""

from __future__ import annotations

import sys

__all__ = ["explain"]


def explain(op: str, left: object, right: object) -> list[str] | None:
    """Return the lines that explain why ``left op right`` is false, or None where it is not about runs or verdicts."""
    if op not in ("==", "!="):
        return None
    return _runs(op, left, right) or _verdicts(op, left, right)


def _runs(op: str, left: object, right: object) -> list[str] | None:
    if "pytest_rvads.runs.run" not in sys.modules:  # then neither is one, and numpy need not be loaded
        return None
    from pytest_rvads.runs.divergence import diverge
    from pytest_rvads.runs.run import Run

    if not (isinstance(left, Run) and isinstance(right, Run)):
        return None
    found = diverge(left, right)
    return [f"{left!r} {op} {right!r}", str(found) if found else f"the same bit for bit, hash {left.hash[:12]}"]


def _verdicts(op: str, left: object, right: object) -> list[str] | None:
    if "pytest_rvads.logic.judging.verdicts" not in sys.modules:
        return None
    from pytest_rvads.logic.judging.verdicts import Verdict

    if not (isinstance(left, Verdict) and isinstance(right, Verdict)):
        return None
    return [f"{left.rule} {left.status} {op} {right.rule} {right.status}", left.message, right.message]
