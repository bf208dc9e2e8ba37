"""What the JSON header of a kept run must look like, and the check that it does."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["check_header"]


@dataclass(frozen=True, slots=True)
class _Maybe:
    """The shape of something that may be null or missing."""

    shape: Any


_SEGMENT = (int, str, str, _Maybe(str))
_GEOMETRY = {
    "approaches": [_SEGMENT],
    "movements": [(int, int, *_SEGMENT)],
    "exits": [_SEGMENT],
    "lane_width": float,
}
_JUNCTION = {
    "name": str,
    "id": str,
    "control": str,
    "movements": [(int, int, str, float, _Maybe(str))],
    "right_of": [(int, int)],
    "opposite": [(int, int)],
    "phase_groups": [[int]],
    "setbacks": [float],
    "left_hand": bool,
    "geometry": _Maybe(_GEOMETRY),
}
_HEADER = {
    "label": str,
    "dt": float,
    "agents": [(str, int, int, str)],
    "junction": _JUNCTION,
    "collisions": _Maybe([(float, str, str, float)]),
    "fault": _Maybe((float, str, str)),
    "facts": {"subject": _Maybe(str), "sizes": _Maybe([(float, float)]), "speed_limit": _Maybe(float), "strayed": _Maybe([str])},
    "meta": {},
}
"""A type; a list of any length in brackets, of this length in parentheses; an object with at least these keys."""
_WORDS = {str: "a text", int: "a whole number", float: "a finite number", bool: "true or false"}


def check_header(header: Mapping[str, Any]) -> None:
    """Check the shape of a header.

    Raises:
        ValueError: it has another shape; the message names the field and what was expected.
    """
    _check(header, _HEADER, "header")
    junction = header["junction"]
    ways = len({m[0] for m in junction["movements"]})
    if len(junction["setbacks"]) != ways or any(not 0 <= e < ways for g in junction["phase_groups"] for e in g):
        raise ValueError(f"setbacks and phase_groups must be about the {ways} entrances of the junction")
    geometry = junction["geometry"]
    if geometry and {tuple(m[:2]) for m in geometry["movements"]} != {tuple(m[:2]) for m in junction["movements"]}:
        raise ValueError("geometry must have one line per movement of the junction")
    if geometry and not len(geometry["approaches"]) == len(geometry["exits"]) == ways:
        raise ValueError(f"geometry must have one line per approach and exit of the {ways} ways")
    facts = header["facts"]
    if facts.get("sizes") is not None and len(facts["sizes"]) != len(header["agents"]):
        raise ValueError(f"sizes must hold one for each of {len(header['agents'])} vehicles, got {len(facts['sizes'])}")
    for name, value in (
        ("speed_limit", facts.get("speed_limit")),
        *(("sizes", v) for size in facts.get("sizes") or () for v in size),
    ):
        if value is not None and value <= 0:
            raise ValueError(f"{name} in facts must be positive, got {value}")
    if facts.get("subject") is not None and facts["subject"] not in [agent[0] for agent in header["agents"]]:
        raise ValueError(f"subject in facts must be one of the vehicles, got {facts['subject']!r}")


def _check(value: object, shape: Any, where: str) -> None:
    if isinstance(shape, _Maybe):
        if value is not None:
            _check(value, shape.shape, where)
    elif isinstance(shape, dict):
        if not isinstance(value, dict):
            raise ValueError(f"{where} must be an object, got {type(value).__name__}")
        for key, inner in shape.items():
            if key not in value and not isinstance(inner, _Maybe):
                raise ValueError(f"{key!r} is missing")
            _check(value.get(key), inner, key)
    elif isinstance(shape, list | tuple):
        if not isinstance(value, list) or (isinstance(shape, tuple) and len(value) != len(shape)):
            raise ValueError(
                f"{where} must be a list{f' of {len(shape)}' if isinstance(shape, tuple) else ''}, got {value!r:.60}"
            )
        for entry, inner in zip(value, shape if isinstance(shape, tuple) else shape * len(value), strict=True):
            _check(entry, inner, where)
    elif not _is(value, shape):
        raise ValueError(f"{where} must be {_WORDS[shape]}, got {value!r:.60}")


def _is(value: object, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return type(value) is kind
