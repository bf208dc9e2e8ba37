"""Kinds of junctions: their control, number of arms, and length of approaches."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.usability import FEWEST, MOST
from pytest_rvads.support.errors import MapError, require, suggest

__all__ = ["Kinds"]

_TYPE = re.compile(
    r"(?P<ways>\d+)-way\s+(?P<control>(all-way\s+)?stops?|(traffic\s+)?lights?|none|uncontrolled|yields?|partial)"
    r"(\s+with\s+(at\s+least\s+)?(?P<approach>\d+(\.\d+)?)\s*m(\s+of\s+approach)?)?",
    re.IGNORECASE,
)
_KEYS = ("control", "arms", "approach")


@dataclass(frozen=True, slots=True)
class Kinds:
    """A condition on junctions; properties that are not given are not restricted."""

    control: tuple[JunctionControl, ...] = ()
    """The allowed controls; empty for any control."""
    arms: tuple[int, ...] = ()
    """The allowed numbers of arms; empty for any number."""
    approach: float = 0.0
    """Least length of approaches, from the previous junction to the stopping line [m]."""

    @classmethod
    def of(cls, properties: Mapping[str, Any]) -> Kinds:
        """Return kinds from words: ``{"control": ["stop", "lights"], "arms": 4, "approach": 40}``, one value or several.

        Raises:
            MapError: a key is unknown, or a value that no junction can have is given.
        """
        require(properties, Mapping, "kinds of junctions are a dict such as {'control': 'stop', 'arms': (3, 4)}", MapError)
        for key in properties:
            if key not in _KEYS:
                hint = suggest(key, _KEYS) if isinstance(key, str) else ""
                raise MapError(f"kinds of junctions are told by {', '.join(_KEYS)}, got {key!r}{hint}")
        if not properties:
            raise MapError(f"kinds of junctions are empty: tell them by {', '.join(_KEYS)}, or leave them out")
        controls, approach = tuple(JunctionControl), properties.get("approach", 0.0)
        control = _values_of("control", properties, controls, f"one or several of {', '.join(controls)}")
        arms = _values_of("arms", properties, range(FEWEST, MOST + 1), f"numbers from {FEWEST} to {MOST}, one or several")
        if isinstance(approach, bool) or not isinstance(approach, int | float) or not 0 <= approach < math.inf:
            raise MapError(f"approach of kinds of junctions must be a length in metres, 0 or more, got {approach!r}")
        return cls(tuple(map(JunctionControl, control)), tuple(map(int, arms)), float(approach))

    @classmethod
    def parse(cls, text: str) -> Kinds | None:
        """Return the kind of a type such as "4-way all-way stop with 40 m of approach"; None if the text is no type."""
        match = _TYPE.fullmatch(text.strip())
        if match is None:
            return None
        control_text = match["control"].lower()
        control = next((kind for kind in JunctionControl if kind.value.removesuffix("s") in control_text), JunctionControl.NONE)
        return cls((control,), (int(match["ways"]),), float(match["approach"] or 0.0))

    def match(self, report: JunctionReport) -> bool:
        """Return whether a junction, usable or not, has the control and the arms; a junction without entrances has no control."""
        if self.arms and report.ways not in self.arms:
            return False
        return not self.control or (bool(report.entrances) and report.control in self.control)

    def fit(self, report: JunctionReport) -> bool:
        """Return whether a junction is usable and of these kinds, and its approaches are long enough."""
        return report.usable and self.match(report) and report.usable_from >= self.approach

    def __str__(self) -> str:
        parts = [" or ".join(self.control)] if self.control else []
        parts += [f"{' or '.join(map(str, self.arms))} arms"] if self.arms else []
        return ", ".join([*parts, *([f"{self.approach:g} m of approach"] if self.approach else [])])


def _values_of(key: str, properties: Mapping[str, Any], allowed: Iterable[Any], expected: str) -> tuple[Any, ...]:
    """Return the values under a key as a tuple; empty if the key is missing."""
    if key not in properties:
        return ()
    value, allowed = properties[key], tuple(allowed)
    values = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
    if not values or any(isinstance(item, bool) or item not in allowed for item in values):
        raise MapError(f"{key} of kinds of junctions must be {expected}, got {value!r}")
    return values
