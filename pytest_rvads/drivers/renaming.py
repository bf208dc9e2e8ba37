"""Autopilots that know the vehicles by other names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.runs.states import Agent

__all__ = ["renamed"]


def renamed(factory: Callable[[], Any], names: Mapping[str, str]) -> Callable[[], Any]:
    """Return the same autopilot, or traffic system, to which every vehicle has another name.

    Args:
        factory: makes it.
        names: from the names of the run to those it shall see.
    """

    def make() -> Any:
        made = factory()
        return _System(made, names) if callable(getattr(made, "autopilots", None)) else _Pilot(made, names)

    return make


class _Pilot:
    def __init__(self, inner: Any, names: Mapping[str, str]) -> None:
        self._inner = inner
        self._names = names
        if hasattr(inner, "period"):
            self.period = inner.period

    def control(self, seen: Observation) -> Any:
        names = self._names
        others = tuple([other._replace(name=names[other.name]) for other in seen.others])
        return self._inner.control(seen._replace(me=seen.me._replace(name=names[seen.me.name]), others=others))


class _System:
    def __init__(self, inner: Any, names: Mapping[str, str]) -> None:
        self._inner = inner
        self._names = names

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[_Pilot]:
        known = [replace(agent, name=self._names[agent.name]) for agent in agents]
        return [_Pilot(pilot, self._names) for pilot in self._inner.autopilots(known)]
