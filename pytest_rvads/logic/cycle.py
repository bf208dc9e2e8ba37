"""Obligations that contradict each other: four vehicles that each wait for the one on their right."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pytest_rvads.logic.boolean import evaluate
from pytest_rvads.logic.evaluate import Values
from pytest_rvads.logic.finite import settle
from pytest_rvads.logic.prepare import Template
from pytest_rvads.logic.shape import Kind, agents_of

__all__ = ["Cycle", "find_cycle"]


@dataclass(frozen=True, slots=True)
class Cycle:
    """Vehicles each of which had to wait for the next one, the last for the first."""

    tick: int
    """From this tick on."""
    agents: tuple[str, ...]
    alone: bool = True
    """True when the obligations of one rule suffice, False when those of its companions are part of it."""


def find_cycle(templates: Iterable[Template], values: Values) -> Cycle | None:
    """Find the earliest cycle of vehicles that all wait for each other, among instances of the form YIELD.

    Within it every vehicle must stay until another one has entered, so no continuation satisfies all of them.
    """
    spans: list[tuple[int, int, str, str]] = []
    steps = values.run.steps
    for t in templates:
        shape = t.shape
        if shape.kind is not Kind.YIELD or shape.premise is None or shape.waits is None or shape.goes is None:
            continue
        ones, twos = agents_of(shape.waits), agents_of(shape.goes)
        held = settle(shape.premise, values, steps)
        if len(ones) != 1 or len(twos) != 1 or not held.any():
            continue
        start = int(np.argmax(held))
        over = evaluate(shape.goes, values, (steps,)) | ~evaluate(shape.waits, values, (steps,))
        ends = np.flatnonzero(over[start:])
        spans.append((start, start + int(ends[0]) if len(ends) else steps, ones[0].name, twos[0].name))
    for tick in sorted({s[0] for s in spans}):
        waits: dict[str, list[str]] = {}
        for start, end, one, two in spans:
            if start <= tick < end:
                waits.setdefault(one, []).append(two)
        for first in sorted(waits):
            found = _around(first, first, waits, ())
            if found:
                return Cycle(tick, found)
    return None


def _around(here: str, goal: str, waits: Mapping[str, list[str]], path: tuple[str, ...]) -> tuple[str, ...] | None:
    path = (*path, here)
    for target in sorted(waits.get(here, ())):
        if target == goal:
            return path
        if target not in path and (found := _around(target, goal, waits, path)):
            return found
    return None
