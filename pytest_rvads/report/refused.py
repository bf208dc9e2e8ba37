"""What tests asked for and did not run: junctions that are left out, by reason, and what was not drawn."""

from __future__ import annotations

from pytest_rvads.report.session_report import Report

__all__ = ["refused"]

_NAMED = 5
"""Junctions named per reason."""


def refused(report: Report, most: int | None = None) -> list[str]:
    """Return a line per reason why junctions are left out, the most frequent first, and one per test that ran a sample.

    Args:
        report: of a session, or merged.
        most: reasons told; the junctions of the others are counted.
    """
    reasons = sorted(report.refused.items(), key=lambda entry: -len(entry[1]))
    lines = [f"{_counted(len(names))} left out: {reason}: {_first(names)}" for reason, names in reasons[:most]]
    others = {name for _, names in reasons[len(lines) :] for name in names}
    if others:
        lines.append(f"{_counted(len(others))} left out for other reasons: the reports of --rvads-report say which")
    return lines + [f"{one.taken:,} of {one.total:,} {one.what} drawn, seed {one.seed}: {one.test}" for one in report.drawn]


def _counted(count: int) -> str:
    return f"{count:,} junction{'' if count == 1 else 's'}"


def _first(names: tuple[str, ...]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
