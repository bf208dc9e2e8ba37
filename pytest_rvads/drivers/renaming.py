"""Autopilots that know the vehicles by other names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pytest_rvads.drivers.interface import Command, Coordinates, Drives, Factory, Observation
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.runs.states import Agent

__all__ = ["renamed"]


def renamed(factory: Factory, names: Mapping[str, str]) -> Factory:
    """Return the same autopilot, or traffic system, to which every vehicle has another name.

    Args:
        factory: makes it.
        names: from the names of the run to those it shall see.
    """
    return _Renamed(factory, names)


class _Wrapper:
    """Stands around something and has all of its abilities; the name in messages is that of what it stands around."""

    def __init__(self, inner: Any, names: Mapping[str, str]) -> None:
        self._inner, self._names = inner, names
        self.label = name_of(inner)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # no ability; copying and unpickling ask before there is anything inside
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self._inner, name)


class _Renamed(_Wrapper):
    def __call__(self) -> Drives | Coordinates:
        made = self._inner()
        return _System(made, self._names) if callable(getattr(made, "autopilots", None)) else _Pilot(made, self._names)


class _Pilot(_Wrapper):
    def control(self, seen: Observation) -> Command:
        names = self._names
        others = tuple([other._replace(name=names[other.name]) for other in seen.others])
        command: Command = self._inner.control(seen._replace(me=seen.me._replace(name=names[seen.me.name]), others=others))
        return command


class _System(_Wrapper):
    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        known = [replace(agent, name=self._names[agent.name]) for agent in agents]
        return [_Pilot(pilot, self._names) for pilot in self._inner.autopilots(known)]
