"""The extremes of a session's key performance indicators: how near, how hard, how long, and in whose run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from pytest_rvads.report.record import Record

__all__ = ["extremes"]

_Pick = Callable[[Iterable[float]], float]
_LINES: tuple[tuple[str, tuple[tuple[str, str, str, _Pick, str], ...]], ...] = (
    (
        "nearest",
        (("time to collision", "pairs", "ttc", min, "s"), ("post-encroachment time", "pairs", "pet", min, "s")),
    ),
    (
        "most",
        (
            ("braking", "vehicles", "deceleration", max, "m/s^2"),
            ("waiting", "vehicles", "waiting", max, "s"),
            ("delay", "vehicles", "delay", max, "s"),
        ),
    ),
)
"""Per line its first word, and per indicator what it is called, where the record has it, which one counts, its unit."""


def extremes(records: Sequence[Record]) -> list[str]:
    """Return at most two lines: the nearest encounters, and the hardest braking, longest wait and longest delay.

    What no run records is left out. Of equal values the first one is named.
    """
    lines = []
    for word, indicators in _LINES:
        shown = [text for indicator in indicators if (text := _extreme(records, *indicator))]
        if shown:
            lines.append(f"{word}: {', '.join(shown)}")
    return lines


def _extreme(records: Sequence[Record], name: str, kind: str, key: str, pick: _Pick, unit: str) -> str:
    found = [
        (entry[key], entry, record)
        for record in records
        for entry in record.get("kpis", {}).get(kind, ())
        if entry[key] is not None
    ]
    if not found:
        return ""
    most = pick(value for value, _, _ in found)
    _, entry, record = next(f for f in found if f[0] == most)
    who = " and ".join(entry.get("agents") or [entry["agent"]])
    return f"{name} {most:.2f} {unit} ({who} in {record['test']}[{record['run']}])"
