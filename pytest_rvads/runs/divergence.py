"""The divergence of two runs: the first state and the first field in which the runs differ, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.measured import Divergence
from pytest_rvads.runs.run import ARRAYS, Run
from pytest_rvads.runs.states import Colour, Zone


def diverge(one: Run, other: Run) -> Divergence | None:
    """Return the first difference between two runs; None if the runs have the same hash.

    The comparison begins with the properties of the runs (label, time step, vehicles, facts, junction), goes on with the states
    in order of time, and ends with length, fault and collisions.
    """
    properties: dict[str, tuple[object, ...]] = {
        "label": (one.label, other.label),
        "step": (one.dt, other.dt),
        "vehicles": tuple(" ".join(f"{a.name}:{a.entrance}->{a.exit}" for a in run.agents) for run in (one, other)),
        "facts": (one.facts, other.facts),
        "junction": (one.junction.digest[:12], other.junction.digest[:12]),
    }
    for what, (a, b) in properties.items():
        if a != b:
            return Divergence(what, str(a), str(b))
    states = [d for field in ARRAYS if (d := _first_difference(one, other, field))]
    if states:
        return min(states, key=lambda d: -1 if d.tick is None else d.tick)
    ending: dict[str, tuple[object, ...]] = {
        "length": (one.steps, other.steps),
        "fault": (one.fault, other.fault),
        "collisions": (one.collisions, other.collisions),
    }
    for what, (a, b) in ending.items():
        if a != b:
            return Divergence(what, str(a), str(b))
    return None


_PARTS = {"pose": ("x", "y", "heading"), "controls": ("throttle", "brake", "steering")}
_ENUMS = {"zone": Zone, "lights": Colour}


def _first_difference(one: Run, other: Run, field: str) -> Divergence | None:
    a: NDArray[Any] | None = getattr(one, field)
    b: NDArray[Any] | None = getattr(other, field)
    if a is None or b is None:
        own, others = ("not recorded" if values is None else "recorded" for values in (a, b))
        return None if a is b else Divergence(field, own, others)
    parts = (np.ascontiguousarray(values[: min(len(a), len(b))]) for values in (a, b))
    # Floats are compared as integers, which are equal where the floats are the same bit for bit, NaN included.
    bits, other_bits = (values.view(np.int64) if values.dtype == np.float64 else values for values in parts)
    differs = bits != other_bits
    if not differs.any():
        return None
    tick, column, *part = (int(i) for i in np.argwhere(differs)[0])
    name = _PARTS[field][part[0]] if part else field
    where = f"light of entrance {column}" if field == "lights" else f"{name} of {one.agents[column].name}"
    differing, kind = [values[(tick, column, *part)] for values in (a, b)], _ENUMS.get(field)
    own, others = (kind(int(value)).name.lower() if kind else repr(float(value)) for value in differing)
    return Divergence(where, own, others, tick, round(tick * one.dt, 9))
