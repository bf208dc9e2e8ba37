"""Planned tests that did not run: junctions that are left out or changed, by reason, and the sizes of samples."""

from __future__ import annotations

from pytest_rvads.report.session_report import Report
from pytest_rvads.wording import first, plural

__all__ = ["refused"]

_NAMED = 5
"""Most junctions named per reason."""


def refused(report: Report, most: int | None = None) -> list[str]:
    """Return a line per reason for left-out junctions or movements, the most frequent first, and a line per drawn sample.

    Args:
        report: the report of a session, or of several sessions merged.
        most: most reasons that have a line; the junctions of further reasons are counted.
    """
    reasons = sorted(report.refused.items(), key=lambda entry: -len(entry[1]))
    lines = []
    for reason, names in reasons[:most]:
        what = plural(len(names), "movement" if " from entrance " in names[0] else "junction")
        lines.append(f"{what}{'' if reason.startswith('with ') else ' left out:'} {reason}: {first(names, _NAMED)}")
    others = {name for _, names in reasons[len(lines) :] for name in names}
    if others:
        lines.append(f"{plural(len(others), 'junction')} left out for other reasons: reports in files say which")
    return lines + [f"{one.taken:,} of {one.total:,} {one.what} drawn, seed {one.seed}: {one.test}" for one in report.drawn]
