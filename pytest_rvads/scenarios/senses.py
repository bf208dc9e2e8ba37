"""Imperfections of the senses and actions of the vehicle under test: parameters of a scenario, ideal by default."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

from pytest_rvads.support.errors import ScenarioError, suggest


@dataclass(frozen=True, slots=True)
class Senses:
    """How an autopilot sees other vehicles and pedestrians, how old the view is, and the latency of the autopilot's commands.

    The vehicle's own state, the lights and the map are known exactly. All random draws come from `seed`.

    Raises:
        ScenarioError: a number is out of range.
    """

    delay: float = 0.0
    """Age of the observed states of other vehicles [s]."""
    range: float = math.inf
    """Range of sight, from reference point to reference point [m]; vehicles farther away are not seen."""
    occlusion: bool = False
    """Whether vehicles hide road users. A hidden road user is not seen.

    A road user is hidden if vehicles cut the lines from the observer's front to the front, the centre and the rear of the road
    user.
    """
    dropout: float = 0.0
    """Share of decisions in which a visible vehicle is not seen, 0..1; drawn for each vehicle and decision."""
    position_noise: float = 0.0
    """Standard deviation of positions, along and across the way, drawn for each vehicle and decision [m]."""
    speed_noise: float = 0.0
    """Standard deviation of speeds, drawn for each vehicle and decision [m/s]."""
    latency: float = 0.0
    """Time from an observation to the effect of the command [s]."""
    jitter: float = 0.0
    """Largest addition to the latency, drawn for each decision [s]."""
    seed: int = 0
    """Seed of all random draws."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value: Any = getattr(self, item.name)
            if item.name in _KINDS:
                kind, expected = _KINDS[item.name]
                if type(value) is not kind or value < 0:
                    raise ScenarioError(f"{item.name} must be {expected}, got {value!r}")
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
                raise ScenarioError(f"{item.name} must be a number of 0 or more, got {value!r}")
            if value == math.inf and item.name != "range":
                raise ScenarioError(f"{item.name} must be finite, got {value!r}")
            object.__setattr__(self, item.name, float(value))
        if self.dropout > 1:
            raise ScenarioError(f"dropout must be a share, 0 to 1, got {self.dropout!r}")

    @classmethod
    def grid(cls, axes: Mapping[str, Any]) -> tuple[Senses, ...]:
        """Return the senses with all combinations of values; a field of the senses has a value or a list of values.

        Raises:
            ScenarioError: a field is unknown, a list is empty, or a value is out of range.
        """
        names = [item.name for item in fields(cls)]
        for name in axes:
            if name not in names:
                raise ScenarioError(f"senses have {', '.join(names)}, got {name!r}{suggest(str(name), names)}")
        lists = [value if isinstance(value, list | tuple) else [value] for value in axes.values()]
        if not all(lists):
            raise ScenarioError(f"senses are given by values or lists of at least one value, got {dict(axes)!r}")
        return tuple(cls(**dict(zip(axes, point, strict=True))) for point in product(*lists))

    @property
    def blurred(self) -> bool:
        """Whether an observation of other vehicles can be late, inexact or incomplete."""
        return Senses(latency=self.latency, jitter=self.jitter, seed=self.seed) != self

    @property
    def label(self) -> str:
        """The senses that are not ideal, as in the ids of tests: ``delay0.20.range40.00``; empty for ideal senses."""
        parts = []
        for item in fields(self):
            value = getattr(self, item.name)
            if value != item.default:
                text = "" if value is True else f"{value:05.2f}" if isinstance(value, float) else str(value)
                parts.append(f"{item.name}{text}")
        return ".".join(parts)

    def record(self) -> dict[str, Any]:
        """Return the fields of the senses that are not ideal, as builtins (such as numbers)."""
        return {item.name: value for item in fields(self) if (value := getattr(self, item.name)) != item.default}


_KINDS: dict[str, tuple[Any, str]] = {"occlusion": (bool, "True or False"), "seed": (int, "a whole number of 0 or more")}
"""The fields that are no real numbers: their type, and its name in messages."""
IDEAL = Senses()
"""Ideal senses: everything is seen at once and exactly, and commands act at once."""
