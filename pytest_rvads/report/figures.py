"""Figures of a session, a line each: who drove and what simulated, how near, how hard, how long, and how slow."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

from pytest_rvads.report.record import Computing, Record

__all__ = ["extremes", "makers", "slowest", "timing"]

_Pick = Callable[..., Any]
_LINES: tuple[tuple[str, tuple[tuple[str, str, _Pick, str], ...]], ...] = (
    ("nearest", (("time to collision", "ttc", min, "s"), ("post-encroachment time", "pet", min, "s"))),
    ("most", (("braking", "deceleration", max, "m/s^2"), ("waiting", "waiting", max, "s"), ("delay", "delay", max, "s"))),
)
"""Per line its first word, and per indicator what it is called, its name in the record, which one counts, its unit."""


def makers(records: Sequence[Record]) -> list[str]:
    """Return a line per system under test, and one per simulator: what it is called, and how many runs it made."""
    runs: dict[str, set[str]] = {}
    for what, names in (("driven", [r.driver for r in records]), ("simulated", [r.simulator for r in records])):
        for name, record in zip(names, records, strict=True):
            if name:
                runs.setdefault(f"{what} by {name}", set()).add(record.hash or record.nodeid)
    return [f"{made}: {len(found)} run{'' if len(found) == 1 else 's'}" for made, found in runs.items()]


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


def _extreme(records: Sequence[Record], name: str, key: str, pick: _Pick, unit: str) -> str:
    found = [entry for record in records for entry in _measured(record, key)]
    if not found:
        return ""
    most, who = pick(found, key=itemgetter(0))
    return f"{name} {most:.2f} {unit} ({who})"


def _measured(record: Record, key: str) -> Iterator[tuple[float, str]]:
    """Yield the values of an indicator in a run, and whose they are."""
    entries = [(pair, " and ".join(pair.agents)) for pair in record.kpis.pairs] if record.kpis else []
    vehicles = [(vehicle, vehicle.agent) for vehicle in record.kpis.vehicles] if record.kpis else []
    for entry, who in (*entries, *vehicles):
        value = getattr(entry, key, None)
        if value is not None:
            yield value, f"{who} in {record.test}[{record.run}]"


def timing(records: Sequence[Record]) -> list[str]:
    """Return a line per stack in another process: in how many runs it made how many decisions, and how long they took.

    That is real time, which no verdict depends on.
    """
    runs = {(record.run, record.traffic, record.hash): record.timing for record in records if record.timing}
    stacks: dict[str, list[Computing]] = {}
    for vehicles in runs.values():
        for one in vehicles.values():
            stacks.setdefault(one.stack, []).append(one)
    return [_line(stack, found) for stack, found in stacks.items()]


def _line(stack: str, found: Sequence[Computing]) -> str:
    count = sum(one.decisions for one in found)
    mean = math.fsum(one.compute for one in found) / max(count, 1)
    longest = max(one.longest for one in found)
    return f"{stack}: {count} decisions in {len(found)} runs, {1000 * mean:.2g} ms each, {1000 * longest:.2g} ms the longest"


def slowest(seconds: Mapping[str, float], most: int, least: float = 0.0) -> list[str]:
    """Return a line on the runs that took longest.

    Args:
        seconds: run to how long it took [s].
        most: runs named.
        least: there is no such line where none took as long [s].
    """
    ranked = sorted(seconds.items(), key=lambda entry: -entry[1])[:most]
    if not ranked or ranked[0][1] < least:
        return []
    return ["slowest: " + ", ".join(f"{taken:.1f} s {run}" for run, taken in ranked)]
