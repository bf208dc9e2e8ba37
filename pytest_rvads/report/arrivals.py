"""Arrivals: the order in which the subject and the other vehicles came to a junction, and the times between them."""

from __future__ import annotations

from collections import defaultdict

from pytest_rvads.report.record import Record
from pytest_rvads.wording import plural

__all__ = ["Arrivals"]

_TOGETHER = 0.5
"""Longest time between two vehicles that arrive together [s]: the tie window of the road rulebook, `TIE`."""
_NEAR = 2.0
"""Two vehicles on a shared stretch met if one reached it less than this time after the other had left it [s]."""


class Arrivals:
    """Collects a record per run with a subject, and counts the orders in which the subject and the nearest vehicle arrived."""

    def __init__(self) -> None:
        self._gaps: dict[str, list[float]] = defaultdict(list)
        """By order, the times between the arrivals of the subject and of the vehicle nearest in time [s]."""
        self._apart = 0

    def add(self, record: Record) -> None:
        """Add a record of a run, once per run."""
        subject = next((verdict.subject for verdict in record.verdicts if verdict.subject), None)
        kpis = record.kpis
        times = {one.agent: one.arrival for one in kpis.vehicles if one.arrival is not None} if kpis else {}
        if kpis is None or subject not in times:
            return
        gaps = [time - times[subject] for agent, time in times.items() if agent != subject]
        gap = min(gaps, key=abs, default=0.0)
        order = "others first" if gap < -_TOGETHER else "subject first" if gap > _TOGETHER else "simultaneous"
        self._gaps[order if gaps else "alone"].append(abs(gap))
        self._apart += bool(gaps) and (kpis.pet is None or kpis.pet >= _NEAR)

    def lines(self, junction: str) -> list[str]:
        """Return a line on the orders of arrival at a junction, with the gaps; no line if no run has a subject."""
        total = sum(map(len, self._gaps.values()))
        told: list[str] = []
        for order in ("simultaneous", "others first", "subject first", "alone"):
            if gaps := self._gaps.get(order):
                least, most = f"{min(gaps):.1f}", f"{max(gaps):.1f}"
                wide = f" (by {least if least == most else f'{least} to {most}'} s)" if order.endswith("first") else ""
                told.append(f"{len(gaps)} of {total} arrivals {order}{wide}" if not told else f"{len(gaps)} {order}{wide}")
        if self._apart:
            told.append(f"{plural(self._apart, 'run')} in which no two came within {_NEAR:g} s of each other on a shared stretch")
        return [f"{junction}: {', '.join(told)}"] if told else []
